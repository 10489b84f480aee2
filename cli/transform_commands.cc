// calibrate chain, transform scans|motion|manual.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "cli/command.h"
#include "core/mesh_io.h"
#include "pipeline/displacement_steps.h"
#include "pipeline/motion_steps.h"
#include "pipeline/therapeutic_steps.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string pose_line(const char* name, const ChainPose& p) {
  std::string weak;
  for (const std::string& w : p.weak) weak += (weak.empty() ? "; weak: " : ", ") + w;
  return fmt::format("{:<18} rms {:.3f} mm, held out {:.3f} mm, condition {:.0f}{}\n", name, p.rms_mm,
                     p.held_out_mm, p.condition, weak);
}

/// MI and TP as the tracker saw them, for the joint problem.
Result<TrackedPositions> tracked_positions(const std::string& motion) {
  GNATHION_TRY(const PoseRecording poses, read_poses(motion));
  GNATHION_TRY(const SessionMotion session, to_session_motion(poses, motion));
  if (!mount_covariance(session).isZero())
    return bad_input("cannot solve chain", motion,
                     "poses of an electromagnetic sensor carry their mount's error, which is not among the "
                     "unknowns here; 'transform motion' takes them");
  GNATHION_TRY(const JawPositions positions, resting_positions(session, {}));
  if (!positions.closes())
    return fail(ErrorCode::kGate, "MI does not close", motion, closure_text(positions));
  return TrackedPositions{positions.head_from_bow_mi, positions.head_from_bow_tp};
}

void add_calibrate_chain(CLI::App& calibrate, ChosenCommand& chosen) {
  struct Options {
    ChainFiles files;
    std::string out, motion;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      calibrate.add_subcommand("chain", "T_D, T_F, T and T_B from scans of bow, teeth and face");
  command->add_option("--mandible-mi", o->files.mandible_mi, "lower arch in the dental frame")->required();
  command->add_option("--clutch-scan", o->files.clutch_scans, "lower teeth with the clutch on; repeatable")
      ->required();
  command->add_option("--bow-model", o->files.bow_model, "the bow's CAD surface")->required();
  command->add_option("--face-mi", o->files.faces_mi, "face scan with the bow in MI; repeatable");
  command->add_option("--face-tp", o->files.faces_tp, "face scan with the bow in TP; repeatable");
  command->add_option("--head-frame-model", o->files.head_frame_model,
                      "the head frame's CAD surface, worn in both face scans");
  command->add_option("--motion", o->motion,
                      "motion.mcap of 'gnathion track': MI and TP by the camera enter the same problem");
  command->add_option("--out", o->out, "chain.json")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        std::vector<std::string> inputs = {o->motion, o->files.mandible_mi.string(),
                                           o->files.bow_model.string(), o->files.head_frame_model.string()};
        for (const auto* list : {&o->files.clutch_scans, &o->files.faces_mi, &o->files.faces_tp})
          for (const auto& path : *list) inputs.push_back(path.string());
        GNATHION_CHECK_OK(may_write(o->out, common, inputs));
        GNATHION_TRY(const ChainScans scans, read_chain_scans(o->files));
        ChainOptions options;
        if (!o->motion.empty()) {
          GNATHION_TRY(options.tracked, tracked_positions(o->motion));
        }
        GNATHION_TRY(const Chain chain, solve_chain(scans, options, progress));
        const json j = chain_json(chain);
        GNATHION_CHECK_OK(write_json(o->out, j));
        std::string text = pose_line("bow_from_dental", chain.bow_from_dental);
        if (chain.has_faces)
          text += pose_line("bow_from_face", chain.bow_from_face) +
                  pose_line("dental_from_face", chain.dental_from_face) +
                  pose_line("bow_motion", chain.bow_motion);
        if (chain.tracked)
          text += fmt::format("tracker and scans: T_th {:.3f} mm, {:.3f} deg apart (p {:.2f})\n",
                              chain.tracked->therapeutic_mm, chain.tracked->therapeutic_deg,
                              chain.tracked->p_value);
        for (const std::string& m : chain.missing) text += "missing: " + m + "\n";
        for (const std::string& w : chain.warnings) text += "warning: " + w + "\n";
        return CommandOutput{text, j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
      });
}

