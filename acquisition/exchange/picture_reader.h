// Pictures of one camera one after the other: an image folder, or a video file.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/result.h"

namespace gnathion {

/// Grey, 8 bits, all of one size: anything else is refused by its file's or frame's name.
class PictureReader {
 public:
  virtual ~PictureReader() = default;
  virtual Result<std::optional<Image8>> next() = 0;
  virtual std::size_t expected() const = 0;               ///< as far as it is known
  virtual std::optional<double> own_rate_hz() const = 0;  ///< a video's
  virtual std::vector<std::string> notes() const = 0;

  static Result<std::unique_ptr<PictureReader>> open(const std::filesystem::path& path);
};

}  // namespace gnathion
