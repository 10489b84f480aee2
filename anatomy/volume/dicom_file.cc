#include "anatomy/volume/dicom_file.h"

#include <fmt/format.h>
#include <gdcmDataSet.h>
#include <gdcmImageReader.h>
#include <gdcmReader.h>
#include <gdcmSequenceOfItems.h>
#include <gdcmTrace.h>

#include <charconv>
#include <cstring>
#include <map>
#include <optional>
#include <sstream>

#include "anatomy/volume/volume_checks.h"

namespace gnathion {
namespace {

using gdcm::DataSet;
using gdcm::Tag;

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

const gdcm::ByteValue* bytes_of(const DataSet& ds, const Tag& tag) {
  return ds.FindDataElement(tag) ? ds.GetDataElement(tag).GetByteValue() : nullptr;
}

std::string text(const DataSet& ds, std::uint16_t group, std::uint16_t element) {
  const gdcm::ByteValue* value = bytes_of(ds, Tag(group, element));
  if (value == nullptr || value->GetPointer() == nullptr) return "";
  std::string out(value->GetPointer(), std::min<std::size_t>(value->GetLength(), 4096));
  const std::size_t last = out.find_last_not_of(std::string_view(" \0", 2));
  out.resize(last == std::string::npos ? 0 : last + 1);
  const std::size_t first = out.find_first_not_of(' ');
  return first == std::string::npos ? "" : out.substr(first);
}

std::optional<int> us(const DataSet& ds, std::uint16_t group, std::uint16_t element) {
  const gdcm::ByteValue* value = bytes_of(ds, Tag(group, element));
  if (value == nullptr || value->GetPointer() == nullptr || value->GetLength() < 2) return {};
  std::uint16_t number;  // GDCM has brought it to this machine's byte order
  std::memcpy(&number, value->GetPointer(), 2);
  return number;
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

/// The data set of a sequence's item; nothing if it is not there. `keep` owns it.
const DataSet* item(const DataSet& ds, std::uint16_t group, std::uint16_t element, std::size_t index,
                    gdcm::SmartPointer<gdcm::SequenceOfItems>& keep) {
  const Tag tag(group, element);
  if (!ds.FindDataElement(tag)) return nullptr;
  keep = ds.GetDataElement(tag).GetValueAsSQ();
  if (!keep || keep->GetNumberOfItems() <= index) return nullptr;
  return &keep->GetItem(index + 1).GetNestedDataSet();
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
  gdcm::SmartPointer<gdcm::SequenceOfItems> keep_shared, keep_frames;
  const DataSet* shared = item(ds, 0x5200, 0x9229, 0, keep_shared);
  for (std::size_t f = 0; f < planes.size(); ++f) {
    const DataSet* own = item(ds, 0x5200, 0x9230, f, keep_frames);
    const auto find = [&](std::uint16_t element, std::uint16_t group,
                          gdcm::SmartPointer<gdcm::SequenceOfItems>& keep) -> const DataSet* {
      const DataSet* found = own != nullptr ? item(*own, group, element, 0, keep) : nullptr;
      if (found == nullptr && shared != nullptr) found = item(*shared, group, element, 0, keep);
      return found;
    };
    gdcm::SmartPointer<gdcm::SequenceOfItems> a, b, c, d;
    const DataSet* position = find(0x9113, 0x0020, a);
    const DataSet* orientation = find(0x9116, 0x0020, b);
    const DataSet* measures = find(0x9110, 0x0028, c);
    if (position != nullptr && orientation != nullptr && measures != nullptr)
      read_place(*position, *orientation, *measures, planes[f]);
    if (const DataSet* scale = find(0x9145, 0x0028, d)) read_scale(*scale, planes[f]);
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

Result<DicomHeader> header_of(const gdcm::Reader& reader, const std::string& name, bool has_pixels) {
  const DataSet& ds = reader.GetFile().GetDataSet();
  DicomHeader h;
  h.name = name;
  read_identity(ds, h);
  h.transfer_syntax = text(reader.GetFile().GetHeader(), 0x0002, 0x0010);
  h.photometric = text(ds, 0x0028, 0x0004);
  h.rows = us(ds, 0x0028, 0x0010).value_or(0);
  h.columns = us(ds, 0x0028, 0x0011).value_or(0);
  h.bits_allocated = us(ds, 0x0028, 0x0100).value_or(0);
  h.bits_stored = us(ds, 0x0028, 0x0101).value_or(h.bits_allocated);
  h.samples = us(ds, 0x0028, 0x0002).value_or(1);
  h.is_signed = us(ds, 0x0028, 0x0103).value_or(0) == 1;
  h.lossy = text(ds, 0x0028, 0x2110) == "01";
  h.encrypted_attributes = ds.FindDataElement(Tag(0x0400, 0x0500));
  h.modality_lut = ds.FindDataElement(Tag(0x0028, 0x3000));
  h.has_pixels = has_pixels && h.rows > 0 && h.columns > 0;
  if (const auto tilt = decimals(ds, 0x0018, 0x1120, 1)) h.tilt_deg = (*tilt)[0];
  double frames = 1.0;
  if (const auto n = decimals(ds, 0x0028, 0x0008, 1)) frames = (*n)[0];
  if (!(frames >= 1.0) || frames > 20000.0)
    return bad_input(kReadVolume, name, fmt::format("{:.0f} frames in one file", frames));
  h.planes.resize(static_cast<std::size_t>(frames));
  for (DicomPlane& plane : h.planes) read_scale(ds, plane);
  if (ds.FindDataElement(Tag(0x5200, 0x9230)) || ds.FindDataElement(Tag(0x5200, 0x9229)))
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

/// Uncompressed pixels must be as many as the header says: GDCM takes the header's word.
Status check_length(const gdcm::Image& image, const DicomHeader& header, std::size_t needed) {
  const gdcm::ByteValue* value = image.GetDataElement().GetByteValue();
  if (value == nullptr) return {};  // in fragments: compressed
  const std::size_t there = value->GetLength();
  if (there < needed)
    return bad_input(kReadVolume, header.name,
                     fmt::format("truncated: {} x {} x {} pixels take {} bytes, {} are there", header.columns,
                                 header.rows, header.planes.size(), needed, there));
  if (there > needed + 1)
    return bad_input(kReadVolume, header.name,
                     fmt::format("its header lies: {} x {} x {} pixels take {} bytes, {} are there",
                                 header.columns, header.rows, header.planes.size(), needed, there));
  return {};
}

Result<DicomPixels> decode(const std::string& bytes, const DicomHeader& header) {
  MemoryBuffer buffer(bytes);
  std::istream in(&buffer);
  gdcm::ImageReader reader;
  reader.SetStream(in);
  if (!reader.Read())
    return bad_input(kReadVolume, header.name,
                     "its pixels cannot be read (" + transfer_syntax_name(header.transfer_syntax) + ")");
  const gdcm::Image& image = reader.GetImage();
  const gdcm::PixelFormat& format = image.GetPixelFormat();
  const std::size_t pixels =
      static_cast<std::size_t>(header.rows) * static_cast<std::size_t>(header.columns) * header.planes.size();
  const std::size_t unit = format.GetPixelSize();
  if (image.GetColumns() != static_cast<unsigned>(header.columns) ||
      image.GetRows() != static_cast<unsigned>(header.rows) || format.GetSamplesPerPixel() != 1 ||
      image.GetBufferLength() != pixels * unit)
    return bad_input(kReadVolume, header.name,
                     fmt::format("its pixels are not the {} x {} x {} that its header says", header.columns,
                                 header.rows, header.planes.size()));
  GNATHION_CHECK_OK(check_length(image, header, pixels * unit));
  std::vector<char> raw(pixels * unit);
  if (!image.GetBuffer(raw.data()))
    return bad_input(kReadVolume, header.name,
                     "its pixels cannot be decoded (" + transfer_syntax_name(header.transfer_syntax) + ")");
  DicomPixels out;
  const int stored = format.GetBitsStored();
  switch (format.GetScalarType()) {
    case gdcm::PixelFormat::UINT8:
      GNATHION_CHECK_OK(narrow<std::uint8_t>(raw, stored, out, header.name));
      break;
    case gdcm::PixelFormat::INT8:
      GNATHION_CHECK_OK(narrow<std::int8_t>(raw, stored, out, header.name));
      break;
    case gdcm::PixelFormat::UINT12:
    case gdcm::PixelFormat::UINT16:
      GNATHION_CHECK_OK(narrow<std::uint16_t>(raw, stored, out, header.name));
      break;
    case gdcm::PixelFormat::INT12:
    case gdcm::PixelFormat::INT16:
      GNATHION_CHECK_OK(narrow<std::int16_t>(raw, stored, out, header.name));
      break;
    case gdcm::PixelFormat::UINT32:
      GNATHION_CHECK_OK(narrow<std::uint32_t>(raw, stored, out, header.name));
      break;
    case gdcm::PixelFormat::INT32:
      GNATHION_CHECK_OK(narrow<std::int32_t>(raw, stored, out, header.name));
      break;
    default:
      return bad_input(kReadVolume, header.name, "pixels of this type are not read");
  }
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

Result<DicomHeader> parse_dicom_header(const std::string& bytes, const std::string& name) {
  silence();
  try {
    MemoryBuffer buffer(bytes);
    std::istream in(&buffer);
    gdcm::Reader reader;
    reader.SetStream(in);
    if (!reader.ReadUpToTag(Tag(0x7fe0, 0x0010)))
      return bad_input(kReadVolume, name, "damaged: its header cannot be read");
    const bool has_pixels = reader.GetFile().GetDataSet().FindDataElement(Tag(0x7fe0, 0x0010)) ||
                            static_cast<std::size_t>(in.tellg()) < bytes.size();
    return header_of(reader, name, has_pixels);
  } catch (const std::exception& e) {
    return bad_input(kReadVolume, name, std::string("damaged: ") + e.what());
  }
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
