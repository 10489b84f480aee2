#include "design/simplification.h"

#include <algorithm>
#include <map>
#include <utility>

#include "core/mesh_query.h"
#include "design/adaptive_mesh.h"

namespace gnathion {
namespace {

constexpr double kToleranceOnTeethMm = 0.003, kToleranceMm = 0.01;
// A contact ends at a gap of 0.05 mm: a surface that lies 0.001 mm low loses a fiftieth of the contact's area.
constexpr double kToleranceInContactsMm = 0.001;
constexpr double kMaybeContactMm = 0.2;  // by coarse distances
constexpr double kSharp = 0.25;  // of Preparation's sharpness: about 40° of turn
constexpr double kAroundTipsMm = 0.3;
constexpr double kAroundCrossingsMm = 0.6;
constexpr int kAttempts = 4, kUntanglingRounds = 12;

/// Cells of the coarse grid in which no vertex is removed.
class ProtectedCells {
 public:
  explicit ProtectedCells(const GridShape& shape) : shape_(shape), cells_(shape.size(), 0) {}
  void protect(const Vector3& p_mm, double radius_mm) {
    const Vector3 low = (p_mm - Vector3::Constant(radius_mm) - shape_.origin_mm) / shape_.spacing_mm;
    const Vector3 high = (p_mm + Vector3::Constant(radius_mm) - shape_.origin_mm) / shape_.spacing_mm;
    if ((high.array() < 0.0).any() || (low.array() >= shape_.nodes.cast<double>().array()).any()) return;
    const Eigen::Vector3i a = low.cast<int>().cwiseMax(0);
    const Eigen::Vector3i b = high.cast<int>().cwiseMin(shape_.nodes - Eigen::Vector3i::Ones());
    for (int i = a.x(); i <= b.x(); ++i)
      for (int j = a.y(); j <= b.y(); ++j)
        for (int k = a.z(); k <= b.z(); ++k) cells_[shape_.index(i, j, k)] = 1;
  }
  bool holds(const Vector3& p_mm) const {
    const Eigen::Vector3i c = located(shape_, p_mm).index;
    return cells_[shape_.index(c.x(), c.y(), c.z())] != 0;
  }

 private:
  GridShape shape_;
  std::vector<char> cells_;
};

void protect_tips(const TriangleMesh& jaw, const std::vector<double>& sharpness, ProtectedCells& cells) {
  for (std::size_t v = 0; v < sharpness.size(); ++v)
    if (sharpness[v] > kSharp) cells.protect(jaw.vertices_mm[v], kAroundTipsMm);
}

/// Surfaces that pass through one cell twice, closer than its edges are long, may be triangulated through
/// each other. Their corners go to the middle of their neighbours until none cross.
TriangleMesh untangled(TriangleMesh mesh) {
  for (int round = 0; round < kUntanglingRounds; ++round) {
    const auto crossings = self_intersections(mesh);
    if (crossings.empty()) break;
    std::map<std::uint32_t, std::pair<Vector3, int>> around;
    for (const auto& pair : crossings)
      for (const std::uint32_t t : pair)
        for (const std::uint32_t v : mesh.triangles[t]) around[v] = {Vector3::Zero(), 0};
    for (const Triangle& t : mesh.triangles)
      for (int k = 0; k < 3; ++k)
        if (const auto at = around.find(t[k]); at != around.end()) {
          at->second.first += mesh.vertices_mm[t[(k + 1) % 3]];
          ++at->second.second;
        }
    for (const auto& [v, sum] : around) mesh.vertices_mm[v] = sum.first / sum.second;
  }
  return mesh;
}

}  // namespace

TriangleMesh simplified(TriangleMesh mesh, const SplintField& field) {
  const Preparation& preparation = field.preparation();
  ProtectedCells kept(preparation.coarse);
  protect_tips(preparation.support.mesh(), preparation.support_sharpness, kept);
  protect_tips(preparation.opposing.mesh(), preparation.opposing_sharpness, kept);
  AdaptiveMeshOptions options;
  options.tolerance_mm = [&](const Vector3& p) {
    if (kept.holds(p)) return 0.0;
    if (field.jaws().opposing.linear(p) < kMaybeContactMm) return kToleranceInContactsMm;
    return field.near_jaw(p, 0.0) ? kToleranceOnTeethMm : kToleranceMm;
  };
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    TriangleMesh fewer = adaptive_mesh(mesh, options);
    const auto crossings = self_intersections(fewer);
    if (crossings.empty()) return fewer;
    if (attempt == 0) mesh = untangled(std::move(mesh));  // else they would come back each time
    for (const auto& pair : crossings)
      for (const std::uint32_t t : pair)
        for (int k = 0; k < 3; ++k) kept.protect(fewer.corner(t, k), kAroundCrossingsMm);
  }
  return mesh;
}

}  // namespace gnathion
