#include "design/splint.h"

#include <algorithm>

#include <fmt/format.h>
#include <tbb/parallel_invoke.h>

#include "core/time.h"
#include "design/contact_fit.h"
#include "design/extraction.h"
#include "design/gates.h"
#include "design/pressing.h"
#include "design/printing/build_direction.h"
#include "design/simplification.h"
#include "design/splint_field.h"
#include "design/verification_steps.h"
#include "occlusion/crowns.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kPressToleranceMm = 0.008;  // well within the gate of 0.02
constexpr double kIslandMm3 = 2.0;           // a dropped piece larger than this deserves a warning

/// Tells the progress and takes the time of each step.
class Steps {
 public:
  Steps(Progress& progress, StageTimes& times) : progress_(progress), times_(times) {}
  ~Steps() { finish(); }
  void begin(const std::string& name, double share) {
    finish();
    name_ = name;
    progress_.begin_step(name, share);
    watch_.restart();
  }
  void finish() {
    if (!name_.empty()) times_.emplace_back(name_, watch_.seconds());
    name_.clear();
  }

 private:
  Progress& progress_;
  StageTimes& times_;
  std::string name_;
  Stopwatch watch_;
};

void warn_of_pieces(const LargestPiece& pieces, std::vector<std::string>& warnings) {
  if (pieces.largest_island_mm3 > kIslandMm3)
    warnings.push_back(
        fmt::format("a piece of {:.1f} mm³ that nothing holds was removed", pieces.largest_island_mm3));
}

/// Walls that the imprint's limit could not lower.
void warn_of_imprint(const SplintVerification& v, const SplintParameters& p,
                     std::vector<std::string>& warnings) {
  for (const auto& place : v.imprint.held_by_wall)
    warnings.push_back(fmt::format(
        "imprint: the wall of {:.1f} mm{} stands {:.2f} mm beyond the natural relief over {:.1f} mm² at "
        "({:.1f}, {:.1f}, {:.1f})",
        p.wall_mm, place.teeth.empty() ? "" : fmt::format(" on tooth {}", place.teeth.front()),
        place.depth_mm, place.area_mm2, place.where_mm.x(), place.where_mm.y(), place.where_mm.z()));
}

void tell_label(const SplintField& field, SplintDesign& design) {
  const Preparation& preparation = field.preparation();
  if (preparation.label_texts.empty()) return;
  if (!field.label()) {
    design.warnings.push_back("no room for the label: " + preparation.label_texts.front());
    return;
  }
  const Label& label = *field.label();
  design.label = EmbossedLabel{label.text(), label.buccal(), label.letter_mm(), label.width_mm(),
                               preparation.design_from_dental.inverse() * label.centre_mm()};
  if (label.text() != preparation.label_texts.front())
    design.warnings.push_back("no room for the design's hash beside the label");
}

/// Surfaces that pictures and profiles show beside the splint.
void add_pictures(const SplintInputs& inputs, const FinishedSplint& splint, const Preparation& preparation,
                  SplintDesign& design) {
  const Rigid3 dental = preparation.design_from_dental.inverse();
  design.opposing_tp = transformed(inputs.opposing_motion(), inputs.opposing_mi());
  const TriangleMesh occlusal =
      inputs.occlusal_surface
          ? *inputs.occlusal_surface
          : region_mesh(inputs.support(), crown_region(inputs.support(), preparation.arch, inputs.arch,
                                                       design.parameters.stamp_height_mm));
  design.occlusal_surface_tp =
      preparation.flat ? transformed(dental, splint.region({SurfacePart::kStamp, SurfacePart::kImprint}))
                       : transformed(inputs.opposing_motion(), occlusal);
  design.cavity = transformed(dental, splint.region({SurfacePart::kCavity}));
  design.outer = transformed(dental, splint.region({SurfacePart::kOuter, SurfacePart::kStamp,
                                                    SurfacePart::kImprint, SurfacePart::kRelief}));
}

/// Nothing where an arch has no central incisor.
std::optional<BiteReadout> read_bite(const SplintInputs& inputs, const Preparation& preparation) {
  const ArchFrame& arch = preparation.arch;
  const auto &support_fdi = preparation.support_fdi, &opposing_fdi = preparation.opposing_fdi;
  const auto points = bite_points(inputs.maxilla, inputs.on_maxilla() ? support_fdi : opposing_fdi,
                                  inputs.mandible_mi, inputs.on_maxilla() ? opposing_fdi : support_fdi, arch);
  if (!points) return std::nullopt;
  return bite_readout(*points, arch, inputs.therapeutic.rigid);
}

SplintVerification::Build best_build(const SplintDesign& design, const FinishedSplint& splint) {
  static const std::vector<float> kNoThickness;
  const PlacedTree tree{splint.query, design.dental_from_design.inverse()};
  const BuildDirection best = find_build_direction({design.splint, kNoThickness, design.part},
                                                   design.insertion.direction, kSelfSupportingDeg, &tree);
  return {best.up, best.overhang_mm2, best.cavity_overhang_mm2};
}

