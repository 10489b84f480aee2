// The form of a single crown as an implicit surface, built as a dental technician waxes one up: a body with
// its heights of contour, then cusps, cusp ridges, marginal ridges and the fissures between them.
//
// Tooth frame, millimetres: u mesial, v buccal (labial), w occlusal (incisal); origin at the centre of the
// cervix. The frame is the same for all four quadrants: placing a tooth mirrors it as needed.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "core/rigid.h"

namespace gnathion {

/// A distance told at seven heights from the cervix (0) to the highest point of the crown (1), evenly spaced.
using CrownProfile = std::array<double, 7>;

/// A point of the occlusal relief in plan view, with its height over the cervix.
struct ReliefPoint {
  double u_mm = 0.0, v_mm = 0.0, w_mm = 0.0;
};

/// A crest between two relief points. Across it, the surface falls by `slope`, rounded over `round_mm`.
struct ReliefRidge {
  int from = 0, to = 0;
  double slope = 0.7;
  double round_mm = 0.35;
  double bulge_mm = 0.0;  ///< how far the middle of the crest stands over the straight line
};

/// A fissure: polyline in plan view.
struct Fissure {
  std::vector<Eigen::Vector2d> path_mm;
  double depth_mm = 0.3;
  double width_mm = 0.45;
};

/// A groove that runs down the buccal or lingual face (or a hollow between the lobes of a front tooth).
struct FaceGroove {
  double u_mm = 0.0;
  bool buccal = true;
  double depth_mm = 0.2, width_mm = 0.8;
  double from = 0.4, to = 1.2;  ///< heights, as parts of the crown's
};

enum class ToothClass : std::uint8_t { kIncisor, kCanine, kPremolar, kMolar };

/// Everything that tells one kind of crown from another. Sizes after Wheeler's tables (Nelson, Wheeler's
/// Dental Anatomy, Physiology and Occlusion).
struct ToothForm {
  ToothClass tooth_class = ToothClass::kIncisor;
  double height_mm = 8.0;
  /// How far the body reaches from the axis: mesially, distally (positive), and where its buccal and
  /// lingual faces lie (v).
  CrownProfile mesial_mm{}, distal_mm{}, buccal_mm{}, lingual_mm{};
  double squareness_cervix = 2.3, squareness_top = 2.8;  ///< exponents of the superelliptic outline
  double lingual_taper = 0.0;  ///< how much narrower the lingual face is than the buccal one
  double skew = 0.0;           ///< shear of u by v: rhomboid molars
  double bend_per_mm = 0.0;    ///< how far the face curves back to the lingual, times u²
  double edge_round_mm = 0.6;  ///< rounding between body and relief

  // Front teeth: the incisal edge as a height over u, and the lingual fossa.
  double edge_tip_u_mm = 0.0;  ///< where the edge is highest
  double edge_mesial_slope = 0.0, edge_distal_slope = 0.0;
  double edge_tip_round_mm = 0.4;
  double corner_mesial_mm = 0.6, corner_distal_mm = 1.2;  ///< drop of the incisal angles
  double mamelon_mm = 0.0;
  double fossa_depth_mm = 0.0, fossa_half_width_mm = 2.5, fossa_from = 0.3, fossa_to = 0.95;
  double lingual_ridge_mm = 0.0;  ///< crest in the middle of the fossa (canines)

  // Back teeth: the occlusal relief.
  std::vector<ReliefPoint> points;
  std::vector<ReliefRidge> ridges;
  std::vector<Fissure> fissures;
  std::vector<int> functional_cusps;  ///< of `points`: those that hold the bite
  double floor_mm = 0.0;              ///< the relief never lies below
  double relief_round_mm = 0.42;      ///< rounding of the valleys' shoulders
  std::vector<FaceGroove> face_grooves;

  /// The point that is set on the arch: incisal edge, buccal cusp line (lower), central fossa (upper).
  ReliefPoint reference;
  int central_fossa = -1;  ///< of `points`, for molars: the pit in the middle

  // The gingival margin: height over the cervix on the faces and between the teeth.
  double margin_buccal_mm = 0.6, margin_lingual_mm = 0.6, papilla_mm = 2.4;
};

/// The nominal form of a tooth by the last digit of its FDI number, 1..7.
ToothForm upper_tooth_form(int number);
ToothForm lower_tooth_form(int number);
/// The form scaled along u, v, w.
ToothForm scaled(const ToothForm& form, const Vector3& factors);

/// Evaluates a form. Distances are first-order: exact sign and zero, roughly right within a millimetre.
class Crown {
 public:
  explicit Crown(ToothForm form);
  const ToothForm& form() const { return form_; }
  ToothForm& form() { return form_; }

  /// Negative inside the crown; the root goes on below it without end.
  double distance_mm(const Vector3& p_mm) const;
  /// The body alone, without the occlusal end: what the gingiva lies on.
  double body_distance_mm(const Vector3& p_mm) const;
  /// Height of the occlusal relief or incisal edge.
  double relief_mm(double u_mm, double v_mm) const;
  /// Height of the gingival margin at the side that the point lies on.
  double margin_mm(const Vector3& p_mm) const;
  /// The surface point over (u, v), seen from the occlusal; NaN height where there is none.
  Vector3 surface_from_above_mm(double u_mm, double v_mm) const;
  /// A bound: the crown's occlusal part lies within this of its centre (0, 0, height/2).
  double radius_mm() const { return radius_mm_; }
  /// A bound: no part of the body is farther than this from the axis.
  double reach_mm() const { return reach_mm_; }

 private:
  double edge_mm(double u_mm) const;
  double lingual_face_mm(double u_mm, double t) const;
  ToothForm form_;
  double radius_mm_ = 0.0, reach_mm_ = 0.0;
};

/// Smooth maximum and minimum (quadratic, width k): exact where the two differ by more than k.
inline double smooth_max(double a, double b, double k) {
  const double d = a - b, h = k - (d < 0 ? -d : d);
  const double m = a > b ? a : b;
  return h > 0 ? m + 0.25 * h * h / k : m;
}
inline double smooth_min(double a, double b, double k) {
  return -smooth_max(-a, -b, k);
}

}  // namespace gnathion
