#include "tracking/rests.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>

namespace gnathion {
namespace {

const char* const kCannotFindRests = "cannot find MI and TP";
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
  constexpr double kHalf_s = 0.1, kWidest_s = 0.4, kLever_mm = 80;
  std::size_t from = i, to = i;
  while (from > 0 && rows[i].time_s - rows[from - 1].time_s <= kHalf_s) --from;
  while (to + 1 < rows.size() && rows[to + 1].time_s - rows[i].time_s <= kHalf_s) ++to;
  // Slow cameras: the nearest rows, as long as they are near in time.
  const auto near = [&](std::size_t k) { return std::abs(rows[k].time_s - rows[i].time_s) <= kWidest_s; };
  while (to - from < 4) {
    const bool down = from > 0 && near(from - 1), up = to + 1 < rows.size() && near(to + 1);
    if (!down && !up) return std::nullopt;
    if (down && (!up || i - from <= to - i))
      --from;
    else
      ++to;
  }
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

std::vector<RestPlace> rank_places(const std::vector<Plateau>& rests, const PlateauOptions& options) {
  std::vector<RestPlace> places;
  for (std::size_t i = 0; i < rests.size(); ++i) {
    auto place = std::find_if(places.begin(), places.end(), [&](const RestPlace& p) {
      return same_place(rests[p.rests.front()], rests[i], options);
    });
    if (place == places.end()) place = places.insert(places.end(), RestPlace());
    place->rests.push_back(i);
    place->rested_s += rests[i].end_s - rests[i].start_s;
    place->dispersion_mm += rests[i].dispersion_mm * rests[i].dispersion_mm;
  }
  for (RestPlace& p : places)
    p.dispersion_mm = std::sqrt(p.dispersion_mm / static_cast<double>(p.rests.size()));
  std::stable_sort(places.begin(), places.end(), [](const RestPlace& a, const RestPlace& b) {
    if (a.rests.size() != b.rests.size()) return a.rests.size() > b.rests.size();
    if (std::abs(a.rested_s - b.rested_s) > 0.1) return a.rested_s > b.rested_s;
    return a.dispersion_mm < b.dispersion_mm;
  });
  return places;
}

Status label_mi(const std::vector<Plateau>& rests, const PlateauOptions& options, JawPositions* positions) {
  if (!positions->mi.empty()) return {};
  if (rests.empty())
    return bad_input(kCannotFindRests, "session", "no marks, no intervals given, and the jaw never rests");
  std::vector<RestPlace> places = rank_places(rests, options);
  if (!positions->tp.empty())  // marked: no place to look for MI
    places.erase(std::remove_if(places.begin(), places.end(),
                                [&](const RestPlace& p) {
                                  return same_place(rests[p.rests.front()], positions->tp.front(), options);
                                }),
                 places.end());
  if (places.empty()) return bad_input(kCannotFindRests, "session", "no MI: every rest is at the marked TP");
  for (const std::size_t i : places.front().rests) positions->mi.push_back(rests[i]);
  positions->notes.push_back(
      fmt::format("MI was not marked: taken as the rest that is visited most often, {} times",
                  places.front().rests.size()));
  if (places.size() > 1 && places[1].rests.size() == places[0].rests.size())
    positions->notes.push_back(
        fmt::format("another rest, at {:.1f} s, is visited as often; MI is the one rested at longer ({:.1f} "
                    "against {:.1f} s)",
                    rests[places[1].rests.front()].start_s, places[0].rested_s, places[1].rested_s));
  return {};
}

Status label_tp(const std::vector<Plateau>& rests, const PlateauOptions& options, JawPositions* positions) {
  if (!positions->tp.empty()) return {};
  std::vector<RestPlace> places = rank_places(rests, options);
  places.erase(std::remove_if(places.begin(), places.end(),
                              [&](const RestPlace& p) {
                                return same_place(rests[p.rests.front()], positions->mi.front(), options);
                              }),
               places.end());
  if (places.empty())
    return bad_input(kCannotFindRests, "session",
                     rests.empty() ? "no TP: the jaw never rests" : "no TP: every rest is at MI");
  const auto longest =
      std::max_element(places.begin(), places.end(),
                       [](const RestPlace& a, const RestPlace& b) { return a.rested_s < b.rested_s; });
  for (const std::size_t i : longest->rests) positions->tp.push_back(rests[i]);
  positions->notes.push_back(fmt::format(
      "TP was not marked: taken as the longest rest away from MI, {:.1f} s in {} visit{}, dispersion "
      "{:.3f} mm; {} other place{}",
      longest->rested_s, longest->rests.size(), longest->rests.size() == 1 ? "" : "s", longest->dispersion_mm,
      places.size() - 1, places.size() == 2 ? "" : "s"));
  return {};
}

}  // namespace gnathion
