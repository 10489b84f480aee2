// The occlusal surface of a stabilisation splint: a plane that the opposing cusps meet in TP, with guidance
// ramps before canines and incisors.
#pragma once

#include <cstdint>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"
#include "core/transform.h"
#include "design/parameters.h"
#include "occlusion/arch.h"

namespace gnathion {

class OcclusalMap;
struct SplintInputs;

/// All in the design frame.
class FlatPlane {
 public:
  /// Highest point of an opposing tooth in TP.
  struct Tip {
    std::uint8_t fdi = 0;
    Vector3 p_mm = Vector3::Zero();
    double into_mm = 0.0;  ///< how far it passes the plane; negative: that far away
  };
  struct Ramp {
    std::uint8_t fdi = 0;
    Vector3 start_mm = Vector3::Zero();  ///< on the plane, where it begins to rise
    Vector3 along = Vector3::UnitY();    ///< unit, in the plane: where the opposing tooth goes
    double slope = 0.0, length_mm = 0.0, half_width_mm = 0.0;
  };

  /// The plane is parallel to the occlusal plane (flat_plane 1), or tilted to pass the tips of canines to
  /// molars with least squares (2). It lies so that no such tip goes deeper than plane_indent_mm, and all
  /// touch where the tips allow it. Refused (kInput): fewer than three such tips over the splint; a tilt (2)
  /// that tips on one side or nearly on a line leave open, or of more than 10 deg from both occlusal planes.
  /// `opposing_fdi`: per vertex of the opposing arch's scan.
  static Result<FlatPlane> fitted(const SplintInputs& inputs, const std::vector<std::uint8_t>& opposing_fdi,
                                  const ArchFrame& arch, const Rigid3& design_from_dental,
                                  const Rigid3& tp_from_mi, const OcclusalMap& level,
                                  const SplintParameters& p);

  /// Distance from the slab with its ramps, negative inside; 1-Lipschitz, exact beside the biting surface.
  double slab_mm(const Vector3& p_mm) const;
  /// Height over plane and ramps towards the opposing arch: what stands higher is no flat surface.
  double beyond_mm(const Vector3& p_mm) const;

  /// Right to left.
  const std::vector<Tip>& tips() const { return tips_; }
  const std::vector<Ramp>& ramps() const { return ramps_; }
  const Vector3& normal() const { return normal_; }
  const Vector3& point_mm() const { return point_; }

 private:
  double height_mm(const Vector3& p_mm) const { return -normal_.dot(p_mm - point_); }
  double ramp_mm(const Ramp& ramp, const Vector3& p_mm) const;
  Vector3 point_ = Vector3::Zero();
  Vector3 normal_ = Vector3::UnitZ();  ///< towards the gingiva of the splint's arch
  double half_mm_ = 4.0;  ///< how far the plane reaches to each side of the line through the tips
  std::vector<Tip> tips_;
  std::vector<Ramp> ramps_;
};

/// Told in Dental.
nlohmann::json flat_plane_json(const FlatPlane& plane, const Rigid3& dental_from_design);

}  // namespace gnathion
