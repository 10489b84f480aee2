#include "tracking/smoothing.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Cholesky>

namespace gnathion {
namespace {

using Matrix18 = Eigen::Matrix<double, 18, 18>;
using Vector18 = Eigen::Matrix<double, 18, 1>;
using Matrix18x6 = Eigen::Matrix<double, 18, 6>;

/// One reading: the bow's reference point frame in the head frame, and the covariance of its right
/// perturbation.
struct Reading {
  std::size_t row;
  double time_s;
  Rigid3 pose;
  Matrix6 covariance;
};

/// Pose, twist and its rate, all in the moving frame's own axes; errors (δpose, δtwist, δrate) on the right.
struct State {
  Rigid3 pose;
  Vector6 twist = Vector6::Zero(), rate = Vector6::Zero();
  Matrix18 covariance = Matrix18::Zero();
};

struct Densities {
  double rotation, translation;
};

Vector18 minus(const State& a, const State& b) {
  Vector18 d;
  d << log_se3(b.pose.inverse() * a.pose), a.twist - b.twist, a.rate - b.rate;
  return d;
}

void add(const Vector18& d, State* s) {
  s->pose = s->pose * exp_se3(d.head<6>());
  s->twist += d.segment<6>(6);
  s->rate += d.tail<6>();
}

/// White jerk of density q over dt, for one axis of pose, twist, rate; in blocks.
Matrix18 process_noise(double dt, const Densities& q) {
  const double t2 = dt * dt, t3 = t2 * dt, t4 = t3 * dt, t5 = t4 * dt;
  const double block[3][3] = {{t5 / 20, t4 / 8, t3 / 6}, {t4 / 8, t3 / 3, t2 / 2}, {t3 / 6, t2 / 2, dt}};
  Matrix18 noise = Matrix18::Zero();
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b)
      for (int k = 0; k < 6; ++k)
        noise(6 * a + k, 6 * b + k) = block[a][b] * (k < 3 ? q.rotation : q.translation);
  return noise;
}

/// The state dt later; `f` is the errors' transition.
State predicted(const State& s, double dt, const Densities& q, Matrix18* f) {
  State next = s;
  const Vector6 way = dt * s.twist + 0.5 * dt * dt * s.rate;
  const Rigid3 step = exp_se3(way);
  next.pose = s.pose * step;
  next.twist += dt * s.rate;
  f->setIdentity();
  f->block<6, 6>(0, 0) = adjoint(step.inverse());
  f->block<6, 6>(0, 6).diagonal().setConstant(dt);
  f->block<6, 6>(0, 12).diagonal().setConstant(0.5 * dt * dt);
  f->block<6, 6>(6, 12).diagonal().setConstant(dt);
  next.covariance = *f * s.covariance * f->transpose() + process_noise(dt, q);
  return next;
}

/// Takes a reading in; gives −2·log-likelihood of its innovation, and adds its normalised square.
double update(const Reading& z, State* s, double* square) {
  const Vector6 innovation = log_se3(s->pose.inverse() * z.pose);
  const Matrix6 total = s->covariance.topLeftCorner<6, 6>() + z.covariance;
  const Eigen::LLT<Matrix6> llt(total);
  const Matrix18x6 gain = llt.solve(s->covariance.topRows<6>()).transpose();
  const double nis = innovation.dot(llt.solve(innovation));
  add(gain * innovation, s);
  // Joseph's form: stays positive where a reading is far sharper than what was known.
  Matrix18 keep = Matrix18::Identity();
  keep.leftCols<6>() -= gain;
  s->covariance = keep * s->covariance * keep.transpose() + gain * z.covariance * gain.transpose();
  *square += nis;
  return nis + 2 * llt.matrixLLT().diagonal().array().log().sum();
}

State first_state(const Reading& z) {
  constexpr double kTwist_rad = 5, kTwist_mm = 300, kRate_rad = 100, kRate_mm = 1e4;  // faster than jaws are
  State s;
  s.pose = z.pose;
  s.covariance.topLeftCorner<6, 6>() = z.covariance;
  for (int k = 0; k < 6; ++k) {
    s.covariance(6 + k, 6 + k) = std::pow(k < 3 ? kTwist_rad : kTwist_mm, 2);
    s.covariance(12 + k, 12 + k) = std::pow(k < 3 ? kRate_rad : kRate_mm, 2);
  }
  return s;
}

struct Fit {
  double deviance = 0;  ///< −2·log-likelihood
  double squares = 0;
  std::size_t count = 0;
};

/// A stretch without gaps.
using Stretch = std::vector<Reading>;
constexpr std::size_t kSettling = 4;  ///< first readings of a stretch: the twist is not known yet

void filter(const Stretch& stretch, std::size_t from, std::size_t to, const Densities& q, Fit* fit) {
  State s = first_state(stretch[from]);
  Matrix18 f;
  for (std::size_t i = from + 1; i < to; ++i) {
    s = predicted(s, stretch[i].time_s - stretch[i - 1].time_s, q, &f);
    double square = 0;
    const double deviance = update(stretch[i], &s, &square);
    if (i - from <= kSettling) continue;
    fit->deviance += deviance;
    fit->squares += square;
    ++fit->count;
  }
}

/// Pieces of at most 250 readings, spread over the recording.
Fit filter_sample(const std::vector<Stretch>& stretches, const Densities& q, std::size_t most) {
  constexpr std::size_t kPiece = 250;
  std::size_t total = 0;
  for (const Stretch& s : stretches) total += s.size();
  const std::size_t every = std::max<std::size_t>(1, (total + most - 1) / most);
  Fit fit;
  std::size_t piece = 0;
  for (const Stretch& s : stretches)
    for (std::size_t from = 0; from + kSettling + 2 < s.size(); from += kPiece, ++piece)
      if (piece % every == 0) filter(s, from, std::min(from + kPiece, s.size()), q, &fit);
  return fit;
}

/// The densities under which the innovations are most likely: a search in decades, then in thirds and tenths.
Densities most_likely(const std::vector<Stretch>& stretches, const SmoothingOptions& options) {
  double rotation = 2, translation = 6;  // log10; a jaw that chews
  const auto deviance = [&](double r, double t) {
    const Densities q{options.rotation_density.value_or(std::pow(10, r)),
                      options.translation_density.value_or(std::pow(10, t))};
    return filter_sample(stretches, q, options.likelihood_rows).deviance;
  };
  double best = deviance(rotation, translation);
  for (const double step : {1.0, 0.33, 0.1}) {
    for (int round = 0; round < 8; ++round) {
      bool better = false;
      for (double* which : {&rotation, &translation}) {
        if ((which == &rotation ? options.rotation_density : options.translation_density).has_value())
          continue;
        for (const double sign : {1.0, -1.0}) {
          const double was = *which;
          *which = std::clamp(was + sign * step, -6.0, 14.0);
          const double now = deviance(rotation, translation);
          if (now < best - 1e-6) {
            best = now;
            better = true;
            break;
          }
          *which = was;
        }
      }
      if (!better) break;
    }
  }
  return {options.rotation_density.value_or(std::pow(10, rotation)),
          options.translation_density.value_or(std::pow(10, translation))};
}

/// Forward, then backward (Rauch, Tung, Striebel 1965), errors told at the predicted states.
std::vector<State> smooth(const Stretch& stretch, const Densities& q, Fit* fit) {
  const std::size_t n = stretch.size();
  std::vector<State> filtered(n), ahead(n);
  std::vector<Matrix18> transitions(n);
  filtered[0] = first_state(stretch[0]);
  for (std::size_t i = 1; i < n; ++i) {
    ahead[i] = predicted(filtered[i - 1], stretch[i].time_s - stretch[i - 1].time_s, q, &transitions[i]);
    filtered[i] = ahead[i];
    double square = 0;
    fit->deviance += update(stretch[i], &filtered[i], &square);
    if (i > kSettling) fit->squares += square, ++fit->count;
  }
  std::vector<State> smoothed = filtered;
  for (std::size_t i = n - 1; i-- > 0;) {
    const Matrix18 gain =
        ahead[i + 1].covariance.ldlt().solve(transitions[i + 1] * filtered[i].covariance).transpose();
    add(gain * minus(smoothed[i + 1], ahead[i + 1]), &smoothed[i]);
    const Matrix18 cov = filtered[i].covariance +
                         gain * (smoothed[i + 1].covariance - ahead[i + 1].covariance) * gain.transpose();
    smoothed[i].covariance = 0.5 * (cov + cov.transpose());
  }
  return smoothed;
}

std::vector<Stretch> stretches_of(const SessionMotion& session, const SmoothingOptions& options) {
  const Rigid3 to_point = Rigid3::from_translation(options.point_in_bow_mm);
  std::vector<Stretch> stretches;
  for (std::size_t i = 0; i < session.rows.size(); ++i) {
    const MotionRow& row = session.rows[i];
    if (!row.valid()) continue;
    const double t = session.time_s(row);
    if (stretches.empty() || t - stretches.back().back().time_s > options.gap_s) stretches.emplace_back();
    if (!stretches.back().empty() && t <= stretches.back().back().time_s) continue;
    const Rigid3 pose = row.head_from_bow().rigid * to_point;
    const Matrix6 ad = adjoint(pose.inverse());
    Matrix6 cov = ad * row.head_from_bow_covariance() * ad.transpose();
    cov.diagonal().head<3>().array() += 1e-12;  // a micrometre and a microradian: never singular
    cov.diagonal().tail<3>().array() += 1e-6;
    stretches.back().push_back({i, t, pose, cov});
  }
  return stretches;
}

}  // namespace

