// A phantom patient as a case folder: scans, bodies, rig and truth.
#pragma once

#include <cstdint>
#include <filesystem>

#include "core/progress.h"
#include "core/result.h"
#include "phantom/patient.h"

namespace gnathion {

/// Frames of the phantom's scans, each with its true pose relative to the Dental frame.
struct PhantomScanPoses {
  Transform<IntraoralTp, Dental> tp_scan_from_dental;     ///< of the maxilla, jaws in TP
  Transform<ClutchScan, Dental> clutch_scan_from_dental;  ///< of the mandible in MI
  Transform<FaceScanMi, Dental> face_mi_from_dental;      ///< of the head
  Transform<FaceScanTp, Dental> face_tp_from_dental;      ///< of the head, moved since
};
PhantomScanPoses phantom_scan_poses(std::uint64_t seed);

/// Writes scans/, bodies/, rig.toml, bow.toml, head_frame.toml, truth.json, truth/ and case.toml into `dir`,
/// which must exist. Same seed, same bytes. The recording is written by others.
Status write_phantom_case(const PhantomPatient& patient, std::uint64_t seed, const std::filesystem::path& dir,
                          Progress& progress);

}  // namespace gnathion
