// calibrate bow, bow print.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "acquisition/recording.h"
#include "calibration/bow_geometry_json.h"
#include "cli/command.h"
#include "core/file.h"
#include "core/transform_io.h"
#include "pipeline/bow_film.h"
#include "pipeline/bow_print.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string bow_text(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace);
}

struct CalibrateOptions {
  std::string recording, rig, bow, out, bow_out;
  std::vector<std::string> distances;
  double tag_side_mm = 0, tag_side_sigma_mm = 0.02, interval_s = 0.1;
};

Result<BowFilmOptions> film_options(const CalibrateOptions& o) {
  BowFilmOptions options;
  if (o.tag_side_mm != 0) options.geometry.tag_side_mm = o.tag_side_mm;
  options.geometry.tag_side_sigma_mm = o.tag_side_sigma_mm;
  options.interval_s = o.interval_s;
  for (const std::string& d : o.distances) {
    GNATHION_TRY(const KnownDistance distance, parse_distance(d));
    options.geometry.distances.push_back(distance);
  }
  return options;
}

Result<CommandOutput> calibrate_bow(const CalibrateOptions& o, const CommonOptions& common,
                                    Progress& progress) {
  GNATHION_CHECK_OK(may_write(o.out, common, {o.recording, o.rig, o.bow}));
  if (!o.bow_out.empty()) GNATHION_CHECK_OK(may_write(o.bow_out, common, {o.recording, o.rig, o.bow, o.out}));
  GNATHION_TRY(const BowFilmOptions options, film_options(o));
  GNATHION_TRY(const auto cameras, read_rig_cameras(o.rig));
  GNATHION_TRY(const TaggedBody nominal, read_body(o.bow));
  GNATHION_TRY(auto source, RecordingSource::open(o.recording));
  BowFilmSummary film;
  GNATHION_TRY(const BowGeometry g, calibrate_bow_film(*source, cameras, nominal, options, progress, &film));
  json j = bow_geometry_json(g);
  j["film"] = {{"frames", film.frames}, {"looked_at", film.instants}, {"with_pose", film.with_pose}};
  GNATHION_CHECK_OK(write_json(o.out, j));
  if (!o.bow_out.empty())
    GNATHION_CHECK_OK(write_body(o.bow_out, g.body,
                                 fmt::format("Calibrated from a film: {} tags, {:.4f} mm, scale {:.2f} %.",
                                             g.tags.size(), g.shape_sigma_mm, 100 * g.scale_sigma)));
  return CommandOutput{bow_geometry_text(g), bow_text(j), false};
}

}  // namespace

void add_calibrate_bow_command(CLI::App& calibrate, ChosenCommand& chosen) {
  auto o = std::make_shared<CalibrateOptions>();
  CLI::App* command =
      calibrate.add_subcommand("bow", "tag corners of bow or head frame from a film of it (docs/bow.md)");
  command->add_option("--recording", o->recording, "film of the body, turned before the camera")->required();
  command->add_option("--rig", o->rig, "RIG.toml; only its cameras count")->required();
  command->add_option("--bow", o->bow, "bow.toml or head_frame.toml as designed")->required();
  command->add_option("--out", o->out, "bow_calibration.json")->required();
  command->add_option("--bow-out", o->bow_out, "calibrated bow.toml for 'gnathion track'");
  command
      ->add_option("--tag-side-mm", o->tag_side_mm, "measured side of the black squares; else as in the file")
      ->check(CLI::Range(1.0, 1000.0));
  command->add_option("--tag-side-sigma-mm", o->tag_side_sigma_mm, "how well the side is known [0.02]")
      ->check(CLI::Range(1e-4, 10.0));
  command->add_option(
      "--distance", o->distances,
      "measured length TAG[.CORNER]-TAG[.CORNER]=MM[/SIGMA_MM]; centres without a corner; repeatable");
  command->add_option("--interval-s", o->interval_s, "between the frames that are looked at [0.1]")
      ->check(CLI::Range(0.0, 60.0));
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress& progress) {
    return calibrate_bow(*o, common, progress);
  });
}

namespace {

struct PrintOptions {
  BowPrintJob job;
  std::string out, config;
};

Result<CommandOutput> print_bow(const PrintOptions& o, const CommonOptions& common, Progress& progress) {
  std::vector<std::string> inputs = {o.job.maxilla.string(), o.job.mandible.string(), o.config};
  for (const auto& t : o.job.transforms) inputs.push_back(t.string());
  GNATHION_CHECK_OK(keeps_inputs(o.out, inputs));
  BowParameters parameters;
  if (!o.config.empty()) {
    GNATHION_TRY(parameters, read_bow_parameters(o.config, parameters));
  }
  GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o.out, common.force, {"bow.json"}));
  GNATHION_TRY(const BowDesign design, run_bow_print(o.job, parameters, progress));
  GNATHION_CHECK_OK(write_bow_print(o.job, design, parameters, staged.path(), progress));
  GNATHION_CHECK_OK(staged.commit());
  std::string text = fmt::format("{}: {:.1f} g, bonded over {:.0f} mm2\n", design.verdict, design.mass_g,
                                 design.bonding_area_mm2);
  for (const Gate& g : design.gates)
    if (!g.pass) text += fmt::format("  {} is {:.3f}, limit {:.3f}\n", g.name, g.value, g.limit);
  for (const std::string& w : design.warnings) text += "warning: " + w + "\n";
  return CommandOutput{text, bow_text(bow_design_json(design, parameters)), design.verdict != "pass"};
}

}  // namespace

void add_bow_commands(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* bow = app.add_subcommand("bow", "the mandibular bow and the head frame");
  bow->require_subcommand(1);
  auto o = std::make_shared<PrintOptions>();
  CLI::App* command = bow->add_subcommand("print",
                                          "bow with a labial clutch for these teeth, head frame, and the "
                                          "sheets of tags (docs/bow.md; exit 3: a gate fails)");
  command->add_option("--mandible", o->job.mandible, "lower arch in MI")->required();
  command->add_option("--maxilla", o->job.maxilla, "upper arch, same frame")->required();
  command->add_option("--transform", o->job.transforms,
                      "T_th: the clutch stays clear of the maxilla on the way there, too; repeatable");
  command->add_option("--config", o->config, "TOML file with a [bow] table");
  command->add_option("--out", o->out, "folder for STL, tag layouts, tags.pdf, bow.json and pictures")
      ->required();
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress& progress) {
    return print_bow(*o, common, progress);
  });
}

}  // namespace gnathion
