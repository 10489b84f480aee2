// Cases from what others have: a folder of meshes, workspaces of dpVision, sequences of PLUS; and a workspace of
// dpVision from a case.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/progress.h"
#include "core/result.h"
#include "core/time.h"
#include "pipeline/case_folder.h"

namespace gnathion {

struct CaseImport {
  std::filesystem::path from;    ///< folder, .dpw, .atmdl, .dpvision, .mha/.nrrd/.mhd of PLUS
  std::filesystem::path folder;  ///< case to make; must not exist
  std::string id;
  PatientIdentity patient;
  /// Given by hand where names do not tell: "maxilla_mi" to a file of a folder, or to a label of a workspace.
  std::map<std::string, std::string> roles;
  bool trust_names = false;  ///< go on where the geometry does not confirm what names say
};

struct ImportReport {
  std::string id;
  std::vector<std::string> taken;  ///< "scans.maxilla_mi: by its name, confirmed by its shape"
  std::vector<std::string> notes;  ///< what was left out, and what is unsure
};

/// By what `from` is. Roles that names suggest are held against the geometry: whether both jaws lie in one frame in MI
/// and which is the upper. Refused (kInput) in one line that names the flag which settles it: what is unsure, two
/// files for one role, no jaws; and everything the readers refuse. No case is left half-made.
Result<ImportReport> import_case(const CaseImport& what, Clock& clock, Progress& progress);

/// One file that an import reads, under a name below the folder it would be imported from.
struct ImportSource {
  std::string name;
  std::filesystem::path path;
};
inline constexpr int kDeepestImportSource = 8;  ///< names with slashes between in ImportSource::name, at most
/// What import_case(`from`) would read: a folder's plain files, a workspace with its meshes, a sequence with its data.
/// Each once. Refused (kInput): what is not there, a workspace that cannot be read or whose meshes lie elsewhere, are
/// hidden, too deep, or named by absolute paths.
Result<std::vector<ImportSource>> import_sources(const std::filesystem::path& from);

/// CASE as NAME.dpw with its meshes beside it in NAME_files/: jaws by keyword, the lower one under a node
/// "transformation" with T_th (results/T_th.json, else [position] transform), planes, other meshes, jaw motion as an
/// animation, the splint. Named by the case's id. Refused (kUsage): a file that exists, unless `force`.
Result<std::vector<std::string>> export_dpw(const std::filesystem::path& case_folder, const std::filesystem::path& dpw,
                                            bool force);

}  // namespace gnathion