void add_transform_scans(CLI::App& transform, ChosenCommand& chosen) {
  struct Options {
    std::string maxilla_mi, mandible_mi, maxilla_tp, mandible_tp, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = transform.add_subcommand("scans", "T_th from intraoral scans in MI and in TP");
  command->add_option("--maxilla-mi", o->maxilla_mi, "upper arch, dental frame")->required();
  command->add_option("--mandible-mi", o->mandible_mi, "lower arch in MI, dental frame")->required();
  command->add_option("--maxilla-tp", o->maxilla_tp, "upper arch of the scan in TP")->required();
  command->add_option("--mandible-tp", o->mandible_tp, "lower arch of the scan in TP")->required();
  command->add_option("--out", o->out, "T_th.json")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        GNATHION_CHECK_OK(
            may_write(o->out, common, {o->maxilla_mi, o->mandible_mi, o->maxilla_tp, o->mandible_tp}));
        GNATHION_TRY(const TriangleMesh maxilla_mi, read_jaw(o->maxilla_mi));
        GNATHION_TRY(const TriangleMesh mandible_mi, read_jaw(o->mandible_mi));
        GNATHION_TRY(const TriangleMesh maxilla_tp, read_jaw(o->maxilla_tp));
        GNATHION_TRY(const TriangleMesh mandible_tp, read_jaw(o->mandible_tp));
        GNATHION_TRY(const TwoScanResult r,
                     therapeutic_from_scans(maxilla_mi, mandible_mi, maxilla_tp, mandible_tp, {}, progress));
        const json j = motion_json(r.therapeutic.value, r.therapeutic.covariance,
                                   {{"route", "intraoral scans"},
                                    {"maxilla", pose_json(r.dental_from_intraoral_tp)},
                                    {"mandible", pose_json(r.mandible)}});
        GNATHION_CHECK_OK(write_json(o->out, j));
        return CommandOutput{pose_line("maxilla", r.dental_from_intraoral_tp) +
                                 pose_line("mandible", r.mandible) + motion_text(r.therapeutic.value),
                             j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
      });
}

Result<std::pair<double, double>> parse_interval(const std::string& text) {
  const auto dots = text.find("..");
  if (dots != std::string::npos) {
    char* end = nullptr;
    const std::string first = text.substr(0, dots), second = text.substr(dots + 2);
    const double start = std::strtod(first.c_str(), &end);
    const bool good = end != first.c_str() && *end == 0;
    const double stop = std::strtod(second.c_str(), &end);
    if (good && end != second.c_str() && *end == 0 && start >= 0 && stop > start && std::isfinite(stop))
      return std::pair(start, stop);
  }
  return fail(ErrorCode::kUsage, "wrong usage", text, "an interval is START..END in seconds, as 3.2..3.9");
}

Result<std::vector<std::pair<double, double>>> parse_intervals(const std::vector<std::string>& texts) {
  std::vector<std::pair<double, double>> out;
  for (const std::string& t : texts) {
    GNATHION_TRY(const auto interval, parse_interval(t));
    out.push_back(interval);
  }
  return out;
}

void add_transform_motion(CLI::App& transform, ChosenCommand& chosen) {
  struct Options {
    std::string motion, calibration, out;
    std::vector<std::string> mi_s, tp_s;
    bool accept_slip = false;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = transform.add_subcommand("motion", "T_th from a tracked motion and the chain");
  command->add_option("--motion", o->motion, "motion.mcap of 'gnathion track'")->required();
  command->add_option("--calibration", o->calibration, "chain.json")->required();
  command->add_option("--mi-s", o->mi_s,
                      "MI, START..END in seconds from the first sample; else pedal marks, else found");
  command->add_option("--tp-s", o->tp_s, "TP, in the same way");
  command->add_flag("--accept-slip", o->accept_slip, "go on although the MI recordings do not close");
  command->add_option("--out", o->out, "T_th.json")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        GNATHION_CHECK_OK(may_write(o->out, common, {o->motion, o->calibration}));
        PlateauOptions plateaus;
        GNATHION_TRY(plateaus.mi_s, parse_intervals(o->mi_s));
        GNATHION_TRY(plateaus.tp_s, parse_intervals(o->tp_s));
        progress.begin_step("averaging MI and TP", 1.0);
        GNATHION_TRY(const PoseRecording poses, read_poses(o->motion));
        GNATHION_TRY(const SessionMotion session, to_session_motion(poses, o->motion));
        GNATHION_TRY(const json chain_file, read_json(o->calibration));
        GNATHION_TRY(Chain chain, chain_from_json(chain_file, o->calibration));
        chain.bow_from_dental.covariance += mount_covariance(session);  // of an electromagnetic sensor
        GNATHION_TRY(const CameraRoute route, camera_route(session, chain.bow_from_dental, plateaus));
        if (!route.positions.closes() && !o->accept_slip)
          return fail(ErrorCode::kGate, "MI does not close", o->motion,
                      closure_text(route) + "; --accept-slip goes on");
        const json j = motion_json(route.estimate.therapeutic.value, route.estimate.therapeutic.covariance,
                                   camera_route_source(route));
        GNATHION_CHECK_OK(write_json(o->out, j));
        return CommandOutput{motion_text(route.estimate.therapeutic.value),
                             j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
      });
}

/// The motion that was typed in: 16 numbers, or a turn about an axis and then a shift.
struct TypedMotion {
  std::vector<double> matrix, translate_mm, axis, about_mm;
  std::optional<double> rotate_deg;
  std::string file;

