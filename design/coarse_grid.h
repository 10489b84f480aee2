// A dense grid of samples in the design frame, for what is smooth or only bounds: spacing about 0.3 mm.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/rigid.h"

namespace gnathion {

/// Nodes at origin + spacing·(i, j, k); k runs along a (z of the design frame, towards the gingiva) and is
/// the fastest index, so that a column is contiguous.
struct GridShape {
  Vector3 origin_mm = Vector3::Zero();
  double spacing_mm = 0.3;
  Eigen::Vector3i nodes = Eigen::Vector3i::Zero();

  std::size_t size() const {
    return static_cast<std::size_t>(nodes.x()) * static_cast<std::size_t>(nodes.y()) *
           static_cast<std::size_t>(nodes.z());
  }
  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(i) * static_cast<std::size_t>(nodes.y()) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(nodes.z()) +
           static_cast<std::size_t>(k);
  }
  Vector3 position(int i, int j, int k) const { return origin_mm + spacing_mm * Vector3(i, j, k); }
};

/// A cell of a grid and the place within it, found once for all grids of one shape.
struct GridCell {
  Eigen::Vector3i index = Eigen::Vector3i::Zero();
  Vector3 fraction = Vector3::Zero();
};
GridCell located(const GridShape& shape, const Vector3& p_mm);

/// Scalar samples (mm). Reading is thread-safe. Outside of the box the nearest sample counts.
class CoarseGrid {
 public:
  CoarseGrid() = default;
  CoarseGrid(const GridShape& shape, float value) : shape_(shape), values_(shape.size(), value) {}

  const GridShape& shape() const { return shape_; }
  float& at(int i, int j, int k) { return values_[shape_.index(i, j, k)]; }
  float at(int i, int j, int k) const { return values_[shape_.index(i, j, k)]; }
  float* column(int i, int j) { return &values_[shape_.index(i, j, 0)]; }
  const float* column(int i, int j) const { return &values_[shape_.index(i, j, 0)]; }
  std::vector<float>& values() { return values_; }
  const std::vector<float>& values() const { return values_; }

  /// Trilinear interpolation.
  double linear(const Vector3& p_mm) const { return linear(located(shape_, p_mm)); }
  double linear(const GridCell& cell) const;
  /// Least and greatest of the cell's corners.
  std::pair<float, float> range(const GridCell& cell) const;
  /// Uniform cubic B-spline with the samples as coefficients: C2, smooths by about spacing²·curvature/6.
  double smooth(const Vector3& p_mm) const;
  double smooth(const GridCell& cell) const;

 private:
  GridShape shape_;
  std::vector<float> values_;
};

/// min over z' ≤ z of f(z') + slope·(z − z'): the solid swept towards the gingiva. `slope` = sin δ gives the
/// sweep's side walls the draft δ.
CoarseGrid swept_up(const CoarseGrid& f, double slope = 0.0);
/// min over z' ≥ z: swept away from the gingiva.
CoarseGrid swept_down(const CoarseGrid& f);

/// Layers moved across a, sampled in `shape`, whose layers are those of f: result(x, y, z) =
/// f(x + sx·(z − z0), y + sy·(z − z0), z), z0 the lowest layer. Columns of the result run along (sx, sy, 1).
CoarseGrid sheared(const CoarseGrid& f, double sx, double sy, const GridShape& shape);
/// The box that holds all of `shape` after that: the way back finds every node inside.
GridShape sheared_box(GridShape shape, double sx, double sy);

/// Solves |∇d| = 1 outwards from the nodes marked in `fixed` (fast sweeping, Zhao 2005); `d` holds their
/// unsigned distances and `far_mm` elsewhere, which is where the solution ends.
void sweep_distances(CoarseGrid& d, const std::vector<char>& fixed, double far_mm);

/// Signed distance to the zero level of f, within ± band_mm (clamped): fast sweeping (Zhao 2005) of the
/// Eikonal equation from the nodes beside the level.
CoarseGrid redistanced(const CoarseGrid& f, double band_mm);

/// Gaussian mean of that standard deviation, axis by axis; the last sample counts beyond the ends.
CoarseGrid blurred(const CoarseGrid& f, double sigma_mm);

/// Morphological closing of {f ≤ 0} by a ball: concave corners get fillets of that radius.
CoarseGrid closed(const CoarseGrid& f, double radius_mm);
/// Morphological opening of {f ≤ 0}: what is thinner than twice the radius goes.
CoarseGrid opened(const CoarseGrid& f, double radius_mm);

}  // namespace gnathion
