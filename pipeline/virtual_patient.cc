#include "pipeline/virtual_patient.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "occlusion/arch.h"
#include "pipeline/cbct_steps.h"
#include "pipeline/check_job.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

struct Jaws {
  TriangleMesh maxilla, mandible_mi;
};

/// Those that cannot be this patient's in MI are as good as not found.
Status believable(const Joints& joints, const Jaws& jaws) {
  GNATHION_TRY(RealizabilityChecker checker, RealizabilityChecker::create(jaws.maxilla, jaws.mandible_mi));
  std::vector<std::string> notes;
  return add_joints(joints, "joints", &checker, &notes);
}

Status write_found_joints(const Result<Joints>& joints, const Jaws& jaws, const fs::path& folder,
                          VirtualPatient& found) {
  const Status good = joints ? believable(*joints, jaws) : Status(tl::unexpected<Error>(joints.error()));
  if (!good) {
    found.notes.push_back("joints not checked: " + good.error().line());
    return {};
  }
  std::error_code ec;
  fs::create_directory(folder / "joints", ec);
  if (ec) return fail(ErrorCode::kInternal, "cannot write", (folder / "joints").string(), ec.message());
  GNATHION_CHECK_OK(write_joints(*joints, folder / "joints"));
  found.has_joints = true;  // their warnings are in joints.json, and told by whoever checks with them
  return {};
}

Status write_face(const CaseFile& files, const Volume& volume, const fs::path& folder,
                  VirtualPatient& found) {
  if (files.face_mi.empty()) return {};
  GNATHION_TRY(const TriangleMesh face, read_mesh(files.face_mi));
  const auto skin = register_face(volume, face, {});
  if (!skin) {
    found.notes.push_back("the face scan is not in the volume's frame: " + skin.error().line());
    return {};
  }
  found.has_face = true;
  return write_json(folder / "cbct_from_face_mi.json",
                    cbct_registration_json(*skin, "face_mi", "face scan registered on the skin in the CBCT"));
}

Status look_in_volume(const CaseFile& files, const Jaws& jaws, const fs::path& folder, VirtualPatient& found,
                      Progress& progress) {
  progress.begin_step("reading the volume", 0.3);
  GNATHION_TRY(VolumeFile file, read_volume(files.cbct, {}, progress));
  found.notes = file.info.warnings;
  GNATHION_TRY(const ArchFrame frame, find_arch(jaws.maxilla, jaws.mandible_mi));
  progress.begin_step("upper crowns in the volume", 0.3);
  const auto crowns =
      register_crowns(file.volume, jaws.maxilla, crown_mask(jaws.maxilla, frame, Arch::kMaxilla), {}, {},
                      "upper crowns in the volume");
  if (!crowns) {
    found.notes.push_back("joints not checked: " + crowns.error().line());
    return {};
  }
  found.has_pose = true;
  GNATHION_CHECK_OK(
      write_json(folder / "cbct_from_dental.json",
                 cbct_registration_json(*crowns, Dental::name, "CBCT registered on the upper crowns")));
  progress.begin_step("face scan on the skin", 0.1);
  GNATHION_CHECK_OK(write_face(files, file.volume, folder, found));
  RegisteredVolume registered;
  registered.file = std::move(file);
  registered.cbct_from_dental.rigid = crowns->fit.target_from_source;
  registered.covariance = crowns->fit.covariance;
  return write_found_joints(joints_in_volume(registered, jaws.maxilla, jaws.mandible_mi, {}, progress), jaws,
                            folder, found);
}

}  // namespace

Status write_virtual_patient(const CaseFile& files, const fs::path& folder, Progress& progress) {
  Jaws jaws;
  GNATHION_TRY(jaws.maxilla, read_jaw(files.maxilla_mi));
  GNATHION_TRY(jaws.mandible_mi, read_jaw(files.mandible_mi));
  VirtualPatient found;
  std::error_code ec;
  if (fs::is_directory(files.cbct, ec) && holds_joint_meshes(files.cbct)) {
    const auto joints = joints_from_cbct(files.cbct, jaws.maxilla, jaws.mandible_mi, {}, progress);
    if (!joints) return tl::unexpected<Error>(joints.error());
    GNATHION_CHECK_OK(write_found_joints(joints, jaws, folder, found));
  } else {
    GNATHION_CHECK_OK(look_in_volume(files, jaws, folder, found, progress));
  }
  return write_json(folder / "cbct.json", {{"kind", "virtual patient"},
                                           {"pose", found.has_pose},
                                           {"face", found.has_face},
                                           {"joints", found.has_joints},
                                           {"notes", found.notes}});
}

Result<VirtualPatient> read_virtual_patient(const fs::path& folder) {
  const fs::path path = folder / "cbct.json";
  GNATHION_TRY(const json j, read_json(path));
  try {
    return VirtualPatient{j.at("pose").get<bool>(), j.at("face").get<bool>(), j.at("joints").get<bool>(),
                          j.at("notes").get<std::vector<std::string>>()};
  } catch (const json::exception& e) {
    return bad_input("cannot read", path.string(), e.what());
  }
}

}  // namespace gnathion
