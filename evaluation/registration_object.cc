#include "evaluation/registration_object.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <cmath>

#include "evaluation/discrepancy.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot link the instruments";
constexpr double kLengthMm = 50.0;        // an arch's size: makes turns and shifts comparable
constexpr double kLeastTurnRad = 0.0087;  // half a degree; less gives no axis
constexpr double kUndetermined = 1e-7;    // of the largest eigenvalue of the information
constexpr double kWeak = 1e-3;

using Matrix12 = Eigen::Matrix<double, 12, 12>;
using Vector12 = Eigen::Matrix<double, 12, 1>;

/// A·Y·B⁻¹·X⁻¹ of one position: what does not close.
Vector6 residual(const ObjectPosition& p, const Rigid3& x, const Rigid3& y) {
  return log_se3(p.a_from_object.value * y * p.b_from_object.value.inverse() * x.inverse());
}

/// Its inverse covariance: errors of A act on the left, those of B through X.
Matrix6 weight_of(const ObjectPosition& p, const Rigid3& x) {
  const Matrix6 by_b = adjoint(x);
  Matrix6 cov = p.a_from_object.covariance + by_b * p.b_from_object.covariance * by_b.transpose();
  // Poses without a covariance count alike: 0.02° and 0.02 mm.
  if (cov.norm() < 1e-18) cov.diagonal() << Vector3::Constant(1.2e-7), Vector3::Constant(4e-4);
  return cov.ldlt().solve(Matrix6::Identity());
}

/// Jacobian of the residual to (x, y), left perturbations of X and Y.
Eigen::Matrix<double, 6, 12> jacobian(const ObjectPosition& p) {
  Eigen::Matrix<double, 6, 12> j;
  j.leftCols<6>() = -Matrix6::Identity();
  j.rightCols<6>() = adjoint(p.a_from_object.value);
  return j;
}

/// First guess where the object's frames differ: rotations from the axes of the motions (Park & Martin 1994),
/// then shifts by linear least squares.
Result<Rigid3> guess_from_motions(const std::vector<ObjectPosition>& positions) {
  Matrix3 couples = Matrix3::Zero();
  std::vector<std::pair<Rigid3, Rigid3>> motions;
  for (std::size_t i = 0; i < positions.size(); ++i)
    for (std::size_t k = i + 1; k < positions.size(); ++k) {
      const Rigid3 a = positions[k].a_from_object.value * positions[i].a_from_object.value.inverse();
      const Rigid3 b = positions[k].b_from_object.value * positions[i].b_from_object.value.inverse();
      couples += log_so3(a.rotation) * log_so3(b.rotation).transpose();
      motions.emplace_back(a, b);
    }
  const Eigen::JacobiSVD<Matrix3> svd(couples, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Vector3 s = svd.singularValues();
  if (s[0] < kLeastTurnRad * kLeastTurnRad)
    return bad_input(kWhat, "positions", "undetermined: the object hardly turns between them; turn it");
  if (s[1] < 1e-4 * s[0] || s[1] < 0.01 * kLeastTurnRad * kLeastTurnRad)
    return bad_input(
        kWhat, "positions",
        "undetermined: all turns are about one axis: the turn about it and the shift along it stay free; "
        "add a position turned about another axis");
  Matrix3 r = svd.matrixU() * svd.matrixV().transpose();
  if (r.determinant() < 0.0) {
    Matrix3 flip = Matrix3::Identity();
    flip(2, 2) = -1.0;
    r = svd.matrixU() * flip * svd.matrixV().transpose();
  }
  // (R_a − I) t = R·t_b − t_a for each motion.
  Eigen::MatrixXd m(3 * static_cast<Eigen::Index>(motions.size()), 3);
  Eigen::VectorXd rhs(m.rows());
  for (std::size_t i = 0; i < motions.size(); ++i) {
    const auto row = 3 * static_cast<Eigen::Index>(i);
    m.middleRows<3>(row) = motions[i].first.rotation - Matrix3::Identity();
    rhs.segment<3>(row) = r * motions[i].second.translation_mm - motions[i].first.translation_mm;
  }
  return Rigid3{r, m.colPivHouseholderQr().solve(rhs)};
}

std::string in_words(const Vector6& direction) {
  const Vector3 turn = direction.head<3>(), shift = direction.tail<3>();
  const auto text = [](const char* what, const Vector3& v) {
    const Vector3 u = v.normalized();
    return fmt::format("{} ({:.2f}, {:.2f}, {:.2f})", what, u.x(), u.y(), u.z());
  };
  return turn.norm() > shift.norm() ? text("turn about", turn) : text("shift along", shift);
}

/// Conditioning of the information about the poses' centroid in A, lengths scaled.
void describe_conditioning(const Eigen::MatrixXd& information, InstrumentLink* link) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(information);
  const Eigen::VectorXd values = solver.eigenvalues();
  const double largest = values[values.size() - 1];
  link->condition = values[0] > 0.0 ? largest / values[0] : std::numeric_limits<double>::infinity();
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (values[i] > kWeak * largest) break;
    const Vector6 of_x = solver.eigenvectors().col(i).head<6>();
    if (of_x.norm() > 0.3) link->weak.push_back(in_words(of_x));
  }
}

}  // namespace

