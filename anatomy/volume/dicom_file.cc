#include "anatomy/volume/dicom_file.h"

#include <fmt/format.h>
#include <gdcmImageReader.h>
#include <gdcmTrace.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <sstream>

#include "anatomy/volume/dicom_tree.h"
#include "anatomy/volume/volume_checks.h"

namespace gnathion {
namespace {

/// GDCM tells what it dislikes on stderr, from anywhere; here errors are values.
void silence() {
  static const bool once = [] {
    gdcm::Trace::WarningOff();
    gdcm::Trace::ErrorOff();
    gdcm::Trace::DebugOff();
    return true;
  }();
  (void)once;
}

/// A file's elements and their byte order.
struct DataSet {
  const DicomNode* node;
  bool big_endian;
};

std::string text(const DataSet& ds, std::uint32_t group, std::uint32_t element) {
  const DicomNode::Element* found = ds.node->find(group, element);
  if (found == nullptr) return "";
  const std::string_view value = found->value.substr(0, 4096);
  const std::size_t first = value.find_first_not_of(' ');
  const std::size_t last = value.find_last_not_of(std::string_view(" \0", 2));
  if (first == std::string_view::npos || last == std::string_view::npos || last < first) return "";
  return std::string(value.substr(first, last - first + 1));
}

std::optional<int> us(const DataSet& ds, std::uint32_t group, std::uint32_t element) {
  const DicomNode::Element* found = ds.node->find(group, element);
  if (found == nullptr || found->value.size() < 2) return {};
  const auto a = static_cast<unsigned char>(found->value[0]), b = static_cast<unsigned char>(found->value[1]);
  return ds.big_endian ? a << 8 | b : b << 8 | a;
}

/// Decimal strings "0.3\0.3"; nothing unless there are exactly `count` finite ones.
std::optional<std::vector<double>> decimals(const DataSet& ds, std::uint16_t group, std::uint16_t element,
                                            std::size_t count) {
  std::string all = text(ds, group, element);
  std::vector<double> out;
  std::replace(all.begin(), all.end(), '\\', ' ');
  std::istringstream in(all);
  for (std::string word; in >> word;) {
    double value = 0.0;
    const char* begin = word.data() + (word[0] == '+' ? 1 : 0);
    const auto [end, error] = std::from_chars(begin, word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value)) return {};
    out.push_back(value);
  }
  if (out.size() != count) return {};
  return out;
}

/// The data set of a sequence's item; nothing if it is not there.
std::optional<DataSet> item(const DataSet& ds, std::uint32_t group, std::uint32_t element,
                            std::size_t index) {
  const DicomNode::Element* found = ds.node->find(group, element);
  if (found == nullptr || index >= found->items.size()) return {};
  return DataSet{&found->items[index], ds.big_endian};
}

void read_place(const DataSet& position, const DataSet& orientation, const DataSet& measures,
                DicomPlane& plane) {
  const auto p = decimals(position, 0x0020, 0x0032, 3);
  const auto o = decimals(orientation, 0x0020, 0x0037, 6);
  const auto s = decimals(measures, 0x0028, 0x0030, 2);
  if (p) plane.position_mm = {(*p)[0], (*p)[1], (*p)[2]};
  if (o) {
    plane.along_row = {(*o)[0], (*o)[1], (*o)[2]};
    plane.along_column = {(*o)[3], (*o)[4], (*o)[5]};
  }
  if (s) {
    plane.row_spacing_mm = (*s)[0];
    plane.column_spacing_mm = (*s)[1];
  }
  plane.placed = p && o && s;
}

void read_scale(const DataSet& ds, DicomPlane& plane) {
  if (const auto slope = decimals(ds, 0x0028, 0x1053, 1); slope && (*slope)[0] != 0.0)
    plane.slope = (*slope)[0];
  if (const auto intercept = decimals(ds, 0x0028, 0x1052, 1)) plane.intercept = (*intercept)[0];
}

/// Enhanced multi-frame: each frame's place is in its functional groups, or in the shared ones.
void read_functional_groups(const DataSet& ds, std::vector<DicomPlane>& planes) {
  const auto shared = item(ds, 0x5200, 0x9229, 0);
  for (std::size_t f = 0; f < planes.size(); ++f) {
    const auto own = item(ds, 0x5200, 0x9230, f);
    const auto find = [&](std::uint32_t group, std::uint32_t element) {
      std::optional<DataSet> found = own ? item(*own, group, element, 0) : std::nullopt;
      if (!found && shared) found = item(*shared, group, element, 0);
      return found;
    };
    const auto position = find(0x0020, 0x9113), orientation = find(0x0020, 0x9116),
               measures = find(0x0028, 0x9110);
    if (position && orientation && measures) read_place(*position, *orientation, *measures, planes[f]);
    if (const auto scale = find(0x0028, 0x9145)) read_scale(*scale, planes[f]);
  }
}

void read_identity(const DataSet& ds, DicomHeader& h) {
  h.series_uid = text(ds, 0x0020, 0x000e);
  h.series_number = text(ds, 0x0020, 0x0011);
  h.description = text(ds, 0x0008, 0x103e);
  h.modality = text(ds, 0x0008, 0x0060);
  h.instance_uid = text(ds, 0x0008, 0x0018);
  h.sop_class = text(ds, 0x0008, 0x0016);
  h.image_type = text(ds, 0x0008, 0x0008);
  h.date = text(ds, 0x0008, 0x0020);
  h.acquisition = text(ds, 0x0020, 0x0012);
  h.echo = text(ds, 0x0018, 0x0081);
  h.temporal_position = text(ds, 0x0020, 0x0100);
  h.kernel = text(ds, 0x0018, 0x1210);
  h.patient_name = text(ds, 0x0010, 0x0010);
  h.patient_id = text(ds, 0x0010, 0x0020);
  h.patient_birth_date = text(ds, 0x0010, 0x0030);
}

Result<DicomHeader> header_of(const DicomTree& tree, const std::string& name) {
  const DataSet ds{&tree.root, tree.big_endian};
  const auto has = [&](std::uint32_t group, std::uint32_t element) {
    return tree.root.find(group, element) != nullptr;
  };
  DicomHeader h;
  h.name = name;
  read_identity(ds, h);
  h.transfer_syntax = tree.transfer_syntax;
  h.photometric = text(ds, 0x0028, 0x0004);
  h.rows = us(ds, 0x0028, 0x0010).value_or(0);
  h.columns = us(ds, 0x0028, 0x0011).value_or(0);
  h.bits_allocated = us(ds, 0x0028, 0x0100).value_or(0);
  h.bits_stored = us(ds, 0x0028, 0x0101).value_or(h.bits_allocated);
  h.samples = us(ds, 0x0028, 0x0002).value_or(1);
  h.is_signed = us(ds, 0x0028, 0x0103).value_or(0) == 1;
  h.lossy = text(ds, 0x0028, 0x2110) == "01";
  h.encrypted_attributes = has(0x0400, 0x0500);
  h.modality_lut = has(0x0028, 0x3000);
  h.has_pixels = has(0x7fe0, 0x0010) && h.rows > 0 && h.columns > 0;
  if (const auto tilt = decimals(ds, 0x0018, 0x1120, 1)) h.tilt_deg = (*tilt)[0];
  double frames = 1.0;
  if (const auto n = decimals(ds, 0x0028, 0x0008, 1)) frames = (*n)[0];
  if (!(frames >= 1.0) || frames > 20000.0)
    return bad_input(kReadVolume, name, fmt::format("{:.0f} frames in one file", frames));
  h.planes.resize(static_cast<std::size_t>(frames));
  for (DicomPlane& plane : h.planes) read_scale(ds, plane);
  if (has(0x5200, 0x9230) || has(0x5200, 0x9229))
    read_functional_groups(ds, h.planes);
  else if (h.planes.size() == 1)
    read_place(ds, ds, ds, h.planes[0]);
  return h;
}

/// Values of one type, as int16 with an offset where that is needed.
template <class T>
Status narrow(const std::vector<char>& raw, int bits_stored, DicomPixels& out, const std::string& name) {
  const std::size_t count = raw.size() / sizeof(T);
  out.values.resize(count);
  out.offset = std::is_same_v<T, std::uint16_t> && bits_stored == 16 ? 32768 : 0;
  const int unused = 8 * static_cast<int>(sizeof(T)) - bits_stored;
  for (std::size_t i = 0; i < count; ++i) {
    T value;
    std::memcpy(&value, raw.data() + i * sizeof(T), sizeof(T));
    // Bits above those that are stored may hold anything (old overlays); signed values are extended.
    if (unused > 0 && sizeof(T) <= 2) {
      using U = std::make_unsigned_t<T>;
      const auto shifted = static_cast<U>(static_cast<U>(value) << unused);
      value = static_cast<T>(static_cast<T>(shifted) >> unused);
    }
    const auto stored = static_cast<std::int64_t>(value) - out.offset;
    if (stored < -32768 || stored > 32767)
      return bad_input(kReadVolume, name, "32-bit pixels beyond 16 bits are not read");
    out.values[i] = static_cast<std::int16_t>(stored);
  }
  return {};
}

/// Reads from memory that somebody else keeps: no copy.
class MemoryBuffer : public std::streambuf {
 public:
  explicit MemoryBuffer(const std::string& bytes) {
    char* begin = const_cast<char*>(bytes.data());
    setg(begin, begin, begin + bytes.size());
  }

