#include "pipeline/motion_steps.h"

#include "acquisition/recording.h"

namespace gnathion {
namespace {

PoseRecord record_of(const MotionRow& row, const BodyPose& pose) {
  PoseRecord r;
  r.sequence = row.sequence;
  r.capture = row.capture;
  r.valid = pose.valid;
  r.reason = pose.reason;
  r.camera_from_body = pose.camera_from_body;
  r.covariance = pose.covariance;
  r.rms_px = pose.rms_px;
  r.tags = pose.tags_used;
  return r;
}

BodyPose pose_of(const PoseRecord& r) {
  BodyPose pose;
  pose.valid = r.valid;
  pose.reason = r.reason;
  pose.camera_from_body = r.camera_from_body;
  pose.covariance = r.covariance;
  pose.rms_px = r.rms_px;
  pose.tags_used = r.tags;
  return pose;
}

}  // namespace

Result<SessionMotion> track_recording(const std::filesystem::path& recording, const Rig& rig,
                                      Progress& progress) {
  GNATHION_TRY(auto source, RecordingSource::open(recording));
  TrackOptions options;
  options.fraction_read = [&source = *source] { return source.fraction(); };
  return track_session(*source, rig, options, progress);
}

PoseRecording to_pose_recording(const SessionMotion& session, const SmoothedMotion* smoothed) {
  PoseRecording poses;
  poses.start = session.start;
  poses.events = session.events;
  for (const MotionRow& row : session.rows) {
    poses.bodies["bow"].push_back(record_of(row, row.bow));
    poses.bodies["head_frame"].push_back(record_of(row, row.head));
  }
  if (smoothed == nullptr) return poses;
  for (std::size_t i = 0; i < session.rows.size(); ++i) {
    const MotionRow& raw = session.rows[i];
    const SmoothedRow& row = smoothed->rows[i];
    PoseRecord r;
    r.parent = HeadFrame::name;
    r.sequence = raw.sequence;
    r.capture = raw.capture;
    r.valid = row.valid;
    r.reason = row.valid ? "" : raw.reason();
    r.camera_from_body = row.head_from_bow.rigid;
    r.covariance = row.covariance;
    poses.bodies["bow_smoothed"].push_back(std::move(r));
  }
  return poses;
}

Result<SessionMotion> to_session_motion(const PoseRecording& poses, const std::string& where) {
  SessionMotion session;
  session.start = poses.start;
  session.events = poses.events;
  const auto bow = poses.bodies.find("bow"), head = poses.bodies.find("head_frame");
  if (bow == poses.bodies.end() || head == poses.bodies.end() || bow->second.size() != head->second.size())
    return bad_input("cannot read motion", where, "needs a row of 'bow' and of 'head_frame' for every frame");
  for (std::size_t i = 0; i < bow->second.size(); ++i) {
    if (bow->second[i].capture != head->second[i].capture)
      return bad_input("cannot read motion", where, "rows of 'bow' and 'head_frame' have different times");
    MotionRow row;
    row.sequence = bow->second[i].sequence;
    row.capture = bow->second[i].capture;
    row.cameras = 1;
    row.bow = pose_of(bow->second[i]);
    row.head = pose_of(head->second[i]);
    session.rows.push_back(std::move(row));
  }
  return session;
}

}  // namespace gnathion
