#include "pipeline/time_calibration_job.h"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "acquisition/exchange/pose_source.h"
#include "acquisition/recording.h"
#include "core/transform_io.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot find the offset in time";
using Streams = std::map<std::string, std::vector<TimedPose>>;

/// Valid poses by stream, and by stream/body where a stream tells of several bodies.
Status read_streams(const std::string& path, Streams* streams) {
  GNATHION_TRY(const auto source, open_any_recording(path));
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
    for (auto& [body, poses] : by_body) {
      const std::string name = by_body.size() == 1 ? stream : stream + "/" + body;
      if (!streams->emplace(name, std::move(poses)).second)
        return bad_input(kWhat, path, "'" + name + "' is in both files");
    }
  return {};
}

/// Moves the capture times of one stream.
class ShiftedSource : public Source {
 public:
  ShiftedSource(Source& source, std::string stream, std::int64_t shift_ns)
      : source_(source), stream_(std::move(stream)), shift_ns_(shift_ns) {}
  Result<std::optional<Sample>> next() override {
    GNATHION_TRY(auto sample, source_.next());
    if (!sample) return sample;
    std::visit(
        [&](auto& s) {
          if (s.header.stream != stream_) return;
          s.header.capture.ns += shift_ns_;
          ++moved_;
        },
        *sample);
    return sample;
  }
  std::size_t moved() const { return moved_; }

 private:
  Source& source_;
  std::string stream_;
  std::int64_t shift_ns_;
  std::size_t moved_ = 0;
};

/// A stream's own name: without the body, by which a calibration tells the sensors of one stream apart.
std::string stream_in(const RecordingSummary& summary, const std::string& name) {
  if (summary.streams.count(name)) return name;
  const std::string stream = name.substr(0, name.rfind('/'));
  return summary.streams.count(stream) ? stream : std::string();
}

}  // namespace

Result<TimeCalibrationResult> run_time_calibration(const TimeCalibrationJob& job, Progress& progress) {
  progress.begin_step("reading poses", 0.7);
  if (job.streams[0] == job.streams[1])
    return fail(ErrorCode::kUsage, kWhat, job.streams[0], "is named twice");
  Streams streams;
  for (const std::string& file : job.files) GNATHION_CHECK_OK(read_streams(file, &streams));
  std::string known;
  for (const auto& [name, poses] : streams) known += (known.empty() ? "" : ", ") + name;
  for (const std::string& name : job.streams)
    if (!streams.count(name))
      return bad_input(kWhat, name,
                       known.empty() ? fmt::format("no streams of poses in {}", fmt::join(job.files, ", "))
                                     : "no such stream of poses; there are " + known);
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
  // Times are too late by what the instrument's latency is set too low.
  const bool second_late = r.offset.offset_s < 0;
  const std::string late = job.streams[second_late ? 1 : 0];
  return fmt::format(
      "{}: {:+.3f} ms ± {:.3f} ms bring its times onto those of {}; correlation {:.3f} over {:.1f} s\n"
      "from now on: {:.3f} ms more latency for {} in devices.toml; this recording: gnathion recording "
      "shift\n",
      job.streams[1], 1e3 * r.offset.offset_s, 1e3 * r.offset.sigma_s, job.streams[0], r.offset.correlation,
      r.offset.overlap_s, 1e3 * std::abs(r.offset.offset_s), late);
}

Result<std::size_t> shift_recording(const TimeShiftJob& job, Progress& progress) {
  const char* what = "cannot shift recording";
  GNATHION_TRY(const nlohmann::json j, read_json(job.time));
  if (!j.is_object() || j.value("kind", std::string()) != "time_calibration" || !j.contains("offset_s") ||
      !j["offset_s"].is_number() || !j.contains("second") || !j["second"].is_string())
    return bad_input(what, job.time.string(), "is no time.json of 'gnathion calibrate time'");
  const double offset_s = j["offset_s"].get<double>();
  if (!(std::abs(offset_s) < 3600)) return bad_input(what, job.time.string(), "offset_s is out of range");
  progress.begin_step("reading the recording", 0.3);
  GNATHION_TRY(const RecordingSummary summary, summarise_recording(job.recording));
  const std::string name = j["second"].get<std::string>();
  const std::string stream = stream_in(summary, name);
  if (stream.empty()) return bad_input(what, job.recording.string(), "has no stream '" + name + "'");
  GNATHION_TRY(const auto source, RecordingSource::open(job.recording));
  std::map<std::string, std::string> attachments;
  for (const AttachmentInfo& a : source->attachments()) {
    const bool of_a_scan = a.name.find('/') != std::string::npos;  // written again with its sample
    if (of_a_scan) continue;
    if (a.name == "time_shift." + stream + ".json")
      return bad_input(what, job.recording.string(), "'" + stream + "' has been shifted before");
    GNATHION_TRY(attachments[a.name], source->attachment(a.name));
  }
  attachments["time_shift." + stream + ".json"] = j.dump(2) + "\n";
  progress.begin_step("writing", 0.7);
  ShiftedSource shifted(*source, stream, std::llround(offset_s * 1e9));
  const std::filesystem::path part = job.out.string() + ".part";
  GNATHION_CHECK_OK(record(shifted, part, attachments, static_cast<double>(summary.messages), progress));
  std::error_code ec;
  std::filesystem::rename(part, job.out, ec);
  if (ec) return fail(ErrorCode::kInternal, what, job.out.string(), ec.message());
  return shifted.moved();
}

}  // namespace gnathion