 private:
  pos_type seekoff(off_type offset, std::ios_base::seekdir from, std::ios_base::openmode) override {
    off_type base = 0;
    if (from == std::ios_base::cur) base = gptr() - eback();
    if (from == std::ios_base::end) base = egptr() - eback();
    const off_type to = base + offset;
    if (to < 0 || to > egptr() - eback()) return pos_type(off_type(-1));
    setg(eback(), eback() + to, egptr());
    return pos_type(to);
  }
  pos_type seekpos(pos_type to, std::ios_base::openmode mode) override {
    return seekoff(off_type(to), std::ios_base::beg, mode);
  }
};

/// The values of all pixels by their size and sign in the file.
Status narrow_any(const std::vector<char>& raw, int bits, int stored, bool is_signed, DicomPixels& out,
                  const std::string& name) {
  if (stored < 1 || stored > bits)
    return bad_input(kReadVolume, name, "its header lies: more bits stored than there are");
  switch (bits) {
    case 8:
      return is_signed ? narrow<std::int8_t>(raw, stored, out, name)
                       : narrow<std::uint8_t>(raw, stored, out, name);
    case 16:
      return is_signed ? narrow<std::int16_t>(raw, stored, out, name)
                       : narrow<std::uint16_t>(raw, stored, out, name);
    case 32:
      return is_signed ? narrow<std::int32_t>(raw, stored, out, name)
                       : narrow<std::uint32_t>(raw, stored, out, name);
    default:
      return bad_input(kReadVolume, name, fmt::format("pixels of {} bits are not read", bits));
  }
}

/// Uncompressed pixels: they must be as many as the header says.
Result<std::vector<char>> native_pixels(const DicomNode::Element& pixels, bool big_endian,
                                        const DicomHeader& header, std::size_t needed) {
  const std::size_t there = pixels.value.size();
  const std::string told = fmt::format("{} x {} x {} pixels take {} bytes, {} are there", header.columns,
                                       header.rows, header.planes.size(), needed, there);
  if (there < needed) return bad_input(kReadVolume, header.name, "truncated: " + told);
  if (there > needed + 1) return bad_input(kReadVolume, header.name, "its header lies: " + told);
  std::vector<char> raw(pixels.value.begin(), pixels.value.begin() + static_cast<std::ptrdiff_t>(needed));
  const auto unit = static_cast<std::size_t>(header.bits_allocated / 8);
  if (big_endian)
    for (std::size_t at = 0; unit > 1 && at + unit <= raw.size(); at += unit)
      std::reverse(raw.begin() + static_cast<std::ptrdiff_t>(at),
                   raw.begin() + static_cast<std::ptrdiff_t>(at + unit));
  return raw;
}

void put16(std::string& out, std::size_t v) {
  out += static_cast<char>(v & 0xff);
  out += static_cast<char>(v >> 8 & 0xff);
}
void put32(std::string& out, std::size_t v) {
  put16(out, v & 0xffff);
  put16(out, v >> 16);
}
void put_element(std::string& out, std::size_t group, std::size_t element, const char* vr,
                 std::string value) {
  if (value.size() % 2 != 0) value += std::string_view(vr) == "UI" ? '\0' : ' ';
  put16(out, group), put16(out, element);
  out += vr;
  put16(out, value.size());
  out += value;
}

/// A file of nothing but what decoding needs, sound in all but the compressed pixels themselves.
std::string minimal_file(const DicomNode::Element& pixels, const DicomHeader& h) {
  constexpr const char* kCt = "1.2.840.10008.5.1.4.1.1.2";
  std::string meta, out(128, '\0');
  put_element(meta, 2, 2, "UI", kCt);
  put_element(meta, 2, 3, "UI", "1.2.3");
  put_element(meta, 2, 0x10, "UI", h.transfer_syntax);
  std::string length;
  put32(length, meta.size());
  out += "DICM";
  put_element(out, 2, 0, "UL", length);
  out += meta;
  put_element(out, 8, 0x16, "UI", kCt);
  const auto number = [&](std::size_t element, int value) {
    std::string bytes;
    put16(bytes, static_cast<std::size_t>(value));
    put_element(out, 0x28, element, "US", bytes);
  };
  number(2, 1);
  put_element(out, 0x28, 4, "CS", "MONOCHROME2");
  if (h.planes.size() > 1) put_element(out, 0x28, 8, "IS", std::to_string(h.planes.size()));
  number(0x10, h.rows), number(0x11, h.columns);
  number(0x100, h.bits_allocated), number(0x101, h.bits_stored), number(0x102, h.bits_stored - 1);
  number(0x103, h.is_signed ? 1 : 0);
  put16(out, 0x7fe0), put16(out, 0x10);
  out += "OB";
  put16(out, 0), put32(out, 0xffffffff);
  for (std::size_t f = 0; f < pixels.fragments.size(); ++f) {
    const bool table =
        f == 0 && pixels.fragments[f].size() != 4 * h.planes.size();  // a table of another size lies
    const std::string_view fragment = table ? std::string_view() : pixels.fragments[f];
    put16(out, 0xfffe), put16(out, 0xe000), put32(out, fragment.size());
    out += fragment;
  }
  put16(out, 0xfffe), put16(out, 0xe0dd), put32(out, 0);
  return out;
}

Result<std::vector<char>> decoded_pixels(const DicomNode::Element& pixels, const DicomHeader& header,
                                         std::size_t needed) {
  const std::string packing = transfer_syntax_name(header.transfer_syntax);
  const std::string file = minimal_file(pixels, header);
  MemoryBuffer buffer(file);
  std::istream in(&buffer);
  gdcm::ImageReader reader;
  reader.SetStream(in);
  if (!reader.Read())
    return bad_input(kReadVolume, header.name, "its pixels cannot be read (" + packing + ")");
  const gdcm::Image& image = reader.GetImage();
  if (image.GetColumns() != static_cast<unsigned>(header.columns) ||
      image.GetRows() != static_cast<unsigned>(header.rows) ||
      image.GetPixelFormat().GetSamplesPerPixel() != 1 ||
      image.GetPixelFormat().GetBitsAllocated() != header.bits_allocated || image.GetBufferLength() != needed)
    return bad_input(kReadVolume, header.name,
                     fmt::format("its pixels are not the {} x {} x {} that its header says", header.columns,
                                 header.rows, header.planes.size()));
  std::vector<char> raw(needed);
  if (!image.GetBuffer(raw.data()))
    return bad_input(kReadVolume, header.name, "its pixels cannot be decoded (" + packing + ")");
  return raw;
}

Result<DicomPixels> decode(const std::string& bytes, const DicomHeader& header) {
  GNATHION_TRY(const DicomTree tree, parse_dicom_tree(bytes, header.name));
  const DicomNode::Element* pixels = tree.root.find(0x7fe0, 0x0010);
  if (pixels == nullptr) return bad_input(kReadVolume, header.name, "it has no pixels");
  if (header.samples != 1) return bad_input(kReadVolume, header.name, "a colour picture");
  if (header.bits_allocated != 8 && header.bits_allocated != 16 && header.bits_allocated != 32)
    return bad_input(kReadVolume, header.name,
                     fmt::format("pixels of {} bits are not read", header.bits_allocated));
  if (header.bits_stored < 1 || header.bits_stored > header.bits_allocated)
    return bad_input(kReadVolume, header.name, "its header lies: more bits stored than there are");
  const std::size_t needed = static_cast<std::size_t>(header.rows) *
                             static_cast<std::size_t>(header.columns) * header.planes.size() *
                             static_cast<std::size_t>(header.bits_allocated / 8);
  std::vector<char> raw;
  if (pixels->fragments.empty()) {
    GNATHION_TRY(raw, native_pixels(*pixels, tree.big_endian, header, needed));
  } else {
    GNATHION_TRY(raw, decoded_pixels(*pixels, header, needed));
  }
  DicomPixels out;
  GNATHION_CHECK_OK(
      narrow_any(raw, header.bits_allocated, header.bits_stored, header.is_signed, out, header.name));
  return out;
}

}  // namespace

