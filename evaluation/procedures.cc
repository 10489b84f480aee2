// The six procedures of the method, from scans to figures (docs/evaluation.md has the formulas).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "evaluation/distance_field.h"
#include "evaluation/planned_model.h"
#include "evaluation/scan_checks.h"
#include "evaluation/scan_fit.h"

namespace gnathion {
namespace {

constexpr double kDoubtfulMm = 0.2;          // mean |distance| of a jaw's scan: looked for again, and checked
constexpr double kLeastSeatAreaMm2 = 150.0;  // of a region that can be fitted by itself

/// A pose with its covariance: left perturbation, in Dental.
struct Pose {
  Rigid3 dental_from_scan;
  Matrix6 covariance = Matrix6::Zero();
};
Pose pose_of(const ScanFit& fit) {
  return {fit.model_from_scan, fit.report.covariance};
}

/// a·b⁻¹ of two poses of one scan: what moves the scan from where b puts it to where a does.
Uncertain<Motion<Dental>> between(const Pose& a, const Pose& b) {
  const Rigid3 b_inverse = b.dental_from_scan.inverse();
  return {Motion<Dental>(a.dental_from_scan * b_inverse),
          composed_covariance(a.covariance, a.dental_from_scan,
                              inverse_covariance(b.covariance, b.dental_from_scan))};
}

/// One evaluation on its way: the scans' facts, and what is found.
struct Work {
  const PlannedModel& model;
  const EvaluationCase& input;
  const EvaluationOptions& options;
  FieldOptions field;
  SplintEvaluation out;

