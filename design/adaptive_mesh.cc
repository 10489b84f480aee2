#include "design/adaptive_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include <tbb/parallel_sort.h>

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

/// A triangle of a vertex's fan: its side opposite to the vertex, and what does not depend on where the
/// vertex goes.
struct Opposite {
  std::uint32_t p = kNone, q = kNone;
  Vector3 at_p, at_q;
  Vector3 normal;  ///< not normalised, as it is
  double normal2 = 0.0, length2 = 0.0;
};
/// A triangle that would remain: `to` and its opposite side.
struct Made {
  const Opposite* side = nullptr;
  Vector3 normal;  ///< not normalised
  double normal2 = 0.0;

  /// Whether p is near enough: mostly its height over the plane tells.
  bool has_within(const Vector3& p, const Vector3& to, double squared_mm2) const {
    const Vector3 from_to = p - to;
    const double height = normal.dot(from_to);
    if (height * height > squared_mm2 * normal2 * (1.0 + 1e-9)) return false;
    return closest_on_triangle(p, to, side->at_p, side->at_q).squared_distance <= squared_mm2;
  }
};
struct OppositeSides {
  std::array<Opposite, kMostNeighbours> sides;
  std::size_t count = 0;
};

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
    std::vector<std::uint32_t> size(places_.size(), 0);
    for (const Triangle& t : triangles_)
      for (const std::uint32_t v : t) ++size[v];
    parallel_each(fans_.size(), [&](std::size_t v) { fans_[v].reserve(size[v] + 2); });
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
    // The grid stands still; the vertices move through it from round to round.
    const Vector3 shift = Vector3::Constant(kBlockMm * 0.37 * round);
    parallel_each(places_.size(), [&](std::size_t v) { block_[v] = block_at(places_[v] + shift); });
    std::size_t alive = 0;
    std::vector<std::pair<std::uint64_t, std::uint32_t>> wanted;  // by block, then in order
    for (std::uint32_t v = 0; v < fans_.size(); ++v) {
      if (fans_[v].empty()) continue;
      ++alive;
      if (!refused_[v] && tolerance_[v] > 0.0) wanted.emplace_back(block_[v], v);
    }
    tbb::parallel_sort(wanted.begin(), wanted.end());
    std::vector<std::size_t> starts;
    for (std::size_t i = 0; i < wanted.size(); ++i)
      if (i == 0 || wanted[i].first != wanted[i - 1].first) starts.push_back(i);
    starts.push_back(wanted.size());
    std::fill(touched_.begin(), touched_.end(), 0);
    std::vector<std::size_t> removed(starts.size() - 1, 0);
    tbb::parallel_for(std::size_t{0}, removed.size(), [&](std::size_t g) {
      for (std::size_t i = starts[g]; i < starts[g + 1]; ++i)
        removed[g] += collapse(wanted[i].second) ? 1 : 0;
    });
    std::size_t total = 0;
    for (const std::size_t n : removed) total += n;
    return total * 50 > alive;
  }

  static std::uint64_t block_at(const Vector3& p) {
    std::uint64_t out = 0;
    for (int d = 0; d < 3; ++d)
      out = out << 21 |
            (static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(p[d] / kBlockMm)) + (1 << 20)) &
             0x1fffff);
    return out;
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
    OppositeSides opposite;
    if (!measure_opposite(v, opposite)) return false;
    Collapse best;
    for (std::size_t i = 0; i < n; ++i) {
      const double quality = quality_of(v, ring[i], opposite, best.quality);
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

  /// False where the fan is too large.
  bool measure_opposite(std::uint32_t v, OppositeSides& out) const {
    if (fans_[v].size() > kMostNeighbours) return false;
    for (const std::uint32_t t : fans_[v]) {
      const Triangle& corners = triangles_[t];
      const std::size_t k = corners[0] == v ? 0 : corners[1] == v ? 1 : 2;
      Opposite& side = out.sides[out.count++];
      side.p = corners[(k + 1) % 3];
      side.q = corners[(k + 2) % 3];
      side.at_p = places_[side.p];
      side.at_q = places_[side.q];
      side.normal = (side.at_p - places_[v]).cross(side.at_q - places_[v]);
      side.normal2 = side.normal.squaredNorm();
      side.length2 = (side.at_p - side.at_q).squaredNorm();
    }
    return true;
  }

  /// Sine of the sharpest corner among the triangles that would remain; -1 where the collapse is refused, or
  /// is not better than `least`.
  double quality_of(std::uint32_t v, std::uint32_t onto, const OppositeSides& opposite, double least) const {
    std::array<Made, kMostNeighbours> made;
    std::size_t count = 0;
    double quality = 1.0;
    const Vector3& to = places_[onto];
    const double longest2 = options_.longest_edge_mm * options_.longest_edge_mm;
    for (std::size_t i = 0; i < opposite.count; ++i) {
      const Opposite& side = opposite.sides[i];
      if (side.p == onto || side.q == onto) continue;
      const Vector3 from_p = side.at_p - to, from_q = side.at_q - to, after = from_p.cross(from_q);
      const double area2 = after.squaredNorm(), turn = side.normal.dot(after);
      if (turn <= 0.0 || turn * turn < least_cosine_ * least_cosine_ * side.normal2 * area2) return -1.0;
      const double qt = from_q.squaredNorm(), tp = from_p.squaredNorm();
      if (std::max(qt, tp) > longest2) return -1.0;
      // Twice the area over the product of the two longest sides: the sine between them, the sharpest
      // corner's.
      const double sides2 = side.length2 * qt * tp / std::min({side.length2, qt, tp});
      quality = std::min(quality, std::sqrt(area2 / sides2));
      if (quality < least_sine_ || quality <= least) return -1.0;
      made[count++] = {&side, after, area2};
    }
    if (count == 0) return -1.0;
    std::size_t last = 0;  // where the one before was near: often near again
    const auto near_enough = [&](std::uint32_t ghost) {
      const double tolerance = tolerance_[ghost];
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t n = (last + i) % count;
        if (!made[n].has_within(places_[ghost], to, tolerance * tolerance)) continue;
        last = n;
        return true;
      }
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
    std::vector<std::uint32_t> ghosts;
    ghosts.reserve(32);
    ghosts.push_back(v);
    std::array<std::uint32_t, kMostNeighbours> remaining{};
    std::size_t count = 0;
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
      remaining[count++] = t;
    }
    fans_[v].clear();
    for (const std::uint32_t ghost : ghosts) {
      std::uint32_t nearest = remaining[0];
      double least = 1e300;
      for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t t = remaining[i];
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
  std::vector<Triangle> triangles_;   ///< kNone: removed
  std::vector<Fan> fans_;             ///< empty: removed
  std::vector<std::uint64_t> block_;  ///< of each vertex in this round
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
