#include "cli/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "core/interrupt.h"
#include "pipeline/phantom_device.h"
#include "pipeline/version.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kDescription =
    "Gnathion: from a recorded jaw motion to an occlusal positioning splint.\n"
    "Research software; it makes no clinical claim.";
constexpr const char* kFooter =
    "Lengths are millimetres, angles degrees, times seconds. Exit codes: 0 done, 2 wrong usage,\n"
    "3 valid input but the result fails a gate, 4 unreadable or invalid input, 1 anything else.";

int print_error(const Error& error) {
  fmt::print(stderr, "gnathion: {}\n", error.line());
  return exit_code(error.code);
}

int print_usage_error(const CLI::App& app, const CLI::ParseError& e) {
  if (e.get_exit_code() == 0) return app.exit(e);  // --help, --version
  std::string why = e.what();
  for (char& c : why)
    if (c == '\n') c = ' ';
  fmt::print(stderr, "gnathion: wrong usage: {}: try --help\n", why);
  return exit_code(ErrorCode::kUsage);
}

}  // namespace

void finish_command(CLI::App& command, ChosenCommand& chosen, CommandBody body, bool writes) {
  const auto common = chosen.common;
  command.add_flag("--json", common->json, "print the result as JSON on stdout");
  command.add_flag("--quiet", common->quiet, "no progress, no summary");
  if (writes) command.add_flag("--force", common->force, "replace an existing output");
  command.footer(kFooter);
  command.callback([&chosen, body = std::move(body)] { chosen.body = body; });
}

Status may_write(const std::string& path, const CommonOptions& common,
                 const std::vector<std::string>& inputs) {
  std::error_code ec;
  const auto refuse = [&](const char* why) { return fail(ErrorCode::kUsage, "cannot write", path, why); };
  const fs::path folder = fs::path(path).parent_path();
  if (!folder.empty() && !fs::is_directory(folder, ec)) return refuse("its folder does not exist");
  if (!fs::exists(path, ec)) return {};
  for (const std::string& input : inputs)
    if (fs::equivalent(path, input, ec)) return refuse("is an input");
  if (fs::is_directory(path, ec)) return refuse("is a folder");
  return common.force ? Status() : refuse("exists; --force replaces it");
}

Status keeps_inputs(const std::string& folder, const std::vector<std::string>& inputs) {
  std::error_code ec;
  const fs::path target = fs::weakly_canonical(folder, ec);
  for (const std::string& input : inputs) {
    if (input.empty()) continue;
    const fs::path file = fs::weakly_canonical(input, ec);
    if (std::mismatch(target.begin(), target.end(), file.begin(), file.end()).first == target.end())
      return fail(ErrorCode::kUsage, "cannot write", folder, "holds the input " + input);
  }
  return {};
}

int run_command_line(int argc, char** argv) {
  CLI::App app(kDescription, "gnathion");
  app.set_version_flag("--version", std::string("gnathion ") + kVersion);
  app.require_subcommand(1);
  app.footer(kFooter);
  ChosenCommand chosen;
  end_with_the_daemon();
  clean_up_when_interrupted();
  add_phantom_device();
  add_demo_commands(app, chosen);
  add_recording_commands(app, chosen);
  add_frames_commands(app, chosen);
  add_cbct_commands(app, chosen);
  add_transform_commands(app, chosen);
  add_check_commands(app, chosen);
  add_joint_commands(app, chosen);
  add_xray_commands(app, chosen);
  add_range_commands(app, chosen);
  add_design_commands(app, chosen);
  add_case_commands(app, chosen);
  add_audit_commands(app, chosen);
  add_print_commands(app, chosen);
  add_bow_commands(app, chosen);
  add_evaluate_commands(app, chosen);
  add_motion_commands(app, chosen);
  add_daemon_commands(app, chosen);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return print_usage_error(app, e);
  }
  const CommonOptions& common = *chosen.common;
  Result<CommandOutput> output = CommandOutput{};
  {
    TerminalProgress progress(progress_mode(common.quiet));
    try {
      output = chosen.body(common, progress);
    } catch (const std::bad_alloc&) {
      output = fail(ErrorCode::kInternal, "cannot go on", "memory", "not enough of it");
    } catch (const std::exception& e) {
      output = fail(ErrorCode::kInternal, "cannot go on", "unexpected", e.what());
    }
  }
  if (!output) return print_error(output.error());
  if (common.json) {
    std::puts(output->json.c_str());
  } else if (!common.quiet) {
    std::fputs(output->text.c_str(), stdout);
  }
  if (std::fflush(stdout) != 0)
    return print_error(
        {ErrorCode::kInternal, "cannot write", "standard output", "the result did not go out whole"});
  return output->gate_failed ? exit_code(ErrorCode::kGate) : 0;
}

}  // namespace gnathion
