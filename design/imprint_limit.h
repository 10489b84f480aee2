// How low the splint may stand beside the opposing arch's imprint, so that it does not lock the jaw.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "design/preparation.h"

namespace gnathion {

/// Axes of the opening path, told in the design frame: the third column is the occlusal normal, towards the
/// splint's arch; the opposing arch opens against it.
Matrix3 opening_axes(const Preparation& preparation);

/// A floor under the splint, as heights across the opening path: wherever the opposing arch presses into the
/// splint, nothing within kImprintReachMm beside it may stand out farther than d beyond the natural relief
/// (the lowest place of T_th·S_occ within that reach); from there the floor falls away at 50°.
class ImprintLimit {
 public:
  /// No floor.
  ImprintLimit() = default;
  /// `solid`: whether the splint without a floor has material at a point.
  ImprintLimit(const Preparation& preparation, double depth_mm,
               const std::function<bool(const Vector3&)>& solid);
  bool empty() const { return floor_.empty(); }
  /// How far the point lies below the floor: a lower bound of the distance to it, negative above.
  double below_mm(const Vector3& p_mm) const;

 private:
  using Heights = std::vector<std::optional<double>>;  ///< by node, over low_
  std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(j);
  }
  double& at(int i, int j) { return floor_[index(i, j)]; }
  double at(int i, int j) const { return floor_[index(i, j)]; }
  Vector3 node(int i, int j) const { return low_ + spacing_mm_ * Vector3(i, j, 0.0); }
  bool has_node(int i, int j) const { return i >= 0 && j >= 0 && i < nx_ && j < ny_; }
  Heights imprints(double top_mm, const MeshQuery& opposing,
                   const std::function<bool(const Vector3&)>& solid) const;
  std::vector<double> natural_relief(const Heights& imprint, const Preparation& preparation) const;
  void raise(const Heights& imprint, const std::vector<double>& natural, double depth_mm);
  template <class Body>
  void each_near(const Heights& imprint, const Body& body) const;
  void let_fall();
  void smooth();

  Matrix3 axes_ = Matrix3::Identity();
  Vector3 low_ = Vector3::Zero();  ///< along the axes
  double spacing_mm_ = 0.3;
  int nx_ = 0, ny_ = 0;
  std::vector<double> floor_;
};

constexpr double kImprintReachMm = 1.5;  // a wall that near beside holds the tooth
constexpr double kInImprintMm = 0.35;    // from the opposing arch: contacts and the clearance about them

}  // namespace gnathion
