// What the condyles' paths tell: inclination, Bennett angle, side shift, and the incisal guidance.
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/angle.h"
#include "tracking/analysis/jaw_scene.h"

namespace gnathion {
namespace {

/// When a point's path, seen by `length`, first reaches `chord_mm` on the outward limb.
template <class Length>
std::optional<double> crossing(const JawScene& scene, const Vector3& point_mm, const JawSegment& s,
                               double chord_mm, const Length& length) {
  const auto [first, last] = scene.rows(s.start_s, s.turn_s);
  double before = 0, before_s = 0;
  for (std::size_t i = first; i <= last; ++i) {
    const double t = (*scene.time_s)[i], now = length(scene.displacement_at(point_mm, t));
    if (now >= chord_mm) {
      // Already there at the first row, or within a gap: where it was reached has not been seen.
      if (i == first || t - before_s > scene.gap_s) return std::nullopt;
      return before_s + (t - before_s) * std::clamp((chord_mm - before) / (now - before), 0.0, 1.0);
    }
    before = now;
    before_s = t;
  }
  return std::nullopt;
}

struct Line {
  double intercept = 0, slope = 0;
};

/// Least-squares line of medial over forward travel between two forward distances.
std::optional<Line> side_shift_line(const JawScene& scene, const Vector3& condyle_mm, const Vector3& medial,
                                    const JawSegment& s, double from_mm, double to_mm) {
  const auto [first, last] = scene.rows(s.start_s, s.turn_s);
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, nearest = to_mm, farthest = from_mm;
  for (std::size_t i = first; i <= last; ++i) {
    const Vector3 d = scene.displacement_at(condyle_mm, (*scene.time_s)[i]);
    const double forward = scene.landmarks.plane.forward(d), inward = d.dot(medial);
    if (forward < from_mm || forward > to_mm) continue;
    nearest = std::min(nearest, forward);
    farthest = std::max(farthest, forward);
    n += 1;
    x += forward, y += inward, xx += forward * forward, xy += forward * inward;
  }
  const double spread = n * xx - x * x;
  if (n < 4 || farthest - nearest < 0.5 * (to_mm - from_mm)) return std::nullopt;
  Line line;
  line.slope = (n * xy - x * y) / spread;
  line.intercept = (y - line.slope * x) / n;
  return line;
}

JawNumber condyle_number(const std::string& name, const char* side, const char* unit,
                         std::string definition) {
  JawNumber n;
  n.name = name;
  n.side = side;
  n.unit = unit;
  n.definition = std::move(definition);
  return n;
}

void set(double value, double start_s, double end_s, const JawScene& scene, JawNumber* n) {
  const auto [first, last] = scene.rows(start_s, end_s);
  n->value = value;
  n->start_s = start_s;
  n->end_s = end_s;
  n->rows = static_cast<int>(last - first + 1);
  n->determined = std::isfinite(value);
}

constexpr const char* kNoCondyles = "the condyles are not known: no landmarks, and no hinge axis";

/// Angle below the reference plane of the chord from MI to where the path is `chord_mm` long, sagittal
/// projection.
JawNumber inclination(const JawScene& scene, const JawSegment* s, const std::optional<Vector3>& point_mm,
                      double chord_mm, JawNumber n) {
  const ReferencePlane& plane = scene.landmarks.plane;
  if (!point_mm) {
    n.reason = kNoCondyles;
  } else if (s == nullptr) {
    n.reason = "no protrusion in the recording";
  } else {
    const auto sagittal = [&](const Vector3& d) { return std::hypot(plane.forward(d), plane.downward(d)); };
    const auto at = crossing(scene, *point_mm, *s, chord_mm, sagittal);
    if (at) {
      const Vector3 d = scene.displacement_at(*point_mm, *at);
      set(std::atan2(plane.downward(d), plane.forward(d)) / kRadPerDeg, s->start_s, *at, scene, &n);
    } else {
      n.reason = fmt::format("the protrusion does not reach {:g} mm here, or a gap hides where", chord_mm);
    }
  }
  return n;
}

/// Numbers of the balancing (nonworking) condyle in a laterotrusion to the other side.
void add_balancing(const JawScene& scene, const std::vector<JawSegment>& segments, bool left_condyle,
                   const JawAnalysisOptions& options, std::vector<JawNumber>* out) {
  const ReferencePlane& plane = scene.landmarks.plane;
  const char* side = left_condyle ? "left" : "right";
  const auto movement = left_condyle ? JawMovement::kLaterotrusionRight : JawMovement::kLaterotrusionLeft;
  const JawSegment* s = largest_of(scene, segments, movement);
  const auto& condyle = left_condyle ? scene.landmarks.condyle_left_mm : scene.landmarks.condyle_right_mm;
  const Vector3 medial = left_condyle ? Vector3(-plane.left) : plane.left;
  const auto reason = [&](JawNumber* n) {
    n->reason = !condyle ? kNoCondyles : fmt::format("no {} in the recording", name_of(movement));
  };
  for (const double chord : options.chords_mm) {
    JawNumber n = condyle_number(
        fmt::format("bennett_angle_{:g}mm", chord), side, "deg",
        fmt::format(
            "angle with the sagittal plane, seen along the reference plane's normal, of the chord from MI to "
            "where the balancing condyle's path is {:g} mm long; medial is positive",
            chord));
    if (condyle && s != nullptr) {
      const auto at = crossing(scene, *condyle, *s, chord, [](const Vector3& d) { return d.norm(); });
      if (at) {
        const Vector3 d = scene.displacement_at(*condyle, *at);
        set(std::atan2(d.dot(medial), plane.forward(d)) / kRadPerDeg, s->start_s, *at, scene, &n);
      } else {
        n.reason = fmt::format("the balancing condyle does not travel {:g} mm, or a gap hides where", chord);
      }
    } else {
      reason(&n);
    }
    out->push_back(std::move(n));
  }
  JawNumber immediate = condyle_number("immediate_side_shift", side, "mm",
                                       "medial shift of the balancing condyle at the start: where the line "
                                       "through its horizontal path between 2 and 5 "
                                       "mm of advance meets no advance at all");
  JawNumber progressive = condyle_number("progressive_side_shift", side, "deg",
                                         "angle of that line with the sagittal plane; medial is positive");
  if (condyle && s != nullptr) {
    const auto line = side_shift_line(scene, *condyle, medial, *s, 2, 5);
    if (line) {
      set(line->intercept, s->start_s, s->turn_s, scene, &immediate);
      set(std::atan(line->slope) / kRadPerDeg, s->start_s, s->turn_s, scene, &progressive);
    } else {
      immediate.reason = progressive.reason =
          "fewer than 4 rows, or less than half the way, between 2 and 5 mm of advance";
    }
  } else {
    reason(&immediate);
    reason(&progressive);
  }
  out->push_back(std::move(immediate));
  out->push_back(std::move(progressive));
}

}  // namespace

void add_condyle_numbers(const JawScene& scene, const std::vector<JawSegment>& segments,
                         const JawAnalysisOptions& options, std::vector<JawNumber>* out) {
  const JawLandmarks& l = scene.landmarks;
  const JawSegment* protrusion = largest_of(scene, segments, JawMovement::kProtrusion);
  out->push_back(
      inclination(scene, protrusion, l.incisal_mm, 3,
                  condyle_number("incisal_guidance_3mm", "", "deg",
                                 "angle below the reference plane of the chord from MI to where the "
                                 "incisal point has gone 3 mm in protrusion, sagittal plane")));
  for (const bool left : {true, false}) {
    const char* side = left ? "left" : "right";
    const auto& condyle = left ? l.condyle_left_mm : l.condyle_right_mm;
    for (const double chord : options.chords_mm)
      out->push_back(inclination(
          scene, protrusion, condyle, chord,
          condyle_number(
              fmt::format("sagittal_condylar_inclination_{:g}mm", chord), side, "deg",
              fmt::format("angle below the {} plane of the chord from MI to where the condyle has gone "
                          "{:g} mm in protrusion, sagittal plane",
                          l.plane.name, chord))));
    add_balancing(scene, segments, left, options, out);
    JawNumber travel = condyle_number("condylar_translation_opening", side, "mm",
                                      "distance of the condyle from MI at the largest opening");
    const JawSegment* opening = largest_of(scene, segments, JawMovement::kOpening);
    if (condyle && opening != nullptr && scene.seen_at(opening->turn_s)) {
      set(scene.displacement_at(*condyle, opening->turn_s).norm(), opening->start_s, opening->turn_s, scene,
          &travel);
    } else {
      travel.reason = !condyle             ? kNoCondyles
                      : opening == nullptr ? "no opening movement in the recording"
                                           : "a gap in the recording hides the turning point";
    }
    out->push_back(std::move(travel));
  }
}

}  // namespace gnathion
