// Writes PLUS sequences.
#include <fmt/format.h>
#include <unistd.h>
#include <zlib.h>

#include <cerrno>
#include <cstring>
#include <fstream>

#include "acquisition/exchange/plus_sequence.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot write sequence";
using ImageOf = std::function<Result<std::optional<Image8>>(std::size_t)>;

bool is_nrrd(const fs::path& path) {
  return path.extension() == ".nrrd";
}

std::string one_line(std::string text) {
  for (char& c : text)
    if (c == '\n' || c == '\r') c = ' ';
  return text;
}

std::string matrix_text(const Matrix4& m) {
  std::string text;
  for (int i = 0; i < 16; ++i) text += fmt::format("{}{}", i ? " " : "", m(i / 4, i % 4) + 0.0);
  return text;
}

/// "Seq_Frame0000_Name = value" lines of every frame; `between` is " = " or ":=".
std::string frame_lines(const PlusSequence& s, const std::string& between) {
  std::string text;
  for (std::size_t i = 0; i < s.frames.size(); ++i) {
    const PlusFrame& f = s.frames[i];
    const std::string prefix = fmt::format("Seq_Frame{:04}_", i);
    const auto line = [&](const std::string& key, const std::string& value) {
      text += prefix + key + between + one_line(value) + "\n";
    };
    for (const auto& [name, t] : f.transforms) {
      line(name + "Transform", matrix_text(t.matrix));
      line(name + "TransformStatus", t.status.empty() ? (t.valid ? "OK" : "INVALID") : t.status);
    }
    if (f.number) line("FrameNumber", std::to_string(*f.number));
    if (f.timestamp_ns) line("Timestamp", decimal_seconds(*f.timestamp_ns));
    if (f.unfiltered_timestamp_ns) line("UnfilteredTimestamp", decimal_seconds(*f.unfiltered_timestamp_ns));
    for (const auto& [key, value] : f.fields) line(key, value);
    line("ImageStatus", f.has_image && s.width_px > 0 ? "OK" : "INVALID");
  }
  return text;
}

std::string meta_header(const PlusSequence& s, bool compressed, std::uint64_t data_bytes) {
  const bool images = s.width_px > 0;
  std::string text =
      "ObjectType = Image\nNDims = 3\nAnatomicalOrientation = RAI\nBinaryData = True\n"
      "BinaryDataByteOrderMSB = False\nCenterOfRotation = 0 0 0\n";
  text += fmt::format("CompressedData = {}\n", compressed ? "True" : "False");
  if (compressed) text += fmt::format("CompressedDataSize = {}\n", data_bytes);
  text += fmt::format("DimSize = {} {} {}\n", s.width_px, s.height_px, s.frames.size());
  text +=
      "Kinds = domain domain list\nElementNumberOfChannels = 1\nElementSpacing = 1 1 1\n"
      "ElementType = MET_UCHAR\nOffset = 0 0 0\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n";
  text += fmt::format("UltrasoundImageOrientation = {}\nUltrasoundImageType = {}\n", images ? "MF" : "XX",
                      images ? "BRIGHTNESS" : "XX");
  for (const auto& [key, value] : s.fields) text += key + " = " + one_line(value) + "\n";
  return text + frame_lines(s, " = ") + "ElementDataFile = LOCAL\n";
}

/// NRRD knows no image without pixels: where there are none, each frame has one pixel that is not valid.
std::string nrrd_header(const PlusSequence& s, bool compressed) {
  const bool images = s.width_px > 0;
  std::string text =
      "NRRD0004\n# Complete NRRD file format specification at:\n"
      "# http://teem.sourceforge.net/nrrd/format.html\ntype: uint8\ndimension: 3\nspace dimension: 2\n";
  text +=
      fmt::format("sizes: {} {} {}\n", images ? s.width_px : 1, images ? s.height_px : 1, s.frames.size());
  text += "space directions: (1,0) (0,1) none\nkinds: domain domain list\nendian: little\n";
  text += fmt::format("encoding: {}\nspace origin: (0,0)\n", compressed ? "gzip" : "raw");
  text += fmt::format("ultrasound image orientation:={}\nultrasound image type:={}\n", images ? "MF" : "XX",
                      images ? "BRIGHTNESS" : "XX");
  for (const auto& [key, value] : s.fields) text += key + ":=" + one_line(value) + "\n";
  return text + frame_lines(s, ":=") + "\n";
}

