#include "design/adaptive_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check.h"
#include "core/point_groups.h"
#include "core/triangle_distance.h"
#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr std::uint32_t kNone = 0xffffffffu;
constexpr double kBlockMm = 4.0;
constexpr std::size_t kMostNeighbours = 24;

/// The triangles about each vertex, in lists that grow and shrink.
using Fan = std::vector<std::uint32_t>;

/// A collapse of a vertex onto a neighbour, with the triangles that remain of its fan.
struct Collapse {
  std::uint32_t onto = kNone;
  double quality = -1.0;
};

/// Sine of a triangle's sharpest corner: twice the area over the product of the two longest sides.
double sine_of_sharpest(const Vector3& a, const Vector3& b, const Vector3& c) {
  const double ab = (b - a).squaredNorm(), bc = (c - b).squaredNorm(), ca = (a - c).squaredNorm();
  const double least = std::min({ab, bc, ca});
  return least > 0.0 ? std::sqrt((b - a).cross(c - a).squaredNorm() * least / (ab * bc * ca)) : 0.0;
}

class Simplifier {
 public:
  Simplifier(const TriangleMesh& mesh, const AdaptiveMeshOptions& options)
      : options_(options),
        least_sine_(std::sin(options.sharpest_corner_deg * M_PI / 180.0)),
        least_cosine_(std::cos(options.largest_turn_deg * M_PI / 180.0)),
        places_(mesh.vertices_mm),
        triangles_(mesh.triangles),
        fans_(places_.size()),
        block_(places_.size(), 0),
        first_ghost_(triangles_.size(), kNone),
        next_ghost_(places_.size(), kNone),
        touched_(places_.size(), 0),
        refused_(places_.size(), 0),
        tolerance_(places_.size(), 0.0) {
    parallel_each(places_.size(), [&](std::size_t v) { tolerance_[v] = options_.tolerance_mm(places_[v]); });
    for (std::uint32_t t = 0; t < triangles_.size(); ++t)
      for (const std::uint32_t v : triangles_[t]) fans_[v].push_back(t);
  }

  TriangleMesh run() {
    for (int round = 0; round < options_.rounds; ++round)
      if (!collapse_all(round)) break;
    TriangleMesh out;
    out.vertices_mm = std::move(places_);
    std::vector<bool> keep(triangles_.size());
    for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = triangles_[t][0] != kNone;
    for (std::size_t t = 0; t < keep.size(); ++t)
      if (!keep[t]) triangles_[t] = {0, 0, 0};
    out.triangles = std::move(triangles_);
    return submesh(out, keep);
  }

