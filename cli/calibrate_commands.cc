// calibrate camera, calibrate rig, calibrate time; recording shift.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "core/file.h"
#include "core/transform_io.h"
#include "pipeline/camera_calibration_job.h"
#include "pipeline/time_calibration_job.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kBoardHelp =
    "chessboard:COLUMNSxROWS:SQUARE_MM (inner corners), charuco:COLUMNSxROWS:SQUARE_MM:MARKER_MM:DICTIONARY "
    "(squares) or "
    "aprilgrid:COLUMNSxROWS:TAG_MM:GAP (tags; gap over tag side)";

std::string calibration_text(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace);
}

struct CameraOptions {
  std::string images, recording, name = "camera_0", board, out, bow, head_frame;
  std::vector<std::string> cameras, streams;
  std::string pair = "name";
  bool without_k3 = false;
  int max_frames = 120;
  double same_instant_ms = 2;
};

void add_common(CLI::App& command, CameraOptions& o) {
  command.add_option("--recording", o.recording, "recording (.mcap) with images of the board");
  command.add_option("--board", o.board, kBoardHelp)->required();
  command.add_option("--out", o.out, "FILE.json; FILE.toml (for the rig) and FILE.png are written beside it")
      ->required();
  command.add_option("--bow", o.bow, "bow.toml, to be named in FILE.toml (relative to it)");
  command.add_option("--head-frame", o.head_frame, "head_frame.toml, in the same way");
  command.add_flag("--without-k3", o.without_k3, "hold k3 at 0");
  command.add_option("--max-frames", o.max_frames, "of a recording, taken evenly")
      ->check(CLI::Range(3, 5000));
}

/// FILE.json, FILE.toml, FILE.png.
struct Outputs {
  fs::path json, toml, png;
};

Result<Outputs> outputs_of(const CameraOptions& o, const CommonOptions& common) {
  const fs::path out = o.out;
  if (out.extension() != ".json" && out.extension() != ".toml")
    return fail(ErrorCode::kUsage, "cannot write", o.out,
                "give FILE.json; FILE.toml and FILE.png come beside it");
  Outputs files{out, out, out};
  files.json.replace_extension(".json");
  files.toml.replace_extension(".toml");
  files.png.replace_extension(".png");
  for (const fs::path& f : {files.json, files.toml, files.png})
    GNATHION_CHECK_OK(may_write(f.string(), common, {o.recording, o.bow, o.head_frame}));
  return files;
}

Result<CommandOutput> calibrate(const CameraOptions& o, std::vector<CalibrationCamera> cameras,
                                const CommonOptions& common, Progress& progress) {
  CameraCalibrationJob job;
  job.cameras = std::move(cameras);
  job.recording = o.recording;
  job.pair_by_time = o.pair == "time";
  job.same_instant_s = o.same_instant_ms * 1e-3;
  job.max_frames = o.max_frames;
  job.options.estimate_k3 = !o.without_k3;
  job.bow = o.bow;
  job.head_frame = o.head_frame;
  GNATHION_TRY(job.board, parse_board(o.board));
  GNATHION_TRY(const Outputs files, outputs_of(o, common));
  GNATHION_TRY(const CameraCalibrationOutput result, run_camera_calibration(job, progress));
  const json j = camera_calibration_json(job, result);
  GNATHION_TRY(const std::string png, camera_calibration_picture(result));
  GNATHION_CHECK_OK(write_file(files.png, png));
  GNATHION_CHECK_OK(write_file(files.toml, calibration_rig_toml(job, result)));
  GNATHION_CHECK_OK(write_json(files.json, j));
  return CommandOutput{camera_calibration_text(result), calibration_text(j), false};
}

tl::unexpected<Error> usage(const std::string& where, const std::string& why) {
  return fail(ErrorCode::kUsage, "wrong usage", where, why);
}

void add_calibrate_camera(CLI::App& group, ChosenCommand& chosen) {
  auto o = std::make_shared<CameraOptions>();
  CLI::App* command = group.add_subcommand("camera", "intrinsics of a camera from images of a board");
  command->add_option("--images", o->images, "folder with images of the board");
  command->add_option("--name", o->name, "the camera's name: its stream in recordings")
      ->capture_default_str();
  add_common(*command, *o);
  finish_command(*command, chosen,
                 [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
                   if (o->images.empty() == o->recording.empty())
                     return usage("calibrate camera", "give --images or --recording");
                   return calibrate(*o, {{o->name, o->images}}, common, progress);
                 });
}

