#include "tracking/analysis/jaw_recording.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace gnathion {
namespace {

const char* const kCannotAnalyseRecording = "cannot analyse the jaw's motion";
constexpr std::size_t kFewestRecordedRows = 10;

Status check_millimetres(const JawRecording& recording) {
  double nearest = 1e300, farthest = 0;
  for (const Rigid3& r : recording.head_from_bow) {
    nearest = std::min(nearest, r.translation_mm.norm());
    farthest = std::max(farthest, r.translation_mm.norm());
  }
  if (farthest < 5)
    return bad_input(
        kCannotAnalyseRecording, "poses",
        fmt::format("the bow never is farther than {:.3f} mm from the head frame's origin: these "
                    "look like metres, millimetres are needed",
                    farthest));
  if (nearest > 10'000)
    return bad_input(
        kCannotAnalyseRecording, "poses",
        fmt::format("the bow is {:.0f} mm and more from the head frame: not millimetres", nearest));
  return {};
}

Status check_distance(const char* what, double value_mm, double low_mm, double high_mm) {
  if (value_mm >= low_mm && value_mm <= high_mm) return {};
  return bad_input(
      kCannotAnalyseRecording, "landmarks",
      fmt::format("{}: {:.1f} mm, a jaw has {:.0f} to {:.0f} mm", what, value_mm, low_mm, high_mm));
}

}  // namespace

std::vector<Rigid3> JawRecording::mandible() const {
  const Rigid3 t_d = bow_from_dental.value.rigid;
  const Rigid3 left = (mi.value.rigid * t_d).inverse();
  std::vector<Rigid3> motions;
  motions.reserve(head_from_bow.size());
  for (const Rigid3& r : head_from_bow) motions.push_back(left * r * t_d);
  return motions;
}

Result<JawRecording> jaw_recording(const SessionMotion& session,
                                   const Uncertain<Transform<HeadFrame, Bow>>& mi,
                                   const Uncertain<Transform<Bow, Dental>>& bow_from_dental) {
  JawRecording recording;
  recording.mi = mi;
  recording.bow_from_dental = bow_from_dental;
  for (const MotionRow& row : session.rows) {
    if (!row.valid()) continue;
    recording.time_s.push_back(session.time_s(row));
    recording.head_from_bow.push_back(row.head_from_bow().rigid);
    recording.covariance.push_back(row.head_from_bow_covariance());
  }
  if (recording.time_s.size() < kFewestRecordedRows)
    return bad_input(kCannotAnalyseRecording, "motion",
                     fmt::format("{} of {} rows are valid, need {}", recording.time_s.size(),
                                 session.rows.size(), kFewestRecordedRows));
  GNATHION_CHECK_OK(check_millimetres(recording));
  return recording;
}

Result<JawRecording> jaw_recording(const JawMotion& motion) {
  if (motion.frame != Dental::name)
    return bad_input(kCannotAnalyseRecording, "motion",
                     "is told in the frame '" + motion.frame + "': landmarks need the dental one (a chain)");
  JawRecording recording;
  for (const JawMotionRow& row : motion.rows) {
    if (!row.valid) continue;
    if (!recording.time_s.empty() && row.time_s <= recording.time_s.back())
      return bad_input(kCannotAnalyseRecording, fmt::format("{:.6f} s", row.time_s), "times do not increase");
    const double each = row.sigma_mm * row.sigma_mm / 3, lever_mm = 80;
    Matrix6 cov = Matrix6::Zero();
    cov.bottomRightCorner<3, 3>() = Matrix3::Identity() * each;
    cov.topLeftCorner<3, 3>() = Matrix3::Identity() * (0.25 * each / (lever_mm * lever_mm));
    recording.time_s.push_back(row.time_s);
    recording.head_from_bow.push_back(row.motion);
    recording.covariance.push_back(cov);
  }
  if (recording.time_s.size() < kFewestRecordedRows)
    return bad_input(kCannotAnalyseRecording, "motion",
                     fmt::format("{} of {} rows are valid, need {}", recording.time_s.size(),
                                 motion.rows.size(), kFewestRecordedRows));
  return recording;
}

Result<ReferencePlane> plane_through(const std::string& name, const Vector3& left_mm, const Vector3& right_mm,
                                     const Vector3& front_mm) {
  ReferencePlane plane;
  plane.name = name;
  const Vector3 across = left_mm - right_mm;
  const Vector3 out = front_mm - 0.5 * (left_mm + right_mm);
  const Vector3 ahead = out - out.dot(across) / std::max(across.squaredNorm(), 1e-12) * across;
  if (!(across.norm() > 5) || !(ahead.norm() > 5))
    return bad_input(kCannotAnalyseRecording, "landmarks",
                     "the points of the " + name + " plane lie together or on one line");
  plane.left = across.normalized();
  plane.anterior = ahead.normalized();
  plane.up = plane.left.cross(Vector3(-plane.anterior));
  return plane;
}

Status check_landmarks(const JawLandmarks& l) {
  const Vector3 molars = 0.5 * (l.molar_left_mm + l.molar_right_mm);
  GNATHION_CHECK_OK(
      check_distance("the molars' distance", (l.molar_left_mm - l.molar_right_mm).norm(), 30, 90));
  GNATHION_CHECK_OK(check_distance("from the molars forward to the incisal point",
                                   l.plane.forward(l.incisal_mm - molars), 15, 75));
  if (l.plane.leftward(l.molar_left_mm - l.molar_right_mm) <= 0)
    return bad_input(kCannotAnalyseRecording, "landmarks",
                     "the left molar lies to the right of the right one");
  if (l.condyle_left_mm.has_value() != l.condyle_right_mm.has_value())
    return bad_input(kCannotAnalyseRecording, "landmarks", "one condyle is given, the other is missing");
  if (!l.condyle_left_mm) return check_distance("the intercondylar distance", l.intercondylar_mm, 70, 160);
  if (l.plane.leftward(*l.condyle_left_mm - *l.condyle_right_mm) <= 0)
    return bad_input(kCannotAnalyseRecording, "landmarks",
                     "the left condyle lies to the right of the right one");
  GNATHION_CHECK_OK(
      check_distance("the condyles' distance", (*l.condyle_left_mm - *l.condyle_right_mm).norm(), 70, 160));
  for (const Vector3& condyle : {*l.condyle_left_mm, *l.condyle_right_mm}) {
    GNATHION_CHECK_OK(
        check_distance("from a condyle to the incisal point", (condyle - l.incisal_mm).norm(), 70, 160));
    GNATHION_CHECK_OK(check_distance("from a condyle forward to the incisal point",
                                     l.plane.forward(l.incisal_mm - condyle), 40, 140));
  }
  return {};
}

}  // namespace gnathion
