// evaluate.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "core/file.h"
#include "core/utc.h"
#include "pipeline/evaluate_job.h"
#include "pipeline/evaluation_report.h"

namespace gnathion {
namespace {

struct EvaluateOptions {
  EvaluateJob flags;
  EvaluateSplint splint;
  std::string config, out, name, pose = "mi", region = "auto";
  std::vector<std::string> others;
  std::vector<std::string> scans() const {
    return {splint.scan_splint.string(), splint.scan_maxilla.string(), splint.scan_mandible.string(),
            splint.scan_splint_free.string()};
  }
};

void add_limit(CLI::App& command, const char* name, std::optional<double>& limit, const char* what) {
  command
      .add_option_function<double>(
          name, [&limit](double v) { limit = v; }, what)
      ->check(CLI::PositiveNumber);
}

void add_options(CLI::App& command, EvaluateOptions& o) {
  EvaluateSplint& s = o.splint;
  EvaluationTolerance& t = o.flags.tolerance;
  command.add_option("--config", o.config, "evaluation.toml: several splints and all parameters");
  command.add_option("--design", s.design,
                     "one splint: its design's folder, with design.json and splint.stl");
  command.add_option("--name", o.name, "of that splint, in tables (its folder's name)");
  command.add_option("--scan-splint", s.scan_splint, "scan of the splint in place");
  command.add_option("--scan-maxilla", s.scan_maxilla, "upper jaw with the splint in place, same frame");
  command.add_option("--scan-mandible", s.scan_mandible, "lower jaw biting on the splint, same frame");
  command.add_option("--scan-splint-free", s.scan_splint_free,
                     "the splint alone, any frame, for procedure 1");
  command.add_option("--maxilla", s.maxilla, "model of the upper arch (design.json's)");
  command.add_option("--mandible", s.mandible, "model of the lower arch (design.json's)");
  command.add_option("--transform", s.transform, "T_th (design.json's)");
  command.add_option("--mandible-pose", o.pose, "where the mandible's model has it")
      ->check(CLI::IsMember({"mi", "tp"}))
      ->capture_default_str();
  command.add_option("--other-design", o.others, "further designs to ask when a scan fits badly; repeatable");
  command.add_option("--seat-region", o.region, "what procedure 4 fits")
      ->check(CLI::IsMember({"auto", "palate", "crowns", "whole"}))
      ->capture_default_str();
  command.add_option("--rows", o.flags.rows,
                     "statistics only, of a table procedure,splint,n,avg_mm,std_mm,…");
  command.add_option("--printed", o.flags.printed,
                     "what was printed under the rows (printed_totals.csv beside them)");
  command.add_option("--out", o.out, "folder to make");
  command.add_flag("!--no-pictures", o.flags.pictures, "leave out report.html, report.pdf and the pictures");
  add_limit(command, "--max-avg-mm", t.avg_mm, "exit 3 when a splint's |AVG| passes it");
  add_limit(command, "--max-std-mm", t.std_mm, "exit 3 when a splint's STD passes it");
  add_limit(command, "--max-alpha-deg", t.alpha_deg, "exit 3 when a splint's rotation passes it");
  add_limit(command, "--max-t-mm", t.t_mm,
            "exit 3 when a splint's displacement of the arch's centroid passes it");
  add_limit(command, "--max-tooth-mm", t.max_tooth_mm, "exit 3 when a tooth's displacement passes it");
  add_limit(command, "--equivalence-mm", t.equivalence_mm,
            "exit 3 when the splints' mean AVG is not shown to lie within it");
  command.add_option("--seed", o.flags.statistics.seed, "of the bootstrap")->capture_default_str();
}

tl::unexpected<Error> usage(const std::string& why) {
  return fail(ErrorCode::kUsage, "cannot evaluate", "command line", why);
}

/// The job that the options ask for: a file, rows, or one splint.
Result<EvaluateJob> job_of(const EvaluateOptions& o) {
  const int ways = !o.config.empty() + !o.flags.rows.empty() + !o.splint.design.empty();
  if (ways != 1) return usage("give one of --config, --design, --rows");
  if (o.out.empty()) return usage("give --out");
  EvaluateJob job = o.flags;
  if (!o.config.empty()) {
    GNATHION_TRY(job, read_evaluation_file(o.config));
    const auto over = [](std::optional<double>& limit, const std::optional<double>& flag) {
      if (flag) limit = flag;
    };
    over(job.tolerance.avg_mm, o.flags.tolerance.avg_mm);
    over(job.tolerance.std_mm, o.flags.tolerance.std_mm);
    over(job.tolerance.alpha_deg, o.flags.tolerance.alpha_deg);
    over(job.tolerance.t_mm, o.flags.tolerance.t_mm);
    over(job.tolerance.max_tooth_mm, o.flags.tolerance.max_tooth_mm);
    over(job.tolerance.equivalence_mm, o.flags.tolerance.equivalence_mm);
    return job;
  }
  if (!o.flags.rows.empty()) return job;
  if (o.splint.scan_splint.empty()) return usage("--design needs --scan-splint");
  EvaluateSplint s = o.splint;
  s.mandible_is_in_tp = o.pose == "tp";
  s.name = o.name.empty() ? std::filesystem::weakly_canonical(s.design).filename().string() : o.name;
  job.splints = {s};
  job.other_designs.assign(o.others.begin(), o.others.end());
  job.options.seat_region = o.region == "palate"   ? SeatRegion::kPalate
                            : o.region == "crowns" ? SeatRegion::kCrowns
                            : o.region == "whole"  ? SeatRegion::kWhole
                                                   : SeatRegion::kAuto;
  return job;
}

std::vector<std::string> input_paths(const EvaluateJob& job) {
  std::vector<std::string> paths = {job.config.string(), job.rows.string(), job.printed.string()};
  for (const EvaluateSplint& s : job.splints)
    for (const auto& p : {s.design / "design.json", s.maxilla, s.mandible, s.transform, s.scan_splint,
                          s.scan_maxilla, s.scan_mandible, s.scan_splint_free})
      paths.push_back(p.string());
  return paths;
}

std::string summary(const EvaluationOutcome& outcome, const std::string& where) {
  std::string text = fmt::format("{:<26}{:>8}{:>11}{:>12}{:>12}{:>12}\n", "procedure", "splints", "N",
                                 "mean [mm]", "STD [mm]", "within");
  for (const ProcedureTable& t : outcome.tables)
    text += fmt::format("{:<26}{:>8}{:>11}{:>12.4f}{:>12.3f}{:>12.3f}\n", t.procedure, t.totals.splints,
                        t.totals.n_total, t.totals.weighted_mean_mm, t.totals.total_std_mm,
                        t.totals.within_std_mm);
  for (const SplintEvaluation& s : outcome.splints)
    for (const ProcedureResult& r : s.procedures)
      if (r.motion)
        text += fmt::format(
            "splint {}: {}: {:.3f} deg, {:.3f} mm at the arch's centroid, {:.3f} mm at tooth {}\n", s.name,
            procedure_name(r.procedure), r.motion->alpha_deg, r.motion->t_mm, r.motion->max_tooth_mm,
            r.motion->max_tooth_fdi);
  for (const std::string& note : outcome.notes) text += "note: " + note + "\n";
  for (const std::string& v : outcome.violated) text += "fails: " + v + "\n";
  return text + "in " + where + "\n";
}

}  // namespace

void add_evaluate_commands(CLI::App& app, ChosenCommand& chosen) {
  auto o = std::make_shared<EvaluateOptions>();
  CLI::App* command = app.add_subcommand(
      "evaluate", "printed against planned: the six procedures (exit 3: a given limit is passed)");
  add_options(*command, *o);
  const CommandBody body = [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
    GNATHION_TRY(const EvaluateJob job, job_of(*o));
    GNATHION_CHECK_OK(keeps_inputs(o->out, input_paths(job)));
    GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o->out, common.force, {"evaluation.json"}));
    GNATHION_TRY(const EvaluationOutcome outcome, run_evaluation(job, staged.path(), progress));
    if (job.pictures && o->flags.pictures) {
      SystemClock clock;
      GNATHION_CHECK_OK(
          write_evaluation_report(outcome, staged.path(), utc_text(clock.now()), progress).map([](auto) {}));
    }
    GNATHION_CHECK_OK(staged.commit());
    return CommandOutput{summary(outcome, o->out),
                         outcome.report->dump(2, ' ', false, nlohmann::json::error_handler_t::replace),
                         !outcome.accepted()};
  };
  finish_command(*command, chosen, body);
  add_virtual_print_command(*command, chosen);
  add_position_commands(*command, chosen);
  // Its own subcommands are parsed first: they keep what they chose.
  command->callback([command, &chosen, body] {
    if (command->get_subcommands().empty()) chosen.body = body;
  });
}

}  // namespace gnathion