 private:
  /// One round over blocks whose borders lie elsewhere in each round: a block changes only what is all its
  /// own, so blocks do not meet. Returns whether enough was removed for another round to pay.
  bool collapse_all(int round) {
    std::vector<std::uint32_t> alive;
    for (std::uint32_t v = 0; v < fans_.size(); ++v)
      if (!fans_[v].empty()) alive.push_back(v);
    // The grid stands still, held by one far corner; the vertices move through it from round to round.
    std::vector<Vector3> shifted;
    const Vector3 shift = Vector3::Constant(kBlockMm * 0.37 * round);
    for (const std::uint32_t v : alive) shifted.push_back(places_[v] + shift);
    shifted.push_back(Vector3::Constant(-1000.0));
    const PointGroups groups = grouped_by_place(shifted, kBlockMm);
    for (std::uint32_t g = 0; g < groups.size(); ++g)
      for (const std::uint32_t* p = groups.begin(g); p != groups.end(g); ++p)
        if (*p < alive.size()) block_[alive[*p]] = g;
    std::fill(touched_.begin(), touched_.end(), 0);
    std::vector<std::size_t> removed(groups.size(), 0);
    tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) {
      for (const std::uint32_t* p = groups.begin(g); p != groups.end(g); ++p)
        if (*p < alive.size()) removed[g] += collapse(alive[*p]) ? 1 : 0;
    });
    std::size_t total = 0;
    for (const std::size_t n : removed) total += n;
    return total * 50 > alive.size();
  }

  /// Removes the vertex if a neighbour can take its place. Vertices whose surroundings changed in this round
  /// wait for the next one: removals spread evenly.
  bool collapse(std::uint32_t v) {
    if (touched_[v] || refused_[v] || tolerance_[v] <= 0.0) return false;
    std::array<std::uint32_t, kMostNeighbours> ring{};
    const std::size_t n = neighbours(v, ring);
    if (n == 0) return false;
    for (std::size_t i = 0; i < n; ++i)
      if (block_[ring[i]] != block_[v]) return false;
    Collapse best;
    for (std::size_t i = 0; i < n; ++i) {
      const double quality = quality_of(v, ring[i], best.quality);
      if (quality > best.quality && keeps_topology(v, ring[i], ring, n)) best = {ring[i], quality};
    }
    if (best.onto == kNone) {
      refused_[v] = 1;  // until its fan changes
      return false;
    }
    apply(v, best.onto);
    for (std::size_t i = 0; i < n; ++i) {
      touched_[ring[i]] = 1;
      refused_[ring[i]] = 0;
    }
    return true;
  }

  /// Distinct neighbours; 0 where there are too many.
  std::size_t neighbours(std::uint32_t v, std::array<std::uint32_t, kMostNeighbours>& ring) const {
    std::size_t n = 0;
    for (const std::uint32_t t : fans_[v])
      for (const std::uint32_t w : triangles_[t]) {
        if (w == v || std::find(ring.begin(), ring.begin() + static_cast<std::ptrdiff_t>(n), w) !=
                          ring.begin() + static_cast<std::ptrdiff_t>(n))
          continue;
        if (n == kMostNeighbours) return 0;
        ring[n++] = w;
      }
    return n;
  }

  /// The link condition of a closed manifold: the two ends have exactly two neighbours in common.
  bool keeps_topology(std::uint32_t v, std::uint32_t onto,
                      const std::array<std::uint32_t, kMostNeighbours>& ring, std::size_t n) const {
    if (fans_[v].size() <= 3 || fans_[onto].size() <= 3) return false;
    std::array<std::uint32_t, kMostNeighbours> other{};
    const std::size_t m = neighbours(onto, other);
    if (m == 0 || m + n > kMostNeighbours) return false;
    std::size_t common = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (ring[i] == onto || ring[i] == v) continue;
      for (std::size_t j = 0; j < m; ++j) common += ring[i] == other[j] ? 1 : 0;
    }
    return common == 2;
  }

  /// Sine of the sharpest corner among the triangles that would remain; -1 where the collapse is refused, or
  /// is not better than `least`.
  double quality_of(std::uint32_t v, std::uint32_t onto, double least) {
    struct Remaining {
      Vector3 a, b, c;
    };
    double worst_now = 1.0;  // what is bad already may stay as bad
    std::array<Remaining, kMostNeighbours> made{};
    std::size_t count = 0;
    double quality = 1.0;
    const Vector3& to = places_[onto];
    const double longest2 = options_.longest_edge_mm * options_.longest_edge_mm;
    for (const std::uint32_t t : fans_[v]) {
      const Triangle& corners = triangles_[t];
      if (corners[0] == onto || corners[1] == onto || corners[2] == onto) continue;
      const std::size_t k = corners[0] == v ? 0 : corners[1] == v ? 1 : 2;
      const Vector3 &p = places_[corners[(k + 1) % 3]], &q = places_[corners[(k + 2) % 3]];
      const Vector3 before = (p - places_[v]).cross(q - places_[v]), after = (p - to).cross(q - to);
      const double area2 = after.squaredNorm();
      worst_now = std::min(worst_now, sine_of_sharpest(places_[v], p, q));
      const double turn = before.dot(after);
      if (turn <= 0.0 || turn * turn < least_cosine_ * least_cosine_ * before.squaredNorm() * area2)
        return -1.0;
      const double pq = (p - q).squaredNorm(), qt = (q - to).squaredNorm(), tp = (to - p).squaredNorm();
      if (std::max(qt, tp) > longest2) return -1.0;
      // Twice the area over the product of the two longest sides: the sine between them, the sharpest
      // corner's.
      const double sides2 = pq * qt * tp / std::min({pq, qt, tp});
      quality = std::min(quality, std::sqrt(area2 / sides2));
      if (quality < least_sine_ || quality <= least || count == kMostNeighbours) return -1.0;
      made[count++] = {to, p, q};
    }
    if (count == 0 || quality < std::min(least_sine_, worst_now)) return -1.0;
    const auto near_enough = [&](std::uint32_t ghost) {
      const double tolerance = tolerance_[ghost];
      for (std::size_t i = 0; i < count; ++i)
        if (closest_on_triangle(places_[ghost], made[i].a, made[i].b, made[i].c).squared_distance <=
            tolerance * tolerance)
          return true;
      return false;
    };
    if (!near_enough(v)) return -1.0;
    for (const std::uint32_t t : fans_[v])
      for (std::uint32_t ghost = first_ghost_[t]; ghost != kNone; ghost = next_ghost_[ghost])
        if (!near_enough(ghost)) return -1.0;
    return quality;
  }

  void apply(std::uint32_t v, std::uint32_t onto) {
    // The vertex and those that its triangles stood for go to the nearest of the new triangles.
    std::vector<std::uint32_t> ghosts = {v};
    std::vector<std::uint32_t> remaining;
    for (const std::uint32_t t : fans_[v]) {
      for (std::uint32_t ghost = first_ghost_[t]; ghost != kNone; ghost = next_ghost_[ghost])
        ghosts.push_back(ghost);
      first_ghost_[t] = kNone;
      Triangle& corners = triangles_[t];
      if (corners[0] == onto || corners[1] == onto || corners[2] == onto) {
        for (const std::uint32_t w : corners)
          if (w != v) fans_[w].erase(std::find(fans_[w].begin(), fans_[w].end(), t));
        corners = {kNone, kNone, kNone};
        continue;
      }
      *std::find(corners.begin(), corners.end(), v) = onto;
      fans_[onto].push_back(t);
      remaining.push_back(t);
    }
    fans_[v].clear();
    for (const std::uint32_t ghost : ghosts) {
      std::uint32_t nearest = remaining.front();
      double least = 1e300;
      for (const std::uint32_t t : remaining) {
        const Triangle& c = triangles_[t];
        const double d =
            closest_on_triangle(places_[ghost], places_[c[0]], places_[c[1]], places_[c[2]]).squared_distance;
        if (d < least) {
          least = d;
          nearest = t;
        }
      }
      next_ghost_[ghost] = first_ghost_[nearest];
      first_ghost_[nearest] = ghost;
    }
  }

  const AdaptiveMeshOptions& options_;
  const double least_sine_, least_cosine_;
  std::vector<Vector3> places_;
  std::vector<Triangle> triangles_;  ///< kNone: removed
  std::vector<Fan> fans_;            ///< empty: removed
  std::vector<std::uint32_t> block_;
  std::vector<std::uint32_t> first_ghost_,
      next_ghost_;  ///< removed vertices by the triangle that stands for them
  std::vector<char> touched_, refused_;
  std::vector<double> tolerance_;
};

}  // namespace

TriangleMesh adaptive_mesh(const TriangleMesh& mesh, const AdaptiveMeshOptions& options) {
  return Simplifier(mesh, options).run();
}

}  // namespace gnathion
