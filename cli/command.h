// What all commands share: options, output, exit codes.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "cli/terminal_progress.h"
#include "core/result.h"

namespace CLI {
class App;
}

namespace gnathion {

/// Options that every command has.
struct CommonOptions {
  bool json = false, quiet = false, force = false;
};

/// What a command gives back when it could do its work.
struct CommandOutput {
  std::string text;          ///< for people; printed unless --quiet or --json
  std::string json;          ///< for --json
  bool gate_failed = false;  ///< exit code 3
};

/// A command, once its options are parsed.
using CommandBody = std::function<Result<CommandOutput>(const CommonOptions&, Progress&)>;

/// The command that the parsed command line asks for, with its common options.
struct ChosenCommand {
  CommandBody body;
  std::shared_ptr<CommonOptions> common = std::make_shared<CommonOptions>();
};

/// Adds --json, --quiet (and --force where outputs are written) to a subcommand and remembers `body` for it.
void finish_command(CLI::App& command, ChosenCommand& chosen, CommandBody body, bool writes = true);

void add_demo_commands(CLI::App& app, ChosenCommand& chosen);       // demo, phantom
void add_recording_commands(CLI::App& app, ChosenCommand& chosen);  // recording info|verify|recover|capture
void add_exchange_commands(CLI::App& recording, ChosenCommand& chosen);  // recording import|export
void add_transform_commands(CLI::App& app, ChosenCommand& chosen);  // calibrate chain, transform scans|motion|manual
void add_shift_command(CLI::App& recording, ChosenCommand& chosen);  // recording shift
void add_calibrate_commands(CLI::App& calibrate, ChosenCommand& chosen);  // calibrate camera|rig|time
void add_frames_commands(CLI::App& app, ChosenCommand& chosen);     // frames
void add_cbct_commands(CLI::App& app, ChosenCommand& chosen);       // cbct info|register|surface|joints
void add_check_commands(CLI::App& app, ChosenCommand& chosen);      // check
void add_joint_commands(CLI::App& app, ChosenCommand& chosen);      // joints motion
void add_xray_commands(CLI::App& app, ChosenCommand& chosen);       // xray
void add_range_commands(CLI::App& app, ChosenCommand& chosen);      // range
void add_design_commands(CLI::App& app, ChosenCommand& chosen);     // design, run
void add_run_command(CLI::App& app, ChosenCommand& chosen);         // run
void add_case_commands(CLI::App& app, ChosenCommand& chosen);       // case create|info|list|…
void add_audit_commands(CLI::App& app, ChosenCommand& chosen);      // audit verify
void add_bow_commands(CLI::App& app, ChosenCommand& chosen);                    // bow print
void add_calibrate_bow_command(CLI::App& calibrate, ChosenCommand& chosen);  // under calibrate
void add_evaluate_commands(CLI::App& app, ChosenCommand& chosen);   // evaluate
void add_virtual_print_command(CLI::App& evaluate, ChosenCommand& chosen);  // under evaluate
void add_position_commands(CLI::App& evaluate, ChosenCommand& chosen);      // under evaluate: discrepancy, registration-object

void add_print_commands(CLI::App& app, ChosenCommand& chosen);   // print prepare
void add_motion_commands(CLI::App& app, ChosenCommand& chosen);             // track, motion analyse
void add_calibrate_sensor_command(CLI::App& calibrate, ChosenCommand& chosen);  // under calibrate
void add_daemon_commands(CLI::App& app, ChosenCommand& chosen);  // devices, capture, mark, live, jobs, cases, audit show

/// Refuses (kUsage) an output file that exists unless forced, whose folder does not exist, or that is one of
/// the `inputs`, forced or not.
Status may_write(const std::string& path, const CommonOptions& common,
                 const std::vector<std::string>& inputs);
/// Refuses (kUsage) an output folder that holds one of the `inputs`.
Status keeps_inputs(const std::string& folder, const std::vector<std::string>& inputs);

/// Parses, runs, prints; the process's exit code.
int run_command_line(int argc, char** argv);

}  // namespace gnathion