Result<SmoothedMotion> smooth_motion(const SessionMotion& session, const SmoothingOptions& options) {
  const std::vector<Stretch> stretches = stretches_of(session, options);
  std::size_t total = 0;
  for (const Stretch& s : stretches) total += s.size();
  if (total < 10)
    return bad_input("cannot smooth the motion", "motion", fmt::format("{} valid rows, need 10", total));
  SmoothedMotion result;
  result.rows.resize(session.rows.size());
  result.densities_given = options.rotation_density && options.translation_density;
  const Densities q = most_likely(stretches, options);
  result.rotation_density = q.rotation;
  result.translation_density = q.translation;
  const Rigid3 from_point = Rigid3::from_translation(-options.point_in_bow_mm);
  Fit fit;
  for (const Stretch& stretch : stretches) {
    const std::vector<State> states = smooth(stretch, q, &fit);
    for (std::size_t i = 0; i < states.size(); ++i) {
      SmoothedRow& row = result.rows[stretch[i].row];
      row.valid = true;
      row.head_from_bow = Transform<HeadFrame, Bow>(states[i].pose * from_point);
      const Matrix6 ad = adjoint(states[i].pose);
      row.covariance = ad * states[i].covariance.topLeftCorner<6, 6>() * ad.transpose();
    }
  }
  result.innovation_ratio = fit.count > 0 ? fit.squares / (6.0 * static_cast<double>(fit.count)) : 0;
  return result;
}

SessionMotion smoothed_session(const SessionMotion& session, const SmoothedMotion& smoothed) {
  SessionMotion result = session;
  for (std::size_t i = 0; i < result.rows.size(); ++i) {
    MotionRow& row = result.rows[i];
    if (!smoothed.rows[i].valid) {
      if (row.valid()) row.bow.valid = false, row.bow.reason = "no smoothed pose";
      continue;
    }
    row.bow.camera_from_body = row.head.camera_from_body * smoothed.rows[i].head_from_bow.rigid;
    // All of the error is told with the bow's pose: that of the head is in it already.
    const Matrix6 ad = adjoint(row.head.camera_from_body);
    row.bow.covariance = ad * smoothed.rows[i].covariance * ad.transpose();
    row.head.covariance.setZero();
  }
  return result;
}

}  // namespace gnathion
