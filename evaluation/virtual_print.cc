#include "evaluation/virtual_print.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/mesh_query.h"
#include "core/random.h"
#include "evaluation/planned_model.h"
#include "evaluation/virtual_print_models.h"

namespace gnathion {
namespace {

constexpr double kCavityReach_mm = 0.8;    // the cavity lies this near to the teeth it fits
constexpr double kCoveredReach_mm = 1.2;   // what lies this near under the splint is not seen
constexpr double kContactReach_mm = 0.15;  // bites within this in TP
constexpr std::size_t kFewestContacts = 50;

/// Vertices of `mesh` within `reach_mm` of `other`; with `facing`, only those whose normal points against it.
std::vector<std::uint8_t> near(const TriangleMesh& mesh, const MeshQuery& other, double reach_mm,
                               bool facing) {
  const std::vector<Vector3> normals = vertex_normals(mesh);
  std::vector<std::uint8_t> out(mesh.vertices_mm.size(), 0);
  for (std::size_t v = 0; v < out.size(); ++v) {
    const auto found = other.closest(mesh.vertices_mm[v], reach_mm);
    out[v] = found && (!facing || found->normal.dot(normals[v]) < 0);
  }
  return out;
}

/// The part of a mesh whose triangles have all corners marked (or none, for `wanted` false).
TriangleMesh part(const TriangleMesh& mesh, const std::vector<std::uint8_t>& marked, bool wanted) {
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) {
    const Triangle& i = mesh.triangles[t];
    keep[t] = wanted ? marked[i[0]] && marked[i[1]] && marked[i[2]]
                     : !marked[i[0]] && !marked[i[1]] && !marked[i[2]];
  }
  return submesh(mesh, keep);
}

SharedMesh shared(TriangleMesh mesh) {
  return std::make_shared<const TriangleMesh>(std::move(mesh));
}

/// Scans are exported in any frame.
Rigid3 any_frame(Random& random) {
  return {random.rotation(), 40 * random.normal3()};
}

PredictedFigure figure_of(std::vector<double> values) {
  PredictedFigure f;
  if (values.empty()) return f;
  std::sort(values.begin(), values.end());
  for (const double v : values) f.mean += v / static_cast<double>(values.size());
  const auto quantile = [&](double q) {
    const double place = q * static_cast<double>(values.size() - 1);
    const auto low = static_cast<std::size_t>(place);
    const std::size_t high = std::min(low + 1, values.size() - 1);
    return values[low] + (place - static_cast<double>(low)) * (values[high] - values[low]);
  };
  f.low = quantile(0.05);
  f.high = quantile(0.95);
  return f;
}

PredictedProcedure predicted(ProcedureTable table) {
  PredictedProcedure p;
  std::vector<double> avg, std, alpha, t, tooth;
  for (const SplintRow& r : table.splints) {
    avg.push_back(r.avg_mm);
    std.push_back(r.std_mm);
    if (r.alpha_deg) alpha.push_back(*r.alpha_deg);
    if (r.t_mm) t.push_back(*r.t_mm);
    if (r.max_tooth_mm) tooth.push_back(*r.max_tooth_mm);
  }
  p.avg_mm = figure_of(avg);
  p.std_mm = figure_of(std);
  if (!alpha.empty()) p.alpha_deg = figure_of(alpha);
  if (!t.empty()) p.t_mm = figure_of(t);
  if (!tooth.empty()) p.max_tooth_mm = figure_of(tooth);
  p.table = std::move(table);
  return p;
}

/// Keeps a trial's rows, not its surfaces: a hundred trials fit into memory.
void drop_surfaces(SplintEvaluation& e) {
  e.planned = {};
  e.mandible_tp = nullptr;
  for (ProcedureResult& p : e.procedures) {
    p.field.scan = p.field.reference = nullptr;
    p.field.distance_mm = {};
    p.field.use = {};
  }
}

}  // namespace

