// The header of a PLUS sequence: MetaImage ("Key = value" lines up to ElementDataFile) or NRRD ("field:
// value" and "key:=value" lines up to an empty one).
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "acquisition/exchange/plus_sequence.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot read sequence";
constexpr std::uint64_t kMostFramesWithoutFields = 100'000;
constexpr std::uint64_t kLargestSide_px = 65535;

std::string_view trimmed(std::string_view s) {
  constexpr const char* kBlank = " \t\r\n";
  const std::size_t begin = s.find_first_not_of(kBlank);
  if (begin == std::string_view::npos) return {};
  return s.substr(begin, s.find_last_not_of(kBlank) - begin + 1);
}

std::vector<std::string_view> words(std::string_view s) {
  std::vector<std::string_view> out;
  while (!(s = trimmed(s)).empty()) {
    const std::size_t end = std::min(s.find_first_of(" \t"), s.size());
    out.push_back(s.substr(0, end));
    s.remove_prefix(end);
  }
  return out;
}

template <class T>
std::optional<T> number(std::string_view s) {
  if (!s.empty() && s.front() == '+') s.remove_prefix(1);
  T value{};
  const auto [end, error] = std::from_chars(s.data(), s.data() + s.size(), value);
  if (error != std::errc() || end != s.data() + s.size() || s.empty()) return std::nullopt;
  return value;
}

bool ends_with(std::string_view s, std::string_view end) {
  return s.size() >= end.size() && s.substr(s.size() - end.size()) == end;
}

bool says_yes(std::string_view value) {
  return value == "True" || value == "true" || value == "1";
}

struct PixelName {
  PlusPixel pixel;
  std::array<const char*, 5> names;  ///< in MetaImage, then in NRRD
};
constexpr std::array<PixelName, 8> kPixels = {{
    {PlusPixel::kUint8, {"MET_UCHAR", "uint8", "uchar", "unsigned char", "uint8_t"}},
    {PlusPixel::kInt8, {"MET_CHAR", "int8", "signed char", "int8_t", "char"}},
    {PlusPixel::kUint16, {"MET_USHORT", "uint16", "ushort", "unsigned short", "uint16_t"}},
    {PlusPixel::kInt16, {"MET_SHORT", "int16", "short", "signed short", "int16_t"}},
    {PlusPixel::kUint32, {"MET_UINT", "uint32", "uint", "unsigned int", "uint32_t"}},
    {PlusPixel::kInt32, {"MET_INT", "int32", "int", "signed int", "int32_t"}},
    {PlusPixel::kFloat, {"MET_FLOAT", "float", "float", "float", "float"}},
    {PlusPixel::kDouble, {"MET_DOUBLE", "double", "double", "double", "double"}},
}};
PlusPixel pixel_named(std::string_view name) {
  for (const PixelName& p : kPixels)
    if (std::find(p.names.begin(), p.names.end(), name) != p.names.end()) return p.pixel;
  return PlusPixel::kOther;
}

/// Collects fields in any order, then makes a sequence of them.
class HeaderBuilder {
 public:
  explicit HeaderBuilder(std::string name) : name_(std::move(name)) {}

  Status take_meta(std::string_view key, std::string_view value);
  Status take_nrrd(std::string_view field, std::string_view value);
  Status take_key(std::string_view key, std::string_view value);
  Result<PlusHeader> finish(std::uint64_t header_bytes);

  std::size_t line = 0;  ///< for messages

 private:
  struct Matrix {
    std::optional<Matrix4> matrix;
    std::optional<std::string> status;
  };
  struct Frame {
    PlusFrame frame;
    std::map<std::string, Matrix> transforms;
  };

  tl::unexpected<Error> refuse(std::string why) const { return bad_input(kWhat, name_, std::move(why)); }
  tl::unexpected<Error> refuse_line(std::string_view key, const std::string& why) const {
    return refuse(fmt::format("line {}: {} {}", line, key.substr(0, 80), why));
  }
  Status take_sizes(std::string_view key, std::string_view value);
  Status take_frame_field(Frame& frame, std::string_view key, std::string_view value);
  Status set_dimensions();

