#include "cli/patient_options.h"

#include <CLI/CLI.hpp>

namespace gnathion {

void add_jaw_options(CLI::App& command, PatientFiles& files) {
  command.add_option("--maxilla", files.maxilla, "upper arch")->required();
  command.add_option("--mandible", files.mandible, "lower arch in MI, same frame")->required();
}

void add_joint_options(CLI::App& command, PatientFiles& files) {
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
}

void add_recording_options(CLI::App& command, PatientFiles& files) {
  command.add_option("--motion", files.motion,
                     "the patient's recorded motion: motion.csv in the dental frame, or motion.mcap");
  command.add_option("--calibration", files.calibration,
                     "chain.json for motion.mcap; else the one beside it");
}

}  // namespace gnathion
