// track, motion analyse, calibrate sensor.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "cli/command.h"
#include "core/file.h"
#include "core/transform_io.h"
#include "pipeline/motion_analysis.h"
#include "pipeline/motion_steps.h"

namespace gnathion {
namespace {

using nlohmann::json;

/// "START..END" in seconds.
Result<std::pair<double, double>> interval_of(const std::string& text) {
  const auto dots = text.find("..");
  if (dots != std::string::npos) {
    const std::string first = text.substr(0, dots), second = text.substr(dots + 2);
    char *end_first = nullptr, *end_second = nullptr;
    const double start = std::strtod(first.c_str(), &end_first),
                 stop = std::strtod(second.c_str(), &end_second);
    if (!first.empty() && !second.empty() && *end_first == 0 && *end_second == 0 && start >= 0 &&
        stop > start && std::isfinite(stop))
      return std::pair(start, stop);
  }
  return fail(ErrorCode::kUsage, "wrong usage", text, "an interval is START..END in seconds, as 3.2..3.9");
}

/// "protrusion=12.0..13.1"
Result<JawSegment> segment_of(const std::string& text) {
  const auto equals = text.find('=');
  const auto movement = movement_of(text.substr(0, equals));
  if (equals == std::string::npos || !movement)
    return fail(
        ErrorCode::kUsage, "wrong usage", text,
        "a movement is NAME=START..END; names are opening, protrusion, laterotrusion left, laterotrusion "
        "right, chewing, other");
  GNATHION_TRY(const auto interval, interval_of(text.substr(equals + 1)));
  JawSegment s;
  s.movement = *movement;
  s.start_s = interval.first;
  s.end_s = interval.second;
  s.source = "given";
  return s;
}

std::string motion_text(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace);
}

struct TrackOptionsOfCommand {
  std::string recording, rig, electromagnetic, out, csv, smoothed_csv;
  bool smooth = false;
};

/// What was tracked, by cameras or electromagnetically.
struct Tracked {
  SessionMotion session;
  std::optional<ElectromagneticMotion> electromagnetic;  ///< without its session
  std::optional<SmoothedMotion> smoothed;
};

Result<Tracked> track(const TrackOptionsOfCommand& o, Progress& progress) {
  Tracked t;
  if (o.electromagnetic.empty()) {
    GNATHION_TRY(const Rig rig, read_rig(o.rig));
    progress.begin_step("tracking", 0.9);
    GNATHION_TRY(t.session, track_recording(o.recording, rig, progress));
  } else {
    GNATHION_TRY(const ElectromagneticSetup setup, read_electromagnetic(o.electromagnetic));
    progress.begin_step("reading electromagnetic poses", 0.9);
    GNATHION_TRY(t.electromagnetic, track_electromagnetic(o.recording, setup));
    t.session = std::move(t.electromagnetic->session);
    add_mount_covariance(setup.bow.body_from_sensor.covariance, &t.session);
  }
  if (o.smooth || !o.smoothed_csv.empty()) {
    progress.begin_step("smoothing", 0.1);
    GNATHION_TRY(t.smoothed, smooth_motion(t.session, {}));
  }
  return t;
}

json track_json(const Tracked& t) {
  std::size_t valid = 0;
  for (const MotionRow& row : t.session.rows) valid += row.valid();
  json j = {{"frames", t.session.rows.size()},
            {"valid", valid},
            {"full_searches", t.session.full_searches},
            {"warnings", t.session.warnings}};
  if (t.electromagnetic) {
    json distortions = json::array();
    for (const Distortion& d : t.electromagnetic->distortions)
      distortions.push_back({{"start_s", d.start_s},
                             {"end_s", d.end_s},
                             {"first", d.pair.first},
                             {"second", d.pair.second},
                             {"largest_mm", d.largest_mm},
                             {"largest_deg", d.largest_deg},
                             {"where_mm", {d.where_mm.x(), d.where_mm.y(), d.where_mm.z()}}});
    j["electromagnetic"] = {{"sigma_mm", t.electromagnetic->sigma_mm},
                            {"sigma_deg", t.electromagnetic->sigma_deg},
                            {"distortions", distortions},
                            {"notes", t.electromagnetic->notes}};
  }
  if (t.smoothed)
    j["smoothing"] = {{"model", "constant acceleration, white jerk"},
                      {"rotation_density_rad2_per_s5", t.smoothed->rotation_density},
                      {"translation_density_mm2_per_s5", t.smoothed->translation_density},
                      {"rule", t.smoothed->densities_given ? "given" : "most likely for the innovations"},
                      {"innovation_ratio", t.smoothed->innovation_ratio}};
  return j;
}

std::string track_text(const Tracked& t, const json& j) {
  std::string text = fmt::format("{} frames, {} with bow and head frame\n", j["frames"].get<std::size_t>(),
                                 j["valid"].get<std::size_t>());
  for (const std::string& warning : t.session.warnings) text += "warning: " + warning + '\n';
  if (t.electromagnetic) {
    for (const Distortion& d : t.electromagnetic->distortions) text += "distorted: " + d.text() + '\n';
    for (const std::string& note : t.electromagnetic->notes) text += "note: " + note + '\n';
  }
  if (t.smoothed)
    text += fmt::format("smoothed: normalised innovations {:.2f} (1: covariances and model tell all)\n",
                        t.smoothed->innovation_ratio);
  return text;
}

Status write_tracked(const TrackOptionsOfCommand& o, const Tracked& t) {
  const std::string& setup = o.electromagnetic.empty() ? o.rig : o.electromagnetic;
  GNATHION_TRY(const std::string setup_text, read_file(setup));
  std::map<std::string, std::string> attached = {
      {o.electromagnetic.empty() ? "rig.toml" : "electromagnetic.toml", setup_text}};
  if (t.smoothed) attached["smoothing.json"] = motion_text(track_json(t)["smoothing"]) + '\n';
  GNATHION_CHECK_OK(
      write_poses(o.out, to_pose_recording(t.session, t.smoothed ? &*t.smoothed : nullptr), attached));
  std::optional<Transform<HeadFrame, Bow>> mi;
  if (const auto positions = find_mi(t.session, {})) mi = positions->head_from_bow_mi.value;
  if (!o.csv.empty()) GNATHION_CHECK_OK(write_motion_csv(o.csv, jaw_motion(t.session, mi, std::nullopt)));
  if (!o.smoothed_csv.empty())
    GNATHION_CHECK_OK(write_motion_csv(
        o.smoothed_csv, jaw_motion(smoothed_session(t.session, *t.smoothed), mi, std::nullopt)));
  return {};
}

void add_track(CLI::App& app, ChosenCommand& chosen) {
  auto o = std::make_shared<TrackOptionsOfCommand>();
  CLI::App* command = app.add_subcommand(
      "track", "bow and head frame in every frame of a recording: by cameras, or from electromagnetic poses");
  command->add_option("--recording", o->recording, "recording (.mcap)")->required();
  auto* rig = command->add_option("--rig", o->rig, "cameras and bodies (RIG.toml)");
  command
      ->add_option("--electromagnetic", o->electromagnetic, "sensors on bow and head (electromagnetic.toml)")
      ->excludes(rig);
  command->add_option("--out", o->out, "poses over time (.mcap)")->required();
  command->add_option("--csv", o->csv, "the bow's motion in the head frame as a table");
  command->add_flag("--smooth", o->smooth, "a second channel, bow_smoothed, beside the raw motion");
  command->add_option("--smoothed-csv", o->smoothed_csv, "the smoothed motion as a table");
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        const std::string& setup = o->electromagnetic.empty() ? o->rig : o->electromagnetic;
        if (setup.empty())
          return fail(ErrorCode::kUsage, "wrong usage", "track", "give --rig or --electromagnetic");
        std::set<std::string> outputs;
        for (const std::string* out : {&o->out, &o->csv, &o->smoothed_csv}) {
          if (out->empty()) continue;
          GNATHION_CHECK_OK(may_write(*out, common, {o->recording, setup}));
          if (!outputs.insert(*out).second)
            return fail(ErrorCode::kUsage, "cannot write", *out, "is also another output");
        }
        GNATHION_TRY(const Tracked t, track(*o, progress));
        GNATHION_CHECK_OK(write_tracked(*o, t));
        const json j = track_json(t);
        return CommandOutput{track_text(t, j), motion_text(j), false};
      });
}

