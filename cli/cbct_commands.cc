// cbct info, register, surface, joints.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "anatomy/volume/iso_surface.h"
#include "cli/command.h"
#include "cli/patient_options.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "occlusion/arch.h"
#include "pipeline/cbct_steps.h"

namespace gnathion {
namespace {

using nlohmann::json;

std::string cbct_text(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace);
}

struct VolumeOptions {
  std::string cbct, series;
  void add_to(CLI::App& command) {
    command.add_option("--cbct", cbct, "folder of a DICOM series, or a NIfTI or NRRD file")->required();
    command.add_option("--series", series,
                       "series of a DICOM folder: UID, number, or #1, #2, … of 'cbct info'");
  }
};

std::string told(const std::vector<std::string>& warnings) {
  std::string out;
  for (const std::string& w : warnings) out += "  warning: " + w + "\n";
  return out;
}

std::string told(const VolumeInfo& info, std::size_t place, bool with_names) {
  const Vector3 s = info.grid.spacing_mm();
  std::string out = fmt::format("#{} {} {} {}\n  {} x {} x {} voxels of {:.4g} x {:.4g} x {:.4g} mm",
                                place + 1, info.format, info.modality, info.description, info.grid.size[0],
                                info.grid.size[1], info.grid.size[2], s.x(), s.y(), s.z());
  if (info.gantry_tilt_deg > 0.05) out += fmt::format(", tilted {:.1f} degrees", info.gantry_tilt_deg);
  out += "\n";
  if (!info.series_uid.empty())
    out += fmt::format("  series {} {}, {} files, {}, {}\n", info.series_number, info.series_uid, info.files,
                       info.transfer_syntax, info.date);
  if (with_names)
    out += fmt::format("  patient {}, {}, born {}\n", info.patient_name, info.patient_id,
                       info.patient_birth_date);
  return out + told(info.warnings);
}

std::string told(const CbctRegistration& r, const char* what) {
  std::string out =
      fmt::format("{}: {:.0f} % found at level {:.0f}, RMS {:.3f} mm, held out {:.3f} mm\n", what,
                  100.0 * r.fit.inlier_fraction, r.level, r.fit.rms_mm, r.fit.held_out_mm);
  for (const std::string& weak : r.fit.weak) out += "  weak: " + weak + "\n";
  return out;
}

void add_cbct_info(CLI::App& cbct, ChosenCommand& chosen) {
  struct Options {
    std::string path;
    bool with_names = false;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = cbct.add_subcommand("info", "series, geometry and what is odd about them");
  command->add_option("PATH", o->path, "folder of DICOM files, or one file (DICOM, NIfTI, NRRD)")->required();
  command->add_flag("--with-names", o->with_names, "the patient's name, number and birth date too");
  finish_command(
      *command, chosen,
      [o](const CommonOptions&, Progress&) -> Result<CommandOutput> {
        GNATHION_TRY(const std::vector<VolumeInfo> found, list_volumes(o->path));
        json j = {{"kind", "volumes"}, {"volumes", json::array()}};
        std::string text;
        for (std::size_t i = 0; i < found.size(); ++i) {
          j["volumes"].push_back(volume_info_json(found[i], o->with_names));
          text += told(found[i], i, o->with_names);
        }
        return CommandOutput{text, cbct_text(j), false};
      },
      false);
}

struct RegisterOptions {
  VolumeOptions volume;
  std::string maxilla, mandible, face, face_out, face_frame = "face_mi", out;
  double crown_level = NAN, skin_level = NAN;
};

Result<std::vector<bool>> crowns_of(const TriangleMesh& maxilla, const std::string& mandible) {
  if (mandible.empty()) return std::vector<bool>();
  GNATHION_TRY(const TriangleMesh lower, read_jaw(mandible));
  GNATHION_TRY(const ArchFrame frame, find_arch(maxilla, lower));
  return crown_mask(maxilla, frame, Arch::kMaxilla);
}

Result<CommandOutput> register_volume(const RegisterOptions& o, const CommonOptions& common,
                                      Progress& progress) {
  const std::vector<std::string> inputs = {o.volume.cbct, o.maxilla, o.mandible, o.face};
  GNATHION_CHECK_OK(may_write(o.out, common, inputs));
  if (!o.face_out.empty()) GNATHION_CHECK_OK(may_write(o.face_out, common, inputs));
  CbctOptions options;
  options.read.series = o.volume.series;
  if (std::isfinite(o.crown_level)) options.crown_level = o.crown_level;
  if (std::isfinite(o.skin_level)) options.skin_level = o.skin_level;
  GNATHION_TRY(const TriangleMesh maxilla, read_jaw(o.maxilla));
  GNATHION_TRY(const std::vector<bool> crowns, crowns_of(maxilla, o.mandible));
  progress.begin_step("reading volume", 0.4);
  GNATHION_TRY(const VolumeFile file, read_volume(o.volume.cbct, options.read, progress));
  progress.begin_step("upper crowns in the volume", 0.4);
  GNATHION_TRY(const CbctRegistration found,
               register_crowns(file.volume, maxilla, crowns, options, {}, "upper crowns in the volume"));
  json j = cbct_registration_json(found, Dental::name, "CBCT registered on the upper crowns");
  j["warnings"] = file.info.warnings;
  std::string text = told(found, "upper crowns") + told(file.info.warnings);
  json all = j;
  if (!o.face.empty()) {
    progress.begin_step("face scan on the skin", 0.2);
    GNATHION_TRY(const TriangleMesh face, read_mesh(o.face));
    GNATHION_TRY(const CbctRegistration skin, register_face(file.volume, face, options));
    const json f = cbct_registration_json(skin, o.face_frame, "face scan registered on the skin in the CBCT");
    GNATHION_CHECK_OK(write_json(o.face_out, f));
    all["face"] = f;
    text += told(skin, "face scan");
  }
  GNATHION_CHECK_OK(write_json(o.out, j));
  return CommandOutput{text, cbct_text(all), false};
}

void add_register(CLI::App& cbct, ChosenCommand& chosen) {
  auto o = std::make_shared<RegisterOptions>();
  CLI::App* command = cbct.add_subcommand("register", "the volume's pose to the dental model, by the crowns");
  o->volume.add_to(*command);
  command->add_option("--maxilla", o->maxilla, "upper arch, dental frame")->required();
  command->add_option("--mandible", o->mandible, "lower arch in MI: tells crowns from gingiva");
  command->add_option("--out", o->out, "cbct_from_dental.json, an edge for [[frame]] of case.toml")
      ->required();
  CLI::Option* face = command->add_option("--face", o->face, "face scan, to be registered on the skin");
  CLI::Option* face_out = command->add_option("--face-out", o->face_out, "its pose, JSON")->needs(face);
  face->needs(face_out);
  command->add_option("--face-frame", o->face_frame, "name of the face scan's frame [face_mi]")->needs(face);
  command->add_option("--crown-level", o->crown_level, "value of the surface of crowns; else by Otsu");
  command->add_option("--skin-level", o->skin_level, "value of the skin's surface; else by Otsu");
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress& progress) {
    return register_volume(*o, common, progress);
  });
}

