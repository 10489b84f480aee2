// jobs: what gnathiond computes, in processes of its own.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <condition_variable>
#include <mutex>
#include <nlohmann/json.hpp>

#include "cli/daemon_commands.h"

namespace gnathion {
namespace {

using client::DaemonClient;
using client::JobState;
using nlohmann::json;

json json_of(const client::Job& j) {
  return {
      {"id", j.id},     {"case", j.case_id},      {"kind", j.kind},       {"state", client::name_of(j.state)},
      {"step", j.step}, {"fraction", j.fraction}, {"message", j.message}, {"exit_code", j.exit_code},
      {"who", j.who}};
}

std::string line_of(const client::Job& j) {
  return fmt::format("{:<22} {:<16} {:<18} {:<11} {:>3.0f} % {}", j.id, j.case_id, j.kind,
                     client::name_of(j.state), 100 * j.fraction, j.message.empty() ? j.step : j.message);
}

CommandOutput output_of(const client::Job& j) {
  return {line_of(j) + "\n", dump_json(json_of(j)), j.state == JobState::kGateFailed};
}

Result<CommandOutput> list_jobs(DaemonClient& daemon, const std::string& case_id) {
  GNATHION_TRY(const auto jobs, daemon.jobs(case_id));
  json list = json::array();
  std::string text;
  for (const client::Job& job : jobs) {
    list.push_back(json_of(job));
    text += line_of(job) + "\n";
  }
  return CommandOutput{text, dump_json(list), false};
}

Result<CommandOutput> list_kinds(DaemonClient& daemon) {
  GNATHION_TRY(const auto kinds, daemon.job_kinds());
  json list = json::array();
  std::string text;
  for (const client::JobKind& kind : kinds) {
    text += fmt::format("{}: {}\n", kind.name, kind.help);
    json options = json::array();
    for (const client::JobOption& o : kind.options) {
      text += fmt::format("    {}={}{}{}\n", o.name, o.type, o.required ? ", needed" : "",
                          o.repeated ? ", repeatable" : "");
      options.push_back(
          {{"name", o.name}, {"type", o.type}, {"required", o.required}, {"repeated", o.repeated}});
    }
    list.push_back({{"name", kind.name}, {"help", kind.help}, {"options", options}});
  }
  return CommandOutput{text, dump_json(list), false};
}

/// Follows a job to its end, on a terminal with a line that goes on.
Result<CommandOutput> watch_job(DaemonClient& daemon, const std::string& id) {
  std::mutex mutex;
  std::condition_variable changed;
  bool over = false;
  Status ended;
  const bool show = ::isatty(STDERR_FILENO) != 0;
  const auto subscription = daemon.job_progress(
      id,
      [&](const client::Job& job) {
        if (show) fmt::print(stderr, "\r\033[K{}", line_of(job));
      },
      [&](const Status& status) {
        std::lock_guard lock(mutex);
        ended = status;
        over = true;
        changed.notify_all();
      });
  std::unique_lock lock(mutex);
  changed.wait(lock, [&] { return over; });
  if (show) fmt::print(stderr, "\r\033[K");
  if (!ended) return tl::unexpected<Error>(ended.error());
  GNATHION_TRY(const client::JobResult result, daemon.job_result(id));
  if (result.job.state == JobState::kFailed || result.job.state == JobState::kCancelled)
    return fail(ErrorCode::kInternal, "job " + std::string(client::name_of(result.job.state)), id,
                result.job.message);
  return output_of(result.job);
}

Result<CommandOutput> show_result(DaemonClient& daemon, const std::string& id) {
  GNATHION_TRY(const client::JobResult result, daemon.job_result(id));
  json j = json_of(result.job);
  const json made = json::parse(result.json, nullptr, false);
  j["result"] = made.is_discarded() ? json(result.json) : made;
  j["outputs"] = result.outputs;
  std::string text = line_of(result.job) + "\n";
  for (const std::string& output : result.outputs) text += "  " + output + "\n";
  return CommandOutput{text, dump_json(j), result.job.state == JobState::kGateFailed};
}

struct Order {
  client::JobRequest request;
  std::vector<std::string> options;
  bool wait = false;
};

Result<CommandOutput> submit(DaemonClient& daemon, const Order& o) {
  client::JobRequest request = o.request;
  for (const std::string& option : o.options) {
    const std::size_t equals = option.find('=');
    if (equals == std::string::npos)
      return fail(ErrorCode::kUsage, "cannot submit", option,
                  "options are NAME=VALUE; `gnathion jobs kinds` lists them");
    request.values.emplace_back(option.substr(0, equals), option.substr(equals + 1));
  }
  GNATHION_TRY(const client::Job job, daemon.submit(request));
  if (o.wait) return watch_job(daemon, job.id);
  return output_of(job);
}

}  // namespace

void add_jobs(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* group = app.add_subcommand("jobs", "what gnathiond computes: submit, watch, cancel");
  group->require_subcommand(1);
  auto word = std::make_shared<std::string>();
  add_daemon_command(*group, chosen, "list", "newest first", [word](DaemonClient& d) {
    return list_jobs(d, *word);
  })->add_option("--case", *word, "of this case alone");
  add_daemon_command(*group, chosen, "kinds", "what can be submitted, with its options", list_kinds);
  const auto by_id = [&](const char* name, const char* help, DaemonBody body) {
    add_daemon_command(*group, chosen, name, help, std::move(body))
        ->add_option("JOB", *word, "its id")
        ->required();
  };
  by_id("watch", "follow a job to its end", [word](DaemonClient& d) { return watch_job(d, *word); });
  by_id("result", "what it gave", [word](DaemonClient& d) { return show_result(d, *word); });
  by_id("cancel", "stop it and remove what it had half-written",
        [word](DaemonClient& d) -> Result<CommandOutput> {
          GNATHION_TRY(const client::Job job, d.cancel(*word));
          return output_of(job);
        });
  auto order = std::make_shared<Order>();
  CLI::App* command = add_daemon_command(*group, chosen, "submit", "have something computed",
                                         [order](DaemonClient& d) { return submit(d, *order); });
  command->add_option("CASE", order->request.case_id, "the case's id")->required();
  command->add_option("KIND", order->request.kind, "as `gnathion jobs kinds` has it: \"calibrate camera\"")
      ->required();
  command->add_option("OPTION", order->options, "NAME=VALUE; paths are inside the case's folder");
  command->add_flag("--replace", order->request.force, "replace existing outputs");
  command->add_flag("--wait", order->wait, "follow it to its end");
}

}  // namespace gnathion
