// A case's CBCT hung into its frames: pose by the crowns, face scan over the skin, joints.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/progress.h"
#include "core/result.h"
#include "pipeline/case_file.h"

namespace gnathion {

/// What a volume tells of a patient. A volume that shows less than it could (no joints in its field of view,
/// no crowns to register by) does not stop a case: what is missing is said in `notes`.
struct VirtualPatient {
  bool has_pose = false, has_face = false, has_joints = false;
  std::vector<std::string> notes;
};

/// Writes cbct_from_dental.json, cbct_from_face_mi.json and joints/ (docs/cbct.md) as far as they are found,
/// and cbct.json with what was and what was not. `files.cbct` is a volume or a folder of joints as meshes.
/// Fails (kInput) only where nothing there can be read.
Status write_virtual_patient(const CaseFile& files, const std::filesystem::path& folder, Progress& progress);
Result<VirtualPatient> read_virtual_patient(const std::filesystem::path& folder);

}  // namespace gnathion
