// evaluate virtual-print.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "core/file.h"
#include "core/utc.h"
#include "pipeline/virtual_print_job.h"

namespace gnathion {
namespace {

struct Options {
  VirtualPrintJob job;
  std::vector<std::string> set;
  std::string out, pose = "mi";
};

std::vector<std::string> input_paths(const VirtualPrintJob& job) {
  std::vector<std::string> paths = {job.maxilla.string(), job.mandible.string(), job.transform.string()};
  for (const auto& d : job.designs) paths.push_back((d / "design.json").string());
  return paths;
}

Result<CommandOutput> run(Options& o, const CommonOptions& common, Progress& progress) {
  for (const std::string& s : o.set) GNATHION_CHECK_OK(set_magnitude(o.job.options, s));
  if (o.job.designs.size() > 1 &&
      !(o.job.maxilla.empty() && o.job.mandible.empty() && o.job.transform.empty()))
    return fail(ErrorCode::kUsage, "cannot print virtually", "--maxilla, --mandible, --transform",
                "they go with one design; several name their own files");
  o.job.mandible_is_in_tp = o.pose == "tp";
  SystemClock clock;
  o.job.date_iso = utc_text(clock.now());
  GNATHION_CHECK_OK(keeps_inputs(o.out, input_paths(o.job)));
  GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o.out, common.force, {"virtual_print.json"}));
  GNATHION_TRY(const VirtualPrintOutcome outcome, run_virtual_print(o.job, staged.path(), progress));
  GNATHION_CHECK_OK(staged.commit());
  return CommandOutput{virtual_print_text(outcome) + "  in " + o.out + "\n",
                       outcome.report->dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
}

}  // namespace

void add_virtual_print_command(CLI::App& evaluate, ChosenCommand& chosen) {
  auto o = std::make_shared<Options>();
  CLI::App* command = evaluate.add_subcommand(
      "virtual-print",
      "what the procedures would find, from the design alone: Monte Carlo over print, seat and scan");
  command->add_option("--design", o->job.designs, "folder of a design; several are compared side by side")
      ->required();
  command->add_option("--out", o->out, "folder to make")->required();
  command->add_option("--trials", o->job.options.trials, "prints of each design")->capture_default_str();
  command->add_option("--seed", o->job.options.seed, "of the random numbers")->capture_default_str();
  command->add_option("--maxilla", o->job.maxilla, "upper arch, if it is not where design.json says");
  command->add_option("--mandible", o->job.mandible, "lower arch, likewise");
  command->add_option("--transform", o->job.transform, "T_th, likewise");
  command->add_option("--mandible-pose", o->pose, "where the mandible's file has it")
      ->check(CLI::IsMember({"mi", "tp"}))
      ->capture_default_str();
  std::string names;
  VirtualPrintOptions defaults;
  for (const auto& [name, value] : magnitudes(defaults)) names += fmt::format("\n    {}={}", name, *value);
  command->add_option("--set", o->set,
                      "one magnitude, NAME=VALUE; repeatable. Defaults (docs/virtual-print.md):" + names);
  finish_command(*command, chosen,
                 [o](const CommonOptions& common, Progress& progress) { return run(*o, common, progress); });
}

}  // namespace gnathion