  std::string name_;
  PlusHeader out_;
  std::vector<std::uint64_t> sizes_;
  std::vector<std::string> kinds_;
  std::string type_;
  bool nrrd_ = false;
  std::map<std::uint32_t, Frame> frames_;
  std::uint64_t frame_count_ = 0;
};

Status HeaderBuilder::take_sizes(std::string_view key, std::string_view value) {
  sizes_.clear();
  for (const std::string_view word : words(value)) {
    const auto size = number<std::uint64_t>(word);
    if (!size || sizes_.size() == 5) return refuse_line(key, "is not a list of sizes");
    sizes_.push_back(*size);
  }
  return {};
}

/// "Seq_Frame0012_StylusToTrackerTransform" belongs to a frame; all else to the file.
Status HeaderBuilder::take_key(std::string_view key, std::string_view value) {
  constexpr std::string_view kPrefix = "Seq_Frame";
  if (key.substr(0, kPrefix.size()) == kPrefix) {
    const std::size_t end = key.find('_', kPrefix.size());
    if (end == std::string_view::npos) return refuse_line(key, "names no field");
    const auto index = number<std::uint32_t>(key.substr(kPrefix.size(), end - kPrefix.size()));
    if (!index) return refuse_line(key, "names no frame");
    return take_frame_field(frames_[*index], key.substr(end + 1), value);
  }
  out_.sequence.fields[std::string(key)] = std::string(value);
  return {};
}

Status HeaderBuilder::take_frame_field(Frame& f, std::string_view key, std::string_view value) {
  constexpr std::string_view kTransform = "Transform", kStatus = "TransformStatus";
  if (ends_with(key, kStatus)) {
    f.transforms[std::string(key.substr(0, key.size() - kStatus.size()))].status = std::string(value);
  } else if (ends_with(key, kTransform)) {
    const auto numbers = words(value);
    if (numbers.size() != 16)
      return refuse_line(key, fmt::format("has {} numbers; a transform has 16", numbers.size()));
    Matrix4 m;
    for (int i = 0; i < 16; ++i) {
      const auto x = number<double>(numbers[static_cast<std::size_t>(i)]);
      if (!x) return refuse_line(key, "is no transform");
      m(i / 4, i % 4) = *x;
    }
    f.transforms[std::string(key.substr(0, key.size() - kTransform.size()))].matrix = m;
  } else if (key == "Timestamp" || key == "UnfilteredTimestamp") {
    const auto ns = ns_from_decimal(value);
    if (!ns) return refuse_line(key, "is no time in seconds");
    (key == "Timestamp" ? f.frame.timestamp_ns : f.frame.unfiltered_timestamp_ns) = *ns;
  } else if (key == "FrameNumber") {
    f.frame.number = number<std::uint32_t>(value);
    if (!f.frame.number) return refuse_line(key, "is no number of a frame");
  } else {
    f.frame.fields[std::string(key)] = std::string(value);
  }
  return {};
}

Status HeaderBuilder::take_meta(std::string_view key, std::string_view value) {
  PlusData& data = out_.data;
  if (key == "DimSize") return take_sizes(key, value);
  if (key == "ElementType") {
    type_ = std::string(value);
  } else if (key == "ElementNumberOfChannels") {
    const auto channels = number<int>(value);
    if (!channels || *channels < 1 || *channels > 16) return refuse_line(key, "is out of range");
    out_.sequence.channels = *channels;
  } else if (key == "BinaryData" && !says_yes(value)) {
    return refuse_line(key, "is not True: data as text is not read");
  } else if (key == "CompressedData") {
    data.compressed = says_yes(value);
  } else if (key == "BinaryDataByteOrderMSB" || key == "ElementByteOrderMSB") {
    data.big_endian = says_yes(value);
  } else if (key == "ElementDataFile") {
    if (value != "LOCAL") data.file = std::string(value);
  } else {
    return take_key(key, value);
  }
  return {};
}

