// The patient's joints out of the case's CBCT: for the constraints, and as X-rays that follow T_th.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anatomy/realizability.h"
#include "anatomy/xray.h"
#include "core/progress.h"
#include "pipeline/cbct_steps.h"
#include "viewer/model/case_content.h"

namespace gnathion {

/// One joint in one view, ready for any position of the mandible.
struct JointFilm {
  Side side = Side::kLeft;
  std::string view;
  XrayWindow window;  ///< of the film in MI: densities stay comparable while the jaw moves
  JointXray xray;
};

/// Immutable once made; shared with background jobs.
struct PatientJoints {
  std::optional<Joints> joints;
  std::shared_ptr<const RealizabilityChecker> checker;  ///< knows them, and the recorded motion
  std::unique_ptr<RegisteredVolume> volume;             ///< the films refer to it
  std::vector<JointFilm> films;  ///< left and right of one view, then of the next; none without a volume
  std::vector<std::string> notes;
  std::string trouble;  ///< why there are no joints; empty: there are
};

/// The constraints without joints: jaws and, where there is one, the recorded motion. Null where the jaws
/// cannot be judged. `notes` may be null.
std::shared_ptr<RealizabilityChecker> jaws_checker(const CaseContent& content, Progress& progress);
/// From CASE/scans' CBCT, or from a folder of joints as meshes. Takes seconds.
std::shared_ptr<const PatientJoints> find_patient_joints(const CaseContent& content, Progress& progress);

}  // namespace gnathion
