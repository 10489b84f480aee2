// check, design, run.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "core/file.h"
#include "pipeline/run_case.h"

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

void add_check(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    DesignJob job;
    std::string out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("check", "can a splint realize this transformation? (exit 3: no)");
  command->add_option("--maxilla", o->job.maxilla, "upper arch")->required();
  command->add_option("--mandible", o->job.mandible, "lower arch in MI, same frame")->required();
  command->add_option("--transform", o->job.transform, "T_th: JSON, 16 numbers, or ITK .tfm")->required();
  command->add_option("--out", o->out, "feasibility.json")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        GNATHION_CHECK_OK(may_write(o->out, common, input_paths(o->job)));
        progress.begin_step("reading the jaws", 0.3);
        GNATHION_TRY(const DesignInputs in, read_design_inputs(o->job));
        progress.begin_step("checking", 0.7);
        GNATHION_TRY(const Feasibility f,
                     check_realizability(in.splint.maxilla, in.splint.mandible_mi, in.splint.therapeutic));
        const json j = feasibility_json(f);
        GNATHION_CHECK_OK(write_json(o->out, j));
        std::string text = fmt::format("{}\n", verdict_name(f.verdict));
        for (const Constraint& c : f.constraints)
          if (!c.pass)
            text += fmt::format("  {}: {:.3f} {}, limit {:.3f}: {}\n", c.name, c.value, c.unit, c.limit,
                                c.consequence);
        return CommandOutput{text, j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace),
                             f.verdict == Verdict::kNotRealizable};
      });
}

struct ParameterOptions {
  std::string config;
  std::vector<std::string> set;
};

void add_parameter_options(CLI::App& command, ParameterOptions& o) {
  command.add_option("--config", o.config, "TOML file with a [design] table, and edits by hand");
  std::string names;
  for (const ParameterHelp& p : parameter_help())
    names += fmt::format("\n    design.{}={} [{}] {}..{}", p.name, p.default_value, p.unit, p.low, p.high);
  command.add_option("--set", o.set,
                     "one parameter, design.NAME=VALUE; repeatable. Defaults and ranges:" + names);
}

Result<SplintParameters> effective_parameters(const ParameterOptions& o, const SplintParameters& base = {}) {
  SplintParameters p = base;
  if (!o.config.empty()) {
    GNATHION_TRY(p, read_parameters(o.config, p));
  }
  for (const std::string& s : o.set) GNATHION_CHECK_OK(set_parameter(p, s));
  GNATHION_CHECK_OK(check_parameters(p));
  return p;
}

/// Edits of the --config file; they take the place of `base` where there are any.
Result<SplintEdits> effective_edits(const ParameterOptions& o, const SplintEdits& base = {}) {
  if (o.config.empty()) return base;
  GNATHION_TRY(const std::string text, read_file(o.config));
  GNATHION_TRY(SplintEdits edits, parse_edits(text, o.config));
  return edits.empty() ? base : edits;
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

void add_design(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    DesignJob job;
    std::string out, arch = "maxilla", pose = "mi";
    bool no_pictures = false;
    ParameterOptions parameters;
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
  add_parameter_options(*command, o->parameters);
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        GNATHION_TRY(o->job.parameters, effective_parameters(o->parameters));
        GNATHION_TRY(o->job.edits, effective_edits(o->parameters));
        o->job.arch = o->arch == "maxilla" ? Arch::kMaxilla : Arch::kMandible;
        o->job.mandible_is_in_tp = o->pose == "tp";
        o->job.pictures = !o->no_pictures;
        std::vector<std::string> inputs = input_paths(o->job);
        inputs.push_back(o->parameters.config);
        GNATHION_CHECK_OK(keeps_inputs(o->out, inputs));
        GNATHION_TRY(StagedDirectory staged,
                     StagedDirectory::create(o->out, common.force, {"design.json", "feasibility.json"}));
        GNATHION_TRY(const DesignOutcome outcome, run_design(o->job, staged.path(), progress));
        GNATHION_CHECK_OK(staged.commit());
        return design_output(outcome, o->out);
      });
}

void add_run(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    std::string folder;
    bool accept_slip = false;
    ParameterOptions parameters;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("run", "everything a case folder asks for, in order, into CASE/results");
  command->add_option("CASE", o->folder, "case folder with case.toml")->required();
  command->add_flag("--accept-slip", o->accept_slip, "go on although the MI recordings do not close");
  add_parameter_options(*command, o->parameters);
  finish_command(*command, chosen,
                 [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
                   RunOptions run;
                   GNATHION_TRY(const CaseFile files, read_case(o->folder));
                   GNATHION_TRY(run.parameters, effective_parameters(o->parameters, files.parameters));
                   GNATHION_TRY(run.edits, effective_edits(o->parameters, files.edits));
                   run.force = common.force;
                   run.accept_slip = o->accept_slip;

                   GNATHION_TRY(const CaseResults r, run_case(files, run, progress));
                   return design_output(r.design, (std::filesystem::path(o->folder) / "results").string());
                 });
}

}  // namespace

void add_design_commands(CLI::App& app, ChosenCommand& chosen) {
  add_check(app, chosen);
  add_design(app, chosen);
  add_run(app, chosen);
}

}  // namespace gnathion
