// The frames of the method (docs/frames.md): tag types that keep chains of transforms in order.
#pragma once

namespace gnathion {

/// The maxilla's own frame, both jaws in MI as scanned (RCS = DM). Results live here.
struct Dental {
  static constexpr const char* name = "dental";
};
/// The face scanner's frame at MI. T_F and T_B of the face route live here.
struct FaceScanMi {
  static constexpr const char* name = "face_scan_mi";
};
/// The face scanner's frame at TP; joined to FaceScanMi by registering the upper face.
struct FaceScanTp {
  static constexpr const char* name = "face_scan_tp";
};
using FaceScan = FaceScanMi;
/// The measurement frame of the camera rig (MCS).
struct Camera {
  static constexpr const char* name = "camera";
};
/// The mandibular bow's own (CAD) frame; its clutch sits on the lower teeth.
struct Bow {
  static constexpr const char* name = "bow";
};
/// The head frame's own (CAD) frame; it moves with the maxilla.
struct HeadFrame {
  static constexpr const char* name = "head_frame";
};
/// Frame of the intraoral scan of the lower teeth with the clutch on.
struct ClutchScan {
  static constexpr const char* name = "clutch_scan";
};
/// Frame of the intraoral scans taken in TP.
struct IntraoralTp {
  static constexpr const char* name = "intraoral_tp";
};
/// A fixed room frame; only the phantom knows it.
struct World {
  static constexpr const char* name = "world";
};

}  // namespace gnathion
