// What follows from the chain's estimated poses, with Jacobians by them.
#pragma once

#include "calibration/chain.h"

namespace gnathion {

/// A product of the chain's poses and how its left perturbation depends on theirs.
struct ChainDerived {
  Rigid3 value;
  Eigen::Matrix<double, 6, 6 * kChainStates> jacobian = Eigen::Matrix<double, 6, 6 * kChainStates>::Zero();
};

/// T = T_D⁻¹·T_F.
ChainDerived dental_from_face_of(const Chain& chain);
/// T_B = F·B1⁻¹·T_F, with F = face_mi_from_face_tp and B1 = bow_from_face_tp.
ChainDerived bow_motion_of(const Chain& chain);
/// T_th = T·T_B·T⁻¹ = T_D⁻¹·T_F·F·B1⁻¹·T_D.
ChainDerived therapeutic_of(const Chain& chain);

}  // namespace gnathion
