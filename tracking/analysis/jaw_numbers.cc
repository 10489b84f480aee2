// Ranges of movement, the hinge axis in numbers, Posselt's envelope, and chewing.
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/angle.h"
#include "tracking/analysis/jaw_scene.h"

namespace gnathion {
namespace {

JawNumber number(const char* name, const char* side, const char* unit, const char* definition) {
  JawNumber n;
  n.name = name;
  n.side = side;
  n.unit = unit;
  n.definition = definition;
  return n;
}

void on_arc(const JawScene& scene, double start_s, double end_s, JawNumber* n) {
  const auto [first, last] = scene.rows(start_s, end_s);
  n->start_s = start_s;
  n->end_s = end_s;
  n->rows = static_cast<int>(last - first + 1);
}

void determined(double value, JawNumber* n) {
  n->value = value;
  n->determined = std::isfinite(value);
  if (!n->determined) n->reason = "not a finite number";
}

constexpr const char* kHidden = "a gap in the recording hides the turning point";

void add_opening(const JawScene& scene, const std::vector<JawSegment>& segments,
                 std::vector<JawNumber>* out) {
  const Vector3& incisal = scene.landmarks.incisal_mm;
  const ReferencePlane& plane = scene.landmarks.plane;
  JawNumber n[4] = {
      number("opening", "", "mm",
             "largest distance of the lower incisal point from where it is in MI (interincisal opening "
             "without the "
             "overbite)"),
      number("opening_angle", "", "deg", "rotation about the transverse axis at the largest opening"),
      number("opening_deflection", "", "mm",
             "sideways distance of the incisal point from the midline at the largest opening, to the left "
             "positive"),
      number(
          "opening_deviation", "", "mm",
          "largest sideways distance of the incisal point from the straight line between MI and the largest "
          "opening, on the opening limb, frontal plane, to the left positive")};
  if (const JawSegment* s = largest_of(scene, segments, JawMovement::kOpening)) {
    const Peak peak =
        peak_of(scene, incisal, s->start_s, s->end_s, [](const Vector3& d) { return d.norm(); });
    const Vector3 top = scene.displacement_at(incisal, peak.time_s);
    for (JawNumber& x : n) on_arc(scene, s->start_s, s->end_s, &x);
    if (!scene.seen_at(peak.time_s)) {
      for (JawNumber& x : n) x.reason = kHidden, out->push_back(x);
      return;
    }
    determined(peak.value, &n[0]);
    determined(scene.opening_rad_at(peak.time_s) / kRadPerDeg, &n[1]);
    determined(plane.leftward(top), &n[2]);
    const auto off_line = [&](const Vector3& d) {
      return plane.leftward(d) - plane.leftward(top) * plane.downward(d) / plane.downward(top);
    };
    const Peak left = peak_of(scene, incisal, s->start_s, peak.time_s, off_line);
    const Peak right =
        peak_of(scene, incisal, s->start_s, peak.time_s, [&](const Vector3& d) { return -off_line(d); });
    determined(left.value >= right.value ? left.value : -right.value, &n[3]);
  } else {
    for (JawNumber& x : n) x.reason = "no opening movement in the recording";
  }
  out->insert(out->end(), std::begin(n), std::end(n));
}

void add_reach(const JawScene& scene, const std::vector<JawSegment>& segments, JawMovement movement,
               const Vector3& direction, JawNumber n, std::vector<JawNumber>* out) {
  if (const JawSegment* s = largest_of(scene, segments, movement)) {
    on_arc(scene, s->start_s, s->end_s, &n);
    const Peak peak = peak_of(scene, scene.landmarks.incisal_mm, s->start_s, s->end_s,
                              [&](const Vector3& d) { return d.dot(direction); });
    if (scene.seen_at(peak.time_s)) {
      determined(peak.value, &n);
    } else {
      n.reason = kHidden;
    }
  } else {
    n.reason = fmt::format("no {} in the recording", name_of(movement));
  }
  out->push_back(std::move(n));
}

/// Area of the convex hull of points in a plane (monotone chain, shoelace).
double hull_area(std::vector<Eigen::Vector2d> p) {
  if (p.size() < 3) return 0;
  std::sort(p.begin(), p.end(),
            [](const auto& a, const auto& b) { return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y(); });
  const auto turn = [](const auto& o, const auto& a, const auto& b) {
    return (a.x() - o.x()) * (b.y() - o.y()) - (a.y() - o.y()) * (b.x() - o.x());
  };
  std::vector<Eigen::Vector2d> hull;
  for (int pass = 0; pass < 2; ++pass) {
    const std::size_t base = hull.size();
    for (const auto& q : p) {
      while (hull.size() >= base + 2 && turn(hull[hull.size() - 2], hull.back(), q) <= 0) hull.pop_back();
      hull.push_back(q);
    }
    hull.pop_back();
    std::reverse(p.begin(), p.end());
  }
  double area = 0;
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const auto &a = hull[i], &b = hull[(i + 1) % hull.size()];
    area += 0.5 * (a.x() * b.y() - b.x() * a.y());
  }
  return std::abs(area);
}

void add_posselt(const JawScene& scene, const std::vector<JawSegment>& segments,
                 std::vector<JawNumber>* out) {
  const char* const definition =
      "area of the convex hull of MI and the incisal point's recorded path in the sagittal plane, less what "
      "noise widens it by (Posselt's envelope as far as the recorded border movements reach)";
  JawNumber n = number("posselt_sagittal_area", "", "mm2", definition);
  JawNumber frontal = number("posselt_frontal_area", "", "mm2", "the same in the frontal plane");
  const bool all = largest_of(scene, segments, JawMovement::kOpening) != nullptr &&
                   largest_of(scene, segments, JawMovement::kProtrusion) != nullptr;
  if (all) {
    // MI is a corner of the envelope; movements begin a little beside it.
    std::vector<Eigen::Vector2d> sagittal{{0, 0}}, front{{0, 0}};
    double start = 1e300, end = -1e300;
    for (const JawSegment& s : segments) {
      if (s.movement == JawMovement::kOther) continue;
      start = std::min(start, s.start_s);
      end = std::max(end, s.end_s);
      const auto [first, last] = scene.rows(s.start_s, s.end_s);
      for (std::size_t i = first; i <= last; ++i) {
        const Vector3 d = scene.displacement_at(scene.landmarks.incisal_mm, (*scene.time_s)[i]);
        const ReferencePlane& p = scene.landmarks.plane;
        sagittal.emplace_back(p.forward(d), p.downward(d));
        front.emplace_back(p.leftward(d), p.downward(d));
      }
    }
    on_arc(scene, start, end, &n);
    on_arc(scene, start, end, &frontal);
    determined(hull_area(sagittal), &n);
    determined(hull_area(front), &frontal);
    n.grows_with_noise = frontal.grows_with_noise = true;
  } else {
    n.reason = frontal.reason = "needs an opening and a protrusion";
  }
  out->push_back(std::move(n));
  out->push_back(std::move(frontal));
}

void add_hinge(const JawScene& scene, const std::optional<HingeAxis>& hinge, const std::string& reason,
               std::vector<JawNumber>* out) {
  const ReferencePlane& plane = scene.landmarks.plane;
  JawNumber n[4] = {
      number(
          "hinge_axis_behind_incisal", "", "mm",
          "distance of the terminal hinge axis behind the incisal point, in the midsagittal plane, along the "
          "reference plane"),
      number("hinge_axis_above_incisal", "", "mm",
             "the same, above the incisal point, normal to the reference plane"),
      number("hinge_axis_tilt_horizontal", "", "deg",
             "angle of the axis with the transverse direction, seen from above; its left end forward is "
             "positive"),
      number("hinge_axis_tilt_frontal", "", "deg",
             "the same seen from the front; its left end up is positive")};
  if (hinge) {
    const Vector3 d = hinge->point_mm - scene.landmarks.incisal_mm;
    const double along = plane.leftward(hinge->direction);
    determined(-plane.forward(d), &n[0]);
    determined(-plane.downward(d), &n[1]);
    determined(std::atan2(plane.forward(hinge->direction), along) / kRadPerDeg, &n[2]);
    determined(std::atan2(-plane.downward(hinge->direction), along) / kRadPerDeg, &n[3]);
    for (JawNumber& x : n) {
      x.start_s = hinge->start_s;
      x.end_s = hinge->end_s;
      x.rows = hinge->rows;
    }
  } else {
    for (JawNumber& x : n) x.reason = reason;
  }
  out->insert(out->end(), std::begin(n), std::end(n));
}

}  // namespace

