// A case that is being put together from others' files, for the import's own .cc files.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "pipeline/dpvision_workspace.h"
#include "pipeline/import_case.h"

namespace gnathion {

struct ImportDraft {
  explicit ImportDraft(std::filesystem::path work_folder) : work(std::move(work_folder)) {}

  std::filesystem::path work;  ///< for files that are made on the way
  NewCase made;
  ImportReport report;
  bool named_for_sure = false;  ///< roles by keyword or by hand, not guessed from names

  /// Refuses a role that is taken.
  Status take(const std::string& role, const std::filesystem::path& from, const std::string& how);
  /// The file of a role, empty where there is none.
  std::filesystem::path file_of(const std::string& role) const;
};

/// Whether the two arches lie in one frame in MI and which is the upper, held against what names say.
Status confirm_jaws(const CaseImport& what, ImportDraft& draft);

Status import_folder(const CaseImport& what, ImportDraft& draft);
/// `archive` null: shells name files beside `what.from`; else what lies in it.
Status import_workspace(const CaseImport& what, const DpWorkspace& workspace, const DpArchive* archive,
                        ImportDraft& draft);

}  // namespace gnathion
