// Sequence files of the PLUS toolkit: tracker poses and images over time, .igs.mha (MetaImage; .mhd with its
// data beside it) and .igs.nrrd. docs/exchange.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/image.h"
#include "core/result.h"
#include "core/rigid.h"

namespace gnathion {

/// "StylusToTrackerTransform" of one frame: maps points of Stylus to Tracker, mm.
struct PlusTransform {
  Matrix4 matrix = Matrix4::Identity();  ///< as it stands in the file; not every one is rigid
  bool valid = true;                     ///< its ...Status is OK, or it has none
  std::string status;                    ///< as it stands: "OK", "INVALID", "OUT_OF_VIEW"
};

struct PlusFrame {
  std::optional<std::int64_t> timestamp_ns, unfiltered_timestamp_ns;
  std::optional<std::uint32_t> number;              ///< FrameNumber
  bool has_image = true;                            ///< ImageStatus is not INVALID and the file has pixels
  std::map<std::string, PlusTransform> transforms;  ///< by name without the final "Transform"
  std::map<std::string, std::string> fields;        ///< every other field of the frame
};

enum class PlusPixel : std::uint8_t {
  kUint8,
  kInt8,
  kUint16,
  kInt16,
  kUint32,
  kInt32,
  kFloat,
  kDouble,
  kOther
};

/// All but the pixels.
struct PlusSequence {
  int width_px = 0, height_px = 0;  ///< 0: no images
  int channels = 1;
  PlusPixel pixel = PlusPixel::kUint8;
  std::vector<PlusFrame> frames;
  std::map<std::string, std::string> fields;  ///< of the file: "UltrasoundImageOrientation", ...
};

/// Where and how the pixels are kept.
struct PlusData {
  std::uint64_t offset = 0;  ///< in the file that holds them
  std::string file;          ///< empty: behind the header
  bool compressed = false;   ///< zlib (MetaImage) or gzip (NRRD)
  bool big_endian = false;
};

/// Decodes the header of either kind at the start of `bytes`; `name` stands in errors. Refuses sizes that
/// cannot be, numbers that are none, frames beyond those announced.
struct PlusHeader {
  PlusSequence sequence;
  PlusData data;
};
Result<PlusHeader> parse_plus_header(std::string_view bytes, const std::string& name);

/// Reads a sequence: its header at once, its images one by one in file order, memory of one image.
class PlusReader {
 public:
  static Result<PlusReader> open(const std::filesystem::path& path);
  /// The same from memory; a file that keeps its data beside it is refused.
  static Result<PlusReader> parse(std::string bytes, const std::string& name);
  PlusReader(PlusReader&&) noexcept;
  ~PlusReader();
  const PlusSequence& sequence() const;
  /// The pixels of the next frame as they stand, channels interleaved, in the machine's byte order. Each
  /// frame has its block, also one without a valid image.
  Result<std::string> next_pixels();

 private:
  struct State;
  explicit PlusReader(std::unique_ptr<State> state);
  static Result<PlusReader> with_data(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

struct PlusWriteOptions {
  bool compressed = false;
};
/// Writes `sequence` whole or not at all; the kind by extension (.mha or .nrrd). `image(i)` gives frame i's
/// 8-bit grey image, or nothing; it is called once for each frame, in order, where the sequence has a size.
Status write_plus_sequence(const std::filesystem::path& path, const PlusSequence& sequence,
                           const std::function<Result<std::optional<Image8>>(std::size_t)>& image,
                           const PlusWriteOptions& options);

/// Nanoseconds as decimal seconds without loss: 1500000000 is "1.500000000". The other way any decimal number
/// is read, rounded to ns; nothing for what is none or does not fit.
std::string decimal_seconds(std::int64_t ns);
std::optional<std::int64_t> ns_from_decimal(std::string_view text);

}  // namespace gnathion
