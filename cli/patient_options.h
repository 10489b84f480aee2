// Options that all commands about a patient's jaws and joints share.
#pragma once

#include "pipeline/check_job.h"

namespace CLI {
class App;
}

namespace gnathion {

/// --maxilla, --mandible.
void add_jaw_options(CLI::App& command, PatientFiles& files);
/// --cbct and how it is read: --series, --bone-level, --cbct-pose, --labels, --condyle-labels,
/// --fossa-labels, and the regions of both joints.
void add_joint_options(CLI::App& command, KnowledgeFiles& files);
/// --motion, --calibration.
void add_recording_options(CLI::App& command, KnowledgeFiles& files);
/// --box-SIDE, --condyle-SIDE, --fossa-SIDE: where a joint is in the volume.
void add_region_options(CLI::App& command, const std::string& side, std::optional<JointRegion>& region);

}  // namespace gnathion
