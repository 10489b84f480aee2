#include "design/contact_sigma.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace gnathion {
namespace {

struct Sum {
  double weighted_variance = 0.0, area_mm2 = 0.0, largest = 0.0;
};

}  // namespace

double gap_sigma_mm(const Matrix6& covariance, const Vector3& p, const Vector3& normal) {
  Eigen::Matrix<double, 6, 1> j;
  j << p.cross(normal), normal;
  return std::sqrt(std::max(0.0, j.dot(covariance * j)));
}

ContactSigma contact_sigmas(const Contacts& contacts, const TriangleMesh& opposing_mi,
                            const std::vector<std::uint8_t>& fdi_of_vertex, const Rigid3& therapeutic,
                            bool splint_on_maxilla, const Matrix6& covariance) {
  // The gap hangs on where the mandible lies against the maxilla, whichever is drawn at rest. Over a
  // mandibular splint the maxilla's point u0, displaced by T_th⁻¹, meets a point of the splint that T_th
  // brings back to u0: there the mandible moves by ξ.
  const auto sigma_at = [&](const SurfaceSample& s) {
    const Vector3 normal = face_normal_scaled(opposing_mi, s.triangle).normalized();
    return splint_on_maxilla ? gap_sigma_mm(covariance, therapeutic * s.p_mm, therapeutic.rotation * normal)
                             : gap_sigma_mm(covariance, s.p_mm, normal);
  };
  ContactSigma out;
  std::map<std::uint8_t, Sum> teeth;
  std::vector<double> sigma;
  for (const SurfaceSample& s : contacts.samples) {
    sigma.push_back(sigma_at(s));
    Sum& tooth = teeth[fdi_of_vertex.empty() ? std::uint8_t{0} : fdi_of_vertex[s.vertex]];
    tooth.weighted_variance += s.area_mm2 * sigma.back() * sigma.back();
    tooth.area_mm2 += s.area_mm2;
    tooth.largest = std::max(tooth.largest, sigma.back());
  }
  for (const ToothArea& tooth : contacts.per_tooth) {
    const Sum& sum = teeth[tooth.fdi];
    const double mean = sum.area_mm2 > 0.0 ? sum.weighted_variance / sum.area_mm2 : 0.0;
    out.per_tooth.push_back({tooth.fdi, std::sqrt(mean), sum.largest});
  }
  const Rigid3 displaced = splint_on_maxilla ? therapeutic : therapeutic.inverse();
  for (const ContactPatch& patch : contacts.patches) {
    double nearest = 1e300, value = 0.0;
    for (std::size_t i = 0; i < sigma.size(); ++i) {
      const double d = (displaced * contacts.samples[i].p_mm - patch.centre_mm).squaredNorm();
      if (d >= nearest) continue;
      nearest = d;
      value = sigma[i];
    }
    out.patches_mm.push_back(value);
  }
  return out;
}

}  // namespace gnathion
