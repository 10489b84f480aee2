#include "viewer/model/patient_joints.h"

#include "pipeline/check_job.h"
#include "pipeline/xray_job.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kViews[] = {"lateral", "frontal"};

/// Joints and the volume they were found in, or the reason why not.
Status find_joints(const CaseContent& c, PatientJoints* out, Progress& progress) {
  const TriangleMesh &maxilla = *c.mesh("maxilla_mi"), &mandible = *c.mesh("mandible_mi");
  std::error_code ec;
  if (fs::is_directory(c.files.cbct, ec) && holds_joint_meshes(c.files.cbct)) {
    GNATHION_TRY(out->joints, joints_from_cbct(c.files.cbct, maxilla, mandible, {}, progress));
    return {};
  }
  // Registered anew: a pose among the results may be of scans that were replaced since.
  GNATHION_TRY(RegisteredVolume volume, registered_volume(c.files.cbct, maxilla, mandible, {}, progress));
  out->volume = std::make_unique<RegisteredVolume>(std::move(volume));
  GNATHION_TRY(out->joints, joints_in_volume(*out->volume, maxilla, mandible, {}, progress));
  const std::vector<std::string>& odd = out->volume->file.info.warnings;
  out->notes.insert(out->notes.end(), odd.begin(), odd.end());
  return {};
}

Status make_films(const ArchFrame& arch, PatientJoints* out) {
  const XrayOptions options = scaled_to(out->volume->file.volume, {}, &out->notes);
  GNATHION_TRY(const std::vector<MovingJoint> moving,
               moving_joints(*out->volume, *out->joints, {}, options.field_mm, &out->notes));
  for (const char* name : kViews) {
    GNATHION_TRY(const XrayView view, named_view(name, arch));
    for (const MovingJoint& joint : moving) {
      GNATHION_TRY(JointXray xray,
                   JointXray::create(out->volume->file.volume, out->volume->cbct_from_dental, joint.mandible,
                                     joint.centre_mm, view, options, out->joints->scanned_from_mi));
      const XrayWindow window = window_of(xray.film({}));
      out->films.push_back({joint.side, view.name, window, std::move(xray)});
    }
  }
  return {};
}

}  // namespace

std::shared_ptr<RealizabilityChecker> jaws_checker(const CaseContent& c, Progress& progress) {
  const TriangleMesh &maxilla = *c.mesh("maxilla_mi"), &mandible = *c.mesh("mandible_mi");
  auto checker = RealizabilityChecker::create(maxilla, mandible);
  if (!checker) return nullptr;
  PatientFiles files;
  std::vector<std::string> notes;
  std::error_code ec;
  files.motion = c.files.motion;
  if (fs::exists(c.results() / "motion.csv", ec)) files.motion = c.results() / "motion.csv";
  // Without its recording the jaw is judged all the same: the Motion step says what is wrong with the file.
  (void)add_knowledge(files, maxilla, mandible, &*checker, &notes, progress);
  return std::make_shared<RealizabilityChecker>(std::move(*checker));
}

std::shared_ptr<const PatientJoints> find_patient_joints(const CaseContent& c, Progress& progress) {
  auto out = std::make_shared<PatientJoints>();
  if (const Status found = find_joints(c, out.get(), progress); !found) {
    out->joints.reset();
    out->trouble = found.error().line();
    return out;
  }
  auto checker = jaws_checker(c, progress);
  if (checker) {
    if (const Status fits = add_joints(*out->joints, c.files.cbct, checker.get(), &out->notes); !fits) {
      out->joints.reset();
      out->trouble = fits.error().line();
      return out;
    }
    out->checker = std::move(checker);
  }
  if (!out->volume) {
    out->notes.push_back("joints are meshes: X-rays need the volume");
  } else if (const Status made = make_films(*c.arch, out.get()); !made) {
    out->films.clear();
    out->notes.push_back(made.error().line());
  }
  return out;
}

}  // namespace gnathion
