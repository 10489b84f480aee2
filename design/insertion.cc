#include "design/insertion.h"

#include <algorithm>
#include <cmath>

#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr double kSpacingMm = 0.35;
constexpr double kHalfWidthMm = 9.0;  // crowns lie this near to the arch curve
constexpr double kTiltCost = 0.02;    // of the undercut along the normal, for the widest tilt
constexpr double kRadians = M_PI / 180.0;

GridShape crown_grid(const TriangleMesh& support, const OcclusalMap& level, double depth_mm) {
  Box box;
  for (const Vector3& v : support.vertices_mm)
    if (std::abs(level.off_curve_mm(v)) < kHalfWidthMm && v.z() < level.level_mm(v) + depth_mm) box.extend(v);
  GridShape shape;
  shape.spacing_mm = kSpacingMm;
  if (!(box.size_mm().array() > 0.0).all()) return shape;
  shape.origin_mm = box.min_mm - Vector3::Constant(kSpacingMm);
  shape.nodes = (box.size_mm() / kSpacingMm).array().ceil().cast<int>() + 3;
  return shape;
}

/// Node (i, j, k) of the crowns' neighbourhood: inside, free, or behind the cutting surface.
enum class Node : char { kFree, kInside, kBeyond };

std::vector<Node> classified(const TriangleMesh& support, const OcclusalMap& level, const GridShape& shape,
                             double depth_mm, const MarginSurface& margin) {
  const std::vector<char> inside = nodes_inside(support, shape);
  std::vector<Node> nodes(inside.size());
  parallel_each(shape.nodes.x(), [&](int i) {
    for (int j = 0; j < shape.nodes.y(); ++j) {
      const Vector3 foot = shape.position(i, j, 0);
      const double plane = level.level_mm(foot) + depth_mm;
      const double cut = margin.empty() ? plane : margin.cut_mm(foot, plane);
      const bool crowns =
          std::abs(level.off_curve_mm(foot)) < kHalfWidthMm && level.beyond_cover_mm(foot) < 0.0;
      for (int k = 0; k < shape.nodes.z(); ++k) {
        const std::size_t n = shape.index(i, j, k);
        const bool beyond = !crowns || shape.position(i, j, k).z() > cut;
        nodes[n] = beyond ? Node::kBeyond : inside[n] ? Node::kInside : Node::kFree;
      }
    }
  });
  return nodes;
}

/// Unit direction with the given tilts about the two horizontal axes.
Vector3 tilted(const Eigen::Vector2d& tilt_deg) {
  return Vector3(std::tan(tilt_deg.x() * kRadians), std::tan(tilt_deg.y() * kRadians), 1.0).normalized();
}

double angle_deg(const Vector3& a, const Vector3& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) / kRadians;
}

/// Free nodes that lie behind an inside node, seen along the direction; as a volume.
double undercut_mm3(const std::vector<Node>& nodes, const GridShape& shape, const Vector3& direction) {
  const double sx = direction.x() / direction.z(), sy = direction.y() / direction.z();
  const int nx = shape.nodes.x(), ny = shape.nodes.y(), nz = shape.nodes.z();
  const int reach_x = static_cast<int>(std::ceil(std::abs(sx) * nz)) + 1;
  const int reach_y = static_cast<int>(std::ceil(std::abs(sy) * nz)) + 1;
  const int wide_y = ny + 2 * reach_y;
  std::vector<char> shadow(static_cast<std::size_t>(nx + 2 * reach_x) * static_cast<std::size_t>(wide_y), 0);
  std::size_t count = 0;
  for (int k = 0; k < nz; ++k) {
    const int dx = static_cast<int>(std::lround(k * sx)), dy = static_cast<int>(std::lround(k * sy));
    for (int i = 0; i < nx; ++i)
      for (int j = 0; j < ny; ++j) {
        const Node node = nodes[shape.index(i, j, k)];
        char& dark = shadow[static_cast<std::size_t>(i - dx + reach_x) * static_cast<std::size_t>(wide_y) +
                            static_cast<std::size_t>(j - dy + reach_y)];
        if (node == Node::kInside) dark = 1;
        if (node == Node::kFree && dark) ++count;
      }
  }
  return static_cast<double>(count) * std::pow(shape.spacing_mm, 3);
}

struct Candidate {
  Eigen::Vector2d tilt_deg;
  double undercut_mm3 = 0.0, cost = 0.0;
};

/// What the search needs to judge a direction.
class Judge {
 public:
  Judge(const TriangleMesh& support, const OcclusalMap& level, Arch arch, const SplintParameters& p,
        const std::vector<MarginCurve>& margins, const Rigid3& upright_from_dental)
      : shape_(crown_grid(support, level,
                          std::max(p.depth_mm, deepest_margin_mm(margins, upright_from_dental, level)))),
        // x is the patient's left over the maxilla and right over the mandible, y posterior.
        start_(arch == Arch::kMaxilla ? p.insertion_left_deg : -p.insertion_left_deg,
               -p.insertion_anterior_deg),
        search_deg_(p.insertion_search_deg) {
    if ((shape_.nodes.array() > 0).all())
      nodes_ =
          classified(support, level, shape_, p.depth_mm, MarginSurface(margins, upright_from_dental, shape_));
    at_normal_ = nodes_.empty() ? 0.0 : undercut_mm3(nodes_, shape_, Vector3::UnitZ());
  }
  bool empty() const { return nodes_.empty(); }
  double at_normal_mm3() const { return at_normal_; }
  const Eigen::Vector2d& start() const { return start_; }

