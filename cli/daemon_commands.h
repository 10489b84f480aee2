// Commands that are clients of gnathiond.
#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>

#include "cli/command.h"
#include "client/daemon_client.h"

namespace gnathion {

/// A command's work, once it is connected.
using DaemonBody = std::function<Result<CommandOutput>(client::DaemonClient&)>;

/// With --socket, --json and --quiet.
CLI::App* add_daemon_command(CLI::App& group, ChosenCommand& chosen, const char* name, const char* help,
                             DaemonBody body);
std::string dump_json(const nlohmann::json& j);

void add_live(CLI::App& app, ChosenCommand& chosen);
void add_jobs(CLI::App& app, ChosenCommand& chosen);

}  // namespace gnathion
