// frames: the patient's frames, their registrations, and any pair composed.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <nlohmann/json.hpp>

#include "calibration/frames_graph_json.h"
#include "cli/command.h"
#include "core/transform_io.h"
#include "pipeline/frames_steps.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string frames_text(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace);
}

}  // namespace

void add_frames_commands(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    std::string folder, to, from, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "frames", "a case's frames, their registrations, and whether its loops close (exit 3: one does not)");
  command->add_option("CASE", o->folder, "case folder with case.toml")->required();
  CLI::Option* to = command->add_option("--to", o->to, "compose the pose to this frame …");
  CLI::Option* from =
      command->add_option("--from", o->from, "… from this one, along the best path")->needs(to);
  to->needs(from);
  command->add_option("--out", o->out, "write the composed pose as JSON")->needs(to);
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        if (!o->out.empty()) GNATHION_CHECK_OK(may_write(o->out, common, {o->folder + "/case.toml"}));
        progress.begin_step("reading frames", 1.0);
        GNATHION_TRY(const FramesGraph graph, read_case_frames(o->folder));
        if (!o->to.empty()) {
          GNATHION_TRY(const FramePath path, graph.path(o->to, o->from));
          const json j = path_json(graph, path);
          if (!o->out.empty()) GNATHION_CHECK_OK(write_json(o->out, j));
          return CommandOutput{path_text(graph, path), frames_text(j), false};
        }
        const std::vector<FrameLoop> loops = graph.loops();
        const bool open =
            std::any_of(loops.begin(), loops.end(), [](const FrameLoop& l) { return !l.consistent(); });
        return CommandOutput{frames_text(graph), frames_text(frames_json(graph)), open};
      });
}

}  // namespace gnathion
