// The frame of a CBCT or CT volume.
#pragma once

namespace gnathion {

/// The volume's patient frame as DICOM has it (LPS): x to the patient's left, y posterior, z superior, mm,
/// right-handed. RAS and LAS files are turned into it when they are read.
struct Cbct {
  static constexpr const char* name = "cbct";
};

}  // namespace gnathion
