// The mandibular bow for one patient: a clutch bonded to the labial surfaces of the lower front teeth, a stem
// between the lips, and a carrier with tags before the face; and the head frame that goes with it.
//
// Both are built in frames of their own (CAD): x the patient's left, y posterior, z up; the bow's origin is
// the lower incisal point in MI.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/camera_model.h"
#include "core/mesh.h"
#include "core/progress.h"
#include "core/result.h"
#include "core/transform.h"
#include "design/bow/bow_parameters.h"
#include "design/verification.h"
#include "occlusion/arch.h"

namespace gnathion {

struct BowInputs {
  TriangleMesh maxilla, mandible_mi;          ///< Dental, in MI
  std::vector<Motion<Dental>> jaw_positions;  ///< besides MI: the maxilla must be clear there, too
};

/// A printed body with places for tags.
struct PrintedBody {
  TriangleMesh surface;  ///< closed, in the body's frame
  TaggedBody tags;       ///< nominal layout, the same frame
};

struct BowDesign {
  PrintedBody bow, head_frame;
  Transform<Bow, Dental> bow_from_dental;  ///< as designed: where the bow's frame lies on the scans in MI
  TriangleMesh clutch;                     ///< the part of the bow at the teeth, for pictures; bow frame
  std::vector<Gate> gates;
  std::vector<std::string> violated, warnings;
  std::string verdict;  ///< "pass" or "fail"
  double volume_mm3 = 0, mass_g = 0;
  double bonding_area_mm2 = 0;  ///< clutch within 0.3 mm of the teeth
  ArchFrame arch;               ///< Dental
};

/// Builds and verifies. Jaws that occlusion/arch.h refuses are refused; a bow that fails a gate is a value.
Result<BowDesign> design_bow(const BowInputs& inputs, const BowParameters& parameters, Progress& progress);

nlohmann::json bow_design_json(const BowDesign& design, const BowParameters& parameters);

}  // namespace gnathion
