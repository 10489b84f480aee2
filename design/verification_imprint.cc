// What the opposing arch pressed into the splint: whether it could lock the jaw.
#include <algorithm>
#include <cmath>
#include <optional>

#include "design/parallel.h"
#include "design/swept_depth.h"
#include "design/verification_steps.h"

namespace gnathion {
namespace {

constexpr double kOpeningMm = 6.0;  // deeper than any imprint
constexpr double kCellMm = 0.25;
constexpr double kReachMm = 1.5;       // a wall that far beside holds the tooth
constexpr double kInImprintMm = 0.35;  // from the opposing arch: contacts and the clearance about them
constexpr double kNone = -1e9;

/// Heights over a plane across the opening path, seen along it.
struct Relief {
  int nx = 0, ny = 0;
  std::vector<double> splint, opposing, natural;  // of the surfaces that face each other; kNone: none
  std::vector<Vector3> on_splint;
  std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(ny) + static_cast<std::size_t>(j);
  }
};

/// `up` is the direction towards the splint's arch. The opposing arch is asked for where the splint is.
Relief seen_along(const Vector3& up, const FinishedSplint& splint, const Preparation& preparation) {
  Matrix3 axes;
  axes.col(2) = up;
  axes.col(0) = Vector3(Vector3::UnitX() - up * up.x()).normalized();
  axes.col(1) = up.cross(axes.col(0));
  Box box;
  for (const Vector3& v : splint.mesh().vertices_mm) box.extend(axes.transpose() * v);
  const Rigid3 natural_from_tp = preparation.tp_from_mi.inverse();
  const double below = box.min_mm.z() - 1.0;
  Relief r;
  r.nx = static_cast<int>(box.size_mm().x() / kCellMm) + 1;
  r.ny = static_cast<int>(box.size_mm().y() / kCellMm) + 1;
  const std::size_t count = static_cast<std::size_t>(r.nx) * static_cast<std::size_t>(r.ny);
  r.splint.assign(count, kNone);
  r.opposing = r.natural = r.splint;
  r.on_splint.assign(count, Vector3::Zero());
  parallel_each(r.nx, [&](int i) {
    for (int j = 0; j < r.ny; ++j) {
      const Vector3 foot =
          axes * Vector3(box.min_mm.x() + (i + 0.5) * kCellMm, box.min_mm.y() + (j + 0.5) * kCellMm, below);
      const auto hit = splint.query.ray(foot, up);
      if (!hit) continue;
      const std::size_t c = r.index(i, j);
      r.splint[c] = below + hit->distance_mm;
      r.on_splint[c] = hit->point_mm;
      // From just inside the splint downwards: the first surface of the opposing arch.
      const Vector3 inside = hit->point_mm + 0.1 * up;
      if (const auto tooth = preparation.opposing.ray(inside, -up, 0.0, 8.0))
        r.opposing[c] = r.splint[c] + 0.1 - tooth->distance_mm;
      if (const auto relief = preparation.stamp_source().ray(natural_from_tp * (foot - 8.0 * up),
                                                             natural_from_tp.rotation * up, 0.0, 40.0))
        r.natural[c] = below - 8.0 + relief->distance_mm;
    }
  });
  return r;
}

/// How far the surface beside a cell stands out beyond `floor_mm` towards the opposing arch.
double stands_out(const Relief& r, const std::vector<double>& surface, int i, int j, double floor_mm) {
  const int reach = static_cast<int>(kReachMm / kCellMm);
  double most = 0.0;
  for (int di = -reach; di <= reach; ++di)
    for (int dj = -reach; dj <= reach; ++dj) {
      if (di * di + dj * dj > reach * reach || i + di < 0 || j + dj < 0 || i + di >= r.nx || j + dj >= r.ny)
        continue;
      const double height = surface[r.index(i + di, j + dj)];
      if (height > kNone) most = std::max(most, floor_mm - height);
    }
  return most;
}

}  // namespace

void verify_imprint(const FinishedSplint& splint, const Preparation& preparation, SplintVerification& out) {
  const Rigid3 dental = preparation.design_from_dental.inverse();
  // Along the occlusal normal, told in the design frame; z points to the splint's arch.
  Vector3 up = preparation.design_from_dental.rotation * preparation.arch.up;
  if (up.z() < 0.0) up = -up;

  const Relief r = seen_along(up, splint, preparation);
  std::vector<double> depth(r.splint.size(), 0.0);
  parallel_each(r.nx, [&](int i) {
    for (int j = 0; j < r.ny; ++j) {
      const std::size_t c = r.index(i, j);
      if (r.splint[c] == kNone || r.opposing[c] == kNone || r.splint[c] - r.opposing[c] > kInImprintMm)
        continue;
      depth[c] = std::max(
          0.0, stands_out(r, r.splint, i, j, r.splint[c]) - stands_out(r, r.natural, i, j, r.splint[c]));
    }
  });
  const auto deepest = std::max_element(depth.begin(), depth.end());
  if (deepest != depth.end() && *deepest > 0.0) {
    out.imprint.depth_mm = *deepest;
    out.imprint.deepest_where_mm = dental * r.on_splint[static_cast<std::size_t>(deepest - depth.begin())];
  }

  const SweptDepth theirs =
      deepest_on_way(preparation.opposing.mesh().vertices_mm, -up, kOpeningMm, splint.query);
  const SweptDepth ours = deepest_on_way(splint.mesh().vertices_mm, up, kOpeningMm, preparation.opposing);
  const bool from_ours = ours.depth_mm >= theirs.depth_mm;
  out.imprint.undercut_mm = from_ours ? ours.depth_mm : theirs.depth_mm;
  out.imprint.undercut_where_mm =
      dental * (from_ours ? ours.start_mm : Vector3(theirs.start_mm - theirs.way_mm * up));
  out.imprint.recorded_path = out.freedom.has_value();
}

}  // namespace gnathion
