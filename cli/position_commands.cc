// evaluate discrepancy, evaluate registration-object.
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "core/transform_io.h"
#include "pipeline/position_jobs.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string position_text(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace);
}

void add_discrepancy(CLI::App& evaluate, ChosenCommand& chosen) {
  struct Options {
    DiscrepancyJob job;
    std::string out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      evaluate.add_subcommand("discrepancy", "from MI to CR: the transformation and its error at landmarks");
  command
      ->add_option("--mi", o->job.mi, "motion(s) of the mandible recorded in MI, with covariance; repeatable")
      ->required();
  command->add_option("--cr", o->job.cr, "the same in CR")->required();
  command->add_option("--maxilla", o->job.maxilla, "upper arch")->required();
  command->add_option("--mandible", o->job.mandible, "lower arch in MI, same frame")->required();
  command->add_option("--landmark", o->job.landmarks,
                      "NAME=X,Y,Z in the arches' frame, mandible in MI; repeatable");
  command->add_option("--out", o->out, "discrepancy.json")->required();
  finish_command(*command, chosen,
                 [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
                   std::vector<std::string> inputs = {o->job.maxilla.string(), o->job.mandible.string()};
                   for (const auto* list : {&o->job.mi, &o->job.cr})
                     for (const auto& p : *list) inputs.push_back(p.string());
                   GNATHION_CHECK_OK(may_write(o->out, common, inputs));
                   progress.begin_step("comparing", 1.0);
                   GNATHION_TRY(const Discrepancy d, run_discrepancy(o->job));
                   const json j = discrepancy_json(d);
                   GNATHION_CHECK_OK(write_json(o->out, j));
                   return CommandOutput{discrepancy_text(d), position_text(j), false};
                 });
}

void add_registration_object(CLI::App& evaluate, ChosenCommand& chosen) {
  struct Options {
    std::string positions, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = evaluate.add_subcommand(
      "registration-object",
      "a splint seen by two instruments, at start and end: the transform between them");
  command
      ->add_option("--positions", o->positions,
                   "poses of the object in both instruments (docs/evaluation.md)")
      ->required();
  command->add_option("--out", o->out, "link.json")->required();
  finish_command(*command, chosen,
                 [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
                   GNATHION_CHECK_OK(may_write(o->out, common, {o->positions}));
                   progress.begin_step("linking", 1.0);
                   GNATHION_TRY(const InstrumentLink link, run_registration_object(o->positions));
                   const json j = instrument_link_json(link);
                   GNATHION_CHECK_OK(write_json(o->out, j));
                   return CommandOutput{instrument_link_text(link), position_text(j), false};
                 });
}

}  // namespace

void add_position_commands(CLI::App& evaluate, ChosenCommand& chosen) {
  add_discrepancy(evaluate, chosen);
  add_registration_object(evaluate, chosen);
}

}  // namespace gnathion