Status HeaderBuilder::take_nrrd(std::string_view field, std::string_view value) {
  nrrd_ = true;
  PlusData& data = out_.data;
  if (field == "sizes") return take_sizes(field, value);
  if (field == "kinds") {
    kinds_.clear();
    for (const std::string_view word : words(value)) kinds_.emplace_back(word);
  } else if (field == "type") {
    type_ = std::string(value);
  } else if (field == "encoding") {
    if (value != "raw" && value != "gz" && value != "gzip")
      return refuse_line(field, fmt::format("'{}' is not read; raw and gzip are", value));
    data.compressed = value != "raw";
  } else if (field == "endian") {
    data.big_endian = value == "big";
  } else if (field == "data file" || field == "datafile") {
    data.file = std::string(value);
  } else if ((field == "byte skip" || field == "byteskip" || field == "line skip" || field == "lineskip") &&
             value != "0") {
    return refuse_line(field, "is not read");
  }
  return {};  // dimension, space, … follow from the sizes, or do not matter here
}

/// Width, height, frames, channels from the list of sizes and what each of them is.
Status HeaderBuilder::set_dimensions() {
  std::vector<std::uint64_t> sides = sizes_;
  PlusSequence& s = out_.sequence;
  frame_count_ = 1;
  if (nrrd_ && kinds_.size() == sizes_.size()) {
    sides.clear();
    for (std::size_t i = 0; i < sizes_.size(); ++i) {
      if (kinds_[i] == "domain" || kinds_[i] == "space")
        sides.push_back(sizes_[i]);
      else if (kinds_[i] == "list" || kinds_[i] == "time")
        frame_count_ = sizes_[i];
      else if (sizes_[i] >= 1 && sizes_[i] <= 16)
        s.channels = static_cast<int>(sizes_[i]);
      else
        return refuse(fmt::format("{} components a pixel", sizes_[i]));
    }
  } else if (sides.size() >= 3) {
    frame_count_ = sides.back();
    sides.pop_back();
  }
  if (sides.size() == 3 && sides[2] <= 1) sides.pop_back();
  if (sides.size() != 2) return refuse("its sizes are not those of images over time");
  if (sides[0] > kLargestSide_px || sides[1] > kLargestSide_px)
    return refuse(fmt::format("images of {}×{} pixels", sides[0], sides[1]));
  const bool none = sides[0] == 0 || sides[1] == 0;
  s.width_px = none ? 0 : static_cast<int>(sides[0]);
  s.height_px = none ? 0 : static_cast<int>(sides[1]);
  return {};
}

Result<PlusHeader> HeaderBuilder::finish(std::uint64_t header_bytes) {
  GNATHION_CHECK_OK(set_dimensions());
  PlusSequence& s = out_.sequence;
  s.pixel = pixel_named(type_);
  const std::uint64_t named = frames_.empty() ? 0 : std::uint64_t{frames_.rbegin()->first} + 1;
  if (named > frame_count_) return refuse(fmt::format("frame {} of {} announced", named - 1, frame_count_));
  // Announced frames cost memory: those without fields are believed up to a number.
  if (frame_count_ > std::max<std::uint64_t>(kMostFramesWithoutFields, 2 * frames_.size()))
    return refuse(fmt::format("announces {} frames and describes {}", frame_count_, frames_.size()));
  s.frames.resize(frame_count_);
  for (auto& [index, f] : frames_) {
    for (auto& [name, m] : f.transforms) {
      if (!m.matrix) {  // a status of nothing
        f.frame.fields[name + "TransformStatus"] = *m.status;
        continue;
      }
      PlusTransform t{*m.matrix, !m.status || *m.status == "OK", m.status.value_or("OK")};
      f.frame.transforms[name] = std::move(t);
    }
    s.frames[index] = std::move(f.frame);
  }
  for (PlusFrame& f : s.frames) {
    const auto status = f.fields.find("ImageStatus");
    f.has_image = s.width_px > 0 && (status == f.fields.end() || status->second != "INVALID");
    if (status != f.fields.end()) f.fields.erase(status);
  }
  out_.data.offset = header_bytes;
  return std::move(out_);
}

}  // namespace

