#include "tracking/rests.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>

namespace gnathion {
namespace {

constexpr double kSamePlace_mm = 0.4, kSamePlace_deg = 0.4;  // MI is reproduced within about 0.1 mm

/// A valid row and where it puts the reference point in the head frame.
struct Placed {
  double time_s;
  Vector3 point_mm;
  Matrix3 rotation;
};

std::vector<Placed> place(const SessionMotion& session, const PlateauOptions& options) {
  std::vector<Placed> placed;
  for (const MotionRow& row : session.rows) {
    if (!row.valid()) continue;
    const auto pose = row.head_from_bow();
    placed.push_back({session.time_s(row), pose * options.point_in_bow_mm, pose.rigid.rotation});
  }
  return placed;
}

/// Speed at a row from the means of the rows before and after it, within a tenth of a second each. Rotation
/// counts by what it does 80 mm away: a jaw that turns about the reference point does not rest.
std::optional<double> speed_mm_s(const std::vector<Placed>& rows, std::size_t i) {
  constexpr double kHalf_s = 0.1, kLever_mm = 80;
  std::size_t from = i, to = i;
  while (from > 0 && rows[i].time_s - rows[from - 1].time_s <= kHalf_s) --from;
  while (to + 1 < rows.size() && rows[to + 1].time_s - rows[i].time_s <= kHalf_s) ++to;
  if (to - from < 4) return std::nullopt;
  // Least-squares slope of position over time, and the turn from end to end.
  double mean_t = 0;
  Vector3 mean_p = Vector3::Zero();
  const double n = static_cast<double>(to - from + 1);
  for (std::size_t k = from; k <= to; ++k) mean_t += rows[k].time_s / n, mean_p += rows[k].point_mm / n;
  double tt = 0;
  Vector3 tp = Vector3::Zero(), tw = Vector3::Zero();
  for (std::size_t k = from; k <= to; ++k) {
    const double t = rows[k].time_s - mean_t;
    tt += t * t;
    tp += t * (rows[k].point_mm - mean_p);
    tw += t * log_so3(rows[k].rotation * rows[i].rotation.transpose());
  }
  return (tp / tt).norm() + kLever_mm * (tw / tt).norm();
}

bool same_place(const Plateau& a, const Plateau& b, const PlateauOptions& options) {
  const Rigid3 &x = a.head_from_bow.value.rigid, &y = b.head_from_bow.value.rigid;
  return (x * options.point_in_bow_mm - y * options.point_in_bow_mm).norm() < kSamePlace_mm &&
         (x.inverse() * y).angle_rad() < kSamePlace_deg * M_PI / 180;
}

}  // namespace

std::vector<Plateau> find_rests(const SessionMotion& session, const PlateauOptions& options) {
  const std::vector<Placed> rows = place(session, options);
  std::vector<Plateau> rests;
  std::size_t start = 0;
  bool resting = false;
  const auto close = [&](std::size_t end) {
    if (!std::exchange(resting, false)) return;
    if (rows[end].time_s - rows[start].time_s < options.rest_min_s) return;
    auto rest = plateau_between(session, rows[start].time_s, rows[end].time_s, options);
    if (!rest) return;
    rest->source = "found";
    rests.push_back(std::move(*rest));
  };
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (i > 0 && rows[i].time_s - rows[i - 1].time_s > 0.25) close(i - 1);  // a gap ends a rest
    const auto speed = speed_mm_s(rows, i);
    const bool slow = speed && *speed <= options.rest_speed_mm_s;
    if (slow && !resting) start = i, resting = true;
    if (!slow && resting) close(i - 1);
  }
  if (!rows.empty()) close(rows.size() - 1);
  return rests;
}

Status label_rests(const std::vector<Plateau>& rests, const PlateauOptions& options,
                   JawPositions* positions) {
  const std::string what = "cannot find MI and TP", where = "session";
  if (rests.empty()) return bad_input(what, where, "no marks, no intervals given, and the jaw never rests");
  std::vector<std::vector<std::size_t>> places;  // rests by position, in order of first visit
  for (std::size_t i = 0; i < rests.size(); ++i) {
    const auto known = std::find_if(places.begin(), places.end(), [&](const auto& place) {
      return same_place(rests[place.front()], rests[i], options);
    });
    if (known != places.end()) {
      known->push_back(i);
    } else {
      places.push_back({i});
    }
  }
  if (positions->mi.empty()) {
    const auto most = std::max_element(places.begin(), places.end(),
                                       [](const auto& a, const auto& b) { return a.size() < b.size(); });
    for (const std::size_t i : *most) positions->mi.push_back(rests[i]);
    positions->notes.push_back(fmt::format(
        "MI was not marked: taken as the rest that is visited most often, {} times", most->size()));
  }
  if (positions->tp.empty()) {
    const Plateau* longest = nullptr;
    for (const Plateau& rest : rests) {
      if (same_place(rest, positions->mi.front(), options)) continue;
      if (longest == nullptr || rest.end_s - rest.start_s > longest->end_s - longest->start_s)
        longest = &rest;
    }
    if (longest == nullptr) return bad_input(what, where, "no TP: every rest is at MI");
    positions->tp.push_back(*longest);
    positions->notes.push_back(
        fmt::format("TP was not marked: taken as the longest rest away from MI, {:.1f}..{:.1f} s",
                    longest->start_s, longest->end_s));
  }
  return {};
}

}  // namespace gnathion