void add_range_numbers(const JawScene& scene, const std::vector<JawSegment>& segments,
                       std::vector<JawNumber>* out) {
  const ReferencePlane& plane = scene.landmarks.plane;
  add_opening(scene, segments, out);
  add_reach(
      scene, segments, JawMovement::kProtrusion, plane.anterior,
      number("protrusion", "", "mm", "largest forward displacement of the incisal point in a protrusion"),
      out);
  add_reach(scene, segments, JawMovement::kLaterotrusionLeft, plane.left,
            number("laterotrusion", "left", "mm", "largest displacement of the incisal point to the left"),
            out);
  add_reach(scene, segments, JawMovement::kLaterotrusionRight, -plane.left,
            number("laterotrusion", "right", "mm", "largest displacement of the incisal point to the right"),
            out);
  add_posselt(scene, segments, out);
}

std::vector<ChewingCycle> chewing_cycles(const JawScene& scene, const std::vector<JawSegment>& segments) {
  const ReferencePlane& plane = scene.landmarks.plane;
  const Vector3& incisal = scene.landmarks.incisal_mm;
  std::vector<ChewingCycle> cycles;
  for (const JawSegment& s : segments) {
    if (s.movement != JawMovement::kChewing || s.cut) continue;
    ChewingCycle c;
    c.start_s = s.start_s;
    c.end_s = s.end_s;
    const auto left = [&](const Vector3& d) { return plane.leftward(d); };
    const double widest_left = peak_of(scene, incisal, s.start_s, s.end_s, left).value;
    const double widest_right =
        peak_of(scene, incisal, s.start_s, s.end_s, [&](const Vector3& d) { return -left(d); }).value;
    const Peak down =
        peak_of(scene, incisal, s.start_s, s.end_s, [&](const Vector3& d) { return plane.downward(d); });
    c.width_mm = widest_left + widest_right;
    c.opening_mm = down.value;
    // The side that the jaw closes from: mean sideways place on the closing limb against that on the opening
    // one.
    const auto mean_left = [&](double from, double to) {
      const auto [first, last] = scene.rows(from, to);
      double sum = 0;
      for (std::size_t i = first; i <= last; ++i) sum += left(scene.displacement(incisal, i));
      return sum / static_cast<double>(last - first + 1);
    };
    const double lead = mean_left(down.time_s, s.end_s) - mean_left(s.start_s, down.time_s);
    constexpr double kLeast_mm = 0.3;
    c.side = std::abs(lead) < kLeast_mm ? "middle" : lead > 0 ? "left" : "right";
    // Cycles of one sequence follow one another; a pause of a second begins a new one.
    if (!cycles.empty() && s.turn_s - cycles.back().end_s < 1.5) {
      const auto before = std::find_if(segments.begin(), segments.end(), [&](const JawSegment& b) {
        return b.movement == JawMovement::kChewing && b.start_s == cycles.back().start_s;
      });
      const Peak last_down = peak_of(scene, incisal, before->start_s, before->end_s,
                                     [&](const Vector3& d) { return plane.downward(d); });
      c.period_s = down.time_s - last_down.time_s;
    }
    cycles.push_back(c);
  }
  return cycles;
}