std::string transfer_syntax_name(const std::string& uid) {
  static const std::map<std::string, const char*> kNames = {
      {"1.2.840.10008.1.2", "implicit little endian"},
      {"1.2.840.10008.1.2.1", "explicit little endian"},
      {"1.2.840.10008.1.2.1.99", "deflated"},
      {"1.2.840.10008.1.2.2", "explicit big endian"},
      {"1.2.840.10008.1.2.4.50", "JPEG baseline"},
      {"1.2.840.10008.1.2.4.51", "JPEG extended"},
      {"1.2.840.10008.1.2.4.57", "JPEG lossless"},
      {"1.2.840.10008.1.2.4.70", "JPEG lossless"},
      {"1.2.840.10008.1.2.4.80", "JPEG-LS lossless"},
      {"1.2.840.10008.1.2.4.81", "JPEG-LS near lossless"},
      {"1.2.840.10008.1.2.4.90", "JPEG 2000 lossless"},
      {"1.2.840.10008.1.2.4.91", "JPEG 2000"},
      {"1.2.840.10008.1.2.5", "RLE"}};
  const auto found = kNames.find(uid);
  return found == kNames.end() ? "transfer syntax " + uid : found->second;
}

std::string DicomHeader::without_identity(const std::string& file_name) const {
  constexpr std::size_t kShortest = 3;
  const auto low = [](char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); };
  std::string shown = std::filesystem::path(file_name).filename().string(), part;
  for (const char c : patient_name + " " + patient_id + " ") {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0 || static_cast<unsigned char>(c) > 127) {
      part += low(c);
      continue;
    }
    const auto same = [&](char a, char b) { return low(a) == b; };
    for (std::size_t at = 0; part.size() >= kShortest && at < shown.size(); at += 3) {
      const auto found = std::search(shown.begin() + static_cast<std::ptrdiff_t>(at), shown.end(),
                                     part.begin(), part.end(), same);
      if (found == shown.end()) break;
      at = static_cast<std::size_t>(found - shown.begin());
      shown.replace(at, part.size(), "***");
    }
    part.clear();
  }
  return shown;
}

Result<DicomHeader> parse_dicom_header(const std::string& bytes, const std::string& name) {
  GNATHION_TRY(const DicomTree tree, parse_dicom_tree(bytes, name));
  return header_of(tree, name);
}

Result<DicomPixels> decode_dicom_pixels(const std::string& bytes, const DicomHeader& header) {
  silence();
  try {
    return decode(bytes, header);
  } catch (const std::exception& e) {
    return bad_input(kReadVolume, header.name, std::string("its pixels cannot be decoded: ") + e.what());
  }
}

}  // namespace gnathion
