#include "design/contact_sigma.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "core/random.h"

namespace gnathion {
namespace {

/// A small triangle about a point with that normal.
TriangleMesh facet(const Vector3& centre, const Vector3& normal) {
  const Vector3 u = normal.unitOrthogonal() * 0.1, v = normal.cross(u);
  return {{centre + u, centre - 0.5 * u + v, centre - 0.5 * u - v}, {{0, 1, 2}}, {}, {}};
}

/// A covariance with correlations between turning and shifting, as registrations give it.
Matrix6 some_covariance() {
  Matrix6 root = Matrix6::Zero();
  for (int i = 0; i < 3; ++i) {
    root(i, i) = 4e-4;
    root(i + 3, i + 3) = 0.02;
    root(i + 3, i) = 0.015 * (i - 1);
  }
  root(5, 0) = -0.01;
  root(3, 1) = 0.012;
  return root * root.transpose();
}

Contacts one_contact(const Vector3& p_mi, const Vector3& p_tp, std::uint8_t fdi) {
  Contacts contacts;
  SurfaceSample sample;
  sample.p_mm = p_mi;
  sample.area_mm2 = 1.0;
  contacts.samples = {sample};
  contacts.per_tooth = {{fdi, 1.0}};
  ContactPatch patch;
  patch.centre_mm = p_tp;
  patch.area_mm2 = 1.0;
  patch.fdi = fdi;
  contacts.patches = {patch};
  return contacts;
}

/// Rigid motion of a perturbation (rotation, translation) on the left.
Rigid3 perturbation(const Eigen::Matrix<double, 6, 1>& xi) {
  const Vector3 turn = xi.head<3>();
  const double angle = turn.norm();
  const Rigid3 rotation =
      angle > 0.0 ? Rigid3::about_axis(Vector3::Zero(), turn / angle, angle) : Rigid3::identity();
  return Rigid3::from_translation(xi.tail<3>()) * rotation;
}

/// Standard deviation of the gap that 20,000 draws of T_th give, each measured as an exact distance from the
/// plane of the nominal contact.
double drawn_sigma_mm(const Matrix6& covariance, const Rigid3& therapeutic, const Vector3& p,
                      const Vector3& normal, bool on_maxilla) {
  const Matrix6 root = covariance.llt().matrixL();
  const char* given = std::getenv("GNATHION_SEED");
  Random random(given ? std::strtoull(given, nullptr, 10) : 5);
  double sum = 0.0, squares = 0.0;
  constexpr int kDraws = 20000;
  const Rigid3 nominal = on_maxilla ? therapeutic : therapeutic.inverse();
  for (int i = 0; i < kDraws; ++i) {
    Eigen::Matrix<double, 6, 1> z;
    for (int k = 0; k < 6; ++k) z[k] = random.normal();
    const Rigid3 drawn = perturbation(root * z) * therapeutic;
    const Rigid3 motion = on_maxilla ? drawn : drawn.inverse();
    const double gap = (motion * p - nominal * p).dot(nominal.rotation * normal);
    sum += gap;
    squares += gap * gap;
  }
  return std::sqrt(squares / kDraws - (sum / kDraws) * (sum / kDraws));
}

TEST(ContactSigma, IsTheSpreadOfDrawnGapsOnBothArches) {
  const Rigid3 therapeutic = Rigid3::from_translation({0.4, -1.5, -2.0}) *
                             Rigid3::about_axis({0, 80, 35}, Vector3::UnitX(), 3.0 * M_PI / 180.0);
  const Matrix6 covariance = some_covariance();
  for (const bool on_maxilla : {true, false})
    for (const Vector3& p : {Vector3(24, 22, -3), Vector3(-25, 18, -2), Vector3(2, -22, -1)})
      for (const Vector3& raw : {Vector3(0, 0, 1), Vector3(0.5, 0.3, 0.8)}) {
        const Vector3 normal = raw.normalized();
        const Rigid3 displaced = on_maxilla ? therapeutic : therapeutic.inverse();
        const ContactSigma sigma = contact_sigmas(one_contact(p, displaced * p, 36), facet(p, normal),
                                                  {36, 36, 36}, therapeutic, on_maxilla, covariance);
        ASSERT_EQ(sigma.per_tooth.size(), 1u);
        const double drawn = drawn_sigma_mm(covariance, therapeutic, p, normal, on_maxilla);
        // 20,000 draws know it to 0.5 %; twice the matter of three of these.
        EXPECT_NEAR(sigma.per_tooth[0].sigma_mm / drawn, 1.0, 0.03);
        EXPECT_DOUBLE_EQ(sigma.patches_mm[0], sigma.per_tooth[0].sigma_mm);
        EXPECT_DOUBLE_EQ(sigma.per_tooth[0].largest_mm, sigma.per_tooth[0].sigma_mm);
      }
}

TEST(ContactSigma, OfAPureShiftIsItsPartAlongTheNormal) {
  Matrix6 covariance = Matrix6::Zero();
  covariance(3, 3) = 0.09;  // 0.3 mm along x
  EXPECT_DOUBLE_EQ(gap_sigma_mm(covariance, {30, 20, 10}, Vector3::UnitX()), 0.3);
  EXPECT_DOUBLE_EQ(gap_sigma_mm(covariance, {30, 20, 10}, Vector3::UnitZ()), 0.0);
  covariance.setZero();
  covariance(0, 0) = 1e-4;  // 0.01 rad about x moves a point 50 mm behind the axis by 0.5 mm along z
  EXPECT_NEAR(gap_sigma_mm(covariance, {7, 50, 0}, Vector3::UnitZ()), 0.5, 1e-12);
}

}  // namespace
}  // namespace gnathion