void add_analyse(CLI::App& motion, ChosenCommand& chosen) {
  struct Options {
    std::string motion, calibration, landmarks, maxilla, mandible, out;
    std::vector<std::string> mi_s, movements;
    double arc_deg = 10;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = motion.add_subcommand(
      "analyse",
      "hinge axis, condylar inclination, Bennett angle, ranges, chewing: numbers, tables, pictures");
  command
      ->add_option("--motion", o->motion,
                   "motion.mcap of 'gnathion track', or motion.csv in the dental frame")
      ->required();
  command->add_option("--calibration", o->calibration, "chain.json; not for a motion.csv");
  auto* landmarks = command->add_option("--landmarks", o->landmarks, "landmarks.toml (docs/jaw-motion.md)");
  command->add_option("--maxilla", o->maxilla, "upper arch: landmarks from both arches instead")
      ->excludes(landmarks);
  command->add_option("--mandible", o->mandible, "lower arch in MI")->excludes(landmarks);
  command->add_option("--mi-s", o->mi_s, "MI, START..END in seconds; else pedal marks, else found");
  command->add_option("--movement", o->movements,
                      "NAME=START..END in seconds: a movement that is not looked for");
  command->add_option("--hinge-arc-deg", o->arc_deg, "opening arcs for the hinge axis, from MI")
      ->capture_default_str()
      ->check(CLI::Range(5.0, 15.0));
  command->add_option("--out", o->out, "folder to make")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        MotionAnalysisJob job;
        job.motion = o->motion;
        job.calibration = o->calibration;
        job.landmarks = o->landmarks;
        job.maxilla = o->maxilla;
        job.mandible = o->mandible;
        job.options.hinge_arc_deg = o->arc_deg;
        for (const std::string& text : o->mi_s) {
          GNATHION_TRY(const auto interval, interval_of(text));
          job.plateaus.mi_s.push_back(interval);
        }
        for (const std::string& text : o->movements) {
          GNATHION_TRY(JawSegment segment, segment_of(text));
          job.options.segments.given.push_back(std::move(segment));
        }
        GNATHION_CHECK_OK(
            keeps_inputs(o->out, {o->motion, o->calibration, o->landmarks, o->maxilla, o->mandible}));
        GNATHION_TRY(StagedDirectory staged,
                     StagedDirectory::create(o->out, common.force, {"analysis.json"}));
        GNATHION_TRY(const MotionAnalysis m, analyse_motion(job, progress));
        GNATHION_CHECK_OK(write_motion_analysis(m, job, staged.path()));
        GNATHION_CHECK_OK(staged.commit());
        return CommandOutput{motion_analysis_text(m), motion_text(motion_analysis_json(m)), false};
      });
}

}  // namespace

