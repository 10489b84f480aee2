// design, run.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "cli/parameter_options.h"
#include "cli/patient_options.h"
#include "core/file.h"
#include "pipeline/design_job.h"
#include "pipeline/ladder_job.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& n : names) text += (text.empty() ? "" : ", ") + n;
  return text;
}

std::vector<std::string> input_paths(const DesignJob& job) {
  return {job.maxilla.string(),          job.mandible.string(), job.transform.string(),
          job.occlusal_surface.string(), job.motion.string(),   job.calibration.string()};
}

CommandOutput design_output(const DesignOutcome& outcome, const std::string& where) {
  std::string text;
  if (!outcome.design) {
    const auto violated = outcome.feasibility.violated();
    text = violated.empty() ? fmt::format("fail: {}\n", joined((*outcome.report)["violated"]))
                            : fmt::format("not realizable: {}\n", joined(violated));
  } else {
    const SplintVerification& v = outcome.design->verification;
    text = fmt::format(
        "{}{}{}\n  {} triangles, {:.0f} mm3, thinnest wall {:.2f} mm, {} aperture(s), contacts {:.1f} mm2\n",
        outcome.design->verdict, outcome.design->violated.empty() ? "" : ": ",
        joined(outcome.design->violated), v.topology.triangles, v.volume_mm3, v.thickness.min_mm,
        v.apertures.size(), v.contacts.area_mm2);
    for (const std::string& w : outcome.design->warnings) text += "  warning: " + w + "\n";
  }
  return {text + "  in " + where + "\n",
          outcome.report->dump(2, ' ', false, nlohmann::json::error_handler_t::replace), !outcome.accepted()};
}

Result<CommandOutput> design_ladder(DesignJob job, const Ladder& rungs, const std::string& out,
                                    const CommonOptions& common, Progress& progress) {
  GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(out, common.force, {"ladder.json"}));
  job.pictures = false;
  GNATHION_TRY(const LadderOutcome outcome, run_ladder(job, rungs, staged.path(), progress));
  GNATHION_CHECK_OK(staged.commit());
  const std::string text =
      fmt::format("{} of {} pass\n{}  in {}\n", outcome.accepted, outcome.rungs, outcome.table, out);
  return CommandOutput{text, outcome.report->dump(2, ' ', false, nlohmann::json::error_handler_t::replace),
                       outcome.accepted < outcome.rungs};
}

void add_design(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    DesignJob job;
    std::string out, arch = "maxilla", pose = "mi";
    bool no_pictures = false;
    ParameterOptions parameters;
    Ladder rungs;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("design", "a splint that holds the mandible where T_th puts it (exit 3: refused)");
  command->add_option("--maxilla", o->job.maxilla, "upper arch")->required();
  command->add_option("--mandible", o->job.mandible, "lower arch, same frame")->required();
  command->add_option("--transform", o->job.transform, "T_th: JSON, 16 numbers, or ITK .tfm")->required();
  command->add_option("--out", o->out, "folder to make")->required();
  command->add_option("--arch", o->arch, "arch that wears the splint")
      ->check(CLI::IsMember({"maxilla", "mandible"}))
      ->capture_default_str();
  command->add_option("--occlusal-surface", o->job.occlusal_surface,
                      "S_occ of that arch, where it lies in MI; else its crowns");
  command->add_option(
      "--motion", o->job.motion,
      "excursions that must run free from TP: motion.csv in the dental frame, or motion.mcap");
  command->add_option("--calibration", o->job.calibration,
                      "chain.json for motion.mcap; else the one beside it");
  command->add_option("--mandible-pose", o->pose, "where the mandible's file has it")
      ->check(CLI::IsMember({"mi", "tp"}))
      ->capture_default_str();
  command->add_flag("--no-pictures", o->no_pictures, "leave the pictures out");
  add_joint_options(*command, o->job.known);
  command->add_option("--recording", o->job.known.motion,
                      "the patient's recorded motion, which T_th must lie in: as --motion");
  add_parameter_options(*command, o->parameters);
  add_edit_options(*command, o->parameters);
  CLI::App* ladder = command->add_subcommand(
      "ladder", "one splint for each engagement and gap, to find what a printer needs; options as of design");
  ladder->fallthrough();
  ladder->add_option("--engagement", o->rungs.engagement_mm, "r, mm, comma-separated")
      ->delimiter(',')
      ->capture_default_str();
  ladder->add_option("--gap", o->rungs.gap_mm, "g, mm, comma-separated")
      ->delimiter(',')
      ->capture_default_str();
  finish_command(*command, chosen,
                 [o, ladder](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
                   GNATHION_TRY(o->job.parameters, effective_parameters(o->parameters));
                   GNATHION_TRY(o->job.edits, effective_edits(o->parameters));
                   o->job.arch = o->arch == "maxilla" ? Arch::kMaxilla : Arch::kMandible;
                   o->job.mandible_is_in_tp = o->pose == "tp";
                   o->job.pictures = !o->no_pictures;
                   if (!o->job.known.motion.empty()) o->job.known.calibration = o->job.calibration;
                   std::vector<std::string> inputs = input_paths(o->job);
                   for (std::string& path : o->job.known.paths()) inputs.push_back(std::move(path));
                   inputs.push_back(o->parameters.config);
                   GNATHION_CHECK_OK(keeps_inputs(o->out, inputs));
                   if (ladder->parsed()) return design_ladder(o->job, o->rungs, o->out, common, progress);
                   GNATHION_TRY(
                       StagedDirectory staged,
                       StagedDirectory::create(o->out, common.force, {"design.json", "feasibility.json"}));
                   GNATHION_TRY(const DesignOutcome outcome, run_design(o->job, staged.path(), progress));
                   GNATHION_CHECK_OK(staged.commit());
                   return design_output(outcome, o->out);
                 });
}

}  // namespace

void add_design_commands(CLI::App& app, ChosenCommand& chosen) {
  add_design(app, chosen);
  add_run_command(app, chosen);
}

}  // namespace gnathion
