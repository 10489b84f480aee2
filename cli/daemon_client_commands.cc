// Commands that ask gnathiond: devices, capture, mark, cases, audit show. Jobs are in
// daemon_jobs_commands.cc, the live view in live_command.cc.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/daemon_commands.h"
#include "core/file.h"
#include "pipeline/import_case.h"

namespace gnathion {
namespace {

using client::DaemonClient;
using nlohmann::json;

json json_of(const client::Session& s) {
  return {{"state", client::name_of(s.state)},
          {"case", s.case_id},
          {"recording", s.recording},
          {"elapsed_s", s.elapsed_s},
          {"bytes", s.file_bytes},
          {"durable_bytes", s.synced_bytes},
          {"marks", s.marks},
          {"message", s.message},
          {"missing", s.devices_missing}};
}

CommandOutput output_of(const client::Session& s) {
  std::string text = client::name_of(s.state);
  if (!s.case_id.empty()) text += fmt::format(", case {}", s.case_id);
  if (!s.recording.empty())
    text += fmt::format(", {} {:.1f} s {:.1f} MiB", s.recording, s.elapsed_s,
                        static_cast<double>(s.file_bytes) / 1048576.0);
  if (!s.message.empty()) text += "\n" + s.message;
  for (const std::string& line : s.devices_missing) text += "\nmissing: " + line;
  return {text + "\n", dump_json(json_of(s)), false};
}

json json_of(const client::DeviceInfo& d) {
  return {{"stream", d.stream},     {"kind", d.kind},
          {"state", d.state},       {"message", d.message},
          {"vendor", d.vendor},     {"model", d.model},
          {"serial", d.serial},     {"settings", d.settings},
          {"warnings", d.warnings}, {"rate_hz", d.rate_hz},
          {"received", d.received}, {"rejected", d.rejected},
          {"missing", d.missing},   {"reconnects", d.reconnects}};
}

Result<CommandOutput> list_devices(DaemonClient& daemon) {
  GNATHION_TRY(const auto devices, daemon.devices());
  json list = json::array();
  std::string text;
  for (const client::DeviceInfo& d : devices) {
    list.push_back(json_of(d));
    text += fmt::format("{:<16} {:<14} {:<10} {:>6.1f} Hz  {}\n", d.stream, d.kind, d.state, d.rate_hz,
                        d.message.empty() ? d.model : d.message);
  }
  if (devices.empty()) text = "no devices: `gnathion devices configure devices.toml` names them\n";
  return CommandOutput{text, dump_json(list), false};
}

Result<CommandOutput> configure_devices(DaemonClient& daemon, const std::string& file) {
  GNATHION_TRY(const std::string toml, read_file(file));
  GNATHION_TRY(const auto streams, daemon.configure_devices(toml));
  return CommandOutput{fmt::format("{}\n", fmt::join(streams, "\n")), dump_json(json(streams)), false};
}

Result<CommandOutput> show_health(DaemonClient& daemon) {
  GNATHION_TRY(const client::Health health, daemon.health());
  json loops = json::array();
  std::string text =
      fmt::format("gnathiond {}: {}, {:.0f} MiB, {} connections, {} streams\n", health.version,
                  health.well ? "well" : "not well", health.memory_mib, health.connections, health.streams);
  for (const auto& loop : health.loops) {
    loops.push_back({{"name", loop.name}, {"age_s", loop.age_s}, {"limit_s", loop.limit_s}});
    text += fmt::format("  loop {:<10} {:.2f} s ago (at most {:.0f})\n", loop.name, loop.age_s, loop.limit_s);
  }
  for (const std::string& fault : health.faults) text += "  fault: " + fault + "\n";
  for (const auto& d : health.devices) text += fmt::format("  {:<15} {} {}\n", d.stream, d.state, d.message);
  return CommandOutput{text,
                       dump_json({{"well", health.well},
                                  {"version", health.version},
                                  {"memory_mib", health.memory_mib},
                                  {"connections", health.connections},
                                  {"streams", health.streams},
                                  {"loops", loops},
                                  {"faults", health.faults}}),
                       !health.well};
}

void add_devices(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* group = app.add_subcommand("devices", "the instruments of gnathiond");
  group->require_subcommand(1);
  add_daemon_command(*group, chosen, "list", "what is configured, and how each is", list_devices);
  add_daemon_command(*group, chosen, "health", "the daemon itself: loops, memory, clients", show_health);
  auto file = std::make_shared<std::string>();
  CLI::App* configure =
      add_daemon_command(*group, chosen, "configure", "give it a new devices.toml, for the next arm",
                         [file](DaemonClient& d) { return configure_devices(d, *file); });
  configure->add_option("FILE", *file, "devices.toml")->required();
}

/// A command of the session that takes nothing, and one that takes a word.
using SessionCall = std::function<Result<client::Session>(DaemonClient&)>;
DaemonBody session_body(SessionCall call) {
  return [call = std::move(call)](DaemonClient& daemon) -> Result<CommandOutput> {
    GNATHION_TRY(const client::Session session, call(daemon));
    return output_of(session);
  };
}

void add_capture_group(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* group = app.add_subcommand("capture", "the session of gnathiond: arm, start, mark, stop");
  group->require_subcommand(1);
  auto word = std::make_shared<std::string>();
  const auto add = [&](const char* name, const char* help, SessionCall call) {
    return add_daemon_command(*group, chosen, name, help, session_body(std::move(call)));
  };
  add("arm", "open the devices for a case", [word](DaemonClient& d) { return d.arm(*word); })
      ->add_option("CASE", *word, "the case's id")
      ->required();
  add("start", "begin a recording in the case", [word](DaemonClient& d) {
    return d.start(*word);
  })->add_option("NAME", *word, "of the recording; else it is numbered");
  add("stop", "end the recording; the devices stay open", [](DaemonClient& d) { return d.stop(); });
  add("disarm", "close the devices", [](DaemonClient& d) { return d.disarm(); });
  add("state", "where the session stands", [](DaemonClient& d) { return d.session(); });
  add_daemon_command(*group, chosen, "scan", "ask the face scanners for a scan",
                     [](DaemonClient& d) -> Result<CommandOutput> {
                       GNATHION_TRY(const int scanners, d.request_scan());
                       return CommandOutput{fmt::format("{} scanners asked\n", scanners),
                                            dump_json({{"scanners", scanners}}), false};
                     });
}

void add_mark(CLI::App& app, ChosenCommand& chosen) {
  auto kind = std::make_shared<std::string>();
  auto text = std::make_shared<std::string>();
  CLI::App* command =
      add_daemon_command(app, chosen, "mark", "put a mark into the running recording",
                         [kind, text](DaemonClient& d) -> Result<CommandOutput> {
                           GNATHION_TRY(const HostTime at, d.mark(*kind, *text));
                           return CommandOutput{fmt::format("{} marked\n", *kind),
                                                dump_json({{"kind", *kind}, {"capture_ns", at.ns}}), false};
                         });
  command->add_option("KIND", *kind, "MI, TP, note, or a name of your own")->required();
  command->add_option("TEXT", *text, "what it says; no patient's name");
}

CommandOutput output_of(const client::Case& c) {
  std::string text = fmt::format("{} {}{}\n", c.id, c.kind, c.problem.empty() ? "" : ": " + c.problem);
  json files = json::array();
  for (const client::CaseFile& file : c.files) {
    files.push_back({{"path", file.path}, {"role", file.role}, {"bytes", file.bytes}});
    text += fmt::format("  {:<40} {:<20} {:>12}\n", file.path, file.role, file.bytes);
  }
  return {text, dump_json({{"id", c.id}, {"kind", c.kind}, {"problem", c.problem}, {"files", files}}), false};
}

struct CasesImport {
  std::string from;
  bool incoming = false;
  std::vector<std::string> roles;
  client::ImportOptions options;
};

Result<CommandOutput> import_into_daemon(DaemonClient& daemon, CasesImport& o) {
  for (const std::string& text : o.roles) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0)
      return fail(ErrorCode::kUsage, "wrong usage", text,
                  "a role is given as ROLE=FILE, as maxilla_mi=scan2.stl");
    o.options.roles[text.substr(0, equals)] = text.substr(equals + 1);
  }
  if (o.incoming) {
    GNATHION_TRY(const client::Case made, daemon.import_incoming(o.from, o.options));
    return output_of(made);
  }
  GNATHION_TRY(const std::vector<ImportSource> sources, import_sources(o.from));
  std::vector<client::ImportedFile> files;
  for (const ImportSource& source : sources) files.push_back({source.name, source.path});
  std::error_code ec;
  if (!std::filesystem::is_directory(o.from, ec)) o.options.source = files.front().name;
  GNATHION_TRY(const client::Case made, daemon.import_files(files, o.options));
  return output_of(made);
}

