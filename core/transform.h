// Transform<To, From> re-expresses points; Motion<F> displaces them inside one frame.
//
// Names read one way: `a_from_b` maps coordinates in b to coordinates in a. A chain whose frames do
// not meet does not compile.
#pragma once

#include "core/frames.h"
#include "core/rigid.h"

namespace gnathion {

/// Re-expresses the coordinates of a fixed point: p_to = to_from_from * p_from.
template <class To, class From>
struct Transform {
  Rigid3 rigid;

  Transform() = default;
  explicit Transform(const Rigid3& r) : rigid(r) {}
  Vector3 operator*(const Vector3& p_from_mm) const { return rigid * p_from_mm; }
  template <class Before>
  Transform<To, Before> operator*(const Transform<From, Before>& b) const {
    return Transform<To, Before>(rigid * b.rigid);
  }
  Transform<From, To> inverse() const { return Transform<From, To>(rigid.inverse()); }
};

/// Displaces points, both ends expressed in F: p_after = motion * p_before.
template <class F>
struct Motion {
  Rigid3 rigid;

  Motion() = default;
  explicit Motion(const Rigid3& r) : rigid(r) {}
  Vector3 operator*(const Vector3& p_mm) const { return rigid * p_mm; }
  /// First `b`, then this.
  Motion operator*(const Motion& b) const { return Motion(rigid * b.rigid); }
  Motion inverse() const { return Motion(rigid.inverse()); }
};

/// The same motion told in another frame: T·X·T⁻¹. With T = dental_from_face and X = T_B this is
/// the method's T_th = T·T_B·T⁻¹ (appendix A.2, step 6).
template <class To, class From>
Motion<To> express_in(const Transform<To, From>& to_from, const Motion<From>& motion) {
  return Motion<To>(to_from.rigid * motion.rigid * to_from.rigid.inverse());
}

/// Where bow and head are, seen from one frame at one time.
template <class F>
struct BowAndHead {
  Transform<F, Bow> f_from_bow;         ///< M
  Transform<F, HeadFrame> f_from_head;  ///< H
};

/// The bow's motion from MI to TP relative to the maxilla, told in F at MI: H0·H1⁻¹·M1·M0⁻¹.
/// The head's own motion between the two times cancels. Sign: opening moves the incisal point
/// away from the maxilla.
template <class F>
Motion<F> relative_motion(const BowAndHead<F>& at_mi, const BowAndHead<F>& at_tp) {
  return Motion<F>(at_mi.f_from_head.rigid * at_tp.f_from_head.rigid.inverse() * at_tp.f_from_bow.rigid *
                   at_mi.f_from_bow.rigid.inverse());
}

/// T of the camera route, T = T_D⁻¹·M0⁻¹: the measuring frame at MI told in the dental frame.
template <class F>
Transform<Dental, F> dental_from_measurement(const Transform<Bow, Dental>& bow_from_dental,
                                             const BowAndHead<F>& at_mi) {
  return bow_from_dental.inverse() * at_mi.f_from_bow.inverse();
}

/// A value on SE(3) with the covariance of its left perturbation (rotation, translation), rad, mm.
template <class T>
struct Uncertain {
  T value;
  Matrix6 covariance = Matrix6::Zero();
};

}  // namespace gnathion
