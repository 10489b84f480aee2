#include "anatomy/motion_envelope.h"

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr double kThinMm = 0.15;         // recorded positions closer together than this say the same
constexpr std::size_t kMostRows = 1500;  // of those that are kept
constexpr double kSolvedMm = 1e-3;
constexpr int kMostSteps = 400;

const char* const kNames[] = {"incisal point", "left end of the arch", "right end of the arch",
                              "left condyle", "right condyle"};

}  // namespace

MotionEnvelope::MotionEnvelope(const std::vector<Rigid3>& motions, const ArchFrame& arch,
                               const Vector3& condyle_left_mm, const Vector3& condyle_right_mm)
    : points_mm_{arch.incisal_mm, arch.curve_mm.back(), arch.curve_mm.front(), condyle_left_mm,
                 condyle_right_mm} {
  rows_.push_back(Features::Zero());  // MI
  index_.push_back(kMi);
  // A recording rests for seconds: of positions closer than kThinMm to a kept one nearby in time, one is
  // kept.
  double thin = kThinMm;
  for (;; thin *= 1.5) {
    for (std::size_t i = 0; i < motions.size(); ++i) {
      const Features f = features_of(motions[i]);
      reach_mm_ = std::max(reach_mm_, f.head<3>().norm());
      if (largest_of(f - rows_.back()).first < thin) continue;
      rows_.push_back(f);
      index_.push_back(i);
    }
    if (rows_.size() <= kMostRows) break;
    rows_.resize(1);
    index_.resize(1);
  }
}

MotionEnvelope::Features MotionEnvelope::features_of(const Rigid3& motion) const {
  Features f;
  for (int k = 0; k < kPoints; ++k) {
    const Vector3& p = points_mm_[static_cast<std::size_t>(k)];
    f.segment<3>(3 * k) = motion * p - p;
  }
  return f;
}

std::pair<double, int> MotionEnvelope::largest_of(const Features& f) {
  std::pair<double, int> out{0.0, 0};
  for (int k = 0; k < kPoints; ++k)
    if (const double d = f.segment<3>(3 * k).norm(); d > out.first) out = {d, k};
  return out;
}

EnvelopeDistance MotionEnvelope::distance(const Rigid3& motion) const {
  const Features wanted = features_of(motion);
  EnvelopeDistance out;
  std::size_t nearest = 0;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const double d = largest_of(wanted - rows_[i]).first;
    if (i == 0 || d < out.nearest_mm) {
      out.nearest_mm = d;
      nearest = i;
    }
  }
  if (index_[nearest] != kMi) out.nearest_row = index_[nearest];

  // The hull's point nearest to the wanted one in the least-squares sense: Frank and Wolfe's method with away
  // steps (Guelat and Marcotte 1986), from the nearest recorded position.
  std::vector<double> weight(rows_.size(), 0.0);
  weight[nearest] = 1.0;
  Features at = rows_[nearest];
  for (int step = 0; step < kMostSteps; ++step) {
    const Features slope = at - wanted;
    std::size_t towards = 0, away = nearest;
    double least = 1e300, most = -1e300;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const double s = slope.dot(rows_[i]);
      if (s < least) least = s, towards = i;
      if (weight[i] > 0.0 && s > most) most = s, away = i;
    }
    const double here = slope.dot(at);
    if (here - least < kSolvedMm * kSolvedMm) break;
    const bool forward = here - least >= most - here;
    const Features way = forward ? Features(rows_[towards] - at) : Features(at - rows_[away]);
    const double longest = forward ? 1.0 : weight[away] / (1.0 - weight[away]);
    const double length2 = way.squaredNorm();
    if (length2 <= 0.0) break;
    const double t = std::clamp(-slope.dot(way) / length2, 0.0, longest);
    if (forward) {
      for (double& w : weight) w *= 1.0 - t;
      weight[towards] += t;
    } else {
      for (double& w : weight) w *= 1.0 + t;
      weight[away] -= t;
      if (t == longest) weight[away] = 0.0;
    }
    at += t * way;
  }
  const auto [outside, landmark] = largest_of(wanted - at);
  if (outside > 10.0 * kSolvedMm) {
    out.outside_mm = outside;
    out.landmark = kNames[landmark];
  } else {
    out.landmark = kNames[0];
  }
  out.where_mm = motion * points_mm_[static_cast<std::size_t>(outside > 10.0 * kSolvedMm ? landmark : 0)];
  return out;
}

}  // namespace gnathion
