#include "tracking/analysis/jaw_segments.h"
#include "core/angle.h"

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

/// What a movement looks like at one row, in the anatomical directions.
struct Look {
  double away_mm, down_mm, forward_mm, left_mm;  ///< of the incisal point from MI
  double opening_rad, yaw_rad;
};

std::vector<Look> looks(const std::vector<Rigid3>& mandible, const JawLandmarks& l) {
  std::vector<Look> all;
  for (const Rigid3& m : mandible) {
    const Vector3 d = m * l.incisal_mm - l.incisal_mm, w = log_so3(m.rotation);
    all.push_back({d.norm(), l.plane.downward(d), l.plane.forward(d), l.plane.leftward(d),
                   w.dot(l.plane.left), w.dot(l.plane.up)});
  }
  return all;
}

struct Piece {
  std::size_t first, last;  ///< rows
};

/// Stretches away from MI; gaps end them.
std::vector<Piece> away_from_mi(const std::vector<double>& time_s, const std::vector<Look>& look,
                                const SegmentOptions& options) {
  std::vector<Piece> pieces;
  bool away = false;
  for (std::size_t i = 0; i < look.size(); ++i) {
    const bool gap = i > 0 && time_s[i] - time_s[i - 1] > options.gap_s;
    const bool out = look[i].away_mm > options.at_mi_mm;
    if (out && away && !gap) {
      pieces.back().last = i;
    } else if (out) {
      // The row before belongs to the movement: it is where it begins.
      pieces.push_back({i > 0 && !gap && !away ? i - 1 : i, i});
    } else if (away && !gap) {
      pieces.back().last = i;
    }
    away = out;
  }
  return pieces;
}

/// Cuts where the jaw closes by more than half between two openings: chewing that does not come back to MI.
std::vector<Piece> cut_at_closings(const Piece& piece, const std::vector<Look>& look) {
  constexpr double kHysteresis_mm = 2;
  std::vector<Piece> cycles;
  std::size_t start = piece.first, lowest = piece.first;  // `lowest`: most closed since the last opening
  double top = look[piece.first].down_mm, bottom = top;
  bool closing = false;
  for (std::size_t i = piece.first; i <= piece.last; ++i) {
    const double down = look[i].down_mm;
    if (!closing) {
      top = std::max(top, down);
      if (down < top - kHysteresis_mm && down < 0.5 * top) closing = true, lowest = i, bottom = down;
    } else {
      if (down < bottom) bottom = down, lowest = i;
      if (down > bottom + kHysteresis_mm && down > 2 * bottom) {
        cycles.push_back({start, lowest});
        start = lowest;
        top = down;
        closing = false;
      }
    }
  }
  cycles.push_back({start, piece.last});
  return cycles;
}

std::size_t turn_of(const Piece& piece, const std::vector<Look>& look) {
  std::size_t turn = piece.first;
  for (std::size_t i = piece.first; i <= piece.last; ++i)
    if (look[i].away_mm > look[turn].away_mm) turn = i;
  return turn;
}

double largest_opening(const Piece& piece, const std::vector<Look>& look) {
  double largest = 0;
  for (std::size_t i = piece.first; i <= piece.last; ++i) largest = std::max(largest, look[i].opening_rad);
  return largest;
}

bool may_be_chewing(const Piece& piece, const std::vector<double>& time_s, const std::vector<Look>& look,
                    const SegmentOptions& options) {
  const double duration = time_s[piece.last] - time_s[piece.first], opening = largest_opening(piece, look);
  return duration >= 0.2 && duration <= options.longest_cycle_s && opening >= 4.5 * kRadPerDeg &&
         opening <= 20 * kRadPerDeg;
}

JawMovement border_movement(const Piece& piece, const std::vector<Look>& look) {
  double sideways = 0, forward = 0, yaw = 0;
  for (std::size_t i = piece.first; i <= piece.last; ++i) {
    if (std::abs(look[i].left_mm) > std::abs(sideways)) sideways = look[i].left_mm;
    if (std::abs(look[i].yaw_rad) > std::abs(yaw)) yaw = look[i].yaw_rad;
    forward = std::max(forward, look[i].forward_mm);
  }
  const Look& turn = look[turn_of(piece, look)];
  if (largest_opening(piece, look) >= 6 * kRadPerDeg)
    return std::abs(turn.left_mm) < 0.5 * turn.down_mm ? JawMovement::kOpening : JawMovement::kOther;
  if (std::abs(sideways) >= 2.5 && std::abs(yaw) >= 1.5 * kRadPerDeg && sideways * yaw > 0)
    return sideways > 0 ? JawMovement::kLaterotrusionLeft : JawMovement::kLaterotrusionRight;
  if (forward >= 2 && std::abs(sideways) < 0.5 * forward) return JawMovement::kProtrusion;
  return JawMovement::kOther;
}

