#include "pipeline/time_calibration_job.h"

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "acquisition/recording.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot find the offset in time";
using Streams = std::map<std::string, std::vector<TimedPose>>;

/// Valid poses of a recording by stream, and by stream/body where a stream tells of several bodies.
Status read_recording(const std::string& path, Streams* streams) {
  GNATHION_TRY(const auto source, RecordingSource::open(path));
  std::map<std::string, Streams> bodies;
  for (;;) {
    GNATHION_TRY(const auto sample, source->next());
    if (!sample) break;
    if (const auto* p = std::get_if<PoseSample>(&*sample)) {
      auto& poses = bodies[p->header.stream][p->body];
      if (p->valid) poses.push_back({p->header.capture, p->reference_from_body});
    }
  }
  for (auto& [stream, by_body] : bodies)
    for (auto& [body, poses] : by_body)
      (*streams)[by_body.size() == 1 ? stream : stream + "/" + body] = std::move(poses);
  return {};
}

Status read_motion(const std::string& path, Streams* streams) {
  GNATHION_TRY(const PoseRecording motion, read_poses(path));
  for (const auto& [body, records] : motion.bodies) {
    auto& poses = (*streams)[body];
    for (const PoseRecord& r : records)
      if (r.valid) poses.push_back({r.capture, r.camera_from_body});
  }
  return {};
}

}  // namespace

Result<TimeCalibrationResult> run_time_calibration(const TimeCalibrationJob& job, Progress& progress) {
  progress.begin_step("reading poses", 0.7);
  Streams streams;
  for (const std::string& file : job.files) {
    // A file of tracked poses is a recording, too; as such it has no streams of pose samples.
    if (!read_motion(file, &streams)) GNATHION_CHECK_OK(read_recording(file, &streams));
  }
  std::string known;
  for (const auto& [name, poses] : streams) known += (known.empty() ? "" : ", ") + name;
  for (const std::string& name : job.streams)
    if (!streams.count(name))
      return bad_input(kWhat, name,
                       known.empty()
                           ? "no streams of poses in " + fmt::format("{}", fmt::join(job.files, ", "))
                           : "no such stream of poses; there are " + known);
  if (job.streams[0] == job.streams[1])
    return fail(ErrorCode::kUsage, kWhat, job.streams[0], "is named twice");
  progress.begin_step("comparing", 0.3);
  const auto &first = streams[job.streams[0]], &second = streams[job.streams[1]];
  GNATHION_TRY(const TemporalCalibration offset, calibrate_time_offset(first, second, job.options));
  return TimeCalibrationResult{offset, {first.size(), second.size()}};
}

nlohmann::json time_calibration_json(const TimeCalibrationJob& job, const TimeCalibrationResult& r) {
  return {{"kind", "time_calibration"},
          {"first", job.streams[0]},
          {"second", job.streams[1]},
          {"offset_s", r.offset.offset_s},
          {"sigma_s", r.offset.sigma_s},
          {"correlation", r.offset.correlation},
          {"runner_up", r.offset.runner_up},
          {"overlap_s", r.offset.overlap_s},
          {"samples", {r.samples[0], r.samples[1]}}};
}

std::string time_calibration_text(const TimeCalibrationJob& job, const TimeCalibrationResult& r) {
  return fmt::format("{} + ({:.3f} ± {:.3f}) ms is on the clock of {}; correlation {:.3f} over {:.1f} s\n",
                     job.streams[1], 1e3 * r.offset.offset_s, 1e3 * r.offset.sigma_s, job.streams[0],
                     r.offset.correlation, r.offset.overlap_s);
}

}  // namespace gnathion
