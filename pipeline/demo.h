// The phantom patient's session, from the film to the report, judged against its truth.
#pragma once

#include <cstdint>
#include <filesystem>

#include <nlohmann/json_fwd.hpp>

#include "core/progress.h"
#include "core/result.h"
#include "phantom/patient.h"
#include "pipeline/run_case.h"

namespace gnathion {

/// Scans, bodies, rig, truth and the recording of a virtual patient, into a folder that must exist.
Result<PhantomPatient> make_phantom_case(std::uint64_t seed, const std::filesystem::path& folder,
                                         Progress& progress);

/// The patient's CBCT in MI as scans/cbct.nrrd of such a case, named in its case.toml. About 30 MB.
Status add_phantom_cbct(const PhantomPatient& patient, std::uint64_t seed,
                        const std::filesystem::path& folder);

/// How far an estimate is from the truth, at the teeth.
struct MotionError {
  double largest_tooth_mm = 0;  ///< over all crown vertices of the mandible
  int worst_tooth_fdi = 0;
  double angle_deg = 0;
};

struct DemoResult {
  CaseResults results;
  MotionError dental_from_face;      ///< T
  MotionError camera, faces, fused;  ///< T_th by each route, and fused
};

/// Everything into `folder`, which must exist: CASE files, recording, results.
Result<DemoResult> run_demo(std::uint64_t seed, const SplintParameters& parameters,
                            const std::filesystem::path& folder, Progress& progress, bool with_cbct = false);

nlohmann::json demo_json(const DemoResult& demo);
std::string demo_text(const DemoResult& demo, const std::filesystem::path& folder);

}  // namespace gnathion