  /// The candidate with the least cost; of equals the first.
  Candidate best(const std::vector<Eigen::Vector2d>& tilts_deg) const {
    std::vector<Candidate> found(tilts_deg.size());
    parallel_each(found.size(), [&](std::size_t i) {
      const Vector3 a = tilted(tilts_deg[i]);
      const double away = angle_deg(a, tilted(start_));
      const double volume = undercut_mm3(nodes_, shape_, a);
      const double share = search_deg_ > 0.0 ? away / search_deg_ : 0.0;
      const bool allowed = away <= search_deg_ + 1e-9;
      found[i] = {tilts_deg[i], volume, allowed ? volume + kTiltCost * at_normal_ * share * share : 1e300};
    });
    return *std::min_element(found.begin(), found.end(),
                             [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
  }

 private:
  GridShape shape_;
  Eigen::Vector2d start_;
  double search_deg_ = 0.0, at_normal_ = 0.0;
  std::vector<Node> nodes_;
};

std::vector<Eigen::Vector2d> around(const Eigen::Vector2d& centre_deg, double step_deg, int rings) {
  std::vector<Eigen::Vector2d> out{centre_deg};
  for (int i = -rings; i <= rings; ++i)
    for (int j = -rings; j <= rings; ++j)
      if (i != 0 || j != 0) out.push_back(centre_deg + step_deg * Eigen::Vector2d(i, j));
  return out;
}

}  // namespace

std::vector<char> nodes_inside(const TriangleMesh& solid, const GridShape& shape) {
  const int nx = shape.nodes.x(), ny = shape.nodes.y(), nz = shape.nodes.z();
  struct Crossing {
    double z;
    int turn;  // +1 where a line along z enters
  };
  std::vector<std::vector<Crossing>> crossings(static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny));
  // A shift that no scan's grid shares keeps lines off vertices and edges.
  const double shift_x = 1.234567e-5, shift_y = 2.718281e-5;
  for (std::size_t t = 0; t < solid.triangles.size(); ++t) {
    Vector3 c[3];
    for (int k = 0; k < 3; ++k) {
      c[k] = (solid.corner(t, k) - shape.origin_mm) / shape.spacing_mm;
      c[k].x() -= shift_x;
      c[k].y() -= shift_y;
    }
    const double area =
        (c[1].x() - c[0].x()) * (c[2].y() - c[0].y()) - (c[1].y() - c[0].y()) * (c[2].x() - c[0].x());
    if (area == 0.0) continue;
    const auto low = [&](int d) { return std::min({c[0][d], c[1][d], c[2][d]}); };
    const auto high = [&](int d) { return std::max({c[0][d], c[1][d], c[2][d]}); };
    const int i0 = std::max(0, static_cast<int>(std::ceil(low(0)))),
              i1 = std::min(nx - 1, static_cast<int>(std::floor(high(0))));
    const int j0 = std::max(0, static_cast<int>(std::ceil(low(1)))),
              j1 = std::min(ny - 1, static_cast<int>(std::floor(high(1))));
    for (int i = i0; i <= i1; ++i)
      for (int j = j0; j <= j1; ++j) {
        double weight[3];
        for (int k = 0; k < 3; ++k) {
          const Vector3 &a = c[(k + 1) % 3], &b = c[(k + 2) % 3];
          weight[k] = ((a.x() - i) * (b.y() - j) - (a.y() - j) * (b.x() - i)) / area;
        }
        if (weight[0] < 0.0 || weight[1] < 0.0 || weight[2] < 0.0) continue;
        const double z = weight[0] * c[0].z() + weight[1] * c[1].z() + weight[2] * c[2].z();
        crossings[static_cast<std::size_t>(i) * static_cast<std::size_t>(ny) + static_cast<std::size_t>(j)]
            .push_back({z, area < 0.0 ? 1 : -1});
      }
  }
  std::vector<char> inside(shape.size(), 0);
  parallel_each(crossings.size(), [&](std::size_t column) {
    auto& hits = crossings[column];
    std::sort(hits.begin(), hits.end(), [](const Crossing& a, const Crossing& b) { return a.z < b.z; });
    std::size_t next = 0;
    int depth = 0;
    for (int k = 0; k < nz; ++k) {
      for (; next < hits.size() && hits[next].z <= k; ++next) depth += hits[next].turn;
      inside[column * static_cast<std::size_t>(nz) + static_cast<std::size_t>(k)] = depth > 0;
    }
  });
  return inside;
}

Insertion find_insertion(const TriangleMesh& support, const OcclusalMap& level, Arch arch,
                         const SplintParameters& p, const std::vector<MarginCurve>& margins,
                         const Rigid3& upright_from_dental) {
  const Judge judge(support, level, arch, p, margins, upright_from_dental);
  Insertion out;
  out.direction = tilted(judge.start());
  if (judge.empty()) return out;
  out.undercut_at_normal_mm3 = judge.at_normal_mm3();
  Candidate best = judge.best({judge.start()});
  if (p.insertion_search_deg > 0.0) {
    const double coarse_deg = p.insertion_search_deg / 5.0;
    best = judge.best(around(judge.start(), coarse_deg, 5));
    for (double step = 0.5 * coarse_deg; step > 0.2; step *= 0.5)
      best = judge.best(around(best.tilt_deg, step, 1));
  }
  out.direction = tilted(best.tilt_deg);
  out.tilt_deg = angle_deg(out.direction, Vector3::UnitZ());
  out.undercut_mm3 = best.undercut_mm3;
  return out;
}

}  // namespace gnathion