std::vector<std::pair<std::string, double*>> magnitudes(VirtualPrintOptions& o) {
  return {{"print.scale_sigma", &o.print.scale_sigma},
          {"print.common_scale_sigma", &o.print.common_scale_sigma},
          {"print.growth_sigma_mm", &o.print.growth_sigma_mm},
          {"print.blur_mm", &o.print.blur_mm},
          {"print.warp_sigma_mm", &o.print.warp_sigma_mm},
          {"print.roughness_mm", &o.print.roughness_mm},
          {"print.waviness_mm", &o.print.waviness_mm},
          {"print.waviness_length_mm", &o.print.waviness_length_mm},
          {"seating.shift_sigma_mm", &o.seating.shift_sigma_mm},
          {"seating.turn_sigma_deg", &o.seating.turn_sigma_deg},
          {"seating.slide_sigma_mm", &o.seating.slide_sigma_mm},
          {"seating.bite_sigma_mm", &o.seating.bite_sigma_mm},
          {"seating.slide_turn_sigma_deg", &o.seating.slide_turn_sigma_deg},
          {"scan.noise_mm", &o.scan.noise_mm},
          {"scan.waviness_mm", &o.scan.waviness_mm},
          {"scan.waviness_length_mm", &o.scan.waviness_length_mm},
          {"scan.scale_sigma", &o.scan.scale_sigma},
          {"scan.stitch_sigma_mm", &o.scan.stitch_sigma_mm}};
}

Status set_magnitude(VirtualPrintOptions& options, const std::string& text) {
  const std::size_t equals = text.find('=');
  const std::string name = text.substr(0, equals);
  std::string names;
  for (const auto& [known, value] : magnitudes(options)) {
    names += (names.empty() ? "" : ", ") + known;
    if (known != name || equals == std::string::npos) continue;
    char* end = nullptr;
    const std::string number = text.substr(equals + 1);
    const double parsed = std::strtod(number.c_str(), &end);
    if (number.empty() || *end != 0 || !std::isfinite(parsed))
      return fail(ErrorCode::kUsage, "cannot set magnitude", name, "'" + number + "' is not a number");
    *value = parsed;
    return {};
  }
  return fail(ErrorCode::kUsage, "cannot set magnitude", text, "NAME=VALUE with one of " + names);
}

Status check_options(const VirtualPrintOptions& options) {
  VirtualPrintOptions copy = options;
  for (const auto& [name, value] : magnitudes(copy)) {
    const bool length = name.find("_length_mm") != std::string::npos;
    const double high = length ? 1000 : name.find("scale") != std::string::npos ? 0.05 : 3;
    if (*value < (length ? 0.5 : 0) || *value > high)
      return fail(ErrorCode::kUsage, "magnitude out of range", name,
                  fmt::format("{} is not in {}..{}", *value, length ? 0.5 : 0, high));
  }
  if (options.trials < 1 || options.trials > 10000)
    return fail(ErrorCode::kUsage, "cannot print virtually", "trials",
                fmt::format("{} is not in 1..10000", options.trials));
  return {};
}

Result<VirtualPatient> prepare_patient(const PlannedSplint& planned, const EvaluationOptions& options) {
  VirtualPatient p;
  GNATHION_TRY(p.model, PlannedModel::make(planned, options));
  const MeshQuery& maxilla = p.model->maxilla().query;
  const MeshQuery& mandible = p.model->mandible().query;
  const MeshQuery& splint = p.model->splint().query;
  p.cavity = near(*planned.splint, maxilla, kCavityReach_mm, true);
  if (std::count(p.cavity.begin(), p.cavity.end(), 1) < static_cast<std::ptrdiff_t>(kFewestContacts))
    return bad_input("cannot print virtually", planned.name,
                     "the splint does not fit the maxilla: no surface within 0.8 mm of it");
  p.contact = near(*planned.splint, mandible, kContactReach_mm, true);
  // Without enough contacts the mandible is taken to follow the splint as a whole.
  if (std::count(p.contact.begin(), p.contact.end(), 1) < static_cast<std::ptrdiff_t>(kFewestContacts))
    p.contact.assign(p.contact.size(), 1);
  p.uncovered = near(*planned.maxilla, splint, kCoveredReach_mm, false);
  for (std::uint8_t& u : p.uncovered) u = !u;
  return p;
}