Result<InstrumentLink> link_instruments(const std::vector<ObjectPosition>& positions,
                                        const LinkOptions& options) {
  const bool common = options.common_object_frame;
  const std::size_t needed = common ? 1 : 3;
  if (positions.size() < needed)
    return bad_input(kWhat, "positions", fmt::format("{} given, {} are needed", positions.size(), needed));
  InstrumentLink link;
  link.common_object_frame = common;
  Rigid3 x = positions[0].a_from_object.value * positions[0].b_from_object.value.inverse(), y;
  if (!common) {
    GNATHION_TRY(x, guess_from_motions(positions));
    y = positions[0].a_from_object.value.inverse() * x * positions[0].b_from_object.value;
  }

  // Gauss-Newton on all positions with their covariances; Y stays the identity where the frame is common.
  const Eigen::Index unknowns = common ? 6 : 12;
  Eigen::MatrixXd h;
  for (int iteration = 0; iteration < 30; ++iteration) {
    Matrix12 full = Matrix12::Zero();
    Vector12 gradient = Vector12::Zero();
    link.chi2 = 0.0;
    for (const ObjectPosition& p : positions) {
      const Vector6 r = residual(p, x, y);
      const Matrix6 w = weight_of(p, x);
      const Eigen::Matrix<double, 6, 12> j = jacobian(p);
      full += j.transpose() * w * j;
      gradient += j.transpose() * w * r;
      link.chi2 += r.dot(w * r);
    }
    h = full.topLeftCorner(unknowns, unknowns);
    Vector12 step = Vector12::Zero();
    step.head(unknowns) = -h.ldlt().solve(gradient.head(unknowns));
    x = exp_se3(step.head<6>()) * x;
    if (!common) y = exp_se3(step.tail<6>()) * y;
    if (step.norm() < 1e-12) break;
  }

  // Judged about the object's mean place, where turns and shifts hardly mix.
  Vector3 place = Vector3::Zero();
  for (const ObjectPosition& p : positions)
    place += p.a_from_object.value.translation_mm / static_cast<double>(positions.size());
  Eigen::MatrixXd scaled = Eigen::MatrixXd::Identity(unknowns, unknowns);
  scaled.topLeftCorner(6, 6) = adjoint(Rigid3::from_translation(place));
  for (Eigen::Index k = 0; k < unknowns; ++k)
    if (k % 6 < 3) scaled.col(k) /= kLengthMm;
  const Eigen::MatrixXd information = scaled.transpose() * h * scaled;
  describe_conditioning(information, &link);
  if (!(link.condition < 1.0 / kUndetermined)) {
    std::string free;
    for (const std::string& w : link.weak) free += (free.empty() ? "" : ", ") + w;
    return bad_input(kWhat, "positions", "undetermined: " + free);
  }
  const Eigen::MatrixXd covariance = h.ldlt().solve(Eigen::MatrixXd::Identity(unknowns, unknowns));
  link.a_from_b = {x, covariance.topLeftCorner<6, 6>()};
  link.object_a_from_object_b.value = y;
  if (!common) link.object_a_from_object_b.covariance = covariance.bottomRightCorner<6, 6>();

  for (const ObjectPosition& p : positions) {
    const Rigid3 by_b = x * p.b_from_object.value * y.inverse();
    const auto n = static_cast<double>(positions.size());
    link.rms_mm += (by_b.translation_mm - p.a_from_object.value.translation_mm).squaredNorm() / n;
    link.rms_deg += std::pow((by_b.inverse() * p.a_from_object.value).angle_rad() * 180.0 / M_PI, 2) / n;
  }
  link.rms_mm = std::sqrt(link.rms_mm);
  link.rms_deg = std::sqrt(link.rms_deg);
  link.degrees_of_freedom = 6 * static_cast<int>(positions.size()) - static_cast<int>(unknowns);
  if (link.degrees_of_freedom > 0) link.p_value = chi_square_upper_tail(link.chi2, link.degrees_of_freedom);
  const ObjectPosition &first = positions.front(), &last = positions.back();
  link.motion_in_a = last.a_from_object.value * first.a_from_object.value.inverse();
  link.motion_in_a_by_b = x * last.b_from_object.value * first.b_from_object.value.inverse() * x.inverse();
  return link;
}

}  // namespace gnathion
