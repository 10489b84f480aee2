// Written from DICOM PS3.5 (encoding) and PS3.3 C.7.6, C.8.2 (CT image), apart from the library that reads
// it.
#include "phantom/cbct_dicom.h"

#include <fmt/format.h>

#include "core/file.h"
#include "core/random.h"

namespace gnathion {
namespace {

class Elements {
 public:
  void u16(std::uint32_t v) { bytes_ += {static_cast<char>(v & 0xff), static_cast<char>(v >> 8 & 0xff)}; }
  void text(std::uint32_t group, std::uint32_t element, const char* vr, std::string value, char pad = ' ') {
    if (value.size() % 2 != 0) value += pad;
    head(group, element, vr);
    u16(static_cast<std::uint32_t>(value.size()));
    bytes_ += value;
  }
  void number(std::uint32_t group, std::uint32_t element, int value) {
    head(group, element, "US");
    u16(2);
    u16(static_cast<std::uint32_t>(value));
  }
  void bytes(std::uint32_t group, std::uint32_t element, const char* vr, const std::string& value) {
    head(group, element, vr);
    u16(0);
    u16(static_cast<std::uint32_t>(value.size() & 0xffff));
    u16(static_cast<std::uint32_t>(value.size() >> 16));
    bytes_ += value;
  }
  const std::string& all() const { return bytes_; }

 private:
  void head(std::uint32_t group, std::uint32_t element, const char* vr) {
    u16(group);
    u16(element);
    bytes_ += vr;
  }
  std::string bytes_;
};

/// Decimal strings hold 16 characters.
std::string ds(double v) {
  std::string s = fmt::format("{:.10g}", v);
  return s.size() <= 16 ? s : fmt::format("{:.8g}", v);
}
std::string ds(const Vector3& v) {
  return ds(v.x()) + "\\" + ds(v.y()) + "\\" + ds(v.z());
}

}  // namespace

std::string format_dicom_slice(const DicomSliceSpec& s) {
  constexpr const char* kCtImage = "1.2.840.10008.5.1.4.1.1.2";
  constexpr const char* kSecondaryCapture = "1.2.840.10008.5.1.4.1.1.7";
  const char* const sop_class = s.placed ? kCtImage : kSecondaryCapture;
  Elements meta;
  meta.bytes(2, 1, "OB", std::string("\0\1", 2));
  meta.text(2, 2, "UI", sop_class, '\0');
  meta.text(2, 3, "UI", s.instance_uid, '\0');
  meta.text(2, 0x10, "UI", "1.2.840.10008.1.2.1", '\0');
  meta.text(2, 0x12, "UI", "1.2.826.0.1.3680043.10.999", '\0');
  Elements e;
  e.text(8, 8, "CS", s.image_type);
  e.text(8, 0x16, "UI", sop_class, '\0');
  e.text(8, 0x18, "UI", s.instance_uid, '\0');
  e.text(8, 0x20, "DA", "20260301");
  e.text(8, 0x60, "CS", s.modality);
  e.text(8, 0x103e, "LO", s.description);
  e.text(0x10, 0x10, "PN", s.patient_name);
  e.text(0x10, 0x20, "LO", s.patient_id);
  if (s.placed) e.text(0x18, 0x50, "DS", ds(s.thickness_mm));
  if (s.tilt_deg != 0.0) e.text(0x18, 0x1120, "DS", ds(s.tilt_deg));
  e.text(0x20, 0xd, "UI", "1.2.826.0.1.3680043.10.999.9", '\0');
  e.text(0x20, 0xe, "UI", s.series_uid, '\0');
  e.text(0x20, 0x11, "IS", s.series_number);
  e.text(0x20, 0x13, "IS", std::to_string(s.instance_number));
  if (s.placed) {
    e.text(0x20, 0x32, "DS", ds(s.position_mm));
    e.text(0x20, 0x37, "DS", ds(s.along_row) + "\\" + ds(s.along_column));
  }
  e.number(0x28, 2, 1);
  e.text(0x28, 4, "CS", "MONOCHROME2");
  e.number(0x28, 0x10, s.rows);
  e.number(0x28, 0x11, s.columns);
  if (s.placed) e.text(0x28, 0x30, "DS", ds(s.row_spacing_mm) + "\\" + ds(s.column_spacing_mm));
  e.number(0x28, 0x100, 16);
  e.number(0x28, 0x101, 16);
  e.number(0x28, 0x102, 15);
  e.number(0x28, 0x103, s.is_signed ? 1 : 0);
  e.text(0x28, 0x1052, "DS", ds(s.intercept));
  e.text(0x28, 0x1053, "DS", ds(s.slope));
  e.bytes(
      0x7fe0, 0x10, "OW",
      std::string(reinterpret_cast<const char*>(s.stored.data()), s.stored.size() * sizeof(std::int16_t)));

  Elements length;
  length.u16(2), length.u16(0);
  std::string out(128, '\0');
  out += "DICM" + length.all() + "UL";
  Elements size;
  size.u16(4);
  size.u16(static_cast<std::uint32_t>(meta.all().size()));
  size.u16(0);
  return out + size.all() + meta.all() + e.all();
}

DicomSliceSpec phantom_slice(const PhantomCbct& c, int k) {
  DicomSliceSpec s;
  s.instance_uid = fmt::format("{}.{}", s.series_uid, k + 1);
  s.instance_number = k + 1;
  s.rows = c.size[1];
  s.columns = c.size[0];
  s.intercept = -1024.0;
  const std::size_t n = static_cast<std::size_t>(s.rows) * static_cast<std::size_t>(s.columns);
  s.stored.resize(n);
  for (std::size_t v = 0; v < n; ++v)
    s.stored[v] = static_cast<std::int16_t>(c.hu[static_cast<std::size_t>(k) * n + v] + 1024);
  s.position_mm = c.origin_mm + Vector3(0, 0, k * c.step_mm.z());
  s.row_spacing_mm = c.step_mm.y();
  s.column_spacing_mm = c.step_mm.x();
  s.thickness_mm = c.step_mm.z();
  return s;
}

Status write_phantom_dicom(const std::filesystem::path& folder, const PhantomCbct& c) {
  Random random(7, static_cast<std::uint64_t>(c.size[2]));
  for (int k = 0; k < c.size[2]; ++k)
    GNATHION_CHECK_OK(write_file(folder / fmt::format("IM{:08X}{:04}", random.next_u32(), k),
                                 format_dicom_slice(phantom_slice(c, k))));
  return {};
}

}  // namespace gnathion
