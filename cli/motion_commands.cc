// motion analyse.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "core/file.h"
#include "pipeline/motion_analysis.h"

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
        stop > start)
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
        return CommandOutput{motion_analysis_text(m),
                             motion_analysis_json(m).dump(2, ' ', false, json::error_handler_t::replace),
                             false};
      });
}

}  // namespace

void add_motion_commands(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* motion = app.add_subcommand("motion", "read a tracked jaw motion");
  motion->require_subcommand(1);
  add_analyse(*motion, chosen);
}

}  // namespace gnathion
