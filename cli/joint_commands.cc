// joints motion.
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "cli/patient_options.h"
#include "core/file.h"
#include "pipeline/joint_motion_job.h"

namespace gnathion {

void add_joint_commands(CLI::App& app, ChosenCommand& chosen) {
  struct Options {
    PatientFiles files;
    std::string transform, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* joints = app.add_subcommand("joints", "condyles and fossae");
  joints->require_subcommand(1);
  CLI::App* command = joints->add_subcommand(
      "motion", "their distances in T_th and along a recorded motion, and the poles' paths");
  add_jaw_options(*command, o->files);
  add_joint_options(*command, o->files);
  add_recording_options(*command, o->files);
  command->add_option("--transform", o->transform, "T_th: JSON, 16 numbers, or ITK .tfm");
  command->add_option("--out", o->out, "folder to make")->required();
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        std::vector<std::string> inputs = o->files.paths();
        inputs.push_back(o->transform);
        GNATHION_CHECK_OK(keeps_inputs(o->out, inputs));
        std::optional<Motion<Dental>> therapeutic;
        if (!o->transform.empty()) {
          GNATHION_TRY(const MotionFile motion, read_motion(o->transform));
          therapeutic = motion.motion;
        }
        GNATHION_TRY(const Patient patient, read_patient(o->files, {}, progress));
        GNATHION_TRY(const JointMotions motions, follow_joints(patient, therapeutic, progress));
        GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o->out, common.force, {"joints.json"}));
        GNATHION_CHECK_OK(write_joint_motions(motions, patient, therapeutic, staged.path()));
        GNATHION_CHECK_OK(staged.commit());
        const nlohmann::json j = joint_motions_json(motions, patient.checker.arch());
        return CommandOutput{joint_motions_text(motions),
                             j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace), false};
      });
}

}  // namespace gnathion
