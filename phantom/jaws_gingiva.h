// The soft tissue of one jaw: the ridge's mucosa, the gingival margin with its papillae, and the palate.
#pragma once

#include <optional>
#include <vector>

#include "core/mesh.h"
#include "phantom/jaws_palate.h"
#include "phantom/jaws_ridge.h"

namespace gnathion {

/// Depth under the gingival margins at which the scan ends on the outer side (and the inner, in the
/// mandible).
inline constexpr double kRimDepthMm = 8.0;

class Gingiva {
 public:
  /// Keeps a reference to the arch.
  Gingiva(const DentalArch& arch, std::uint64_t seed);
  /// Distance to the soft tissue, negative inside; first-order near its surface.
  double distance_mm(const Vector3& p_mm) const;
  /// Positive where the scan does not reach.
  double beyond_rim_mm(const Vector3& p_mm) const;
  /// What encloses the jaw's surface up to a little beyond the rim.
  Box box_mm() const;

 private:
  /// The tissue between two teeth: a wedge under their contact point.
  struct Papilla {
    Vector3 tip_mm, along, across, apical;  ///< axes: along the arch, across it, towards the roots
    double widening = 0.0;                  ///< how fast it widens across the arch
    double half_mm = 0.0;                   ///< half the width of the teeth beside it
  };
  double ridge_mm(const AlveolarRidge::Local& l) const;
  double collars_mm(const Vector3& p_mm) const;
  double papillae_mm(const Vector3& p_mm) const;

  const DentalArch* arch_;
  AlveolarRidge ridge_;
  std::optional<Palate> palate_;
  std::vector<Papilla> papillae_;
  Vector3 unevenness_seed_;
};

}  // namespace gnathion
