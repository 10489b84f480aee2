// The soft tissue of one jaw: alveolar ridge, gingival margin with papillae, and the palate.
#pragma once

#include <vector>

#include "core/mesh.h"
#include "phantom/jaws_arch.h"

namespace gnathion {

/// Depth under the gingival margins at which the scan ends on the outer side (and the inner, in the
/// mandible).
inline constexpr double kRimDepthMm = 7.5;

class Gingiva {
 public:
  explicit Gingiva(const DentalArch& arch, std::uint64_t seed);
  /// Distance to the soft tissue, negative inside; first-order near its surface.
  double distance_mm(const Vector3& p_mm) const;
  /// Positive where the scan does not reach.
  double beyond_rim_mm(const Vector3& p_mm) const;
  /// What encloses the jaw's surface up to a little beyond the rim.
  Box box_mm() const;

 private:
  /// The ridge at one place of the arch.
  struct Station {
    Eigen::Vector2d point_mm, outward;
    double s_mm = 0.0;       ///< along the ridge
    double margin_mm = 0.0;  ///< height of the gingival margins, told apically
    double half_mm = 0.0;    ///< half the width of the teeth
    double lean = 0.0;       ///< how far the ridge goes outward per millimetre of depth
    double eminence = 0.0;   ///< 1 over a root, 0 between two
  };
  struct Local {
    Station at;
    double across_mm = 0.0, depth_mm = 0.0;  ///< outward from the ridge's middle; apically from the margin
  };
  Local local(const Vector3& p_mm) const;
  std::size_t nearest_station(const Eigen::Vector2d& p) const;
  double ridge_mm(const Local& l) const;
  double palate_mm(const Vector3& p_mm, const Local& l) const;
  double collars_mm(const Vector3& p_mm) const;
  void fill_nearest_table();

  const DentalArch* arch_;
  double apical_ = 1.0;  ///< sign of z towards the roots
  Vector3 unevenness_seed_;
  double vault_mm_ = 13.0, mean_margin_mm_ = 0.0, end_y_mm_ = 0.0, front_y_mm_ = 0.0;
  std::vector<Station> stations_;
  Eigen::Vector2d table_origin_;
  int table_nx_ = 0, table_ny_ = 0;
  std::vector<std::uint16_t> table_;
};

}  // namespace gnathion
