// NRRD files with their data attached (.nrrd), raw or gzip. Source: the format's definition,
// teem.sourceforge.net/nrrd/format.html.
//
// A reader of its own, because vtkNrrdReader keeps of the space directions only their lengths.
#include <fmt/format.h>

#include <charconv>
#include <map>
#include <optional>
#include <sstream>

#include "anatomy/volume/inflate.h"
#include "anatomy/volume/volume_checks.h"
#include "anatomy/volume/voxel_sink.h"

namespace gnathion {
namespace {

std::string trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return "";
  return std::string(text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1));
}

std::string lower(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

std::vector<std::string> words(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> out;
  for (std::string w; in >> w;) out.push_back(w);
  return out;
}

std::optional<double> number(std::string_view text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return {};
  return value;
}

/// "(1,0,0) none (0, 1, 0)": a vector or nothing for each axis. False where it is neither.
bool vectors(const std::string& text, std::vector<std::optional<Vector3>>& out) {
  std::size_t at = 0;
  while ((at = text.find_first_not_of(" \t", at)) != std::string::npos) {
    if (text.compare(at, 4, "none") == 0) {
      out.push_back({});
      at += 4;
      continue;
    }
    const std::size_t close = text.find(')', at);
    if (text[at] != '(' || close == std::string::npos) return false;
    std::string inside = text.substr(at + 1, close - at - 1);
    std::replace(inside.begin(), inside.end(), ',', ' ');
    const std::vector<std::string> parts = words(inside);
    Vector3 v;
    if (parts.size() != 3) return false;
    for (int k = 0; k < 3; ++k) {
      const auto x = number(parts[static_cast<std::size_t>(k)]);
      if (!x) return false;
      v[k] = *x;
    }
    out.push_back(v);
    at = close + 1;
  }
  return true;
}

std::optional<VoxelType> type_of(const std::string& t) {
  static const std::map<std::string, VoxelType> kTypes = {{"signed char", VoxelType::kInt8},
                                                          {"int8", VoxelType::kInt8},
                                                          {"int8_t", VoxelType::kInt8},
                                                          {"uchar", VoxelType::kUint8},
                                                          {"unsigned char", VoxelType::kUint8},
                                                          {"uint8", VoxelType::kUint8},
                                                          {"uint8_t", VoxelType::kUint8},
                                                          {"short", VoxelType::kInt16},
                                                          {"short int", VoxelType::kInt16},
                                                          {"signed short", VoxelType::kInt16},
                                                          {"signed short int", VoxelType::kInt16},
                                                          {"int16", VoxelType::kInt16},
                                                          {"int16_t", VoxelType::kInt16},
                                                          {"ushort", VoxelType::kUint16},
                                                          {"unsigned short", VoxelType::kUint16},
                                                          {"unsigned short int", VoxelType::kUint16},
                                                          {"uint16", VoxelType::kUint16},
                                                          {"uint16_t", VoxelType::kUint16},
                                                          {"int", VoxelType::kInt32},
                                                          {"signed int", VoxelType::kInt32},
                                                          {"int32", VoxelType::kInt32},
                                                          {"int32_t", VoxelType::kInt32},
                                                          {"uint", VoxelType::kUint32},
                                                          {"unsigned int", VoxelType::kUint32},
                                                          {"uint32", VoxelType::kUint32},
                                                          {"uint32_t", VoxelType::kUint32},
                                                          {"float", VoxelType::kFloat},
                                                          {"double", VoxelType::kDouble}};
  const auto found = kTypes.find(t);
  return found == kTypes.end() ? std::nullopt : std::optional(found->second);
}

/// What turns the file's space into LPS; nothing for spaces that are no patient's.
std::optional<Matrix3> lps_from(const std::string& space) {
  static const std::map<std::string, Vector3> kSpaces = {
      {"left-posterior-superior", {1, 1, 1}},   {"lps", {1, 1, 1}},
      {"right-anterior-superior", {-1, -1, 1}}, {"ras", {-1, -1, 1}},
      {"left-anterior-superior", {1, -1, 1}},   {"las", {1, -1, 1}}};
  const auto found = kSpaces.find(space);
  if (found == kSpaces.end()) return {};
  return Matrix3(found->second.asDiagonal());
}

std::optional<double> mm_per(const std::string& unit) {
  static const std::map<std::string, double> kUnits = {
      {"mm", 1.0},       {"millimeter", 1.0}, {"millimeters", 1.0}, {"cm", 10.0},         {"m", 1000.0},
      {"meter", 1000.0}, {"meters", 1000.0},  {"um", 0.001},        {"micrometer", 0.001}};
  const auto found = kUnits.find(unit);
  return found == kUnits.end() ? std::nullopt : std::optional(found->second);
}

class NrrdReader {
 public:
  NrrdReader(const std::string& bytes, const std::string& name, const ReadVolumeOptions& options)
      : bytes_(bytes), name_(name), options_(options) {}

  Result<VolumeFile> read() {
    out_.info.format = "NRRD";
    out_.info.files = 1;
    GNATHION_CHECK_OK(read_header());
    GNATHION_CHECK_OK(read_shape());
    GNATHION_CHECK_OK(read_map());
    const bool wide = type_ == VoxelType::kFloat || type_ == VoxelType::kDouble;
    GNATHION_CHECK_OK(check_grid(grid_, wide ? 4 : 2, options_.largest_bytes, name_, out_.info.warnings));
    out_.volume.grid = out_.info.grid = grid_;
    GNATHION_CHECK_OK(read_voxels());
    return std::move(out_);
  }

 private:
  tl::unexpected<Error> bad(const std::string& why) const { return bad_input(kReadVolume, name_, why); }

  const std::string* field(const char* key) const {
    const auto found = fields_.find(key);
    return found == fields_.end() ? nullptr : &found->second;
  }

  Status read_header() {
    if (bytes_.compare(0, 7, "NRRD000") != 0) return bad("not NRRD");
    std::size_t at = bytes_.find('\n');
    for (;;) {
      if (at == std::string::npos) return bad("truncated: its header does not end");
      const std::size_t begin = at + 1, end = bytes_.find('\n', begin);
      if (end == std::string::npos) return bad("truncated: its header does not end");
      const std::string line = trimmed(std::string_view(bytes_).substr(begin, end - begin));
      at = end;
      if (line.empty()) break;
      if (begin > 100000) return bad("its header does not end");
      if (line[0] == '#') continue;
      const std::size_t colon = line.find(": ");
      const std::size_t pair = line.find(":=");
      if (colon == std::string::npos || (pair != std::string::npos && pair < colon)) continue;
      fields_[lower(trimmed(std::string_view(line).substr(0, colon)))] =
          trimmed(std::string_view(line).substr(colon + 2));
    }
    data_ = at + 1;
    return {};
  }

  Status read_shape() {
    const std::string *type = field("type"), *dimension = field("dimension"), *sizes = field("sizes"),
                      *encoding = field("encoding");
    if (!type || !dimension || !sizes || !encoding)
      return bad("type, dimension, sizes or encoding is not given");
    if (field("data file") || field("datafile"))
      return bad("its voxels are in another file: save it as one .nrrd with the data attached");
    const auto known = type_of(lower(*type));
    if (!known) return bad("voxels of type '" + *type + "' are not read");
    type_ = *known;
    const std::string packing = lower(*encoding);
    packed_ = packing == "gzip" || packing == "gz";
    if (!packed_ && packing != "raw")
      return bad("encoding '" + *encoding + "' is not read: raw and gzip are");
    if (*dimension != "3") return bad("dimension " + *dimension + "; one volume of 3 is needed");
    const std::vector<std::string> n = words(*sizes);
    if (n.size() != 3) return bad("'sizes' is not three numbers");
    for (std::size_t k = 0; k < 3; ++k) {
      const auto x = number(n[k]);
      if (!x || *x < 1 || *x > 100000 || *x != std::floor(*x))
        return bad("'sizes' is not three numbers of voxels");
      grid_.size[k] = static_cast<int>(*x);
    }
    const std::string* endian = field("endian");
    if (bytes_of(type_) > 1 && !endian) return bad("the byte order ('endian') is not given");
    big_endian_ = endian && lower(*endian) == "big";
    return {};
  }

  Status read_map() {
    Matrix3 lps = Matrix3::Identity();
    if (const std::string* space = field("space")) {
      const auto known = lps_from(lower(*space));
      if (!known) return bad("space '" + *space + "' is no patient's: LPS, RAS and LAS are read");
      lps = *known;
    } else {
      out_.info.warnings.push_back("no 'space': nothing says where left and right are; taken as LPS");
    }
    std::vector<std::optional<Vector3>> v;
    if (const std::string* directions = field("space directions")) {
      if (!vectors(*directions, v) || v.size() != 3 || !v[0] || !v[1] || !v[2])
        return bad("'space directions' is not three vectors");
      for (int k = 0; k < 3; ++k) grid_.step_mm.col(k) = *v[static_cast<std::size_t>(k)];
    } else if (const std::string* spacings = field("spacings")) {
      const std::vector<std::string> s = words(*spacings);
      for (int k = 0; k < 3; ++k) {
        const auto x = s.size() == 3 ? number(s[static_cast<std::size_t>(k)]) : std::nullopt;
        if (!x || !(*x > 0.0)) return bad("'spacings' is not three lengths");
        grid_.step_mm(k, k) = *x;
      }
    } else {
      return bad("neither 'space directions' nor 'spacings': the size of a voxel is not known");
    }
    v.clear();
    if (const std::string* origin = field("space origin")) {
      if (!vectors(*origin, v) || v.size() != 1 || !v[0]) return bad("'space origin' is not a vector");
      grid_.origin_mm = *v[0];
    }
    GNATHION_TRY(const double unit, unit_mm());
    grid_.step_mm = (unit * lps * grid_.step_mm).eval();
    grid_.origin_mm = (unit * lps * grid_.origin_mm).eval();
    return {};
  }

  Result<double> unit_mm() {
    const std::string* units = field("space units");
    if (!units) return 1.0;
    std::string first = *units;
    first.erase(std::remove(first.begin(), first.end(), '"'), first.end());
    const std::vector<std::string> each = words(first);
    if (each.empty()) return 1.0;
    const auto mm = mm_per(each[0]);
    if (!mm || std::any_of(each.begin(), each.end(), [&](const std::string& u) { return mm_per(u) != mm; }))
      return bad("space units '" + *units + "' are not understood");
    if (*mm != 1.0)
      out_.info.warnings.push_back("units of " + each[0] + ", as its header says; turned into mm");
    return *mm;
  }

  Status read_voxels() {
    double skip = 0.0, lines = 0.0;
    if (const std::string* s = field("byte skip")) skip = number(*s).value_or(-2.0);
    if (const std::string* s = field("line skip")) lines = number(*s).value_or(-2.0);
    if (skip < -1.0 || skip > 1e9 || lines != 0.0 || (skip == -1.0 && packed_))
      return bad("'byte skip' or 'line skip' cannot be followed");
    const std::size_t bytes = grid_.count() * bytes_of(type_);
    std::string_view data = std::string_view(bytes_).substr(data_);
    if (static_cast<double>(bytes) > static_cast<double>(data.size()) * (packed_ ? 1100.0 : 1.0) + 1.0)
      return bad(fmt::format("truncated: {} bytes of voxels announced, {} in the file", bytes, data.size()));
    std::size_t drop = skip == -1.0 ? data.size() - bytes : static_cast<std::size_t>(skip);
    VoxelSink sink(out_.volume, type_, big_endian_, grid_.count());
    const auto take = [&](std::string_view piece) {
      const std::size_t now = std::min(drop, piece.size());
      drop -= now;
      return sink.take(piece.substr(now));
    };
    if (packed_) {
      const std::string why = unpack(data, Packing::kGzip, std::uint64_t{1} << 40, take);
      if (!why.empty()) return bad("gzip: " + why);
    } else {
      take(data);
    }
    if (!sink.complete())
      return bad(fmt::format("truncated: {} of {} voxels are there", sink.taken(), grid_.count()));
    if (sink.not_finite() > 0)
      out_.info.warnings.push_back(
          fmt::format("{} voxels are not numbers; they count as 0", sink.not_finite()));
    sink.finish(1.0, 0.0);
    return {};
  }

  const std::string& bytes_;
  const std::string& name_;
  const ReadVolumeOptions& options_;
  std::map<std::string, std::string> fields_;
  std::size_t data_ = 0;
  VoxelType type_ = VoxelType::kInt16;
  bool packed_ = false, big_endian_ = false;
  VoxelGrid grid_;
  VolumeFile out_;
};

}  // namespace

Result<VolumeFile> parse_nrrd(const std::string& bytes, const std::string& name,
                              const ReadVolumeOptions& options) {
  return NrrdReader(bytes, name, options).read();
}

}  // namespace gnathion
