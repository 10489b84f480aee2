// Signs of determinants, exact for all finite doubles that neither overflow nor underflow when three of
// them are multiplied (millimetres never do): first in double precision with Shewchuk's error bound, then,
// where that cannot tell, with floating-point expansions (Shewchuk, Discrete & Computational Geometry 18,
// 1997). Relies on IEEE doubles rounded to nearest, so this must not be compiled with -ffast-math.
#pragma once

#include "core/rigid.h"

namespace gnathion {

/// Sign of det(a−d, b−d, c−d): +1 if d is below the plane abc, seen counter-clockwise from above; −1 above; 0
/// in it.
int orient3d_sign(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d);

/// The same where double precision can tell, else kUncertain; much faster than an exact zero.
int orient3d_filtered(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d);
inline constexpr int kUncertain = 2;

/// Sign of the area of abc in the plane of two coordinate axes: +1 counter-clockwise.
int orient2d_sign(const Vector3& a, const Vector3& b, const Vector3& c, int x_axis, int y_axis);

}  // namespace gnathion