void add_cases_import(CLI::App& group, ChosenCommand& chosen) {
  auto o = std::make_shared<CasesImport>();
  CLI::App* command =
      add_daemon_command(group, chosen, "import", "sends files to gnathiond, which makes a case of them",
                         [o](DaemonClient& d) { return import_into_daemon(d, *o); });
  command->add_option("FROM", o->from, "folder, .dpw, .atmdl, .dpvision, .mha, .nrrd")->required();
  command->add_option("CASE", o->options.case_id,
                      "id of the new case, not the patient's name; else one is made");
  command->add_flag("--incoming", o->incoming, "FROM lies under CASE_ROOT/incoming/ of gnathiond");
  command->add_option("--role", o->roles,
                      "ROLE=FILE (of a workspace: ROLE=LABEL) where names do not tell; repeatable");
  command->add_flag("--trust-names", o->options.trust_names,
                    "go on where the shapes do not confirm the names");
}

void add_cases(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* group = app.add_subcommand("cases", "the cases of gnathiond");
  group->require_subcommand(1);
  add_daemon_command(*group, chosen, "list", "all of them", [](DaemonClient& d) -> Result<CommandOutput> {
    GNATHION_TRY(const auto cases, d.cases());
    json list = json::array();
    std::string text;
    for (const client::Case& c : cases) {
      list.push_back({{"id", c.id}, {"kind", c.kind}, {"problem", c.problem}});
      text += fmt::format("{:<32} {:<8} {}\n", c.id, c.kind, c.problem);
    }
    return CommandOutput{text, dump_json(list), false};
  });
  auto id = std::make_shared<std::string>();
  add_daemon_command(*group, chosen, "show", "what a case holds",
                     [id](DaemonClient& d) -> Result<CommandOutput> {
                       GNATHION_TRY(const client::Case c, d.open_case(*id));
                       return output_of(c);
                     })
      ->add_option("CASE", *id, "the case's id")
      ->required();
  add_daemon_command(*group, chosen, "create", "a new, empty case",
                     [id](DaemonClient& d) -> Result<CommandOutput> {
                       GNATHION_TRY(const client::Case c, d.create_case(*id));
                       return output_of(c);
                     })
      ->add_option("CASE", *id, "its id, not the patient's name; else one is made");
  add_cases_import(*group, chosen);
}