struct SurfaceOptions {
  VolumeOptions volume;
  std::string kind = "bone", registration, out;
  double level = NAN;
};

Result<CommandOutput> write_surface(const SurfaceOptions& o, const CommonOptions& common,
                                    Progress& progress) {
  GNATHION_CHECK_OK(may_write(o.out, common, {o.volume.cbct, o.registration}));
  CbctOptions options;
  options.read.series = o.volume.series;
  if (!o.registration.empty()) GNATHION_CHECK_OK(read_cbct_registration(o.registration, options));
  progress.begin_step("reading volume", 0.5);
  GNATHION_TRY(const VolumeFile file, read_volume(o.volume.cbct, options.read, progress));
  progress.begin_step("surface", 0.5);
  double level = o.level;
  if (!std::isfinite(level)) {
    const TissueLevels levels = tissue_levels(file.volume);
    level = o.kind == "skin" ? levels.skin : o.kind == "crowns" ? levels.crown : levels.bone;
  }
  TriangleMesh mesh = iso_surface(file.volume, level);
  if (mesh.empty())
    return bad_input("cannot make surface", o.volume.cbct,
                     fmt::format("nothing in the volume passes {:.0f}", level));
  if (options.cbct_from_dental) mesh = transformed(options.cbct_from_dental->rigid.inverse(), mesh);
  GNATHION_CHECK_OK(write_mesh(o.out, mesh));
  const json j = {{"kind", "surface"},
                  {"surface", o.kind},
                  {"level", level},
                  {"frame", options.cbct_from_dental ? Dental::name : Cbct::name},
                  {"vertices", mesh.vertices_mm.size()},
                  {"triangles", mesh.triangles.size()},
                  {"area_mm2", surface_area_mm2(mesh)},
                  {"warnings", file.info.warnings}};
  return CommandOutput{fmt::format("{} at {:.0f}: {} triangles\n", o.kind, level, mesh.triangles.size()) +
                           told(file.info.warnings),
                       cbct_text(j), false};
}

