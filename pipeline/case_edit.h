// Adds files to a case and names them in its case.toml, whose other lines stay as a person wrote them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/result.h"
#include "pipeline/case_folder.h"

namespace gnathion {

class CaseEdit {
 public:
  static Result<CaseEdit> open(const std::filesystem::path& folder);

  /// Whether `file` can go in: its role exists and is free (or `force`), it can be read as what it has to be.
  Status check(const NewCaseFile& file, bool force) const;
  /// Copies it to the role's place and names it. The extension is kept, the name is the role's: names that
  /// others gave their files may hold a patient's.
  Status add(const NewCaseFile& file);
  /// Names a value as it is to stand in case.toml ("[plane]" tables go to the end, whole).
  Status set(const std::string& section, const std::string& key, const std::string& toml_value);
  void append(const std::string& text) { text_ += text; }
  /// case.toml by rename; refused where it would not read as meant.
  Status commit();

 private:
  CaseEdit(std::filesystem::path folder, std::string text)
      : folder_(std::move(folder)), text_(std::move(text)) {}
  std::filesystem::path folder_;
  std::string text_;
};

}  // namespace gnathion