void add_calibrate_sensor_command(CLI::App& calibrate, ChosenCommand& chosen) {
  struct Options {
    SensorCalibrationJob job;
    std::string recording, motion, points, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = calibrate.add_subcommand(
      "sensor", "where an electromagnetic sensor sits on the bow: against cameras, or by digitised points");
  auto* points = command->add_option("--points", o->points,
                                     "x,y,z of the bow's file and x,y,z by the sensor, a line each");
  command->add_option("--recording", o->recording, "recording with the sensor's poses")->excludes(points);
  command->add_option("--stream", o->job.stream, "of the sensor: bow/1");
  command->add_option("--motion", o->motion, "motion.mcap of the same time, the bow seen by cameras")
      ->excludes(points);
  command->add_option("--sigma-mm", o->job.sigma_mm, "of one reading, each axis")->capture_default_str();
  command->add_option("--sigma-deg", o->job.sigma_deg, "of one reading, each axis")->capture_default_str();
  command->add_option("--out", o->out, "sensor.json")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        if (o->points.empty() && (o->recording.empty() || o->motion.empty() || o->job.stream.empty()))
          return fail(ErrorCode::kUsage, "wrong usage", "calibrate sensor",
                      "give --points, or --recording, --stream and --motion");
        o->job.recording = o->recording;
        o->job.motion = o->motion;
        o->job.points = o->points;
        std::vector<std::string> inputs;
        for (const std::string* in : {&o->points, &o->recording, &o->motion})
          if (!in->empty()) inputs.push_back(*in);
        GNATHION_CHECK_OK(may_write(o->out, common, inputs));
        progress.begin_step("calibrating the sensor", 1.0);
        GNATHION_TRY(const SensorCalibration c, run_sensor_calibration(o->job));
        const json j = sensor_json(c);
        GNATHION_CHECK_OK(write_json(o->out, j));
        std::string text = fmt::format("{} used, residual {:.3f} mm, {:.3f} deg, held out {:.3f} mm\n",
                                       c.used, c.rms_mm, c.rms_deg, c.held_out_mm);
        for (const std::string& weak : c.weak) text += weak + '\n';
        return CommandOutput{text, motion_text(j), false};
      });
}

void add_motion_commands(CLI::App& app, ChosenCommand& chosen) {
  add_track(app, chosen);
  CLI::App* motion = app.add_subcommand("motion", "read a tracked jaw motion");
  motion->require_subcommand(1);
  add_analyse(*motion, chosen);
}

}  // namespace gnathion
