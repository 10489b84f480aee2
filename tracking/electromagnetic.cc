#include "tracking/electromagnetic.h"
#include "core/angle.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>

namespace gnathion {
namespace {

const char* const kCannotTrackSensor = "cannot track by electromagnetic poses";

/// One reading of a sensor, or why there is none.
struct Reading {
  std::uint32_t sequence = 0;
  HostTime capture;
  bool valid = false;
  std::string reason;
  Rigid3 pose;        ///< transmitter_from_sensor
  bool lost = false;  ///< told by the ledger: its time is that of the line, not its own
};

/// Lost readings are told when the next one has come, with its time: they were taken between the two
/// neighbours that arrived, evenly.
void spread_lost(std::vector<Reading>& readings) {
  std::stable_sort(readings.begin(), readings.end(), [](const Reading& a, const Reading& b) {
    return a.capture != b.capture ? a.capture < b.capture : a.lost && !b.lost;
  });
  for (auto begin = readings.begin(); begin != readings.end();) {
    if (!begin->lost) {
      ++begin;
      continue;
    }
    auto end = begin;
    while (end != readings.end() && end->lost) ++end;
    if (begin != readings.begin() && end != readings.end()) {
      const std::int64_t from_ns = (begin - 1)->capture.ns, span_ns = end->capture.ns - from_ns;
      for (auto it = begin; it != end; ++it)
        it->capture = HostTime{from_ns + span_ns * (it - begin + 1) / (end - begin + 1)};
    }
    begin = end;
  }
}

double median(std::vector<double> v) {
  if (v.empty()) return 0;
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

/// All that the source has, by stream; only poses of the streams that are asked for are kept.
class Readings {
 public:
  explicit Readings(const ElectromagneticSetup& setup) {
    for (const std::string& s : {setup.bow.stream, setup.head.stream}) streams_[s];
    for (const RigidPair& p : setup.pairs) streams_[p.first], streams_[p.second];
  }

  Status pull(Source& source, SessionMotion* session) {
    bool first = true;
    while (true) {
      auto pulled = source.next();
      if (!pulled) return in_context(kCannotTrackSensor, pulled.error());
      if (!*pulled) break;
      if (first) session->start = header_of(**pulled).capture;
      first = false;
      take(std::move(**pulled), session);
    }
    for (auto& [name, readings] : streams_) spread_lost(readings);
    std::stable_sort(
        session->events.begin(), session->events.end(),
        [](const EventSample& a, const EventSample& b) { return a.header.capture < b.header.capture; });
    return check();
  }
  const std::vector<Reading>& of(const std::string& stream) const { return streams_.at(stream); }

 private:
  void take(Sample sample, SessionMotion* session) {
    if (auto* event = std::get_if<EventSample>(&sample)) {
      session->events.push_back(std::move(*event));
    } else if (auto* pose = std::get_if<PoseSample>(&sample)) {
      seen_.insert(pose->header.stream);
      const auto stream = streams_.find(pose->header.stream);
      if (stream == streams_.end()) {
        ++session->ledger[pose->header.stream].ignored;
        return;
      }
      ++session->ledger[pose->header.stream].frames;
      stream->second.push_back({pose->header.sequence, pose->header.capture, pose->valid, pose->reason,
                                pose->reference_from_body});
    } else if (auto* told = std::get_if<LedgerSample>(&sample)) {
      if (told->fate == LedgerSample::Fate::kAccepted || !streams_.count(told->header.stream)) return;
      StreamLedger& ledger = session->ledger[told->header.stream];
      const bool rejected = told->fate == LedgerSample::Fate::kRejected;
      (rejected ? ledger.rejected : ledger.missing) += told->count;
      constexpr std::uint32_t kMostInOneGap = 100000;
      for (std::uint32_t i = 0; i < std::min(told->count, kMostInOneGap); ++i)  // no reading vanishes
        streams_[told->header.stream].push_back({told->header.sequence + i,
                                                 told->header.capture,
                                                 false,
                                                 (rejected ? "rejected: " : "missing: ") + told->reason,
                                                 {},
                                                 true});
    }
  }

  Status check() const {
    for (const auto& [name, readings] : streams_) {
      std::vector<double> distances_mm;
      for (const Reading& r : readings) {
        if (!r.valid) continue;
        distances_mm.push_back(r.pose.translation_mm.norm());
      }
      if (distances_mm.empty())
        return bad_input(kCannotTrackSensor, name, "no valid pose of it" + streams_seen());
      // Nearly the farthest: one wild reading says nothing about the unit.
      const auto rank = distances_mm.begin() + static_cast<std::ptrdiff_t>(distances_mm.size() * 19 / 20);
      std::nth_element(distances_mm.begin(), rank, distances_mm.end());
      const double farthest = *rank;
      if (farthest < 10)
        return bad_input(
            kCannotTrackSensor, name,
            fmt::format("its sensor never is farther than {:.3f} mm from the transmitter: these look "
                        "like metres, millimetres are needed",
                        farthest));
      if (farthest > 5000)
        return bad_input(
            kCannotTrackSensor, name,
            fmt::format("its sensor is {:.0f} mm from the transmitter: not millimetres", farthest));
    }
    return {};
  }

  std::string streams_seen() const {
    std::string text = seen_.empty() ? "; the recording has no poses at all" : "; the recording has";
    for (const std::string& s : seen_) text += (text.back() == 's' ? " " : ", ") + s;
    return text;
  }

  std::map<std::string, std::vector<Reading>> streams_;
  std::set<std::string> seen_;
};

/// The reading nearest to a time, if near enough.
const Reading* reading_at(const std::vector<Reading>& readings, HostTime time, double within_s) {
  const auto after = std::lower_bound(readings.begin(), readings.end(), time,
                                      [](const Reading& r, HostTime t) { return r.capture < t; });
  const Reading* nearest = nullptr;
  double distance = within_s;
  for (auto it = after == readings.begin() ? after : after - 1; it != readings.end() && it <= after; ++it) {
    const double d = std::abs(it->capture.seconds_since(time));
    if (d <= distance) distance = d, nearest = &*it;
  }
  return nearest;
}

/// Standard deviations of one reading, each axis, from third differences in time: their variance is 20 times
/// that of a reading, and a head's or jaw's movement is all but gone from them at the rates of these
/// instruments. The quarter of the recording that scatters least tells: while the jaw rests.
void measure_noise(const std::vector<Reading>& readings, double* sigma_mm, double* sigma_rad) {
  std::vector<double> shifts, turns;
  for (std::size_t i = 3; i < readings.size(); ++i) {
    const Reading* r[4];
    bool good = true;
    for (std::size_t k = 0; k < 4; ++k) good = good && (r[k] = &readings[i - k])->valid;
    if (!good) continue;
    const Vector3 d = r[0]->pose.translation_mm - 3 * r[1]->pose.translation_mm +
                      3 * r[2]->pose.translation_mm - r[3]->pose.translation_mm;
    const auto w = [&](int k) { return log_so3(r[k]->pose.rotation * r[1]->pose.rotation.transpose()); };
    shifts.push_back(d.squaredNorm() / 60);
    turns.push_back((w(0) + 3 * w(2) - w(3)).squaredNorm() / 60);
  }
  // Windows of 25, ordered by their mean: the median of the lower half leaves movement and bad readings out.
  const auto quiet = [](const std::vector<double>& squares) {
    constexpr std::size_t kWindow = 25;
    std::vector<double> means;
    for (std::size_t i = 0; i + kWindow <= squares.size(); i += kWindow) {
      double mean = 0;
      for (std::size_t k = i; k < i + kWindow; ++k) mean += squares[k] / kWindow;
      means.push_back(mean);
    }
    if (means.empty()) return median(squares);
    std::sort(means.begin(), means.end());
    return means[means.size() / 4];
  };
  *sigma_mm = std::sqrt(quiet(shifts));
  *sigma_rad = std::sqrt(quiet(turns));
}

/// Where the second sensor of a pair is, seen by the first, at one time.
struct Between {
  HostTime time;
  double distance_mm;
  Matrix3 rotation;
  Vector3 where_mm;
};

std::vector<Between> between(const Readings& readings, const RigidPair& pair, double within_s) {
  std::vector<Between> all;
  for (const Reading& a : readings.of(pair.first)) {
    if (!a.valid) continue;
    const Reading* b = reading_at(readings.of(pair.second), a.capture, within_s);
    if (b == nullptr || !b->valid) continue;
    const Rigid3 rel = a.pose.inverse() * b->pose;
    all.push_back({a.capture, rel.translation_mm.norm(), rel.rotation, a.pose.translation_mm});
  }
  return all;
}

/// The rotation that half of all are near: the one with the least median angle to a sample of the others.
Matrix3 median_rotation(const std::vector<Between>& all) {
  const std::size_t step = std::max<std::size_t>(1, all.size() / 60);
  Matrix3 best = all.front().rotation;
  double least = 1e300;
  for (std::size_t i = 0; i < all.size(); i += step) {
    std::vector<double> angles;
    for (std::size_t k = 0; k < all.size(); k += step)
      angles.push_back(log_so3(all[i].rotation.transpose() * all[k].rotation).norm());
    if (const double m = median(angles); m < least) least = m, best = all[i].rotation;
  }
  // One step of averaging over those nearby: a single reading's own noise goes out.
  Vector3 mean = Vector3::Zero();
  double n = 0;
  for (const Between& b : all) {
    const Vector3 w = log_so3(best.transpose() * b.rotation);
    if (w.norm() <= 3 * least + 1e-9) mean += w, n += 1;
  }
  return n > 0 ? Matrix3(best * exp_so3(mean / n)) : best;
}

Result<std::vector<Distortion>> find_distortions(const Readings& readings, const RigidPair& pair,
                                                 const ElectromagneticSetup& setup, double sigma_mm,
                                                 double sigma_rad, HostTime start) {
  const std::vector<Between> all = between(readings, pair, setup.same_instant_s);
  const std::string name = pair.first + " and " + pair.second;
  if (all.size() < 20)
    return bad_input(kCannotTrackSensor, name,
                     fmt::format("only {} instants with both sensors: nothing to check", all.size()));
  std::vector<double> distances;
  for (const Between& b : all) distances.push_back(b.distance_mm);
  const double distance = median(distances);
  const Matrix3 rotation = median_rotation(all);
  const double limit_mm = std::max(setup.distortion_sigmas * std::sqrt(2.0) * sigma_mm, setup.distortion_mm);
  const double limit_rad =
      std::max(setup.distortion_sigmas * std::sqrt(2.0) * sigma_rad, setup.distortion_deg * kRadPerDeg);
  std::vector<Distortion> found;
  std::size_t off = 0, last_off = 0, in_this = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double mm = std::abs(all[i].distance_mm - distance);
    const double rad = log_so3(rotation.transpose() * all[i].rotation).norm();
    if (mm <= limit_mm && rad <= limit_rad) continue;
    ++off;
    // Neighbours within a tenth of a second are one event.
    if (found.empty() || all[i].time.seconds_since(all[last_off].time) > 0.1) {
      found.push_back({pair, all[i].time.seconds_since(start), 0, 0, 0, Vector3::Zero()});
      in_this = 0;
    }
    last_off = i;
    Distortion& d = found.back();
    ++in_this;
    d.end_s = all[i].time.seconds_since(start);
    d.largest_mm = std::max(d.largest_mm, mm);
    d.largest_deg = std::max(d.largest_deg, rad / kRadPerDeg);
    d.where_mm += (all[i].where_mm - d.where_mm) / static_cast<double>(in_this);
  }
  if (2 * off > all.size())
    return bad_input(
        kCannotTrackSensor, name,
        fmt::format("their distance and rotation change in {} of {} readings (beyond {:.2f} mm, {:.2f} "
                    "deg): not on one rigid body, or metal close to the transmitter",
                    off, all.size(), limit_mm, limit_rad / kRadPerDeg));
  found.erase(
      std::remove_if(found.begin(), found.end(),
                     [&](const Distortion& d) { return d.end_s - d.start_s < setup.least_distortion_s; }),
      found.end());
  return found;
}

/// Pose and covariance of the body from its sensor's reading. A reading's errors: turned about the sensor by
/// sigma_rad, shifted by sigma_mm, each axis. That of the mount is the same in all readings and is not here
/// (it goes with T_D).
BodyPose body_pose(const Reading& r, const SensorMount& mount, double sigma_mm, double sigma_rad) {
  BodyPose pose;
  pose.valid = r.valid;
  pose.reason = r.valid ? "" : r.reason.empty() ? "not valid" : r.reason;
  if (!r.valid) return pose;
  pose.camera_from_body = r.pose * mount.body_from_sensor.value.inverse();
  Matrix6 at_sensor = Matrix6::Zero();
  at_sensor.topLeftCorner<3, 3>() = Matrix3::Identity() * sigma_rad * sigma_rad;
  at_sensor.bottomRightCorner<3, 3>() = Matrix3::Identity() * sigma_mm * sigma_mm;
  const Matrix6 ad = adjoint(Rigid3::from_translation(r.pose.translation_mm));
  pose.covariance = ad * at_sensor * ad.transpose();
  return pose;
}

}  // namespace

std::string Distortion::text() const {
  return fmt::format(
      "{:.2f}..{:.2f} s: {} and {} are off by up to {:.2f} mm and {:.2f} deg near ({:.0f}, {:.0f}, "
      "{:.0f}) mm from the transmitter: metal in the field",
      start_s, end_s, pair.first, pair.second, largest_mm, largest_deg, where_mm.x(), where_mm.y(),
      where_mm.z());
}

Result<ElectromagneticMotion> electromagnetic_motion(Source& source, const ElectromagneticSetup& setup) {
  if (setup.bow.stream == setup.head.stream)
    return bad_input(kCannotTrackSensor, setup.bow.stream, "is named for the bow and for the head");
  ElectromagneticMotion motion;
  Readings readings(setup);
  GNATHION_CHECK_OK(readings.pull(source, &motion.session));
  double sigma_mm = setup.sigma_mm, sigma_rad = setup.sigma_deg * kRadPerDeg;
  if (!(sigma_mm > 0) || !(sigma_rad > 0)) {
    double mm[2], rad[2];
    measure_noise(readings.of(setup.bow.stream), &mm[0], &rad[0]);
    measure_noise(readings.of(setup.head.stream), &mm[1], &rad[1]);
    if (!(sigma_mm > 0)) sigma_mm = std::max({mm[0], mm[1], 1e-4});
    if (!(sigma_rad > 0)) sigma_rad = std::max({rad[0], rad[1], 1e-6});
    motion.notes.push_back(
        fmt::format("noise of a reading taken from its own scatter: {:.3f} mm, {:.3f} deg an axis", sigma_mm,
                    sigma_rad / kRadPerDeg));
  }
  motion.sigma_mm = sigma_mm;
  motion.sigma_deg = sigma_rad / kRadPerDeg;
  if (setup.pairs.empty())
    motion.notes.push_back("no two sensors on one rigid body are named: distortion by metal was not checked");
  for (const RigidPair& pair : setup.pairs) {
    GNATHION_TRY(const auto found,
                 find_distortions(readings, pair, setup, sigma_mm, sigma_rad, motion.session.start));
    motion.distortions.insert(motion.distortions.end(), found.begin(), found.end());
  }
  for (const Reading& bow : readings.of(setup.bow.stream)) {
    MotionRow row;
    row.sequence = bow.sequence;
    row.capture = bow.capture;
    row.cameras = 1;
    row.bow = body_pose(bow, setup.bow, sigma_mm, sigma_rad);
    const Reading* head = reading_at(readings.of(setup.head.stream), bow.capture, setup.same_instant_s);
    if (head != nullptr) {
      row.head = body_pose(*head, setup.head, sigma_mm, sigma_rad);
    } else {
      row.head.reason = "no reading of " + setup.head.stream + " at this time";
    }
    const double t = motion.session.time_s(row);
    for (const Distortion& d : motion.distortions) {
      if (t < d.start_s - 0.05 || t > d.end_s + 0.05) continue;
      row.bow.valid = row.head.valid = false;
      row.bow.reason = row.head.reason = "metal in the field: " + d.pair.first + " against " + d.pair.second;
    }
    motion.session.rows.push_back(std::move(row));
  }
  return motion;
}

}  // namespace gnathion
