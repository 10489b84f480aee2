#include "design/bow/bow.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "design/bow/bodies.h"
#include "design/bow/bow_checks.h"
#include "design/preparation.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kRad = std::numbers::pi / 180;
// A mean hinge axis, from the lower incisal point (Bonwill's triangle; mean of adults), for an opening that
// is asked for without a recorded motion.
constexpr double kHingeBehind_mm = 88, kHingeAbove_mm = 35;
constexpr int kSteps = 8;  // of a path

/// x left, y posterior, z up, origin at the lower incisal point: the highest point of 31 and 41 by the
/// midline.
Rigid3 bow_frame(const ArchFrame& arch, const TriangleMesh& mandible, const std::vector<std::uint8_t>& fdi) {
  Rigid3 turned{arch.arch_from_dental.rotation, Vector3::Zero()};
  Vector3 best = turned * arch.incisal_mm;
  double height = -1e9;
  for (std::size_t v = 0; v < fdi.size(); ++v) {
    if (fdi[v] != 31 && fdi[v] != 41) continue;
    const Vector3 q = turned * mandible.vertices_mm[v];
    if (q.z() > height && std::abs(q.x() - (turned * arch.incisal_mm).x()) < 3) height = q.z(), best = q;
  }
  turned.translation_mm = -best;
  return turned;
}

/// MI, the positions given, and the paths that the parameters ask for; motions of the mandible, bow frame.
std::vector<Rigid3> jaw_positions(const BowInputs& inputs, const Rigid3& bow_from_dental,
                                  const BowParameters& p) {
  std::vector<Rigid3> out = {Rigid3::identity()};
  for (const Motion<Dental>& m : inputs.jaw_positions) {
    const Rigid3 target = bow_from_dental * m.rigid * bow_from_dental.inverse();
    const Vector6 screw = log_se3(target);
    for (int i = 1; i <= kSteps; ++i) out.push_back(exp_se3(screw * (static_cast<double>(i) / kSteps)));
  }
  for (int i = 1; i <= kSteps && p.opening_deg > 0; ++i)
    out.push_back(Rigid3::about_axis({0, kHingeBehind_mm, kHingeAbove_mm}, Vector3::UnitX(),
                                     p.opening_deg * kRad * i / kSteps));
  const Vector3 forward(0, -std::cos(p.protrusion_descent_deg * kRad),
                        -std::sin(p.protrusion_descent_deg * kRad));
  for (int i = 1; i <= kSteps && p.protrusion_mm > 0; ++i)
    out.push_back(Rigid3::from_translation(forward * p.protrusion_mm * i / kSteps));
  return out;
}

TriangleMesh near_teeth(const TriangleMesh& mesh, const Clutch& clutch) {
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = mesh.corner(t, 0).y() > clutch.front_y_mm() - 6;
  return submesh(mesh, keep);
}

}  // namespace

Result<BowDesign> design_bow(const BowInputs& inputs, const BowParameters& p, Progress& progress) {
  BowDesign out;
  progress.begin_step("reading the jaws' shape", 0.15);
  GNATHION_TRY(out.arch, find_arch(inputs.maxilla, inputs.mandible_mi));
  const std::vector<std::uint8_t> fdi = assign_teeth(inputs.mandible_mi, out.arch, Arch::kMandible);
  const Rigid3 bow_from_dental = bow_frame(out.arch, inputs.mandible_mi, fdi);
  out.bow_from_dental = Transform<Bow, Dental>(bow_from_dental);
  TriangleMesh maxilla = transformed(bow_from_dental, inputs.maxilla);
  TriangleMesh mandible = transformed(bow_from_dental, inputs.mandible_mi);
  GNATHION_TRY(const ArchFrame arch, find_arch(maxilla, mandible));
  ClutchScene scene{MeshQuery(closed_to_solid(mandible, -Vector3::UnitZ(), nullptr)),
                    MeshQuery(closed_to_solid(maxilla, Vector3::UnitZ(), nullptr)),
                    frame_of_jaw(mandible, arch, Arch::kMandible),
                    fdi,
                    mandible,
                    maxilla,
                    jaw_positions(inputs, bow_from_dental, p)};

  progress.begin_step("clutch", 0.2);
  GNATHION_TRY(const Clutch clutch, Clutch::build(scene, p));
  progress.begin_step("bow", 0.35);
  const PlateSolids plates(bow_plates(p), p);
  out.bow.surface = body_surface(
      bow_field(clutch, plates, p), p.fine_mm,
      [&](const Vector3& q) { return clutch.near(q) ? 0.004 : 0.02; }, out.warnings);
  out.bow.tags.name = "bow";
  out.bow.tags.up = Vector3::UnitZ();
  for (const TagPlate& plate : plates.plates()) out.bow.tags.tags.push_back(tag_on(plate, p.tag_side_mm));
  out.clutch = near_teeth(out.bow.surface, clutch);

  progress.begin_step("head frame", 0.15);
  const PlateSolids head(head_plates(p), p);
  out.head_frame.surface = body_surface(
      head_field(head, p), p.fine_mm, [](const Vector3&) { return 0.02; }, out.warnings);
  out.head_frame.tags.name = "head_frame";
  out.head_frame.tags.up = Vector3::UnitZ();
  for (const TagPlate& plate : head.plates())
    out.head_frame.tags.tags.push_back(tag_on(plate, p.tag_side_mm));

  progress.begin_step("verifying", 0.15);
  verify_bow(scene, clutch, p, out);
  return out;
}

nlohmann::json bow_design_json(const BowDesign& d, const BowParameters& parameters) {
  nlohmann::json gates = nlohmann::json::array();
  for (const Gate& g : d.gates)
    gates.push_back({{"name", g.name}, {"value", g.value}, {"limit", g.limit}, {"pass", g.pass}});
  nlohmann::json pose = nlohmann::json::array();
  const Matrix4 m = d.bow_from_dental.rigid.matrix();
  for (int r = 0; r < 4; ++r) pose.push_back({m(r, 0), m(r, 1), m(r, 2), m(r, 3)});
  const auto size = [](const PrintedBody& body) {
    const Vector3 s = bounding_box(body.surface).size_mm();
    return nlohmann::json{s.x(), s.y(), s.z()};
  };
  return {{"verdict", d.verdict},
          {"violated", d.violated},
          {"gates", gates},
          {"bow_from_dental", pose},
          {"bow_size_mm", size(d.bow)},
          {"head_frame_size_mm", size(d.head_frame)},
          {"volume_mm3", d.volume_mm3},
          {"mass_g", d.mass_g},
          {"bonding_area_mm2", d.bonding_area_mm2},
          {"parameters", bow_parameters_json(parameters)},
          {"warnings", d.warnings}};
}

}  // namespace gnathion
