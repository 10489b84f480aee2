// case create, add, info, list, provenance, import, export.
#include <fmt/format.h>

#include <sys/stat.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "pipeline/case_folder.h"
#include "pipeline/case_roles.h"
#include "pipeline/catalogue.h"
#include "pipeline/import_case.h"
#include "pipeline/provenance.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string dumped(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace);
}

/// "scans.maxilla_mi=FILE" or "maxilla_mi=FILE".
Result<std::vector<NewCaseFile>> parse_files(const std::vector<std::string>& given) {
  std::vector<NewCaseFile> files;
  for (const std::string& text : given) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
      return fail(ErrorCode::kUsage, "wrong usage", text,
                  "a file is given as ROLE=FILE, as maxilla_mi=upper.stl");
    files.push_back({text.substr(0, equals), text.substr(equals + 1)});
  }
  return files;
}

std::string roles_text() {
  std::string text;
  for (const CaseRole& role : case_roles()) text += (text.empty() ? "" : ", ") + role.name();
  return text + ", extra.NAME";
}

json summary_json(const CaseSummary& s) {
  json files = json::array();
  for (const CaseFileEntry& f : s.files)
    files.push_back({{"role", f.role}, {"path", f.shown}, {"bytes", f.bytes}});
  return {{"case", s.id},         {"folder", s.folder.string()}, {"kind", s.kind}, {"created", s.created},
          {"verdict", s.verdict}, {"results_at", s.results_at},  {"files", files}, {"problem", s.problem}};
}

std::string summary_text(const CaseSummary& s) {
  std::string text = fmt::format("case {} ({}), created {}\n", s.id, s.kind.empty() ? "?" : s.kind,
                                 s.created.empty() ? "not told" : s.created);
  for (const CaseFileEntry& f : s.files)
    text += fmt::format("  {:<24} {}  {:.1f} MB\n", f.role, f.shown, static_cast<double>(f.bytes) / 1e6);
  text += s.results_at.empty()
              ? "  not run\n"
              : fmt::format("  run {}, verdict {}\n", s.results_at, s.verdict.empty() ? "none" : s.verdict);
  return s.problem.empty() ? text : text + "  problem: " + s.problem + "\n";
}

std::string list_line(const std::string& id, const std::string& kind, const std::string& verdict,
                      const std::string& results_at, const std::string& problem) {
  return fmt::format("{:<24} {:<8} {:<14} {:<20} {}\n", id, kind, verdict.empty() ? "-" : verdict,
                     results_at.empty() ? "not run" : results_at, problem);
}

void add_create(CLI::App& group, ChosenCommand& chosen) {
  struct Options {
    std::string folder;
    NewCase what;
    std::vector<std::string> files;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = group.add_subcommand("create", "a new case folder, readable by its owner alone");
  command->add_option("CASE", o->folder, "folder to make")->required();
  command->add_option("--id", o->what.id, "letters, digits, '.', '_', '-'; else the folder's name");
  command->add_option("--patient-name", o->what.patient.name, "goes into case.toml and nowhere else");
  command->add_option("--patient-number", o->what.patient.number, "as --patient-name");
  command->add_option("--patient-born", o->what.patient.born, "as --patient-name");
  command->add_option("--patient-sex", o->what.patient.sex, "as --patient-name");
  command->add_option("--file", o->files, "ROLE=FILE, copied; repeatable. Roles: " + roles_text());
  finish_command(
      *command, chosen,
      [o](const CommonOptions&, Progress&) -> Result<CommandOutput> {
        ::umask(0077);
        SystemClock clock;
        GNATHION_TRY(o->what.files, parse_files(o->files));
        if (o->what.id.empty())
          o->what.id = std::filesystem::absolute(o->folder).lexically_normal().filename().string();
        GNATHION_TRY(const CaseFile made, create_case(o->folder, o->what, clock));
        return CommandOutput{fmt::format("case {} in {}\n", made.id, o->folder),
                             dumped(summary_json(summarize_case(o->folder))), false};
      },
      false);
}

void add_add(CLI::App& group, ChosenCommand& chosen) {
  struct Options {
    std::string folder;
    std::vector<std::string> files;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = group.add_subcommand("add", "copies files into a case and names them in its case.toml");
  command->add_option("CASE", o->folder, "case folder")->required();
  command->add_option("--file", o->files, "ROLE=FILE; repeatable. Roles: " + roles_text())->required();
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress&) -> Result<CommandOutput> {
    ::umask(0077);
    GNATHION_TRY(const auto files, parse_files(o->files));
    GNATHION_CHECK_OK(add_case_files(o->folder, files, common.force));
    const CaseSummary s = summarize_case(o->folder);
    return CommandOutput{summary_text(s), dumped(summary_json(s)), false};
  });
}

