// What the opposing arch pressed into the splint: whether it could lock the jaw.
#include <algorithm>
#include <cmath>
#include <optional>

#include "design/imprint_limit.h"
#include "design/parallel.h"
#include "design/swept_depth.h"
#include "design/verification_steps.h"

namespace gnathion {
namespace {

constexpr double kOpeningMm = 6.0;  // deeper than any imprint
constexpr double kCellMm = 0.25;
// Over w: where the imprint's limit meets the wall, which the construction takes from a coarse grid.
constexpr double kWallErrorMm = 0.1, kWallErrorSpacings = 0.5;
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

/// Calls body(cell) for the cells within reach.
template <class Body>
void each_beside(const Relief& r, int i, int j, const Body& body) {
  const int reach = static_cast<int>(kImprintReachMm / kCellMm);
  for (int di = -reach; di <= reach; ++di)
    for (int dj = -reach; dj <= reach; ++dj)
      if (di * di + dj * dj <= reach * reach && i + di >= 0 && j + dj >= 0 && i + di < r.nx && j + dj < r.ny)
        body(r.index(i + di, j + dj));
}

/// `axes` of the opening path. The opposing arch is asked for where the splint is.
Relief seen_along(const Matrix3& axes, const FinishedSplint& splint, const Preparation& preparation) {
  const Vector3 up = axes.col(2);
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

/// The lowest height of a surface within reach of a cell, no higher than `floor_mm`.
double lowest_beside(const Relief& r, const std::vector<double>& surface, int i, int j, double floor_mm) {
  double lowest = floor_mm;
  each_beside(r, i, j, [&](std::size_t c) {
    if (surface[c] > kNone) lowest = std::min(lowest, surface[c]);
  });
  return lowest;
}

/// By cell, how far the splint stands out beyond what the imprints beside it find in the natural relief.
std::vector<double> depth_beside_imprints(const Relief& r) {
  std::vector<double> floor(r.splint.size(), kNone);
  parallel_each(r.nx, [&](int i) {
    for (int j = 0; j < r.ny; ++j) {
      const std::size_t c = r.index(i, j);
      if (r.splint[c] == kNone || r.opposing[c] == kNone || r.splint[c] - r.opposing[c] > kInImprintMm)
        continue;
      floor[c] = lowest_beside(r, r.natural, i, j, r.splint[c]);
    }
  });
  std::vector<double> depth(r.splint.size(), 0.0);
  for (int i = 0; i < r.nx; ++i)
    for (int j = 0; j < r.ny; ++j) {
      const double here = floor[r.index(i, j)];
      if (here == kNone) continue;
      each_beside(r, i, j, [&](std::size_t c) {
        if (r.splint[c] > kNone) depth[c] = std::max(depth[c], here - r.splint[c]);
      });
    }
  return depth;
}

/// Whether cavity or tooth are within reach of the splint at each of the cells: the wall is all that stands.
std::vector<char> only_wall(const Relief& r, const std::vector<std::size_t>& cells,
                            const FinishedSplint& splint, const MeshQuery& support, double reach_mm) {
  std::vector<char> out(cells.size(), 0);
  if (cells.empty()) return out;
  std::vector<Vector3> points;
  for (const std::size_t c : cells) points.push_back(r.on_splint[c]);
  const auto mark = [&](const MeshQuery& inner) {
    const std::vector<ClosestHit> hits = closest_points(inner, points, reach_mm);
    for (std::size_t n = 0; n < cells.size(); ++n)
      if (hits[n].triangle != ClosestHit::kNoTriangle) out[n] = 1;
  };
  mark(support);
  TriangleMesh cavity = splint.region({SurfacePart::kCavity});
  if (!cavity.empty()) mark(MeshQuery(std::move(cavity)));
  return out;
}

/// Cells that touch each other, as places; the deepest first.
std::vector<SplintVerification::Imprint::Place> places_of(const Relief& r, const std::vector<double>& depth,
                                                          std::vector<char> wanted) {
  std::vector<SplintVerification::Imprint::Place> out;
  for (std::size_t seed = 0; seed < wanted.size(); ++seed) {
    if (!wanted[seed]) continue;
    SplintVerification::Imprint::Place place;
    std::vector<std::size_t> open{seed};
    wanted[seed] = 0;
    while (!open.empty()) {
      const std::size_t c = open.back();
      open.pop_back();
      place.area_mm2 += kCellMm * kCellMm;
      if (depth[c] > place.depth_mm) {
        place.depth_mm = depth[c];
        place.where_mm = r.on_splint[c];
      }
      const int i = static_cast<int>(c / static_cast<std::size_t>(r.ny)),
                j = static_cast<int>(c % static_cast<std::size_t>(r.ny));
      for (int di = -1; di <= 1; ++di)
        for (int dj = -1; dj <= 1; ++dj) {
          if (i + di < 0 || j + dj < 0 || i + di >= r.nx || j + dj >= r.ny) continue;
          const std::size_t beside = r.index(i + di, j + dj);
          if (!wanted[beside]) continue;
          wanted[beside] = 0;
          open.push_back(beside);
        }
    }
    out.push_back(place);
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const auto& a, const auto& b) { return a.depth_mm > b.depth_mm; });
  return out;
}

/// The places on one tooth as one, where the deepest of them is.
std::vector<SplintVerification::Imprint::Place> one_by_tooth(
    const std::vector<SplintVerification::Imprint::Place>& deepest_first) {
  std::vector<SplintVerification::Imprint::Place> out;
  for (const auto& place : deepest_first) {
    const auto same =
        std::find_if(out.begin(), out.end(), [&](const auto& other) { return other.teeth == place.teeth; });
    if (same == out.end())
      out.push_back(place);
    else
      same->area_mm2 += place.area_mm2;
  }
  return out;
}

void measure_depth(const Relief& r, const FinishedSplint& splint, const Preparation& preparation,
                   const SplintParameters& p, SplintVerification::Imprint& out) {
  const std::vector<double> depth = depth_beside_imprints(r);
  std::vector<std::size_t> deep;
  for (std::size_t c = 0; c < depth.size(); ++c) {
    if (depth[c] > out.depth_mm) {
      out.depth_mm = depth[c];
      out.deepest_where_mm = r.on_splint[c];
    }
    if (depth[c] > p.imprint_depth_mm)
      deep.push_back(c);
    else
      out.avoidable_mm = std::max(out.avoidable_mm, depth[c]);
  }
  const std::vector<char> held =
      only_wall(r, deep, splint, preparation.support,
                p.wall_mm + kWallErrorMm + kWallErrorSpacings * preparation.coarse.spacing_mm);
  std::vector<char> cells(depth.size(), 0);
  for (std::size_t n = 0; n < deep.size(); ++n) {
    cells[deep[n]] = held[n];
    if (!held[n]) out.avoidable_mm = std::max(out.avoidable_mm, depth[deep[n]]);
  }
  out.held_by_wall = places_of(r, depth, std::move(cells));
}

}  // namespace

void verify_imprint(const FinishedSplint& splint, const Preparation& preparation, const SplintParameters& p,
                    const TriangleMesh& support_dental, SplintVerification& out) {
  const Rigid3 dental = preparation.design_from_dental.inverse();
  const Vector3 up = opening_axes(preparation).col(2);
  measure_depth(seen_along(opening_axes(preparation), splint, preparation), splint, preparation, p,
                out.imprint);
  out.imprint.deepest_where_mm = dental * out.imprint.deepest_where_mm;
  for (auto& place : out.imprint.held_by_wall) {
    place.where_mm = dental * place.where_mm;
    place.teeth = tooth_at(place.where_mm, support_dental, preparation.support_fdi);
  }
  out.imprint.held_by_wall = one_by_tooth(out.imprint.held_by_wall);

  const SweptDepth theirs =
      deepest_on_way(preparation.opposing.mesh().vertices_mm, -up, kOpeningMm, splint.query);
  const SweptDepth ours = deepest_on_way(splint.mesh().vertices_mm, up, kOpeningMm, preparation.opposing);
  const bool from_ours = ours.depth_mm >= theirs.depth_mm;
  out.imprint.undercut_mm = from_ours ? ours.depth_mm : theirs.depth_mm;
  out.imprint.undercut_where_mm =
      dental * (from_ours ? ours.start_mm : Vector3(theirs.start_mm - theirs.way_mm * up));
}

}  // namespace gnathion
