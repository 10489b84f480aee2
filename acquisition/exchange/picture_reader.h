// Pictures of one camera one after the other: an image folder, or a video file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/result.h"

namespace gnathion {

struct Picture {
  std::uint32_t number = 0;  ///< rising from 0; what it leaves out is missing
  Image8 image;
};

/// Grey, 8 bits, all of one size: anything else is refused by its file's or frame's name.
class PictureReader {
 public:
  virtual ~PictureReader() = default;
  virtual Result<std::optional<Picture>> next() = 0;
  /// Pictures that there should be, those left out included, as far as it is known; else 0.
  virtual std::size_t expected() const = 0;
  virtual std::optional<double> own_rate_hz() const = 0;  ///< a video's
  virtual std::vector<std::string> notes() const = 0;

  static Result<std::unique_ptr<PictureReader>> open(const std::filesystem::path& path);
};

}  // namespace gnathion
