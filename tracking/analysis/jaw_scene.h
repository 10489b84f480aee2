// One set of motions and landmarks, as measured or as drawn from their errors, and reading positions from it.
// Internal to the analysis.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "tracking/analysis/jaw_analysis.h"

namespace gnathion {

struct JawScene {
  const std::vector<double>* time_s = nullptr;
  std::vector<Rigid3> mandible;  ///< one for each time
  JawLandmarks landmarks;        ///< condyles filled in where they are known
  double half_window_s = 0.05;
  double gap_s = 0.06;  ///< a longer step between rows hides what was in it

  /// Rows close before and after a time: what is read there was seen, not bridged.
  bool seen_at(double time_s) const;

  bool has_condyles() const { return landmarks.condyle_left_mm.has_value(); }
  /// Row range [first, last] inside [start, end].
  std::pair<std::size_t, std::size_t> rows(double start_s, double end_s) const;
  /// Displacement from MI of a point of the mandible at a row, dental axes.
  Vector3 displacement(const Vector3& point_mm, std::size_t row) const {
    return mandible[row] * point_mm - point_mm;
  }
  /// Rotation about the transverse axis, positive opens; by the same quadratic.
  double opening_rad_at(double time_s) const;
  /// The displacement at a time, by least squares of a quadratic over ±half_window.
  Vector3 displacement_at(const Vector3& point_mm, double time_s, double half_window_s) const;
  Vector3 displacement_at(const Vector3& point_mm, double time) const {
    return displacement_at(point_mm, time, half_window_s);
  }
};

/// The largest value that `measure` takes of a point's displacement between two times, and when. The place is
/// found on positions smoothed by wide quadratics, and between rows by a parabola; the value is read with a
/// narrow one, which a sharp top does not bend.
struct Peak {
  double value = 0, time_s = 0;
};
using Measure = std::function<double(const Vector3& displacement_mm)>;
Peak peak_of(const JawScene& scene, const Vector3& point_mm, double start_s, double end_s,
             const Measure& measure);

/// All numbers of all kinds, in an order that depends on segments and options alone: undetermined ones
/// included.
std::vector<JawNumber> jaw_numbers(const JawScene& scene, const std::vector<JawSegment>& segments,
                                   const std::optional<HingeAxis>& hinge, const std::string& hinge_reason,
                                   const JawAnalysisOptions& options);
void add_range_numbers(const JawScene& scene, const std::vector<JawSegment>& segments,
                       std::vector<JawNumber>* out);
void add_condyle_numbers(const JawScene& scene, const std::vector<JawSegment>& segments,
                         const JawAnalysisOptions& options, std::vector<JawNumber>* out);
void add_chewing_numbers(const JawScene& scene, const std::vector<JawSegment>& segments,
                         std::vector<JawNumber>* out);
std::vector<ChewingCycle> chewing_cycles(const JawScene& scene, const std::vector<JawSegment>& segments);
/// The segment of a kind whose turning point is farthest for the incisal point; null where there is none.
const JawSegment* largest_of(const JawScene& scene, const std::vector<JawSegment>& segments,
                             JawMovement movement);

}  // namespace gnathion