  ScanFitOptions fit_options(const char* what, const char* region) const {
    ScanFitOptions o;
    o.noise_mm = options.noise_mm;
    o.points = options.points;
    o.seed = options.seed;
    o.name = fmt::format("{} of splint {}", what, input.name);
    o.region = region;
    return o;
  }
  void warn(std::string text) { out.warnings.push_back(std::move(text)); }
  ProcedureResult& add(Procedure p, DistanceField f, std::string fitted, std::string measured) {
    ProcedureResult r;
    r.procedure = p;
    r.field = std::move(f);
    r.fitted_region = std::move(fitted);
    r.measured_region = std::move(measured);
    out.procedures.push_back(std::move(r));
    return out.procedures.back();
  }
};

std::vector<bool> inverted(std::vector<bool> v) {
  v.flip();
  return v;
}

std::size_t count_of(const std::vector<bool>& v) {
  return static_cast<std::size_t>(std::count(v.begin(), v.end(), true));
}

/// Points of another body are named when they are more than stray ones.
void warn_of_foreign(Work& w, const char* scan, const char* body, const std::vector<bool>& foreign) {
  const double part =
      static_cast<double>(count_of(foreign)) / static_cast<double>(std::max<std::size_t>(1, foreign.size()));
  if (part > 0.02)
    w.warn(fmt::format(
        "the scan of the {} shows the {} still in place: {:.0f} % of its points lie on it and are left out",
        scan, body, 100.0 * part));
}

/// Procedure 1: scanned splint against its model. The scan of the free splint is taken where there is one.
Result<Pose> splint_against_model(Work& w, const ScanFacts& seated,
                                  const std::vector<PlannedSplint>& others) {
  const SearchableSurface& design = w.model.splint();
  ScanFitOptions o = w.fit_options("scan", "whole splint");
  o.with_scale = true;
  Result<ScanFit> first = fit_checked(*seated.mesh, design, o);
  GNATHION_CHECK_OK(
      belongs_to_this_design(*seated.mesh, w.model, first, others, w.options, w.input.name, &w.out.warnings));
  ScanFit fit = std::move(*first);
  // What the scan shows beside the splint takes no part in the second fit.
  const std::vector<bool> foreign = foreign_points(seated, design.distance, w.model.maxilla().distance,
                                                   fit.model_from_scan, w.options.reach_mm);
  if (count_of(foreign) > foreign.size() / 50) {
    o.scan_vertices = inverted(foreign);
    o.guess = fit.model_from_scan;
    GNATHION_TRY(fit, fit_scan(*seated.mesh, *design.mesh, design.query, o));
    w.warn(fmt::format("the scan of the splint shows teeth or palate too: {:.0f} % of its points, left out",
                       100.0 * static_cast<double>(count_of(foreign)) / static_cast<double>(foreign.size())));
  }
  GNATHION_CHECK_OK(covers_both_sides(*seated.mesh, fit.model_from_scan, w.model, "splint", design,
                                      w.input.name, &w.out.warnings));

  ScanFit shown = fit;
  ScanFacts facts = seated;
  std::vector<bool> left_out = foreign;
  if (w.input.scans.splint_free) {
    facts = facts_of(w.input.scans.splint_free, w.field);
    o = w.fit_options("scan of the free splint", "whole splint");
    o.with_scale = true;
    GNATHION_TRY(shown, fit_checked(*facts.mesh, design, o));
    left_out.clear();
  }
  ProcedureResult& r =
      w.add(Procedure::kSplintVsModel,
            measure_field(facts, design.mesh, design.distance, shown.model_from_scan, left_out, w.field),
            "whole splint", "whole splint");
  r.fit = shown.report;
  return pose_of(fit);
}

/// Which points of the maxilla's scan show a region of its model, at the pose of the splint.
std::vector<bool> points_on(const ScanFacts& scan, const SearchableSurface& model, const Rigid3& pose,
                            const std::vector<bool>& region, const std::vector<bool>& foreign,
                            double reach_mm) {
  std::vector<std::uint8_t> on(scan.mesh->vertices_mm.size(), 0);
  model.distance.for_each(scan.mesh->vertices_mm, pose, reach_mm,
                          [&](std::size_t i, const SurfaceFoot& foot) {
                            const Triangle& t = model.mesh->triangles[foot.triangle];
                            on[i] = region[t[0]] && region[t[1]] && region[t[2]] && !foot.on_boundary;
                          });
  std::vector<bool> result(on.begin(), on.end());
  for (std::size_t i = 0; i < foreign.size(); ++i)
    if (foreign[i]) result[i] = false;
  return result;
}

double area_of(const TriangleMesh& mesh, const std::vector<bool>& vertices) {
  double area = 0.0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& c = mesh.triangles[t];
    if (vertices[c[0]] && vertices[c[1]] && vertices[c[2]]) area += 0.5 * face_normal_scaled(mesh, t).norm();
  }
  return area;
}

/// The region that seats the maxilla: as asked, or the palate, the crowns, all, whichever is shown enough.
struct Seat {
  std::vector<bool> points;
  const char* name;
};
Seat choose_seat(Work& w, const ScanFacts& scan, const Pose& by_splint, const std::vector<bool>& foreign) {
  const SearchableSurface& maxilla = w.model.maxilla();
  std::vector<bool> crowns(maxilla.mesh->vertices_mm.size()), whole(crowns.size(), true);
  for (std::size_t v = 0; v < crowns.size(); ++v) crowns[v] = w.model.maxilla_fdi()[v] != 0;
  const auto on = [&](const std::vector<bool>& region) {
    return points_on(scan, maxilla, by_splint.dental_from_scan, region, foreign, w.options.reach_mm);
  };
  const SeatRegion asked = w.options.seat_region;
  if (asked == SeatRegion::kPalate || asked == SeatRegion::kAuto) {
    std::vector<bool> points = on(w.model.palate());
    if (asked == SeatRegion::kPalate || area_of(*scan.mesh, points) >= kLeastSeatAreaMm2)
      return {points, "palate"};
  }
  if (asked == SeatRegion::kCrowns || asked == SeatRegion::kAuto) {
    std::vector<bool> points = on(crowns);
    if (asked == SeatRegion::kCrowns || area_of(*scan.mesh, points) >= kLeastSeatAreaMm2)
      return {points, "crowns"};
  }
  return {on(whole), "whole scan"};
}

/// Procedures 2 and 4: scanned maxilla against model as the splint places it, and once it is seated.
Result<Pose> maxilla_against_model(Work& w, const ScanFacts& scan, const Pose& by_splint) {
  const SearchableSurface& maxilla = w.model.maxilla();
  const std::vector<bool> foreign = foreign_points(scan, maxilla.distance, w.model.splint().distance,
                                                   by_splint.dental_from_scan, w.options.reach_mm);
  warn_of_foreign(w, "maxilla", "splint", foreign);
  DistanceField placed =
      measure_field(scan, maxilla.mesh, maxilla.distance, by_splint.dental_from_scan, foreign, w.field);
  if (area_of(*scan.mesh, inverted(foreign)) < 0.5 * kLeastSeatAreaMm2 ||
      10 * placed.all.n < scan.mesh->vertices_mm.size())
    return bad_input(
        "cannot evaluate", fmt::format("scan of the maxilla of splint {}", w.input.name),
        foreign.size() < 2 * count_of(foreign)
            ? "it shows the splint still in place, and hardly any of the maxilla"
            : "hardly any of it lies at the maxilla: it must be in the frame of the splint's scan");
  w.add(Procedure::kMaxillaVsModel, std::move(placed), "whole splint (splint scan to its design)",
        "scanned maxilla");

  const Seat seat = choose_seat(w, scan, by_splint, foreign);
  ScanFitOptions o = w.fit_options("scan of the maxilla", seat.name);
  o.scan_vertices = seat.points;
  o.guess = by_splint.dental_from_scan;
  GNATHION_TRY(const ScanFit fit, fit_scan(*scan.mesh, *maxilla.mesh, maxilla.query, o));
  const Pose seated = pose_of(fit);
  ProcedureResult& r =
      w.add(Procedure::kMaxillaryClearance,
            measure_field(scan, maxilla.mesh, maxilla.distance, seated.dental_from_scan, foreign, w.field),
            seat.name, "scanned maxilla");
  r.fit = fit.report;
  // Told where the arch was found; the correction itself is reported.
  const Uncertain<Motion<Dental>> error = between(by_splint, seated);
  r.motion = figure_of(error.value, error.covariance, w.model.maxilla_crowns());
  r.motion->motion = error.value.inverse();
  r.motion->covariance = inverse_covariance(error.covariance, error.value.rigid);
  return seated;
}

/// Procedure 3: scanned mandible against model, fitted by itself. Its pose puts it in TP.
Result<Pose> mandible_against_model(Work& w, const ScanFacts& scan, const Pose& by_splint) {
  const SearchableSurface& mandible = w.model.mandible();
  ScanFitOptions o = w.fit_options("scan of the mandible", "whole mandible");
  o.guess = by_splint.dental_from_scan;
  Result<ScanFit> fit = fit_scan(*scan.mesh, *mandible.mesh, mandible.query, o);
  const bool near_tp = fit && fit->report.inlier_fraction > 0.6 &&
                       mean_distance_mm(*scan.mesh, mandible.query, fit->model_from_scan, 2.0) < kDoubtfulMm;
  if (!near_tp) {
    o.guess.reset();
    Result<ScanFit> searched = fit_checked(*scan.mesh, mandible, o);
    // A search that finds no clear pose leaves the near one; a scan that is refused by name is refused.
    if (searched || !fit || searched.error().what != "cannot align") fit = std::move(searched);
  }
  if (!fit) return tl::unexpected<Error>(fit.error());
  GNATHION_CHECK_OK(covers_both_sides(*scan.mesh, fit->model_from_scan, w.model, "mandible", mandible,
                                      w.input.name, &w.out.warnings));
  ProcedureResult& r =
      w.add(Procedure::kMandibleVsModel,
            measure_field(scan, mandible.mesh, mandible.distance, fit->model_from_scan, {}, w.field),
            "whole mandible", "scanned mandible");
  r.fit = fit->report;
  return pose_of(*fit);
}

/// Procedures 5 and 6: the mandible as `reference` places the scans, against TP.
void mandible_against_tp(Work& w, Procedure procedure, const ScanFacts& scan, const Pose& reference,
                         const Pose& in_tp, const char* fitted) {
  const SearchableSurface& mandible = w.model.mandible();
  ProcedureResult& r =
      w.add(procedure,
            measure_field(scan, mandible.mesh, mandible.distance, reference.dental_from_scan, {}, w.field),
            fitted, "scanned mandible");
  const Uncertain<Motion<Dental>> error = between(reference, in_tp);
  r.motion = figure_of(error.value, error.covariance, w.model.mandible_tp_crowns());
  if (r.motion->max_tooth_mm > 10.0)
    w.warn(fmt::format("{}: the mandible is {:.0f} mm from TP: are its scan and the splint's in one frame?",
                       procedure_name(procedure), r.motion->max_tooth_mm));
}

}  // namespace