Result<PlusHeader> parse_plus_header(std::string_view bytes, const std::string& name) {
  HeaderBuilder builder(name);
  const bool nrrd = bytes.substr(0, 4) == "NRRD";
  bool over = false;
  std::size_t at = 0;
  while (!over) {
    const std::size_t end = bytes.find('\n', at);
    if (end == std::string_view::npos) return bad_input(kWhat, name, "its header has no end");
    const std::string_view line = trimmed(bytes.substr(at, end - at));
    at = end + 1;
    ++builder.line;
    if (nrrd) {
      over = line.empty();
      if (over || builder.line == 1 || line.front() == '#') continue;
      const std::size_t colon = line.find(':');
      if (colon == std::string_view::npos)
        return bad_input(kWhat, name, fmt::format("line {} is no field", builder.line));
      const bool key = line.substr(colon, 2) == ":=";
      const std::string_view value = trimmed(line.substr(colon + (key ? 2 : 1)));
      GNATHION_CHECK_OK(key ? builder.take_key(line.substr(0, colon), value)
                            : builder.take_nrrd(line.substr(0, colon), value));
      continue;
    }
    if (line.empty()) continue;
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos)
      return bad_input(kWhat, name,
                       builder.line == 1 ? "is neither MetaImage nor NRRD"
                                         : fmt::format("line {} is no field", builder.line));
    const std::string_view key = trimmed(line.substr(0, equals));
    GNATHION_CHECK_OK(builder.take_meta(key, trimmed(line.substr(equals + 1))));
    over = key == "ElementDataFile";
  }
  return builder.finish(at);
}

std::string decimal_seconds(std::int64_t ns) {
  const std::uint64_t size = ns < 0 ? 0 - static_cast<std::uint64_t>(ns) : static_cast<std::uint64_t>(ns);
  return fmt::format("{}{}.{:09}", ns < 0 ? "-" : "", size / 1'000'000'000, size % 1'000'000'000);
}

std::optional<std::int64_t> ns_from_decimal(std::string_view text) {
  text = trimmed(text);
  const bool negative = !text.empty() && text.front() == '-';
  if (negative || (!text.empty() && text.front() == '+')) text.remove_prefix(1);
  if (text.find_first_not_of("0123456789.") != std::string_view::npos) {  // an exponent: as a double
    const auto s = number<double>(text);
    if (!s || !(std::abs(*s) < 9.2e9) || *s < 0) return std::nullopt;
    return std::llround((negative ? -*s : *s) * 1e9);
  }
  const std::size_t point = std::min(text.find('.'), text.size());
  std::string_view whole = text.substr(0, point), digits = text.substr(std::min(point + 1, text.size()));
  if ((whole.empty() && digits.empty()) || digits.find('.') != std::string_view::npos) return std::nullopt;
  const auto seconds = whole.empty() ? std::uint64_t{0} : number<std::uint64_t>(whole).value_or(UINT64_MAX);
  if (seconds > 9'200'000'000) return std::nullopt;
  std::int64_t ns = 0;
  for (std::size_t i = 0; i < 9; ++i) ns = 10 * ns + (i < digits.size() ? digits[i] - '0' : 0);
  if (digits.size() > 9 && digits[9] >= '5') ++ns;
  ns += static_cast<std::int64_t>(seconds) * 1'000'000'000;
  return negative ? -ns : ns;
}

}  // namespace gnathion