void add_chewing_numbers(const JawScene& scene, const std::vector<JawSegment>& segments,
                         std::vector<JawNumber>* out) {
  const std::vector<ChewingCycle> cycles = chewing_cycles(scene, segments);
  JawNumber count = number("chewing_cycles", "", "1", "openings and closings of one chewing sequence");
  JawNumber period =
      number("chewing_period", "", "s", "mean time from one largest opening of a cycle to the next");
  JawNumber width =
      number("chewing_width", "", "mm", "mean sideways extent of the incisal point's path in a cycle");
  JawNumber opening =
      number("chewing_opening", "", "mm", "mean vertical extent of the incisal point's path in a cycle");
  if (cycles.empty()) {
    for (JawNumber* n : {&count, &period, &width, &opening}) n->reason = "no chewing in the recording";
  } else {
    double periods = 0, sum = 0, widths = 0, openings = 0;
    for (const ChewingCycle& c : cycles) {
      if (c.period_s > 0) periods += 1, sum += c.period_s;
      widths += c.width_mm / static_cast<double>(cycles.size());
      openings += c.opening_mm / static_cast<double>(cycles.size());
    }
    for (JawNumber* n : {&count, &period, &width, &opening})
      on_arc(scene, cycles.front().start_s, cycles.back().end_s, n);
    determined(static_cast<double>(cycles.size()), &count);
    if (periods > 0) {
      determined(sum / periods, &period);
    } else {
      period.reason = "a single cycle has no period";
    }
    determined(widths, &width);
    determined(openings, &opening);
  }
  for (JawNumber* n : {&count, &period, &width, &opening}) out->push_back(std::move(*n));
}

std::vector<JawNumber> jaw_numbers(const JawScene& scene, const std::vector<JawSegment>& segments,
                                   const std::optional<HingeAxis>& hinge, const std::string& hinge_reason,
                                   const JawAnalysisOptions& options) {
  std::vector<JawNumber> numbers;
  add_range_numbers(scene, segments, &numbers);
  add_hinge(scene, hinge, hinge_reason, &numbers);
  add_condyle_numbers(scene, segments, options, &numbers);
  add_chewing_numbers(scene, segments, &numbers);
  return numbers;
}

}  // namespace gnathion