Result<SplintEvaluation> evaluate_splint(const PlannedModel& model, const EvaluationCase& input,
                                         const std::vector<PlannedSplint>& others,
                                         const EvaluationOptions& options, Progress& progress) {
  Work w{model, input, options, {options.reach_mm, options.rim_mm, options.steep_deg}, {}};
  w.out.name = input.name;
  w.out.planned = model.planned();
  w.out.mandible_tp = model.mandible_tp();
  w.out.arch = model.arch();
  if (!input.scans.splint) return bad_input("cannot evaluate", input.name, "no scan of the splint");

  progress.begin_step("the splint", 0.4);
  const ScanFacts splint = facts_of(input.scans.splint, w.field);
  GNATHION_TRY(const Pose by_splint, splint_against_model(w, splint, others));
  w.out.dental_from_seated = by_splint.dental_from_scan;

  progress.begin_step("the maxilla", 0.2);
  std::optional<Pose> by_maxilla;
  if (input.scans.maxilla) {
    GNATHION_TRY(by_maxilla, maxilla_against_model(w, facts_of(input.scans.maxilla, w.field), by_splint));
  }

  progress.begin_step("the mandible", 0.2);
  if (input.scans.mandible) {
    const ScanFacts scan = facts_of(input.scans.mandible, w.field);
    GNATHION_TRY(const Pose in_tp, mandible_against_model(w, scan, by_splint));
    mandible_against_tp(w, Procedure::kMandibularSliding, scan, by_splint, in_tp,
                        "whole splint (splint scan to its design)");
    if (by_maxilla) {
      const std::string seat = w.out.find(Procedure::kMaxillaryClearance)->fitted_region;
      mandible_against_tp(w, Procedure::kMandibularTransformation, scan, *by_maxilla, in_tp,
                          (seat + " of the maxilla").c_str());
    }
  }
  std::sort(w.out.procedures.begin(), w.out.procedures.end(),
            [](const ProcedureResult& a, const ProcedureResult& b) { return a.procedure < b.procedure; });

  progress.begin_step("the splint as a body", 0.2);
  if (options.integrity) w.out.integrity = check_integrity(model, w.out, input.scans);
  return std::move(w.out);
}

Result<SplintEvaluation> evaluate_splint(const EvaluationCase& input,
                                         const std::vector<PlannedSplint>& others,
                                         const EvaluationOptions& options, Progress& progress) {
  GNATHION_TRY(const std::shared_ptr<const PlannedModel> model, PlannedModel::make(input.planned, options));
  return evaluate_splint(*model, input, others, options, progress);
}

}  // namespace gnathion
