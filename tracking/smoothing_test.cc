#include "tracking/smoothing.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include <Eigen/Cholesky>

#include "core/random.h"
#include "tracking/se3_mean.h"

namespace gnathion {
namespace {

constexpr double kRate_hz = 60;
const Vector3 kIncisal(0, 5, 60);

/// MI for 1.5 s, fast chewing (1.8 Hz, 14 deg and 3 mm of slide) for 4 s, MI again; the head stands still.
Rigid3 truth_at(double t) {
  const Rigid3 mi{exp_so3(Vector3(0.1, -0.2, 0.05)), Vector3(3, 70, 20)};
  if (t < 1.5 || t > 5.5) return mi;
  const double turn = 2 * M_PI * 1.8 * (t - 1.5),
               grown = std::min(1.0, (t - 1.5) * 2) * std::min(1.0, (5.5 - t) * 2);
  const double way = 0.5 * (1 - std::cos(turn)) * grown, side = std::sin(turn) * way;
  return Rigid3::from_translation({1.5 * side, -3 * way, -2 * way}) *
         Rigid3::about_axis(Vector3(0, 40, -90), Vector3(1, 0, 0.08 * side), 0.24 * way) * mi;
}

struct Session {
  SessionMotion motion;
  std::vector<Rigid3> truth;
};

Session session_of(std::uint64_t seed) {
  Session s;
  Random random(seed);
  Matrix6 cov = Matrix6::Zero();
  cov.diagonal() << Vector3::Constant(1.5e-8), Vector3(6e-5, 6e-5, 9e-4);
  const Matrix6 ad = adjoint(Rigid3::from_translation(truth_at(0) * kIncisal));
  cov = ad * cov * ad.transpose();
  const Matrix6 l = Eigen::LLT<Matrix6>(cov).matrixL();
  for (int i = 0; i < 7 * kRate_hz; ++i) {
    MotionRow row;
    row.capture.ns = static_cast<std::int64_t>(i / kRate_hz * 1e9);
    const double t = s.motion.time_s(row);
    Vector6 e;
    for (int k = 0; k < 6; ++k) e[k] = random.normal();
    s.truth.push_back(truth_at(t));
    row.bow.camera_from_body = exp_se3(l * e) * s.truth.back();
    row.bow.covariance = cov;
    row.bow.valid = row.head.valid = true;
    if (i % 41 == 7 || (t > 3.0 && t < 3.4)) row.bow.valid = false, row.bow.reason = "no tag seen";
    s.motion.rows.push_back(row);
  }
  return s;
}

SmoothedMotion smoothed(const Session& s) {
  SmoothingOptions options;
  options.point_in_bow_mm = kIncisal;
  auto r = smooth_motion(s.motion, options);
  EXPECT_TRUE(r.has_value());
  return std::move(*r);
}

TEST(Smoothing, LowersTheErrorInFastChewingAndSaysHowMuchIsLeft) {
  double raw2 = 0, smooth2 = 0, nees = 0, n = 0;
  for (std::uint64_t seed = 700; seed < 710; ++seed) {
    const Session s = session_of(seed);
    const SmoothedMotion m = smoothed(s);
    EXPECT_NEAR(m.innovation_ratio, 1, 0.25);
    for (std::size_t i = 0; i < s.truth.size(); ++i) {
      const double t = s.motion.time_s(s.motion.rows[i]);
      if (!m.rows[i].valid || t < 1.6 || t > 5.4) continue;
      const Vector3 truth = s.truth[i] * kIncisal;
      raw2 += (s.motion.rows[i].head_from_bow() * kIncisal - truth).squaredNorm();
      smooth2 += (m.rows[i].head_from_bow * kIncisal - truth).squaredNorm();
      const Vector6 xi = difference(s.truth[i], m.rows[i].head_from_bow.rigid);
      nees += xi.dot(m.rows[i].covariance.ldlt().solve(xi)) / 6;
      n += 1;
    }
  }
  std::printf("chewing: raw %.4f mm, smoothed %.4f mm RMS at the incisal point; NEES/6 %.2f\n",
              std::sqrt(raw2 / n), std::sqrt(smooth2 / n), nees / n);
  EXPECT_LE(smooth2, 0.7 * raw2);
  EXPECT_GE(nees / n, 0.6);
  EXPECT_LE(nees / n, 1.4);
}

TEST(Smoothing, CutsNoTurningPointAndPullsNoRest) {
  double peak_error = 0, rest_shift2 = 0, rest_sigma2 = 0;
  int peaks = 0;
  for (std::uint64_t seed = 720; seed < 728; ++seed) {
    const Session s = session_of(seed);
    const SmoothedMotion m = smoothed(s);
    std::vector<Rigid3> raw_rest, smooth_rest;
    for (std::size_t i = 1; i + 1 < s.truth.size(); ++i) {
      const double t = s.motion.time_s(s.motion.rows[i]);
      if (!m.rows[i].valid) continue;
      const auto away = [&](const Rigid3& x) { return (x * kIncisal - s.truth[0] * kIncisal).norm(); };
      if (t > 2.2 && t < 5 && away(s.truth[i]) > away(s.truth[i - 1]) &&
          away(s.truth[i]) > away(s.truth[i + 1])) {
        peak_error += away(m.rows[i].head_from_bow.rigid) - away(s.truth[i]);
        ++peaks;
      }
      if (t < 1.45) {  // up to just before the movement starts
        raw_rest.push_back(s.motion.rows[i].head_from_bow().rigid);
        smooth_rest.push_back(m.rows[i].head_from_bow.rigid);
      }
    }
    const PoseMean raw = robust_mean(raw_rest), smooth = robust_mean(smooth_rest);
    rest_shift2 += (smooth.mean * kIncisal - raw.mean * kIncisal).squaredNorm();
    rest_sigma2 += point_covariance(raw.mean_covariance, raw.mean * kIncisal).trace();
  }
  std::printf("turning points: %+.4f mm on average of %d; means of rests shifted by %.2f of their sigma\n",
              peak_error / peaks, peaks, std::sqrt(rest_shift2 / rest_sigma2));
  EXPECT_GE(peaks, 30);
  EXPECT_LE(std::abs(peak_error / peaks), 0.01);
  EXPECT_LE(rest_shift2, 0.25 * rest_sigma2);
}

TEST(Smoothing, GapsStayGapsAndTheRawMotionIsKept) {
  const Session s = session_of(740);
  const SmoothedMotion m = smoothed(s);
  ASSERT_EQ(m.rows.size(), s.motion.rows.size());
  for (std::size_t i = 0; i < m.rows.size(); ++i) EXPECT_EQ(m.rows[i].valid, s.motion.rows[i].valid());
  const SessionMotion told = smoothed_session(s.motion, m);
  for (std::size_t i = 0; i < m.rows.size(); ++i) {
    ASSERT_EQ(told.rows[i].valid(), s.motion.rows[i].valid());
    if (!m.rows[i].valid) continue;
    EXPECT_LE((told.rows[i].head_from_bow() * kIncisal - m.rows[i].head_from_bow * kIncisal).norm(), 1e-9);
  }
  SessionMotion few = s.motion;
  few.rows.resize(5);
  EXPECT_FALSE(smooth_motion(few, {}).has_value());
}

TEST(Smoothing, GivenDensitiesAreUsed) {
  const Session s = session_of(741);
  SmoothingOptions options;
  options.rotation_density = 1;
  options.translation_density = 1000;
  const auto stiff = smooth_motion(s.motion, options);
  ASSERT_TRUE(stiff.has_value());
  EXPECT_EQ(stiff->rotation_density, 1);
  EXPECT_EQ(stiff->translation_density, 1000);
  EXPECT_TRUE(stiff->densities_given);
  EXPECT_GT(stiff->innovation_ratio, 1.3);  // far too stiff for chewing, and it says so
}

/// JAWS-3D: columns of time and values after two lines of header.
std::vector<std::vector<double>> rows_of(const std::string& path) {
  std::ifstream in(path);
  std::vector<std::vector<double>> rows;
  std::string line;
  for (int i = 0; std::getline(in, line); ++i) {
    if (i < 2) continue;
    std::istringstream fields(line);
    std::vector<double> row;
    for (double v; fields >> v;) row.push_back(v);
    if (!row.empty()) rows.push_back(row);
  }
  return rows;
}

TEST(Smoothing, OfARealRecordingStaysWithinItsRounding) {
  const char* shared = std::getenv("GNATHION_SHARED");
  const std::string folder = std::string(shared ? shared : "../shared") + "/data/motion/jaws3d/";
  const auto positions = rows_of(folder + "jawPosition.txt"), turns = rows_of(folder + "jawAxisangle.txt");
  if (positions.empty()) GTEST_SKIP() << "no JAWS-3D recording beside the repository";
  SessionMotion session;
  for (std::size_t i = 0; i < std::min(positions.size(), turns.size()); ++i) {
    const auto &p = positions[i], &w = turns[i];
    ASSERT_GE(p.size(), 4u);
    ASSERT_GE(w.size(), 5u);
    MotionRow row;
    row.capture.ns = static_cast<std::int64_t>(p[0] * 1e9);
    row.head.valid = row.bow.valid = true;
    const double angle = w[4];
    const Vector3 axis(w[1], w[2], w[3]);
    row.bow.camera_from_body = {axis.norm() > 0 ? exp_so3(axis.normalized() * angle) : Matrix3::Identity(),
                                Vector3(p[1], p[2], p[3])};
    // The file is rounded to 0.01 mm and 0.01 rad: uniform errors.
    row.bow.covariance.diagonal() << Vector3::Constant(1e-4 / 12), Vector3::Constant(1e-4 / 12);
    session.rows.push_back(row);
  }
  ASSERT_GT(session.rows.size(), 900u);
  const auto m = smooth_motion(session, {});
  ASSERT_TRUE(m.has_value());
  double off2 = 0, jump_raw = 0, jump = 0, n = 0;
  for (std::size_t i = 2; i < session.rows.size(); ++i) {
    if (!m->rows[i].valid || !m->rows[i - 2].valid) continue;
    const auto p = [&](std::size_t k) { return m->rows[k].head_from_bow.rigid.translation_mm; };
    const auto q = [&](std::size_t k) { return session.rows[k].head_from_bow().rigid.translation_mm; };
    off2 += (p(i) - q(i)).squaredNorm();
    jump += (p(i) - 2 * p(i - 1) + p(i - 2)).squaredNorm();
    jump_raw += (q(i) - 2 * q(i - 1) + q(i - 2)).squaredNorm();
    n += 1;
  }
  std::printf(
      "JAWS-3D: %zu rows, moved by %.4f mm RMS, second differences %.4f -> %.4f mm; innovations %.2f\n",
      session.rows.size(), std::sqrt(off2 / n), std::sqrt(jump_raw / n), std::sqrt(jump / n),
      m->innovation_ratio);
  EXPECT_LE(std::sqrt(off2 / n), 0.02);
  EXPECT_LE(jump, 0.5 * jump_raw);
}

}  // namespace
}  // namespace gnathion
