// xray.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "cli/patient_options.h"
#include "core/file.h"
#include "pipeline/xray_job.h"

namespace gnathion {
namespace {

std::string text_of(const XrayOutcome& outcome, const std::string& where) {
  std::string text = fmt::format("{} films of {} steps in {}\n", outcome.steps.size() * outcome.series.size(),
                                 outcome.steps.size(), where);
  for (const std::string& note : outcome.notes) text += "  note: " + note + "\n";
  return text;
}

}  // namespace

void add_xray_commands(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    XrayJob job;
    std::string transform, out;
    std::vector<double> window;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("xray", "virtual X-rays of both condyles from MI to T_th or along a recording");
  add_jaw_options(*command, o->job.files);
  add_joint_options(*command, o->job.files);
  command->get_option("--cbct")->required();
  add_recording_options(*command, o->job.files);
  command->add_option("--transform", o->transform, "T_th; else the films follow --motion");
  command
      ->add_option("--view", o->job.views,
                   "lateral, frontal, towne, submentovertex, or TURN,TILT in degrees; repeatable")
      ->capture_default_str();
  command->add_option("--steps", o->job.steps, "positions, both ends included")->capture_default_str();
  command->add_option("--size-px", o->job.options.size_px, "side of a film")->capture_default_str();
  command->add_option("--field-mm", o->job.options.field_mm, "side of what it shows")->capture_default_str();
  command->add_option("--depth-mm", o->job.options.depth_mm, "of the head along the beam, about the joint")
      ->capture_default_str();
  command->add_option("--source-mm", o->job.options.source_mm, "focus to joint; 0: parallel beam")
      ->capture_default_str();
  command->add_option("--window", o->window, "LOW HIGH of the line integral; else of each view in MI")
      ->expected(2);
  command->add_option("--out", o->out, "folder to make")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        std::vector<std::string> inputs = o->job.files.paths();
        inputs.push_back(o->transform);
        GNATHION_CHECK_OK(keeps_inputs(o->out, inputs));
        if (!o->transform.empty()) {
          GNATHION_TRY(const MotionFile motion, read_motion(o->transform));
          o->job.therapeutic = motion.motion;
        }
        if (!o->window.empty()) {
          if (!(o->window[1] > o->window[0]))
            return fail(ErrorCode::kUsage, "cannot show films", "--window", "LOW is below HIGH");
          o->job.window = XrayWindow{o->window[0], o->window[1]};
        }
        GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o->out, common.force, {"xray.json"}));
        GNATHION_TRY(const XrayOutcome outcome, make_xrays(o->job, progress));
        GNATHION_CHECK_OK(write_xrays(outcome, o->job, staged.path()));
        GNATHION_CHECK_OK(staged.commit());
        return CommandOutput{
            text_of(outcome, o->out),
            xray_json(outcome, o->job).dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
      });
}

}  // namespace gnathion
