// range.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "cli/patient_options.h"
#include "core/file.h"
#include "pipeline/range_job.h"

namespace gnathion {
namespace {

/// "protrusion=-2..8" or "protrusion=-2..8/41".
Result<RangeAxis> parse_axis(const std::string& text, int cells) {
  const auto refused = [&](const char* why) {
    return fail(ErrorCode::kUsage, "cannot map", text,
                std::string(why) + ": AXIS=LOW..HIGH or AXIS=LOW..HIGH/CELLS");
  };
  const std::size_t equal = text.find('='), dots = text.find("..");
  if (equal == std::string::npos || dots == std::string::npos || dots < equal) return refused("not an axis");
  RangeAxis axis;
  const auto which = jaw_axis_of(text.substr(0, equal));
  if (!which)
    return fail(ErrorCode::kUsage, "cannot map", text,
                "axes are protrusion, laterotrusion, lowering, opening, yaw, roll");
  axis.axis = *which;
  axis.cells = cells;
  const std::size_t slash = text.find('/', dots);
  try {
    std::size_t used = 0;
    const std::string low = text.substr(equal + 1, dots - equal - 1);
    axis.low = std::stod(low, &used);
    if (used != low.size()) return refused("LOW is not a number");
    const std::string high = text.substr(dots + 2, slash == std::string::npos ? slash : slash - dots - 2);
    axis.high = std::stod(high, &used);
    if (used != high.size()) return refused("HIGH is not a number");
    if (slash != std::string::npos) {
      const std::string count = text.substr(slash + 1);
      axis.cells = std::stoi(count, &used);
      if (used != count.size()) return refused("CELLS is not a number");
    }
  } catch (const std::exception&) {
    return refused("not a number");
  }
  return axis;
}

/// "yaw=1.5".
Result<std::pair<JawAxis, double>> parse_held(const std::string& text) {
  const std::size_t equal = text.find('=');
  const auto which = equal == std::string::npos ? std::nullopt : jaw_axis_of(text.substr(0, equal));
  char* end = nullptr;
  const double value = which ? std::strtod(text.c_str() + equal + 1, &end) : 0.0;
  if (!which || *end != '\0' || end == text.c_str() + equal + 1 || !std::isfinite(value))
    return fail(ErrorCode::kUsage, "cannot map", text, "--hold takes AXIS=VALUE");
  return std::pair(*which, value);
}

}  // namespace

void add_range_commands(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    PatientFiles files;
    std::string transform, out, x = "protrusion=-2..6", y = "opening=0..8";
    std::vector<std::string> hold;
    int cells = 33;
    double slope_deg = 0.0;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("range", "a map over two of the jaw's six axes of what a splint can hold");
  add_jaw_options(*command, o->files);
  add_joint_options(*command, o->files);
  add_recording_options(*command, o->files);
  command->add_option("--transform", o->transform,
                      "T_th: the other four axes are held there, and it is marked");
  command
      ->add_option("--x", o->x,
                   "AXIS=LOW..HIGH[/CELLS]; axes: protrusion, laterotrusion, lowering (mm), "
                   "opening, yaw, roll (deg)")
      ->capture_default_str();
  command->add_option("--y", o->y, "the other axis")->capture_default_str();
  command->add_option("--cells", o->cells, "along an axis that does not say")->capture_default_str();
  command->add_option("--hold", o->hold, "AXIS=VALUE of an axis that is not mapped; repeatable");
  command
      ->add_option("--condylar-slope-deg", o->slope_deg,
                   "protrusion lowers the condyles along this slope (0: straight forwards)")
      ->capture_default_str();
  command->add_option("--out", o->out, "folder to make: range.json, range.png")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        std::vector<std::string> inputs = o->files.paths();
        inputs.push_back(o->transform);
        GNATHION_CHECK_OK(keeps_inputs(o->out, inputs));
        RangeOptions options;
        GNATHION_TRY(options.x, parse_axis(o->x, o->cells));
        GNATHION_TRY(options.y, parse_axis(o->y, o->cells));
        options.condylar_slope_deg = o->slope_deg;
        HeldAxes held;
        for (const std::string& h : o->hold) {
          GNATHION_TRY(held.emplace_back(), parse_held(h));
        }
        std::optional<Motion<Dental>> therapeutic;
        if (!o->transform.empty()) {
          GNATHION_TRY(const MotionFile motion, read_motion(o->transform));
          therapeutic = motion.motion;
        }
        GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o->out, common.force, {"range.json"}));
        GNATHION_TRY(const Patient patient, read_patient(o->files, {}, progress));
        GNATHION_TRY(const RangeOutcome outcome, run_range(patient, options, therapeutic, held, progress));
        const nlohmann::json j = range_json(outcome);
        GNATHION_CHECK_OK(write_json(staged.path() / "range.json", j));
        GNATHION_CHECK_OK(draw_range(outcome, staged.path() / "range.png"));
        GNATHION_CHECK_OK(staged.commit());
        return CommandOutput{range_text(outcome),
                             j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
      });
}

}  // namespace gnathion