/// Runs of short openings, close after one another, are chewing.
std::vector<bool> chewing_of(const std::vector<Piece>& pieces, const std::vector<double>& time_s,
                             const std::vector<Look>& look, const SegmentOptions& options) {
  constexpr double kLongestPause_s = 0.35;
  std::vector<bool> chewing(pieces.size(), false);
  for (std::size_t i = 0; i < pieces.size();) {
    std::size_t end = i;
    while (end < pieces.size() && may_be_chewing(pieces[end], time_s, look, options) &&
           (end == i || time_s[pieces[end].first] - time_s[pieces[end - 1].last] <= kLongestPause_s))
      ++end;
    if (end - i >= static_cast<std::size_t>(options.least_chewing_cycles))
      std::fill(chewing.begin() + static_cast<std::ptrdiff_t>(i),
                chewing.begin() + static_cast<std::ptrdiff_t>(end), true);
    i = std::max(end, i + 1);
  }
  return chewing;
}

/// Given intervals: one movement each; chewing is cut into its cycles.
std::vector<JawSegment> from_given(const std::vector<double>& time_s, const std::vector<Look>& look,
                                   const SegmentOptions& options) {
  std::vector<JawSegment> segments;
  for (const JawSegment& given : options.given) {
    const auto first = std::lower_bound(time_s.begin(), time_s.end(), given.start_s);
    const auto last = std::upper_bound(first, time_s.end(), given.end_s);
    if (last - first < 2) continue;
    const Piece whole{static_cast<std::size_t>(first - time_s.begin()),
                      static_cast<std::size_t>(last - time_s.begin()) - 1};
    std::vector<Piece> pieces = {whole};
    if (given.movement == JawMovement::kChewing) pieces = cut_at_closings(whole, look);
    for (const Piece& p : pieces) {
      JawSegment s{given.movement, time_s[p.first], time_s[p.last], time_s[turn_of(p, look)], "given", false};
      if (given.movement != JawMovement::kChewing || largest_opening(p, look) >= 2 * kRadPerDeg)
        segments.push_back(s);
    }
  }
  return segments;
}

}  // namespace

const char* name_of(JawMovement movement) {
  switch (movement) {
    case JawMovement::kOpening:
      return "opening";
    case JawMovement::kProtrusion:
      return "protrusion";
    case JawMovement::kLaterotrusionLeft:
      return "laterotrusion left";
    case JawMovement::kLaterotrusionRight:
      return "laterotrusion right";
    case JawMovement::kChewing:
      return "chewing";
    case JawMovement::kOther:
      break;
  }
  return "other";
}

std::optional<JawMovement> movement_of(const std::string& name) {
  for (const auto m : {JawMovement::kOpening, JawMovement::kProtrusion, JawMovement::kLaterotrusionLeft,
                       JawMovement::kLaterotrusionRight, JawMovement::kChewing, JawMovement::kOther})
    if (name == name_of(m)) return m;
  return std::nullopt;
}

std::vector<JawSegment> find_segments(const std::vector<double>& time_s, const std::vector<Rigid3>& mandible,
                                      const JawLandmarks& landmarks, const SegmentOptions& options) {
  const std::vector<Look> look = looks(mandible, landmarks);
  std::vector<JawSegment> segments = from_given(time_s, look, options);
  const std::size_t given = segments.size();
  const auto is_given = [&](JawMovement m) {
    return std::any_of(options.given.begin(), options.given.end(),
                       [m](const auto& g) { return g.movement == m; });
  };
  std::vector<Piece> pieces;
  for (const Piece& away : away_from_mi(time_s, look, options))
    for (const Piece& cycle : cut_at_closings(away, look)) pieces.push_back(cycle);
  const std::vector<bool> chewing = chewing_of(pieces, time_s, look, options);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const Piece& p = pieces[i];
    JawSegment s;
    s.movement = chewing[i] ? JawMovement::kChewing : border_movement(p, look);
    s.start_s = time_s[p.first];
    s.end_s = time_s[p.last];
    s.turn_s = time_s[turn_of(p, look)];
    const auto gap_after = [&](std::size_t row) {
      return row + 1 >= time_s.size() || time_s[row + 1] - time_s[row] > options.gap_s;
    };
    s.cut = (look[p.first].away_mm > options.at_mi_mm && (p.first == 0 || gap_after(p.first - 1))) ||
            (look[p.last].away_mm > options.at_mi_mm && gap_after(p.last));
    if (is_given(s.movement)) continue;
    const bool overlaps =
        std::any_of(segments.begin(), segments.begin() + static_cast<std::ptrdiff_t>(given),
                    [&](const auto& g) { return s.start_s < g.end_s && g.start_s < s.end_s; });
    if (!overlaps) segments.push_back(s);
  }
  std::stable_sort(segments.begin(), segments.end(),
                   [](const JawSegment& a, const JawSegment& b) { return a.start_s < b.start_s; });
  return segments;
}

}  // namespace gnathion