void add_surface(CLI::App& cbct, ChosenCommand& chosen) {
  auto o = std::make_shared<SurfaceOptions>();
  CLI::App* command = cbct.add_subcommand("surface", "bone, skin or crowns as a mesh");
  o->volume.add_to(*command);
  command->add_option("--kind", o->kind, "bone, skin or crowns: whose level [bone]")
      ->check(CLI::IsMember({"bone", "skin", "crowns"}));
  command->add_option("--level", o->level, "the value itself; else by Otsu");
  command->add_option("--registration", o->registration,
                      "cbct_from_dental.json: the mesh in the dental frame");
  command->add_option("--out", o->out, "mesh (.stl, .ply, .obj)")->required();
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress& progress) {
    return write_surface(*o, common, progress);
  });
}

struct JointOptions {
  VolumeOptions volume;
  std::string maxilla, mandible, registration, labels, out;
  double bone_level = NAN;
  std::vector<int> condyle_labels, fossa_labels;
  std::optional<JointRegion> left, right;
};

std::string told(const Joints& joints) {
  std::string out = joints.source + "\n";
  for (const auto* side : {&joints.left, &joints.right})
    if (*side)
      out += fmt::format("{}: condyle {} triangles, {:.1f} mm between its poles; fossa {} triangles\n",
                         side_name((*side)->side), (*side)->condyle.triangles.size(),
                         ((*side)->lateral_pole_mm - (*side)->medial_pole_mm).norm(),
                         (*side)->fossa.triangles.size());
  return out + told(joints.warnings);
}

Result<CommandOutput> find_joints(const JointOptions& o, const CommonOptions& common, Progress& progress) {
  GNATHION_CHECK_OK(keeps_inputs(o.out, {o.volume.cbct, o.maxilla, o.mandible, o.registration, o.labels}));
  CbctOptions options;
  options.read.series = o.volume.series;
  if (std::isfinite(o.bone_level)) options.bone_level = o.bone_level;
  if (!o.registration.empty()) GNATHION_CHECK_OK(read_cbct_registration(o.registration, options));
  options.left = o.left;
  options.right = o.right;
  options.labels = o.labels;
  options.condyle_labels = o.condyle_labels;
  options.fossa_labels = o.fossa_labels;
  GNATHION_TRY(const TriangleMesh maxilla, read_jaw(o.maxilla));
  GNATHION_TRY(const TriangleMesh mandible, read_jaw(o.mandible));
  GNATHION_TRY(StagedDirectory folder, StagedDirectory::create(o.out, common.force, {"joints.json"}));
  GNATHION_TRY(const Joints joints, joints_from_cbct(o.volume.cbct, maxilla, mandible, options, progress));
  GNATHION_CHECK_OK(write_joints(joints, folder.path()));
  GNATHION_CHECK_OK(folder.commit());
  return CommandOutput{told(joints), cbct_text(joints_json(joints)), false};
}

void add_joints(CLI::App& cbct, ChosenCommand& chosen) {
  auto o = std::make_shared<JointOptions>();
  CLI::App* command =
      cbct.add_subcommand("joints", "condyles and fossae as meshes in the dental frame, for 'check --cbct'");
  o->volume.add_to(*command);
  command->add_option("--maxilla", o->maxilla, "upper arch, dental frame")->required();
  command->add_option("--mandible", o->mandible, "lower arch in MI")->required();
  command->add_option("--registration", o->registration, "cbct_from_dental.json; else registered anew");
  command->add_option("--bone-level", o->bone_level, "value where bone begins; else by Otsu");
  add_region_options(*command, "left", o->left);
  add_region_options(*command, "right", o->right);
  CLI::Option* labels =
      command->add_option("--labels", o->labels, "label map in the volume's frame (NIfTI, NRRD)");
  command->add_option("--condyle-label", o->condyle_labels, "label of the mandible; repeatable")
      ->needs(labels);
  command->add_option("--fossa-label", o->fossa_labels, "label of the skull; repeatable")->needs(labels);
  command->add_option("--out", o->out, "folder")->required();
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress& progress) {
    return find_joints(*o, common, progress);
  });
}

}  // namespace

void add_cbct_commands(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* cbct = app.add_subcommand(
      "cbct", "volumes of the head: series, registration, surfaces, joints (docs/cbct.md)");
  cbct->require_subcommand(1);
  add_cbct_info(*cbct, chosen);
  add_register(*cbct, chosen);
  add_surface(*cbct, chosen);
  add_joints(*cbct, chosen);
}

}  // namespace gnathion