void add_calibrate_rig(CLI::App& group, ChosenCommand& chosen) {
  auto o = std::make_shared<CameraOptions>();
  CLI::App* command =
      group.add_subcommand("rig", "two or more cameras that see the board at the same instants");
  command->add_option("--camera", o->cameras,
                      "NAME=FOLDER, for each camera; the first one's frame is the rig's");
  command->add_option("--streams", o->streams,
                      "cameras of the recording; the first one's frame is the rig's");
  command
      ->add_option(
          "--pair-by", o->pair,
          "images of one instant: equal names (or equal digits in them), or names that are times in ns")
      ->check(CLI::IsMember({"name", "time"}))
      ->capture_default_str();
  command
      ->add_option("--same-instant-ms", o->same_instant_ms,
                   "frames at most this far apart are of one instant")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  add_common(*command, *o);
  finish_command(*command, chosen,
                 [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
                   if (o->cameras.empty() == o->recording.empty())
                     return usage("calibrate rig",
                                  "give --camera NAME=FOLDER for each camera, or --recording with --streams");
                   std::vector<CalibrationCamera> cameras;
                   for (const std::string& c : o->cameras) {
                     const auto equals = c.find('=');
                     if (equals == std::string::npos || equals == 0 || equals + 1 == c.size())
                       return usage(c, "a camera is NAME=FOLDER");
                     cameras.push_back({c.substr(0, equals), c.substr(equals + 1)});
                   }
                   for (const std::string& s : o->streams) cameras.push_back({s, {}});
                   if (!o->cameras.empty() && !o->streams.empty())
                     return usage("--streams", "goes with --recording");
                   if (cameras.size() < 2) return usage("calibrate rig", "needs two cameras or more");
                   for (std::size_t a = 0; a < cameras.size(); ++a)
                     for (std::size_t b = 0; b < a; ++b)
                       if (cameras[a].name == cameras[b].name)
                         return usage(cameras[a].name, "two cameras have this name");
                   return calibrate(*o, std::move(cameras), common, progress);
                 });
}

void add_calibrate_time(CLI::App& group, ChosenCommand& chosen) {
  struct Options {
    TimeCalibrationJob job;
    std::string out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      group.add_subcommand("time", "the constant offset in time between two streams of poses");
  command
      ->add_option("--recording", o->job.files,
                   "recordings (.mcap), or motion.mcap of 'gnathion track'; one or two")
      ->required()
      ->expected(1, 2);
  command->add_option("--streams", o->job.streams, "two streams of poses that see one motion")
      ->required()
      ->expected(2);
  command->add_option("--max-offset-s", o->job.options.max_offset_s, "searched on both sides")
      ->check(CLI::Range(0.01, 30.0))
      ->capture_default_str();
  command->add_option("--out", o->out, "time.json")->required();
  finish_command(*command, chosen,
                 [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
                   GNATHION_CHECK_OK(may_write(o->out, common, o->job.files));
                   GNATHION_TRY(const TimeCalibrationResult r, run_time_calibration(o->job, progress));
                   const json j = time_calibration_json(o->job, r);
                   GNATHION_CHECK_OK(write_json(o->out, j));
                   return CommandOutput{time_calibration_text(o->job, r), calibration_text(j), false};
                 });
}

}  // namespace

void add_shift_command(CLI::App& recording, ChosenCommand& chosen) {
  struct Options {
    std::string recording, time, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = recording.add_subcommand(
      "shift", "the recording again, one stream's capture times moved by what 'calibrate time' found");
  command->add_option("FILE", o->recording, "recording (.mcap)")->required();
  command->add_option("--time", o->time, "time.json; its second stream is moved")->required();
  command->add_option("--out", o->out, "recording to write")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        GNATHION_CHECK_OK(may_write(o->out, common, {o->recording, o->time}));
        GNATHION_TRY(const std::size_t moved, shift_recording({o->recording, o->time, o->out}, progress));
        return CommandOutput{fmt::format("{} samples moved\n", moved),
                             calibration_text({{"moved", moved}, {"out", o->out}}), false};
      });
}

void add_calibrate_commands(CLI::App& calibrate, ChosenCommand& chosen) {
  add_calibrate_camera(calibrate, chosen);
  add_calibrate_rig(calibrate, chosen);
  add_calibrate_time(calibrate, chosen);
}

}  // namespace gnathion
