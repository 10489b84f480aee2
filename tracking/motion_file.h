// Jaw motion as rows, and motion.csv.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/transform.h"
#include "tracking/plateaus.h"
#include "tracking/session_motion.h"

namespace gnathion {

/// One instant of jaw motion: the displacement from MI, p' = rigid·p.
struct JawMotionRow {
  double time_s = 0;  ///< from the session's first sample
  bool valid = false;
  std::string reason;   ///< why not valid
  Rigid3 motion;        ///< of the mandible, in the frame that JawMotion names
  double sigma_mm = 0;  ///< standard deviation (RMS of the axes' sum) of the displaced reference point
};

struct JawMotion {
  std::string frame = "dental";  ///< "dental", or "head_frame" where no chain is known
  bool relative_to_mi = true;    ///< else to the first valid row
  std::vector<JawMotionRow> rows;
};

/// Every row of the session relative to `mi` (head_from_bow at MI; without it, relative to the first valid
/// row). With `bow_from_dental` the motion is told in Dental: T_D⁻¹·R0⁻¹·R·T_D; else of the bow in the head
/// frame: R·R0⁻¹. `point_mm` is where sigma is told, in that frame.
JawMotion jaw_motion(const SessionMotion& session, const std::optional<Transform<HeadFrame, Bow>>& mi,
                     const std::optional<Transform<Bow, Dental>>& bow_from_dental,
                     const Vector3& point_mm = Vector3::Zero());

/// Columns time_s,valid,reason,x_mm,y_mm,z_mm,qw,qx,qy,qz,sigma_mm; a first comment line names the frame. x,
/// y, z is the translation of p' = q·p + t, the displacement of the frame's origin. Invalid rows leave
/// numbers empty.
Status write_motion_csv(const std::filesystem::path& path, const JawMotion& motion);
std::string format_motion_csv(const JawMotion& motion);
/// Refused with kInput: no header, wrong count of columns, not a number, quaternion not of length 1; the line
/// is named.
Result<JawMotion> read_motion_csv(const std::filesystem::path& path);
Result<JawMotion> parse_motion_csv(const std::string& text, const std::string& name);

}  // namespace gnathion
