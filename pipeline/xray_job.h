// `gnathion xray`: virtual X-rays of both condyles for each step of a motion.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "anatomy/xray.h"
#include "pipeline/check_job.h"

namespace gnathion {

struct XrayJob {
  PatientFiles files;  ///< cbct is a volume; joints are found in it
  std::optional<Motion<Dental>> therapeutic;
  std::vector<std::string> views = {"lateral", "frontal", "towne"};  ///< named, or "TURN,TILT" in degrees
  int steps = 5;  ///< from MI to T_th, or through the recording, both ends included
  XrayOptions options;
  std::optional<XrayWindow> window;  ///< nothing: of each view in MI
};

/// One place of the mandible that films are made of.
struct XrayStep {
  std::string name;  ///< "MI", "40 % of T_th", "12.50 s"
  Rigid3 motion;
};
/// Evenly from MI to T_th (halfway in rotation and translation about the middle of the condyles), or evenly
/// in time through the recording's valid rows.
std::vector<XrayStep> xray_steps(const std::optional<Motion<Dental>>& therapeutic,
                                 const std::optional<JawMotion>& recording, int steps,
                                 const Vector3& about_mm);

/// One joint in one view: its films in the order of the steps.
struct XraySeries {
  Side side = Side::kLeft;
  XrayView view;
  XrayWindow window;
  std::vector<XrayFilm> films;
};
struct XrayOutcome {
  std::vector<XrayStep> steps;
  std::vector<XraySeries> series;
  double preparing_s = 0.0;  ///< resting films and masks
  double films_s = 0.0;      ///< all films of all steps
  std::vector<std::string> notes;
};
Result<XrayOutcome> make_xrays(const XrayJob& job, Progress& progress);

/// `options` with the attenuation of this volume's values: Hounsfield units where air and soft tissue lie
/// where these have them; else scaled from the volume's own air and soft tissue, which is said in `notes`.
XrayOptions scaled_to(const Volume& volume, XrayOptions options, std::vector<std::string>* notes);

/// One joint of a volume ready for any view: which voxels move, and about what.
struct MovingJoint {
  Side side = Side::kLeft;
  Vector3 centre_mm = Vector3::Zero();
  VoxelMask mandible;
};
/// From the joints that were found in the volume. A side whose mandible cannot be parted from the skull is
/// left out and said in `notes`; none left: refused (kInput).
Result<std::vector<MovingJoint>> moving_joints(const RegisteredVolume& volume, const Joints& joints,
                                               const CbctOptions& options, double field_mm,
                                               std::vector<std::string>* notes);

/// VIEW_SIDE_NN.png of every film, xray.json and sheet.png into `folder`, which exists.
Status write_xrays(const XrayOutcome& outcome, const XrayJob& job, const std::filesystem::path& folder);
nlohmann::json xray_json(const XrayOutcome& outcome, const XrayJob& job);

}  // namespace gnathion
