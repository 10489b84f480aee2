// demo, phantom.
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "core/file.h"
#include "pipeline/demo.h"

namespace gnathion {

void add_demo_commands(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    std::uint64_t seed = 1;
    std::string out = "demo";
    bool cbct = false;
  };
  auto o = std::make_shared<Options>();

  CLI::App* demo =
      app.add_subcommand("demo", "phantom patient, replayed session, T_th, splint, report with pictures");
  demo->add_option("--seed", o->seed, "of the phantom")->capture_default_str();
  demo->add_option("--out", o->out, "folder to make")->capture_default_str();
  const char* const kCbct = "with a CBCT of 30 MB: joints and virtual X-rays";
  demo->add_flag("--cbct", o->cbct, kCbct);
  finish_command(
      *demo, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o->out, common.force, {"case.toml"}));
        GNATHION_TRY(const DemoResult result, run_demo(o->seed, {}, staged.path(), progress, o->cbct));
        GNATHION_CHECK_OK(staged.commit());
        return CommandOutput{demo_text(result, o->out),
                             demo_json(result).dump(2, ' ', false, nlohmann::json::error_handler_t::replace),
                             !result.results.design.accepted()};
      });

  CLI::App* phantom =
      app.add_subcommand("phantom", "a virtual patient as a case folder, with ground truth in truth.json");
  phantom->add_option("--seed", o->seed, "the same seed gives the same bytes")->required();
  phantom->add_option("--out", o->out, "case folder to make")->required();
  phantom->add_flag("--cbct", o->cbct, kCbct);
  finish_command(
      *phantom, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o->out, common.force, {"case.toml"}));
        GNATHION_TRY(const PhantomPatient patient, make_phantom_case(o->seed, staged.path(), progress));
        if (o->cbct) GNATHION_CHECK_OK(add_phantom_cbct(patient, o->seed, staged.path()));
        GNATHION_CHECK_OK(staged.commit());
        return CommandOutput{"Case written to " + o->out + "\n",
                             nlohmann::json{{"case", o->out}, {"seed", o->seed}}.dump(
                                 2, ' ', false, nlohmann::json::error_handler_t::replace),
                             false};
      });
}

}  // namespace gnathion
