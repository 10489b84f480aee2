// print prepare.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "core/file.h"
#include "pipeline/print_job.h"

namespace gnathion {
namespace {

void add_prepare(CLI::App& print, ChosenCommand& chosen) {
  struct Options {
    PrintJob job;
    std::string out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = print.add_subcommand(
      "prepare", "splints turned, compensated and laid out on a printer's plates (exit 3: refused)");
  command->add_option("--design", o->job.designs, "folders that `gnathion design` wrote; one may come twice")
      ->required();
  command->add_option("--profile", o->job.profile, "TOML profile of the printer")->required();
  command->add_option("--material", o->job.material,
                      "of that profile: its gap is compared with the design's");
  command->add_option("--out", o->out, "folder to make")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        std::vector<std::string> inputs = {o->job.profile.string()};
        for (const auto& design : o->job.designs) inputs.push_back(design.string());
        GNATHION_CHECK_OK(keeps_inputs(o->out, inputs));
        GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o->out, common.force, {"print.json"}));
        GNATHION_TRY(const PrintOutcome outcome, prepare_print(o->job, staged.path(), progress));
        GNATHION_CHECK_OK(staged.commit());
        std::string text = fmt::format("{}: {} splint(s) on {} plate(s)\n", outcome.passed ? "pass" : "fail",
                                       outcome.parts, outcome.plates);
        for (const std::string& w : outcome.warnings) text += "  warning: " + w + "\n";
        return CommandOutput{text + "  in " + o->out + "\n",
                             outcome.report->dump(2, ' ', false, nlohmann::json::error_handler_t::replace),
                             !outcome.passed};
      });
}

}  // namespace

void add_print_commands(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* print = app.add_subcommand("print", "make ready for the printer");
  print->require_subcommand(1);
  add_prepare(*print, chosen);
}

}  // namespace gnathion