/// Bytes to a file, compressed on the way or not.
class DataSink {
 public:
  DataSink(std::ostream& out, bool compressed, bool gzip) : out_(out), compressed_(compressed) {
    constexpr int kWindow = 15, kGzip = 16, kMemory = 8, kLevel = 6;
    if (compressed_)
      good_ = ::deflateInit2(&zip_, kLevel, Z_DEFLATED, kWindow + (gzip ? kGzip : 0), kMemory,
                             Z_DEFAULT_STRATEGY) == Z_OK;
  }
  ~DataSink() {
    if (compressed_) ::deflateEnd(&zip_);
  }
  DataSink(const DataSink&) = delete;
  DataSink& operator=(const DataSink&) = delete;
  void write(const std::uint8_t* bytes, std::size_t n) { put(bytes, n, Z_NO_FLUSH); }
  bool finish() {
    if (compressed_) put(nullptr, 0, Z_FINISH);
    return good_ && out_.good();
  }

 private:
  void put(const std::uint8_t* bytes, std::size_t n, int flush) {
    if (!compressed_) {
      out_.write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(n));
      return;
    }
    zip_.next_in = const_cast<Bytef*>(bytes);
    zip_.avail_in = static_cast<uInt>(n);
    do {
      char block[1 << 16];
      zip_.next_out = reinterpret_cast<Bytef*>(block);
      zip_.avail_out = sizeof block;
      if (::deflate(&zip_, flush) == Z_STREAM_ERROR) good_ = false;
      out_.write(block, static_cast<std::streamsize>(sizeof block - zip_.avail_out));
    } while (good_ && zip_.avail_out == 0);
  }
  std::ostream& out_;
  bool compressed_, good_ = true;
  z_stream zip_{};
};

Status write_pixels(DataSink& sink, const PlusSequence& s, const ImageOf& image, bool nrrd,
                    const std::string& where) {
  if (s.width_px == 0) {
    const std::vector<std::uint8_t> zeros(nrrd ? s.frames.size() : 0);
    sink.write(zeros.data(), zeros.size());
    return {};
  }
  const Image8 blank(s.width_px, s.height_px);
  for (std::size_t i = 0; i < s.frames.size(); ++i) {
    GNATHION_TRY(const std::optional<Image8> picture, image(i));
    if (picture && (picture->width_px != s.width_px || picture->height_px != s.height_px))
      return bad_input(kWhat, where,
                       fmt::format("image {} has {}×{} pixels, the first {}×{}", i, picture->width_px,
                                   picture->height_px, s.width_px, s.height_px));
    const auto& pixels = picture ? picture->pixels : blank.pixels;
    sink.write(pixels.data(), pixels.size());
  }
  return {};
}

/// Removes the unfinished files, whatever happened.
struct Parts {
  fs::path whole, data;
  ~Parts() {
    std::error_code ec;
    fs::remove(whole, ec);
    fs::remove(data, ec);
  }
};

}  // namespace

Status write_plus_sequence(const fs::path& path, const PlusSequence& s, const ImageOf& image,
                           const PlusWriteOptions& options) {
  if (s.frames.empty()) return bad_input(kWhat, path.string(), "has no frames");
  if (s.pixel != PlusPixel::kUint8 || s.channels != 1)
    return bad_input(kWhat, path.string(), "only 8-bit grey images are written");
  const bool nrrd = is_nrrd(path);
  if (!nrrd && path.extension() != ".mha")
    return fail(ErrorCode::kUsage, kWhat, path.string(), "ends neither in .igs.mha nor in .igs.nrrd");
  const auto failed = [&] {
    return fail(ErrorCode::kInternal, kWhat, path.string(), std::strerror(errno ? errno : EIO));
  };
  const bool compressed = options.compressed && (nrrd || s.width_px > 0);
  const std::string stem = fmt::format(".{}.part.{}", path.filename().string(), ::getpid());
  const Parts parts{path.parent_path() / stem, path.parent_path() / (stem + ".data")};
  {  // The data first: a MetaImage's header holds its compressed size.
    std::ofstream data(parts.data, std::ios::binary);
    if (!data) return failed();
    DataSink sink(data, compressed, nrrd);
    GNATHION_CHECK_OK(write_pixels(sink, s, image, nrrd, path.string()));
    if (!sink.finish() || !data.flush()) return failed();
  }
  std::error_code ec;
  const std::uint64_t data_bytes = fs::file_size(parts.data, ec);
  std::ofstream out(parts.whole, std::ios::binary);
  const std::string header = nrrd ? nrrd_header(s, compressed) : meta_header(s, compressed, data_bytes);
  out.write(header.data(), static_cast<std::streamsize>(header.size()));
  if (data_bytes > 0) out << std::ifstream(parts.data, std::ios::binary).rdbuf();
  out.close();
  if (!out) return failed();
  fs::rename(parts.whole, path, ec);
  if (ec) return fail(ErrorCode::kInternal, kWhat, path.string(), ec.message());
  return {};
}

}  // namespace gnathion