  Result<MotionFile> read() const {
    const auto usage = [](const std::string& why) {
      return fail(ErrorCode::kUsage, "wrong usage", "transform manual", why);
    };
    const bool turned = rotate_deg.has_value(), shifted = !translate_mm.empty();
    if ((file.empty() ? 0 : 1) + (matrix.empty() ? 0 : 1) + (turned || shifted ? 1 : 0) != 1)
      return usage("give one of --file, --matrix, or --translate-mm and --rotate-deg");
    if (!file.empty()) return read_motion(file);
    if (!matrix.empty()) {
      std::string text;
      for (const double v : matrix) text += fmt::format("{:.17g} ", v);
      return parse_motion(text, "--matrix");
    }
    Rigid3 motion;
    if (turned) {
      if (axis.empty()) return usage("--rotate-deg needs --axis");
      const Vector3 direction(axis[0], axis[1], axis[2]);
      if (!(direction.norm() > 1e-9)) return usage("--axis has no direction");
      const Vector3 point =
          about_mm.empty() ? Vector3::Zero() : Vector3(about_mm[0], about_mm[1], about_mm[2]);
      motion = Rigid3::about_axis(point, direction, *rotate_deg * M_PI / 180);
    } else if (!axis.empty() || !about_mm.empty()) {
      return usage("--axis and --about belong to --rotate-deg");
    }
    if (shifted)
      motion = Rigid3::from_translation({translate_mm[0], translate_mm[1], translate_mm[2]}) * motion;
    if (!motion.matrix().allFinite()) return usage("a number is not finite");
    return MotionFile{Motion<Dental>(motion), std::nullopt, "typed"};
  }
};

void add_transform_manual(CLI::App& transform, ChosenCommand& chosen) {
  struct Options {
    TypedMotion typed;
    std::string maxilla, mandible, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = transform.add_subcommand(
      "manual",
      "T_th typed in, or read from JSON, text or ITK .tfm; its error stays unknown where not given");
  command->add_option("--translate-mm", o->typed.translate_mm, "x y z, after the turn")->expected(3);
  command->add_option("--rotate-deg", o->typed.rotate_deg, "turn about --axis through --about, right-handed");
  command->add_option("--axis", o->typed.axis, "x y z, direction of the axis")->expected(3);
  command->add_option("--about", o->typed.about_mm, "x y z in mm, a point of the axis; else the origin")
      ->expected(3);
  command->add_option("--matrix", o->typed.matrix, "16 numbers, row by row")->expected(16);
  command->add_option("--file", o->typed.file, "JSON, 16 numbers, or ITK .tfm (its inverse is taken)");
  CLI::Option* maxilla =
      command->add_option("--maxilla", o->maxilla, "upper arch: tells what the motion does");
  CLI::Option* mandible = command->add_option("--mandible", o->mandible, "lower arch in MI, same frame");
  maxilla->needs(mandible);
  mandible->needs(maxilla);
  command->add_option("--out", o->out, "T_th.json")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        GNATHION_CHECK_OK(may_write(o->out, common, {o->typed.file, o->maxilla, o->mandible}));
        progress.begin_step("checking the transformation", 1.0);
        GNATHION_TRY(const MotionFile given, o->typed.read());
        json source = {{"route", "manual"}, {"kind", given.kind}};
        if (!o->typed.file.empty()) source["file"] = o->typed.file;
        std::string text = motion_text(given.motion);
        if (!given.covariance) {
          source["notes"] = {"the error of this transformation is unknown"};
          text += "its error is unknown: covariance null\n";
        }
        if (!o->maxilla.empty()) {
          GNATHION_TRY(const TriangleMesh upper, read_jaw(o->maxilla));
          GNATHION_TRY(const TriangleMesh lower, read_jaw(o->mandible));
          GNATHION_TRY(const MandibleLandmarks landmarks, mandible_landmarks(upper, lower));
          source["displacement"] = displacement_json(given.motion, given.covariance, landmarks);
          source["warnings"] = oddities_of(given.motion, landmarks);
          text += displacement_text(given.motion, given.covariance, landmarks);
          for (const std::string& w : oddities_of(given.motion, landmarks)) text += "warning: " + w + "\n";
        }
        const json j = motion_json(given.motion, given.covariance, source);
        GNATHION_CHECK_OK(write_json(o->out, j));
        return CommandOutput{text, j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
      });
}

}  // namespace

void add_transform_commands(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* calibrate = app.add_subcommand("calibrate", "solve for poses that link the instruments");
  calibrate->require_subcommand(1);
  add_calibrate_sensor_command(*calibrate, chosen);
  add_calibrate_chain(*calibrate, chosen);
  add_calibrate_bow_command(*calibrate, chosen);
  add_calibrate_commands(*calibrate, chosen);
  CLI::App* transform = app.add_subcommand("transform", "the therapeutic transformation T_th");
  transform->require_subcommand(1);
  add_transform_scans(*transform, chosen);
  add_transform_motion(*transform, chosen);
  add_transform_manual(*transform, chosen);
}

}  // namespace gnathion
