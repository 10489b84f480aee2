#include "cli/patient_options.h"

#include <CLI/CLI.hpp>

namespace gnathion {

void add_jaw_options(CLI::App& command, PatientFiles& files) {
  command.add_option("--maxilla", files.maxilla, "upper arch")->required();
  command.add_option("--mandible", files.mandible, "lower arch in MI, same frame")->required();
}

void add_region_options(CLI::App& command, const std::string& side, std::optional<JointRegion>& region) {
  static constexpr double kAroundMm = 17.0;
  using Numbers = std::vector<double>;
  const auto of = [](std::optional<JointRegion>& r) -> JointRegion& { return r ? *r : r.emplace(); };
  const auto seed = [&region, of](std::optional<Vector3> JointRegion::*which, const Numbers& v) {
    const Vector3 p(v[0], v[1], v[2]);
    of(region).*which = p;
    region->box_mm.extend(p - Vector3::Constant(kAroundMm));
    region->box_mm.extend(p + Vector3::Constant(kAroundMm));
  };
  command
      .add_option_function<Numbers>(
          "--condyle-" + side, [seed](const Numbers& v) { seed(&JointRegion::condyle_seed_mm, v); },
          "X Y Z on the " + side + " condyle, LPS mm")
      ->expected(3);
  command
      .add_option_function<Numbers>(
          "--fossa-" + side, [seed](const Numbers& v) { seed(&JointRegion::fossa_seed_mm, v); },
          "X Y Z on the bone of the " + side + " fossa, LPS mm")
      ->expected(3);
  // The last of the three, since options are taken in this order: a box that is given replaces the seeds'.
  command
      .add_option_function<Numbers>(
          "--box-" + side,
          [&region, of](const Numbers& v) {
            of(region).box_mm = Box();
            region->box_mm.extend(Vector3(v[0], v[1], v[2]));
            region->box_mm.extend(Vector3(v[3], v[4], v[5]));
          },
          "X0 Y0 Z0 X1 Y1 Z1 around the " + side + " joint, LPS mm")
      ->expected(6);
}

void add_joint_options(CLI::App& command, KnowledgeFiles& files) {
  CbctOptions& o = files.cbct_options;
  command.add_option(
      "--cbct", files.cbct,
      "joints: DICOM folder, NIfTI, NRRD, or a folder with condyle_left.stl, fossa_left.stl, …");
  command.add_option("--series", o.read.series, "which DICOM series: UID, number, or #1, #2, …");
  command.add_option_function<double>(
      "--bone-level", [&o](const double& v) { o.bone_level = v; },
      "bone above this value of the volume; else by Otsu");
  command.add_option("--cbct-pose", files.cbct_pose,
                     "cbct_from_dental.json of an earlier registration; else by the crowns");
  command.add_option("--labels", o.labels, "label map in the volume's frame");
  command.add_option("--condyle-labels", o.condyle_labels, "its labels of the mandible")->delimiter(',');
  command.add_option("--fossa-labels", o.fossa_labels, "its labels of the skull")->delimiter(',');
  add_region_options(command, "left", o.left);
  add_region_options(command, "right", o.right);
}

void add_recording_options(CLI::App& command, KnowledgeFiles& files) {
  command.add_option("--motion", files.motion,
                     "the patient's recorded motion: motion.csv in the dental frame, or motion.mcap");
  command.add_option("--calibration", files.calibration,
                     "chain.json for motion.mcap; else the one beside it");
}

}  // namespace gnathion
