// Where a sensor sits on the bow: hand–eye from poses of both instruments, or from digitised points.
#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include "core/angle.h"
#include "tracking/electromagnetic.h"

namespace gnathion {
namespace {

const char* const kCannotCalibrateSensor = "cannot calibrate the sensor";
using Matrix12 = Eigen::Matrix<double, 12, 12>;
using Vector12 = Eigen::Matrix<double, 12, 1>;

/// Rotation that takes the `from` vectors to the `to` vectors best (Kabsch).
Matrix3 turned_onto(const std::vector<Vector3>& to, const std::vector<Vector3>& from) {
  Matrix3 m = Matrix3::Zero();
  for (std::size_t i = 0; i < to.size(); ++i) m += to[i] * from[i].transpose();
  const Eigen::JacobiSVD<Matrix3> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix3 d = Matrix3::Identity();
  d(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  return svd.matrixU() * d * svd.matrixV().transpose();
}

/// AX = XB over all pairs of instants with the first and the middle one: A of the bow, B of the sensor, X =
/// bow_from_sensor. Rotations by their axes, then the translation linearly.
Rigid3 linear_start(const std::vector<SensorPair>& pairs) {
  std::vector<Vector3> a_axes, b_axes;
  Matrix3 n = 1e-9 * Matrix3::Identity();
  Vector3 g = Vector3::Zero();
  std::vector<std::pair<Rigid3, Rigid3>> motions;
  for (const std::size_t from : {std::size_t{0}, pairs.size() / 2, pairs.size() - 1})
    for (const SensorPair& p : pairs) {
      const Rigid3 a = pairs[from].camera_from_bow.inverse() * p.camera_from_bow;
      const Rigid3 b = pairs[from].transmitter_from_sensor.inverse() * p.transmitter_from_sensor;
      motions.emplace_back(a, b);
      a_axes.push_back(log_so3(a.rotation));
      b_axes.push_back(log_so3(b.rotation));
    }
  Rigid3 x;
  x.rotation = turned_onto(a_axes, b_axes);
  for (const auto& [a, b] : motions) {  // (R_A − I) t_X = R_X t_B − t_A
    const Matrix3 m = a.rotation - Matrix3::Identity();
    n += m.transpose() * m;
    g += m.transpose() * (x.rotation * b.translation_mm - a.translation_mm);
  }
  x.translation_mm = n.ldlt().solve(g);
  return x;
}

struct Solved {
  Rigid3 x, y;
  Matrix12 information = Matrix12::Zero();
  double chi2 = 0, mm2 = 0, rad2 = 0;
};

/// Error of a pair at the sensor: log of transmitter_from_sensor⁻¹·Y⁻¹·camera_from_bow·X.
Rigid3 error_of(const SensorPair& p, const Rigid3& x, const Rigid3& y) {
  return p.transmitter_from_sensor.inverse() * y.inverse() * p.camera_from_bow * x;
}

Solved solve(const std::vector<SensorPair>& pairs, double sigma_mm, double sigma_rad) {
  Solved s;
  s.x = linear_start(pairs);
  // Y from the first guess of X: the mean over all pairs.
  s.y = pairs.front().camera_from_bow * s.x * pairs.front().transmitter_from_sensor.inverse();
  Matrix6 sensor = Matrix6::Zero();
  sensor.diagonal() << Vector3::Constant(sigma_rad * sigma_rad), Vector3::Constant(sigma_mm * sigma_mm);
  for (int iteration = 0; iteration < 20; ++iteration) {
    Vector12 g = Vector12::Zero();
    s.information.setZero();
    s.chi2 = s.mm2 = s.rad2 = 0;
    for (const SensorPair& p : pairs) {
      // With X = exp(ξ)X̂ and Y = exp(η)Ŷ: E = Ê·exp(Ad_{X̂⁻¹}ξ − Ad_{X̂⁻¹M⁻¹}η…); both told at the sensor.
      const Rigid3 e = error_of(p, s.x, s.y);
      const Vector6 r = log_se3(e);
      const Matrix6 by_x = adjoint(s.x.inverse()), by_camera = adjoint((p.camera_from_bow * s.x).inverse());
      Eigen::Matrix<double, 6, 12> j;
      j << by_x, -by_camera;
      const Matrix6 cov = sensor + by_camera * p.camera_covariance * by_camera.transpose();
      const Eigen::LLT<Matrix6> llt(cov);
      const Eigen::Matrix<double, 6, 12> wj = llt.matrixL().solve(j);
      const Vector6 wr = llt.matrixL().solve(r);
      s.information += wj.transpose() * wj;
      g += wj.transpose() * wr;
      s.chi2 += wr.squaredNorm();
      s.rad2 += r.head<3>().squaredNorm();
      s.mm2 += r.tail<3>().squaredNorm();
    }
    // The smallest of eigenvalues may be nothing at all: a hair of damping, in the units of the problem.
    Matrix12 damped = s.information;
    damped.diagonal() += 1e-12 * s.information.diagonal();
    const Vector12 step = -damped.ldlt().solve(g);
    if (!step.allFinite()) break;
    s.x = exp_se3(step.head<6>()) * s.x;
    s.y = exp_se3(step.tail<6>()) * s.y;
    if (step.norm() < 1e-10) break;
  }
  return s;
}

/// An axis without a sign: its largest part is positive, and no zero is negative.
Vector3 shown(Vector3 axis) {
  Eigen::Index largest = 0;
  axis.cwiseAbs().maxCoeff(&largest);
  if (axis[largest] < 0) axis = -axis;
  for (double& v : axis)
    if (std::abs(v) < 0.005) v = 0;
  return axis;
}

/// Names what the bow's frame is not determined in: principal directions of the covariance, in words.
void name_weak(const Matrix6& covariance, const Vector3& at_mm, std::vector<std::string>* weak) {
  constexpr double kWeak_deg = 0.5, kWeak_mm = 0.5;
  const Matrix6 ad =
      adjoint(Rigid3::from_translation(-at_mm));  // errors at the sensor, not at the bow's origin
  const Matrix6 here = ad * covariance * ad.transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3> turn(here.topLeftCorner<3, 3>()),
      shift(here.bottomRightCorner<3, 3>());
  for (int i = 0; i < 3; ++i) {
    const double deg = std::sqrt(std::max(0.0, turn.eigenvalues()[i])) / kRadPerDeg;
    const Vector3 a = shown(turn.eigenvectors().col(i));
    if (deg > kWeak_deg)
      weak->push_back(fmt::format("rotation about ({:.2f}, {:.2f}, {:.2f}) of the bow is weak: {:.2f} deg",
                                  a.x(), a.y(), a.z(), deg));
  }
  for (int i = 0; i < 3; ++i) {
    const double mm = std::sqrt(std::max(0.0, shift.eigenvalues()[i]));
    const Vector3 a = shown(shift.eigenvectors().col(i));
    if (mm > kWeak_mm)
      weak->push_back(
          fmt::format("position along ({:.2f}, {:.2f}, {:.2f}) of the bow is weak: {:.2f} mm; turn the bow "
                      "about other axes, too",
                      a.x(), a.y(), a.z(), mm));
  }
}

Matrix12 inverse_of(const Matrix12& information) {
  const Eigen::SelfAdjointEigenSolver<Matrix12> eigen(information);
  // An undetermined direction gets a large variance, not an infinite one: 10 m, 10 rad at most.
  Vector12 inverse;
  for (int i = 0; i < 12; ++i) inverse[i] = 1 / std::max(eigen.eigenvalues()[i], 1e-8);
  return eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose();
}

}  // namespace

Result<SensorCalibration> calibrate_sensor(const std::vector<SensorPair>& pairs, double sigma_mm,
                                           double sigma_deg) {
  if (pairs.size() < 5)
    return bad_input(kCannotCalibrateSensor, "poses",
                     fmt::format("{} instants with both instruments, need 5", pairs.size()));
  if (!(sigma_mm > 0) || !(sigma_deg > 0))
    return fail(ErrorCode::kUsage, kCannotCalibrateSensor, "noise",
                "the standard deviation of a reading is needed, in mm and deg");
  double turn = 0, disagreement = 0;
  for (const SensorPair& p : pairs) {
    const double a = (pairs.front().camera_from_bow.inverse() * p.camera_from_bow).angle_rad();
    const double b =
        (pairs.front().transmitter_from_sensor.inverse() * p.transmitter_from_sensor).angle_rad();
    turn = std::max(turn, a);
    disagreement = std::max(disagreement, std::abs(a - b));
  }
  if (turn < 5 * kRadPerDeg)
    return bad_input(
        kCannotCalibrateSensor, "poses",
        fmt::format("the bow turns by {:.1f} deg only: turn it by 20 deg and more about two axes",
                    turn / kRadPerDeg));
  if (disagreement > std::max(5 * kRadPerDeg, 0.3 * turn))
    return bad_input(
        kCannotCalibrateSensor, "poses",
        fmt::format("the instruments differ by {:.1f} deg in how far the bow has turned: the sensor is not "
                    "fixed to it, or the clocks are apart",
                    disagreement / kRadPerDeg));
  std::vector<SensorPair> kept, held_out;
  for (std::size_t i = 0; i < pairs.size(); ++i) (i % 5 == 4 ? held_out : kept).push_back(pairs[i]);
  const Solved without = solve(kept, sigma_mm, sigma_deg * kRadPerDeg),
               s = solve(pairs, sigma_mm, sigma_deg * kRadPerDeg);
  SensorCalibration c;
  const double n = static_cast<double>(pairs.size());
  c.used = pairs.size();
  c.rms_mm = std::sqrt(s.mm2 / n);
  c.rms_deg = std::sqrt(s.rad2 / n) / kRadPerDeg;
  double held = 0;
  for (const SensorPair& p : held_out) held += error_of(p, without.x, without.y).translation_mm.squaredNorm();
  c.held_out_mm = held_out.empty() ? 0 : std::sqrt(held / static_cast<double>(held_out.size()));
  c.camera_from_transmitter = s.y;
  c.bow_from_sensor.value = s.x;
  const double birge = std::max(1.0, s.chi2 / (6 * n - 12));
  c.bow_from_sensor.covariance = birge * inverse_of(s.information).topLeftCorner<6, 6>();
  name_weak(c.bow_from_sensor.covariance, s.x.translation_mm, &c.weak);
  return c;
}

Result<SensorCalibration> calibrate_sensor_by_points(const std::vector<Vector3>& in_bow_mm,
                                                     const std::vector<Vector3>& in_sensor_mm) {
  const std::size_t n = in_bow_mm.size();
  if (n != in_sensor_mm.size() || n < 4)
    return bad_input(kCannotCalibrateSensor, "points",
                     fmt::format("{} of the bow and {} digitised, need 4 of each", n, in_sensor_mm.size()));
  const auto fit = [&](std::size_t left_out) {
    Vector3 to = Vector3::Zero(), from = Vector3::Zero();
    double count = 0;
    for (std::size_t i = 0; i < n; ++i)
      if (i != left_out) to += in_bow_mm[i], from += in_sensor_mm[i], count += 1;
    to /= count, from /= count;
    std::vector<Vector3> a, b;
    for (std::size_t i = 0; i < n; ++i)
      if (i != left_out) a.push_back(in_bow_mm[i] - to), b.push_back(in_sensor_mm[i] - from);
    Rigid3 x;
    x.rotation = turned_onto(a, b);
    x.translation_mm = to - x.rotation * from;
    return x;
  };
  SensorCalibration c;
  c.used = n;
  const Rigid3 x = fit(n);
  double squares = 0, held = 0;
  Matrix6 information = Matrix6::Zero();
  Matrix3 spread = Matrix3::Zero();
  Vector3 centre = Vector3::Zero();
  for (const Vector3& p : in_bow_mm) centre += p / static_cast<double>(n);
  for (std::size_t i = 0; i < n; ++i) {
    squares += (x * in_sensor_mm[i] - in_bow_mm[i]).squaredNorm();
    held += (fit(i) * in_sensor_mm[i] - in_bow_mm[i]).squaredNorm() / static_cast<double>(n);
    Eigen::Matrix<double, 3, 6> j;
    j << -skew(x * in_sensor_mm[i]), Matrix3::Identity();
    information += j.transpose() * j;
    spread += (in_bow_mm[i] - centre) * (in_bow_mm[i] - centre).transpose() / static_cast<double>(n);
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3> shape(spread);
  if (std::sqrt(std::max(0.0, shape.eigenvalues()[1])) < 2)
    return bad_input(kCannotCalibrateSensor, "points",
                     "lie on a line or close together: rotation about it is not determined");
  c.rms_mm = std::sqrt(squares / static_cast<double>(n));
  if (c.rms_mm > 3)
    return bad_input(
        kCannotCalibrateSensor, "points",
        fmt::format("digitised points do not fit the bow's: {:.1f} mm RMS; another order, another bow, or "
                    "not millimetres",
                    c.rms_mm));
  c.held_out_mm = std::sqrt(held);
  const double variance = squares / (3 * static_cast<double>(n) - 6);
  c.bow_from_sensor.value = x;
  c.bow_from_sensor.covariance = variance * information.inverse();
  name_weak(c.bow_from_sensor.covariance, x.translation_mm, &c.weak);
  return c;
}

}  // namespace gnathion
