// Which directions of an estimated pose are weak, in the words of the body that it belongs to.
#pragma once

#include <string>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// A body as its surface's principal axes have it: what "long axis" means.
struct BodyAxes {
  std::string name;  ///< "the bow"
  Vector3 centre_mm = Vector3::Zero();
  Matrix3 axes = Matrix3::Identity();  ///< columns: long, middle, short axis
  double radius_mm = 1.0;              ///< RMS distance of the surface from its centre
};
BodyAxes body_axes(std::string name, const TriangleMesh& surface);
/// The same body under a pose.
BodyAxes moved(const Rigid3& to_from_body, BodyAxes body);

struct PoseConditioning {
  double condition = 0.0;  ///< largest to least of the information's eigenvalues, angles at the body's radius
  std::vector<std::string> weak;
};
/// `covariance` of a left perturbation; the body told in the frame that the perturbation acts in. A direction
/// is weak when its error reaches 0.1 mm at the body's radius, or is seven times the best one's and 0.02 mm.
PoseConditioning pose_conditioning(const Matrix6& covariance, const BodyAxes& body);

}  // namespace gnathion
