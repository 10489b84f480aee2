// The palate: its vault, incisive papilla, raphe and rugae.
#pragma once

#include <vector>

#include "phantom/jaws_ridge.h"

namespace gnathion {

class Palate {
 public:
  Palate(const AlveolarRidge& ridge, Random& random);
  /// First-order distance to the palate's surface, negative above it.
  double distance_mm(const Vector3& p_mm) const;
  double highest_mm() const { return highest_mm_; }

 private:
  double vault_at(const Eigen::Vector2d& p) const;
  double relief_at(const Eigen::Vector2d& p) const;

  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();
  int nx_ = 0, ny_ = 0;
  std::vector<double> vault_;  ///< height of the bare vault at the nodes
  double front_y_mm_ = 0.0, highest_mm_ = 0.0;
  Vector3 rugae_seed_ = Vector3::Zero();
};

}  // namespace gnathion