void add_case_info(CLI::App& group, ChosenCommand& chosen) {
  auto folder = std::make_shared<std::string>();
  CLI::App* command = group.add_subcommand("info", "what is in a case; not who the patient is");
  command->add_option("CASE", *folder, "case folder")->required();
  finish_command(
      *command, chosen,
      [folder](const CommonOptions&, Progress&) -> Result<CommandOutput> {
        GNATHION_TRY(const CaseFile readable, read_unfinished_case(*folder));
        const CaseSummary s = summarize_case(*folder);
        return CommandOutput{summary_text(s), dumped(summary_json(s)), false};
      },
      false);
}

Result<CommandOutput> list_of_catalogue(const std::string& file, const CatalogueQuery& query) {
  GNATHION_TRY(const Catalogue catalogue, Catalogue::open(file));
  GNATHION_TRY(const std::vector<CatalogueEntry> all, catalogue.query(query));
  CommandOutput out;
  json j = json::array();
  for (const CatalogueEntry& e : all) {
    out.text += list_line(e.id, e.kind, e.verdict, e.results_at, e.problem);
    j.push_back({{"case", e.id},
                 {"folder", e.folder},
                 {"kind", e.kind},
                 {"created", e.created},
                 {"verdict", e.verdict},
                 {"results_at", e.results_at},
                 {"problem", e.problem},
                 {"files", e.files},
                 {"bytes", e.bytes}});
  }
  out.json = dumped(j);
  return out;
}

