// T_th's covariance carried to the contacts: how sure the gap is that the opposing arch finds there.
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"
#include "core/transform.h"
#include "occlusion/contacts.h"

namespace gnathion {

/// Standard deviations of the gap along the surface's normal, mm.
struct ContactSigma {
  struct Tooth {
    std::uint8_t fdi = 0;
    double sigma_mm = 0.0;    ///< root mean square over its contact area
    double largest_mm = 0.0;  ///< over its contact area
  };
  std::vector<Tooth> per_tooth;    ///< those of Contacts::per_tooth
  std::vector<double> patches_mm;  ///< one for each of Contacts::patches
};

/// How a point of the mandible moves along a direction when T_th is T' = exp(ξ)·T_th, ξ ~ N(0, Σ) with rows
/// (rotation, translation) in Dental: variance jᵀΣj with j = (p × n, n). `p_tp_mm` is the displaced point.
double gap_sigma_mm(const Matrix6& covariance, const Vector3& p_tp_mm, const Vector3& normal);

/// `contacts` were found for `opposing_mi`, displaced by T_th over a maxillary splint, by T_th⁻¹ over a
/// mandibular one. Normals are the opposing arch's.
ContactSigma contact_sigmas(const Contacts& contacts, const TriangleMesh& opposing_mi,
                            const std::vector<std::uint8_t>& fdi_of_vertex, const Rigid3& therapeutic,
                            bool splint_on_maxilla, const Matrix6& covariance);

}  // namespace gnathion