/// Joins the group "audit" where it is there already (`audit verify FILE` needs no daemon).
void add_audit_show(CLI::App& app, ChosenCommand& chosen) {
  const auto there = app.get_subcommands([](CLI::App* a) { return a->get_name() == "audit"; });
  CLI::App* group = there.empty() ? nullptr : there.front();
  if (!group) {
    group = app.add_subcommand("audit", "who did what, when");
    group->require_subcommand(1);
  }
  auto id = std::make_shared<std::string>();
  auto limit = std::make_shared<unsigned>(100);
  CLI::App* show = add_daemon_command(
      *group, chosen, "show", "the last lines of gnathiond's audit trail, after it has been verified",
      [id, limit](DaemonClient& d) -> Result<CommandOutput> {
        GNATHION_TRY(const std::string fault, d.verify_audit());
        GNATHION_TRY(const auto lines, d.audit(*id, *limit));
        json list = json::array();
        std::string text;
        for (const client::AuditLine& l : lines) {
          list.push_back({{"n", l.number},
                          {"time", l.time},
                          {"who", l.who},
                          {"what", l.action},
                          {"case", l.case_id},
                          {"details", l.detail}});
          text += fmt::format("{:>6} {:.19} {:<32} {:<18} {} {}\n", l.number, l.time, l.who, l.action,
                              l.case_id, l.detail);
        }
        if (!fault.empty()) text += "the trail has been tampered with: " + fault + "\n";
        return CommandOutput{text, dump_json({{"fault", fault}, {"lines", list}}), !fault.empty()};
      });
  show->add_option("--case", *id, "of this case alone");
  show->add_option("--last", *limit, "so many lines")->check(CLI::Range(1u, 10000u))->capture_default_str();
}

}  // namespace

std::string dump_json(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace);
}

CLI::App* add_daemon_command(CLI::App& group, ChosenCommand& chosen, const char* name, const char* help,
                             DaemonBody body) {
  CLI::App* command = group.add_subcommand(name, help);
  auto socket = std::make_shared<std::string>();
  command->add_option("--socket", *socket, "of gnathiond; else $GNATHION_SOCKET, or the system's");
  finish_command(
      *command, chosen,
      [socket, body = std::move(body)](const CommonOptions&, Progress&) -> Result<CommandOutput> {
        GNATHION_TRY(const auto daemon, DaemonClient::connect(*socket));
        return body(*daemon);
      },
      false);
  return command;
}

void add_daemon_commands(CLI::App& app, ChosenCommand& chosen) {
  add_devices(app, chosen);
  add_capture_group(app, chosen);
  add_mark(app, chosen);
  add_live(app, chosen);
  add_jobs(app, chosen);
  add_cases(app, chosen);
  add_audit_show(app, chosen);
}

}  // namespace gnathion
