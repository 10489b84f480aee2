// check.
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "cli/patient_options.h"

namespace gnathion {

void add_check_commands(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    PatientFiles files;
    std::string transform, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("check", "can a splint realize this transformation? (exit 3: no)");
  add_jaw_options(*command, o->files);
  command->add_option("--transform", o->transform, "T_th: JSON, 16 numbers, or ITK .tfm")->required();
  add_joint_options(*command, o->files);
  add_recording_options(*command, o->files);
  command->add_option("--out", o->out, "feasibility.json")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        std::vector<std::string> inputs = o->files.paths();
        inputs.push_back(o->transform);
        GNATHION_CHECK_OK(may_write(o->out, common, inputs));
        GNATHION_TRY(const CheckOutcome outcome, run_check(o->files, o->transform, progress));
        const nlohmann::json j = feasibility_json(outcome.feasibility);
        GNATHION_CHECK_OK(write_json(o->out, j));
        return CommandOutput{outcome.text, j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace),
                             outcome.feasibility.verdict == Verdict::kNotRealizable};
      });
}

}  // namespace gnathion
