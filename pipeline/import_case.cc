#include "pipeline/import_case.h"

#include <fmt/format.h>

#include <algorithm>

#include "acquisition/exchange/import_recording.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "occlusion/arch.h"
#include "occlusion/contacts.h"
#include "pipeline/case_private.h"
#include "pipeline/import_draft.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot import";
constexpr double kFarthestInMi_mm = 1.0;

std::string extension_of(const fs::path& path) {
  std::string ext = path.extension().string();
  std::transform(ext.begin(), ext.end(), ext.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ext;
}

Status import_plus(const CaseImport& what, ImportDraft& draft, Progress& progress) {
  const fs::path out = draft.work / "recording.mcap";
  GNATHION_TRY(const ImportSummary read,
               import_plus_sequence(what.from, "image", std::nullopt, out, progress));
  GNATHION_CHECK_OK(
      draft.take("session.recording", out, fmt::format("{} frames, {} poses", read.frames, read.poses)));
  for (const std::string& note : read.notes) draft.report.notes.push_back(note);
  draft.report.notes.push_back("scans are still needed: gnathion case add CASE --file maxilla_mi=...");
  return {};
}

Status import_any(const CaseImport& what, ImportDraft& draft, Progress& progress) {
  std::error_code ec;
  if (!fs::exists(what.from, ec)) return bad_input(kWhat, what.from.string(), "does not exist");
  if (fs::is_directory(what.from, ec)) return import_folder(what, draft);
  const std::string ext = extension_of(what.from);
  if (ext == ".mha" || ext == ".mhd" || ext == ".nrrd") return import_plus(what, draft, progress);
  if (ext == ".dpvision") {
    GNATHION_TRY(const DpArchive archive, read_dpvision(what.from));
    return import_workspace(what, archive.workspace, &archive, draft);
  }
  if (ext == ".dpw" || ext == ".atmdl") {
    GNATHION_TRY(const std::string text, read_file(what.from));
    GNATHION_TRY(const DpWorkspace workspace, parse_dpw(text, what.from.string()));
    return import_workspace(what, workspace, nullptr, draft);
  }
  return bad_input(
      kWhat, what.from.string(),
      "is neither a folder of meshes, nor .dpw, .atmdl, .dpvision, nor a PLUS sequence (.mha, .nrrd)");
}

}  // namespace

Status ImportDraft::take(const std::string& role, const fs::path& from, const std::string& how) {
  for (const NewCaseFile& f : made.files)
    if (f.role == role)
      return bad_input(
          kWhat, role,
          fmt::format("both {} and {} could be it; --role {}=... says which", f.from.filename().string(),
                      from.filename().string(), role.substr(role.find('.') + 1)));
  made.files.push_back({role, from});
  report.taken.push_back(role + ": " + how);
  return {};
}

fs::path ImportDraft::file_of(const std::string& role) const {
  for (const NewCaseFile& f : made.files)
    if (f.role == role) return f.from;
  return {};
}

Status confirm_jaws(const CaseImport& what, ImportDraft& draft) {
  const fs::path upper = draft.file_of("scans.maxilla_mi"), lower = draft.file_of("scans.mandible_mi");
  if (upper.empty() || lower.empty())
    return bad_input(
        kWhat, what.from.string(),
        fmt::format("which mesh is the {}? --role {}=... says it", upper.empty() ? "maxilla" : "mandible",
                    upper.empty() ? "maxilla_mi" : "mandible_mi"));
  GNATHION_TRY(const TriangleMesh maxilla, read_jaw(upper));
  GNATHION_TRY(const TriangleMesh mandible, read_jaw(lower));
  const auto unsure = [&](const std::string& why) -> Status {
    if (!what.trust_names)
      return bad_input(kWhat, what.from.string(), why + "; --role names them, --trust-names goes on");
    draft.report.notes.push_back("not confirmed by shape: " + why);
    return {};
  };
  const auto arch = find_arch(maxilla, mandible), exchanged = find_arch(mandible, maxilla);
  if (!arch && exchanged) return unsure("by their shapes maxilla and mandible are exchanged");
  if (!arch) return unsure("the jaws do not confirm each other: " + arch.error().why);
  const MeshQuery upper_query(maxilla), lower_query(mandible);
  const Overlap overlap = find_overlap(upper_query, lower_query, Rigid3(), arch->up);
  if (overlap.depth_mm > kFarthestInMi_mm)
    return unsure(fmt::format("the jaws are {:.1f} mm inside each other: not in MI", overlap.depth_mm));
  if (overlap.min_distance_mm > kFarthestInMi_mm)
    return unsure(fmt::format("the jaws are {:.1f} mm apart: not in MI", overlap.min_distance_mm));
  draft.report.notes.push_back(
      exchanged
          ? "the jaws lie in one frame, in MI; which is the upper one their shapes do not tell, names do"
          : "the jaws lie in one frame, in MI, and their shapes agree on which is the upper one");
  return {};
}

Result<ImportReport> import_case(const CaseImport& what, Clock& clock, Progress& progress) {
  GNATHION_CHECK_OK(check_case_id(what.id));
  std::error_code ec;
  if (fs::exists(fs::symlink_status(what.folder, ec)))
    return fail(ErrorCode::kUsage, kWhat, what.folder.string(), "exists already");
  progress.begin_step("importing", 1.0);
  const fs::path parent = what.folder.has_parent_path() ? what.folder.parent_path() : fs::path(".");
  GNATHION_TRY(const StagedDirectory work, StagedDirectory::create(parent / (".import." + what.id), true));
  GNATHION_CHECK_OK(make_private(work.path()));
  ImportDraft draft(work.path());
  draft.made.id = what.id;
  draft.made.patient = what.patient;
  GNATHION_CHECK_OK(import_any(what, draft, progress));
  GNATHION_TRY(const CaseFile made, create_case(what.folder, draft.made, clock));
  draft.report.id = made.id;
  return std::move(draft.report);
}

}  // namespace gnathion
