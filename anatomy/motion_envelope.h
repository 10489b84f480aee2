// The positions that a patient's own recorded motion reached, and how far beyond them another one lies.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "occlusion/arch.h"

namespace gnathion {

/// How a position of the mandible lies to the recorded envelope.
struct EnvelopeDistance {
  double outside_mm = 0.0;  ///< largest displacement of a landmark that brings it inside; 0: inside
  Vector3 where_mm = Vector3::Zero();  ///< that landmark, displaced, in Dental
  std::string landmark;                ///< "incisal point", "left condyle", …
  double nearest_mm = 0.0;             ///< the same to the nearest recorded position itself
  std::size_t nearest_row = 0;         ///< index into the motions given
};

/// The convex hull of the recorded positions, MI included, each position told as the displacements of
/// incisal point, both ends of the arch and both condyles: what lies between recorded positions is taken as
/// reachable. Immutable, thread-safe.
class MotionEnvelope {
 public:
  /// `motions`: of the mandible from MI in Dental. `condyles_mm`: left, right, in MI.
  MotionEnvelope(const std::vector<Rigid3>& motions, const ArchFrame& arch, const Vector3& condyle_left_mm,
                 const Vector3& condyle_right_mm);
  EnvelopeDistance distance(const Rigid3& motion) const;
  std::size_t positions() const { return rows_.size(); }
  /// How far the recording itself takes the incisal point from MI: a recording that never left MI says
  /// little.
  double reach_mm() const { return reach_mm_; }

 private:
  static constexpr int kPoints = 5;
  using Features = Eigen::Matrix<double, 3 * kPoints, 1>;
  static constexpr std::size_t kMi = static_cast<std::size_t>(-1);
  Features features_of(const Rigid3& motion) const;
  static std::pair<double, int> largest_of(const Features& f);

  std::vector<Vector3> points_mm_;
  std::vector<Features> rows_;      ///< MI first; positions that say the same only once
  std::vector<std::size_t> index_;  ///< of each row in the motions given; kMi: MI
  double reach_mm_ = 0.0;
};

}  // namespace gnathion
