// audit verify.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "pipeline/audit.h"
#include "pipeline/catalogue.h"

namespace gnathion {
namespace {

using nlohmann::json;

Result<std::vector<AuditHead>> heads_of(const std::string& catalogue, const std::string& trail) {
  std::vector<AuditHead> heads;
  if (catalogue.empty()) return heads;
  std::error_code ec;
  if (!std::filesystem::exists(catalogue, ec))
    return bad_input("cannot verify audit trail", catalogue, "does not exist");
  GNATHION_TRY(const Catalogue c, Catalogue::open(catalogue));
  GNATHION_TRY(const auto head, c.audit_head(std::filesystem::path(trail).filename().string()));
  if (head) heads.push_back(*head);
  return heads;
}

}  // namespace

void add_audit_commands(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    std::string file, catalogue;
  };
  auto o = std::make_shared<Options>();
  CLI::App* group = app.add_subcommand("audit", "the trail of who did what");
  group->require_subcommand(1);
  CLI::App* command =
      group->add_subcommand("verify", "is the trail whole? names each line that is not (exit 3)");
  command->add_option("FILE", o->file, "audit trail, JSON lines")->required();
  command->add_option("--catalogue", o->catalogue, "catalogue that also knows where the trail stood");
  finish_command(
      *command, chosen,
      [o](const CommonOptions&, Progress&) -> Result<CommandOutput> {
        GNATHION_TRY(const std::vector<AuditHead> heads, heads_of(o->catalogue, o->file));
        GNATHION_TRY(const AuditVerdict v, verify_audit(o->file, heads));
        json j = {{"good", v.good()},
                  {"lines", v.head.lines},
                  {"sha256", v.head.sha256},
                  {"faults", json::array()},
                  {"notes", v.notes}};
        std::string text;
        for (const AuditFault& f : v.faults) {
          j["faults"].push_back({{"line", f.line}, {"why", f.why}});
          text += fmt::format("line {} {}\n", f.line, f.why);
        }
        for (const std::string& note : v.notes) text += "note: " + note + "\n";
        text +=
            v.good() ? fmt::format("good: {} lines, head {}\n", v.head.lines, v.head.sha256) : "not good\n";
        return CommandOutput{text, j.dump(2), !v.good()};
      },
      false);
}

}  // namespace gnathion
