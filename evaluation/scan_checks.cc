#include "evaluation/scan_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <set>

namespace gnathion {
namespace {

constexpr double kCapMm = 2.0;          // of a single point's distance in a mean
constexpr double kDoubtfulMm = 0.08;    // mean |distance| of a splint's scan that needs no second look
constexpr double kMirrorMm = 0.15;      // arches are less symmetric than this
constexpr double kBadMm = 0.25;         // and of one that deserves a warning
constexpr double kClearlyBetter = 0.7;  // another explanation needs this part of the mean
constexpr double kCellMm = 3.0;         // of the occlusal plane, for coverage

TriangleMesh mirrored(const TriangleMesh& mesh) {
  TriangleMesh m = mesh;
  for (Vector3& v : m.vertices_mm) v.x() = -v.x();
  flip_orientation(m);  // its normals still point outwards
  return m;
}

TriangleMesh inside_out(const TriangleMesh& mesh) {
  TriangleMesh m = mesh;
  flip_orientation(m);
  return m;
}

double mean_or_cap(const TriangleMesh& scan, const MeshQuery& model, const Result<ScanFit>& fit) {
  return fit ? mean_distance_mm(scan, model, fit->model_from_scan, kCapMm) : kCapMm;
}

}  // namespace

Result<ScanFit> fit_checked(const TriangleMesh& scan, const SearchableSurface& model,
                            const ScanFitOptions& options) {
  Result<ScanFit> fit = fit_scan(scan, *model.mesh, model.query, options);
  const double mean_mm = mean_or_cap(scan, model.query, fit);
  if (fit && mean_mm < kMirrorMm) return fit;
  struct Other {
    TriangleMesh mesh;
    const char* why;
  };
  for (const Other& other : {Other{mirrored(scan), "it is mirrored: its mirror image fits"},
                             Other{inside_out(scan), "it is inside out: its normals point into the body"}}) {
    ScanFitOptions o = options;
    o.points = std::min<std::size_t>(options.points, 3000);
    const Result<ScanFit> tried = fit_scan(other.mesh, *model.mesh, model.query, o);
    if (!tried) continue;
    const double other_mm = mean_or_cap(other.mesh, model.query, tried);
    // Unsigned distances cannot tell a surface from itself inside out: without a fit of its own they need
    // not.
    const bool better = fit ? other_mm < kClearlyBetter * mean_mm : other_mm < kBadMm;
    if (better) return bad_input("cannot evaluate", options.name, other.why);
  }
  return fit;
}

Status belongs_to_this_design(const TriangleMesh& scan, const PlannedModel& model, const Result<ScanFit>& fit,
                              const std::vector<PlannedSplint>& others, const EvaluationOptions& options,
                              const std::string& splint, std::vector<std::string>* warnings) {
  const double own_mm = mean_or_cap(scan, model.splint().query, fit);
  if (own_mm < kDoubtfulMm) return {};
  const PlannedSplint* best = nullptr;
  double best_mm = kClearlyBetter * own_mm;
  for (const PlannedSplint& other : others) {
    if (other.splint == model.planned().splint) continue;
    const MeshQuery query(*other.splint);
    ScanFitOptions o;
    // Splints of one patient share their inside: the pose on one is near that on the other.
    if (fit) o.guess = fit->model_from_scan;
    o.points = 3000;
    o.seed = options.seed;
    o.with_scale = true;
    o.name = other.name;
    const double mm = mean_or_cap(scan, query, fit_scan(scan, *other.splint, query, o));
    if (mm < best_mm) best_mm = mm, best = &other;
  }
  const std::string where = fmt::format("scan of splint {}", splint);
  if (best != nullptr) {
    const std::string why = fmt::format(
        "it fits design '{}' better ({:.2f} mm on average, '{}': {:.2f} mm): the wrong splint's scan",
        best->name, best_mm, model.planned().name, own_mm);
    if (options.refuse_foreign || !fit) return bad_input("cannot evaluate", where, why);
    warnings->push_back(where + ": " + why);
  } else if (fit && own_mm > kBadMm) {
    warnings->push_back(fmt::format("{} fits its design badly ({:.2f} mm on average): another splint's scan?",
                                    where, own_mm));
  }
  if (!fit) return tl::unexpected<Error>(fit.error());
  return {};
}

Status covers_both_sides(const TriangleMesh& scan, const Rigid3& dental_from_scan, const PlannedModel& model,
                         const char* what, const SearchableSurface& surface, const std::string& splint,
                         std::vector<std::string>* warnings) {
  // Cells of the occlusal plane that the model fills, and those of them that the scan reaches.
  using Cell = std::pair<int, int>;
  const auto cell_of = [&](const Vector3& p) {
    const Vector3 at = model.arch().to_arch(p);
    return Cell{static_cast<int>(std::floor(at.x() / kCellMm)),
                static_cast<int>(std::floor(at.y() / kCellMm))};
  };
  std::set<Cell> filled, reached;
  for (const Vector3& v : surface.mesh->vertices_mm) filled.insert(cell_of(v));
  std::vector<std::uint8_t> near(scan.vertices_mm.size(), 0);
  surface.distance.for_each(scan.vertices_mm, dental_from_scan, 1.0,
                            [&](std::size_t i, const SurfaceFoot&) { near[i] = 1; });
  for (std::size_t i = 0; i < near.size(); ++i)
    if (near[i] != 0) reached.insert(cell_of(dental_from_scan * scan.vertices_mm[i]));
  double of[2] = {0.0, 0.0}, covered[2] = {0.0, 0.0};
  for (const Cell& c : filled) {
    const int side = c.first >= 0;  // the patient's left
    of[side] += 1.0;
    covered[side] += reached.count(c) != 0 ? 1.0 : 0.0;
  }
  const double right = covered[0] / std::max(1.0, of[0]), left = covered[1] / std::max(1.0, of[1]);
  const std::string where = fmt::format("scan of the {} of splint {}", what, splint);
  if (std::max(left, right) < 0.2)
    return bad_input("cannot evaluate", where, "it shows hardly any of the arch");
  if (std::min(left, right) < 0.55 * std::max(left, right))
    warnings->push_back(
        fmt::format("the scan of the {} shows half an arch: {:.0f} % of the {} side, {:.0f} % of the {}",
                    what, 100.0 * std::min(left, right), left < right ? "left" : "right",
                    100.0 * std::max(left, right), left < right ? "right" : "left"));
  return {};
}

}  // namespace gnathion
