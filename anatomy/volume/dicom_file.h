// One DICOM file: what its header says, and its pixels. The only place that knows GDCM.
#pragma once

#include <string>
#include <vector>

#include "anatomy/volume/read_volume.h"

namespace gnathion {

/// One picture in space (a file has one, or, multi-frame, several).
struct DicomPlane {
  Vector3 position_mm = Vector3::Zero();                                ///< centre of the first pixel, LPS
  Vector3 along_row = Vector3::Zero(), along_column = Vector3::Zero();  ///< unit; of increasing column, row
  double column_spacing_mm = 0.0;                                       ///< between neighbours in a row
  double row_spacing_mm = 0.0;                                          ///< between rows
  bool placed = false;                                                  ///< all of the above were given
  double slope = 1.0, intercept = 0.0;
};

struct DicomHeader {
  std::string name;  ///< the file
  std::string series_uid, series_number, description, modality, instance_uid, image_type, sop_class;
  std::string transfer_syntax, photometric, acquisition, echo, temporal_position, kernel;
  std::string patient_name, patient_id, patient_birth_date, date;
  int rows = 0, columns = 0, bits_allocated = 0, bits_stored = 0, samples = 1;
  bool is_signed = false, has_pixels = false, lossy = false, encrypted_attributes = false,
       modality_lut = false;
  double tilt_deg = 0.0;  ///< as the tag says
  std::vector<DicomPlane> planes;
  /// The file's name without folders, and without the patient's name and number: files are often named after
  /// the patient, and warnings go into results.
  std::string shown_name() const { return without_identity(name); }
  std::string without_identity(const std::string& file_name) const;
};

enum class DicomKind {
  kNot,        ///< no DICOM file
  kDicom,      ///< has DICOM's mark
  kDirectory,  ///< a DICOMDIR
  kEncrypted,  ///< CMS envelope, or a locked archive
};
/// By its first bytes.
DicomKind dicom_kind(std::string_view first_bytes, const std::string& file_name);

/// Refuses structure that lies: lengths beyond the file, nesting without end. Errors say why.
Status check_dicom_structure(std::string_view bytes, const std::string& name);

/// Header of a file in memory; check_dicom_structure() has passed.
Result<DicomHeader> parse_dicom_header(const std::string& bytes, const std::string& name);
/// Pixels of all its planes as signed 32-bit or narrower: rows·columns·planes values as int16 when they fit
/// (with the offset that was taken off), decoded whatever the transfer syntax.
struct DicomPixels {
  std::vector<std::int16_t> values;
  int offset = 0;  ///< stored value = values[i] + offset: 32768 for unsigned 16 bit
};
Result<DicomPixels> decode_dicom_pixels(const std::string& bytes, const DicomHeader& header);

/// "JPEG 2000 (1.2.840.10008.1.2.4.90)"
std::string transfer_syntax_name(const std::string& uid);

}  // namespace gnathion
