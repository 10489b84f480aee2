#include "pipeline/dental_motion.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "calibration/chain_json.h"
#include "core/transform_io.h"
#include "pipeline/motion_steps.h"
#include "tracking/plateaus.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

Status check_rows(const JawMotion& motion, const fs::path& path) {
  if (std::none_of(motion.rows.begin(), motion.rows.end(), [](const auto& row) { return row.valid; }))
    return bad_input("cannot use motion", path.string(), "no instant of it is valid");
  return {};
}

Result<JawMotion> from_csv(const fs::path& path) {
  GNATHION_TRY(JawMotion motion, read_motion_csv(path));
  if (motion.frame != "dental")
    return bad_input("cannot use motion", path.string(),
                     "told in the frame \"" + motion.frame + "\": a splint needs the dental one");
  GNATHION_CHECK_OK(check_rows(motion, path));
  return motion;
}

}  // namespace

fs::path calibration_of(const fs::path& motion, const fs::path& calibration) {
  if (!calibration.empty()) return calibration;
  std::error_code ec;
  const fs::path beside = motion.parent_path() / "chain.json";
  return fs::exists(beside, ec) ? beside : fs::path();
}

Result<JawMotion> read_dental_motion(const fs::path& path, const fs::path& calibration) {
  if (path.extension() == ".csv") return from_csv(path);
  const fs::path chain_path = calibration_of(path, calibration);
  if (chain_path.empty())
    return fail(ErrorCode::kUsage, "cannot use motion", path.string(),
                "no chain.json beside it: --calibration names the one that brings it to the teeth");
  GNATHION_TRY(const PoseRecording poses, read_poses(path));
  GNATHION_TRY(const SessionMotion session, to_session_motion(poses, path.string()));
  GNATHION_TRY(const nlohmann::json chain_file, read_json(chain_path));
  GNATHION_TRY(const Chain chain, chain_from_json(chain_file, chain_path.string()));
  GNATHION_TRY(const JawPositions positions, find_mi(session, {}));
  if (!positions.closes())
    return bad_input("cannot use motion", path.string(), "MI does not close: bow or head frame slipped");
  JawMotion motion = jaw_motion(session, positions.head_from_bow_mi.value, chain.t_d());
  GNATHION_CHECK_OK(check_rows(motion, path));
  return motion;
}

}  // namespace gnathion
