// run: everything a case folder asks for.
#include <fmt/format.h>

#include <sys/stat.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "cli/parameter_options.h"
#include "pipeline/run_case.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string steps_text(const CaseResults& r) {
  std::string text;
  for (const StepOutcome& s : r.steps)
    text += fmt::format("  {:<14} {}\n", s.step, s.reused ? "reused" : "done: " + s.why);
  return text;
}

std::string names_of(const json& list) {
  std::string text;
  for (const json& n : list) text += (text.empty() ? "" : ", ") + n.get<std::string>();
  return text;
}

std::string design_text(const json& d) {
  const std::string verdict = d.value("verdict", std::string("no verdict"));
  std::string text = verdict + (d["violated"].empty() ? "" : ": " + names_of(d["violated"])) + "\n";
  if (d.contains("mesh") && d["mesh"].is_object() && d["mesh"].contains("triangles"))
    text += fmt::format(
        "  {} triangles, {:.0f} mm3, thinnest wall {:.2f} mm, {} aperture(s), contacts {:.1f} mm2\n",
        d["mesh"]["triangles"].get<std::size_t>(), d["mesh"]["volume_mm3"].get<double>(),
        d["thickness_mm"]["min"].get<double>(), d["apertures"].size(),
        d["contacts"]["area_mm2"].get<double>());
  for (const json& w : d["warnings"]) text += "  warning: " + w.get<std::string>() + "\n";
  return text;
}

CommandOutput run_output(const CaseResults& r, const std::string& where) {
  json j = *r.design.report;
  j["case"] = r.case_id;
  j["session_warnings"] = r.session.warnings;
  j["steps"] = json::array();
  for (const StepOutcome& s : r.steps)
    j["steps"].push_back({{"step", s.step}, {"reused", s.reused}, {"why", s.why}});
  std::string text = steps_text(r) + design_text(*r.design.report);
  for (const std::string& w : r.session.warnings) text += "  warning: " + w + "\n";
  return {text + "  in " + where + "\n", j.dump(2, ' ', false, json::error_handler_t::replace),
          !r.design.accepted()};
}

}  // namespace

void add_run_command(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    std::string folder;
    bool accept_slip = false;
    ParameterOptions parameters;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "run", "everything a case folder asks for, in order, into CASE/results; only what changed is redone");
  command->add_option("CASE", o->folder, "case folder with case.toml")->required();
  command->add_flag("--accept-slip", o->accept_slip, "go on although the MI recordings do not close");
  add_parameter_options(*command, o->parameters);
  finish_command(*command, chosen,
                 [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
                   ::umask(0077);
                   RunOptions run;
                   GNATHION_TRY(const CaseFile files, read_case(o->folder));
                   GNATHION_TRY(run.parameters, effective_parameters(o->parameters, files.parameters));
                   GNATHION_TRY(run.edits, effective_edits(o->parameters, files.edits));
                   run.force = common.force;
                   run.accept_slip = o->accept_slip;
                   GNATHION_TRY(const CaseResults r, run_case(files, run, progress));
                   return run_output(r, (std::filesystem::path(o->folder) / "results").string());
                 });
}

}  // namespace gnathion