/// All measurements, side by side: each fills its own part of the verification, and one the pictures'
/// surfaces. Returns the side walls' 1st percentile.
double verify(const SplintInputs& inputs, const FinishedSplint& splint, const SplintField& field,
              SplintDesign& design) {
  const Preparation& preparation = field.preparation();
  SplintVerification& out = design.verification;
  double side_wall_p01_mm = 0.0;
  tbb::parallel_invoke([&] { verify_topology(splint, out); },
                       [&] { verify_walls(splint, field, out, &side_wall_p01_mm, &design.thickness_mm); },
                       [&] { verify_fit(splint, preparation, inputs.arch, out); },
                       [&] { verify_contacts(inputs, splint, preparation, design.parameters, out); },
                       [&] { verify_seating(inputs, splint, preparation, out); },
                       [&] { out.build = best_build(design, splint); },
                       [&] { add_pictures(inputs, splint, preparation, design); },
                       [&] {
                         verify_freedom(splint, preparation, out);
                         // Along the way that must run free.
                         verify_imprint(splint, preparation, design.parameters, inputs.support(), out);
                       },
                       [&] {
                         const auto& fdi = preparation.support_fdi;
                         verify_insertability(splint, preparation, inputs.support(), out);
                         measure_retention(splint, field, inputs.support(), fdi, out.retention);
                         out.bite = read_bite(inputs, preparation);
                         out.apertures = found_apertures(field, inputs.support(), fdi, inputs.arch);
                         for (Aperture& drawn : drawn_apertures(inputs.edits, preparation.design_from_dental,
                                                                inputs.support(), fdi))
                           out.apertures.push_back(std::move(drawn));
                       });
  const Rigid3 dental = preparation.design_from_dental.inverse();
  out.thickness.where_mm = dental * out.thickness.where_mm;
  return side_wall_p01_mm;
}

void judge(SplintDesign& design, double side_wall_p01_mm) {
  design.gates = splint_gates(design.verification, design.parameters, side_wall_p01_mm);
  if (design.flat) design.gates.push_back(flat_tip_gate(*design.flat, design.parameters));
  for (const Gate& gate : design.gates)
    if (gate.blocks && !gate.pass) design.violated.push_back(gate.name);
  design.verdict = design.violated.empty() ? "pass" : "fail";
}

}  // namespace

Result<SplintDesign> design_splint(const SplintInputs& inputs, const SplintParameters& parameters,
                                   Progress& progress, const NamedJaws* known) {
  GNATHION_CHECK_OK(check_parameters(parameters));
  SplintDesign design;
  design.parameters = parameters;
  design.worn_on = inputs.arch;
  {
    Steps steps(progress, design.timing_s);
    steps.begin("preparation", 0.1);
    GNATHION_TRY(const Preparation preparation, prepare(inputs, parameters, {}, known));
    design.arch = preparation.arch;
    design.support_teeth = preparation.support_teeth;
    design.insertion = preparation.insertion;
    design.edits = inputs.edits;
    design.warnings = preparation.warnings;
    if (preparation.free_poses.empty() && (!inputs.excursions.empty() || parameters.excursion_mm > 0.0))
      design.warnings.push_back(
          "excursions were asked for, and none leaves TP by more than 0.3 mm: nothing is relieved");

    steps.begin("shells and stamp", 0.25);
    const SplintField field(preparation, parameters);
    tell_label(field, design);
    design.flat = preparation.flat;
    design.dental_from_design = preparation.design_from_dental.inverse();

    steps.begin("extraction", 0.25);
    LargestPiece pieces = largest_piece(extracted_splint(field), pieces_of(parameters));
    warn_of_pieces(pieces, design.warnings);
    if (pieces.mesh.empty())
      return fail(ErrorCode::kGate, "cannot design", "splint", "nothing remains between the jaws");

    steps.begin("simplification", 0.1);
    pieces.mesh = simplified(std::move(pieces.mesh), field);
    fit_contacts(pieces.mesh, field);

    steps.begin("pressing", 0.1);
    press_free_of_jaws(pieces.mesh, field, kPressToleranceMm);
    const FinishedSplint splint(std::move(pieces.mesh), field);

    steps.begin("verification", 0.35);
    design.splint = transformed(design.dental_from_design, splint.mesh());
    for (const SurfacePart part : splint.parts) design.part.push_back(static_cast<std::uint8_t>(part));
    const double side_wall_p01_mm = verify(inputs, splint, field, design);
    warn_of_imprint(design.verification, parameters, design.warnings);
    if (!design.verification.seating_note.empty())
      design.warnings.push_back(design.verification.seating_note + ": no predicted seating");
    judge(design, side_wall_p01_mm);
  }
  return design;
}

}  // namespace gnathion