VirtualTrial virtual_trial(const VirtualPatient& patient, const VirtualPrintOptions& options,
                           std::size_t trial) {
  Random random(options.seed, trial);
  const PlannedSplint& planned = patient.model->planned();
  const ArchFrame& arch = patient.model->arch();
  const TriangleMesh print = print_virtually(*planned.splint, arch, options.print, random);

  // The deformed splint comes to rest where its cavity fits best, give or take the play that there is.
  const SeatingModel& s = options.seating;
  VirtualTrial out;
  out.seating = drawn_motion(arch, Vector3::Constant(s.shift_sigma_mm), s.turn_sigma_deg, random);
  out.sliding = drawn_motion(arch, {s.slide_sigma_mm, s.slide_sigma_mm, s.bite_sigma_mm},
                             s.slide_turn_sigma_deg, random);
  const std::vector<Vector3>& designed = planned.splint->vertices_mm;
  const Rigid3 dental_from_print = out.seating * best_motion(print.vertices_mm, designed, patient.cavity);
  // Its imprint moves with it, and carries the mandible.
  const Rigid3 imprint = best_motion(designed, print.vertices_mm, patient.contact);
  out.mandible = dental_from_print * imprint * out.sliding;

  const TriangleMesh seated = transformed(dental_from_print, print);
  const TriangleMesh mandible = transformed(out.mandible, *patient.model->mandible_tp());
  const TriangleMesh maxilla = part(*planned.maxilla, patient.uncovered, true);
  const Rigid3 scan_from_dental = any_frame(random), free_from_print = any_frame(random);
  const auto scanned = [&](const TriangleMesh& surface, const Rigid3& pose) {
    return shared(transformed(pose, scan_virtually(surface, arch, options.scan, random)));
  };
  EvaluationCase& c = out.scanned;
  c.name = fmt::format("trial {}", trial + 1);
  c.planned = planned;
  c.scans.splint = scanned(part(seated, patient.cavity, false), scan_from_dental);
  c.scans.maxilla = maxilla.triangles.size() < 200 ? nullptr : scanned(maxilla, scan_from_dental);
  c.scans.mandible = scanned(mandible, scan_from_dental);
  c.scans.splint_free = scanned(print, free_from_print);
  return out;
}

Result<VirtualPrint> virtual_print(const PlannedSplint& planned, const VirtualPrintOptions& options,
                                   Progress& progress) {
  GNATHION_CHECK_OK(check_options(options));
  GNATHION_TRY(const VirtualPatient patient, prepare_patient(planned, options.evaluation));
  VirtualPrint out;
  out.design = planned.name;
  std::vector<SplintEvaluation> kept;
  for (std::size_t trial = 0; trial < options.trials; ++trial) {
    const VirtualTrial t = virtual_trial(patient, options, trial);
    SilentProgress silent;
    Result<SplintEvaluation> e = evaluate_splint(*patient.model, t.scanned, {}, options.evaluation, silent);
    if (!e) {
      out.refused.push_back(t.scanned.name + ": " + e.error().line());
    } else {
      drop_surfaces(*e);
      for (const std::string& w : e->warnings) out.warnings.push_back(t.scanned.name + ": " + w);
      kept.push_back(std::move(*e));
    }
    progress.update(static_cast<double>(trial + 1) / static_cast<double>(options.trials));
  }
  if (kept.empty())
    return bad_input("cannot print virtually", planned.name,
                     "every trial was refused; the first: " + out.refused.front());
  for (ProcedureTable& table : tables_of(kept, options.statistics))
    out.procedures.push_back(predicted(std::move(table)));
  for (ProcedureTable& table : core_tables_of(kept, options.statistics))
    out.core.push_back(predicted(std::move(table)));
  return out;
}

}  // namespace gnathion