void add_list(CLI::App& group, ChosenCommand& chosen) {
  struct Options {
    std::string root, catalogue;
    bool rebuild = false;
    CatalogueQuery query;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = group.add_subcommand("list", "the cases under a folder, or of a catalogue");
  command->add_option("ROOT", o->root, "folder that holds the cases");
  auto* catalogue =
      command->add_option("--catalogue", o->catalogue, "SQLite file to ask instead of the folders");
  command->add_flag("--rebuild", o->rebuild, "make the catalogue anew from the folders of ROOT first")
      ->needs(catalogue);
  command->add_option("--id", o->query.id_contains, "only ids that hold this");
  command->add_option("--kind", o->query.kind, "only this kind")
      ->check(CLI::IsMember({"patient", "phantom"}));
  command->add_option("--verdict", o->query.verdict, "only this verdict");
  finish_command(
      *command, chosen,
      [o](const CommonOptions&, Progress&) -> Result<CommandOutput> {
        if (o->catalogue.empty() && o->root.empty())
          return fail(ErrorCode::kUsage, "wrong usage", "case list", "give ROOT or --catalogue");
        if (!o->catalogue.empty()) {
          ::umask(0077);
          RebuildOutcome rebuilt;
          if (o->rebuild) {
            if (o->root.empty()) return fail(ErrorCode::kUsage, "wrong usage", "--rebuild", "needs ROOT");
            GNATHION_TRY(rebuilt, Catalogue::rebuild(o->catalogue, o->root));
          }
          std::error_code ec;
          if (!std::filesystem::exists(o->catalogue, ec))
            return bad_input("cannot list cases", o->catalogue, "does not exist; ROOT and --rebuild make it");
          GNATHION_TRY(CommandOutput out, list_of_catalogue(o->catalogue, o->query));
          if (o->rebuild)
            out.text += fmt::format("catalogue made anew: {} cases, {} with problems, {} gone\n",
                                    rebuilt.cases, rebuilt.with_problems, rebuilt.removed);
          return out;
        }
        GNATHION_TRY(const std::vector<CaseSummary> all, list_cases(o->root));
        CommandOutput out;
        json j = json::array();
        for (const CaseSummary& s : all) {
          if (s.id.find(o->query.id_contains) == std::string::npos) continue;
          if (!o->query.kind.empty() && s.kind != o->query.kind) continue;
          if (!o->query.verdict.empty() && s.verdict != o->query.verdict) continue;
          out.text += list_line(s.id, s.kind, s.verdict, s.results_at, s.problem);
          j.push_back(summary_json(s));
        }
        out.json = dumped(j);
        return out;
      },
      false);
}

void add_provenance(CLI::App& group, ChosenCommand& chosen) {
  struct Options {
    std::string folder, result;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = group.add_subcommand(
      "provenance",
      "from a result back to the frames: inputs, parameters, versions (exit 3: a file changed since)");
  command->add_option("CASE", o->folder, "case folder")->required();
  command->add_option("RESULT", o->result, "a file of results/, as splint.stl; else all");
  finish_command(
      *command, chosen,
      [o](const CommonOptions&, Progress&) -> Result<CommandOutput> {
        GNATHION_TRY(const auto tree, trace_provenance(o->folder, o->result));
        const std::vector<std::string> changed = changed_files(tree);
        std::string text = provenance_text(tree);
        for (const std::string& file : changed) text += "changed: " + file + "\n";
        if (changed.empty()) text += "every file is what it was\n";
        return CommandOutput{text, dumped({{"tree", provenance_tree_json(tree)}, {"changed", changed}}),
                             !changed.empty()};
      },
      false);
}

CommandOutput import_output(const ImportReport& report, const std::string& folder) {
  std::string text = fmt::format("case {} in {}\n", report.id, folder);
  for (const std::string& taken : report.taken) text += "  " + taken + "\n";
  for (const std::string& note : report.notes) text += "  note: " + note + "\n";
  return {text,
          dumped({{"case", report.id}, {"folder", folder}, {"taken", report.taken}, {"notes", report.notes}}),
          false};
}

void add_import(CLI::App& group, ChosenCommand& chosen) {
  struct Options {
    CaseImport what;
    std::vector<std::string> roles;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = group.add_subcommand(
      "import", "a case from a folder of STL/PLY/OBJ, a dpVision workspace, or a PLUS sequence");
  command->add_option("FROM", o->what.from, "folder, .dpw, .atmdl, .dpvision, .mha, .nrrd")->required();
  command->add_option("--out", o->what.folder, "case folder to make")->required();
  command->add_option("--id", o->what.id, "letters, digits, '.', '_', '-'; else the folder's name");
  command->add_option("--patient-name", o->what.patient.name, "goes into case.toml and nowhere else");
  command->add_option("--patient-number", o->what.patient.number, "as --patient-name");
  command->add_option(
      "--role", o->roles,
      "ROLE=FILE (of a workspace: ROLE=LABEL) where names do not tell; repeatable. Roles: " + roles_text());
  command->add_flag("--trust-names", o->what.trust_names, "go on where the shapes do not confirm the names");
  finish_command(
      *command, chosen,
      [o](const CommonOptions&, Progress& progress) -> Result<CommandOutput> {
        ::umask(0077);
        SystemClock clock;
        GNATHION_TRY(const auto roles, parse_files(o->roles));
        for (const NewCaseFile& r : roles) o->what.roles[r.role] = r.from.string();
        if (o->what.id.empty())
          o->what.id = std::filesystem::absolute(o->what.folder).lexically_normal().filename().string();
        GNATHION_TRY(const ImportReport report, import_case(o->what, clock, progress));
        return import_output(report, o->what.folder.string());
      },
      false);
}

void add_export(CLI::App& group, ChosenCommand& chosen) {
  struct Options {
    std::string folder, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = group.add_subcommand("export", "a case as a workspace of dpVision, meshes beside it");
  command->add_option("CASE", o->folder, "case folder")->required();
  command->add_option("--out", o->out, "workspace to write, *.dpw")->required();
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress&) -> Result<CommandOutput> {
    ::umask(0077);
    GNATHION_TRY(const std::vector<std::string> written, export_dpw(o->folder, o->out, common.force));
    std::string text;
    for (const std::string& file : written) text += file + "\n";
    return CommandOutput{text, dumped({{"written", written}}), false};
  });
}

}  // namespace

void add_case_commands(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* group = app.add_subcommand("case", "case folders: make, look into, list, import, export");
  group->require_subcommand(1);
  add_create(*group, chosen);
  add_add(*group, chosen);
  add_case_info(*group, chosen);
  add_list(*group, chosen);
  add_provenance(*group, chosen);
  add_import(*group, chosen);
  add_export(*group, chosen);
}

}  // namespace gnathion
