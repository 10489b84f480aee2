// One folder a case: making it, telling what is in it, listing all of a root.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "core/time.h"
#include "pipeline/case_file.h"

namespace gnathion {

/// 1 to 64 of A-Z a-z 0-9 . _ -, not beginning with a dot or dash. Refused with kUsage.
Status check_case_id(std::string_view id);

/// A file that goes into a new case. `role` is a key of case.toml with its section: "scans.maxilla_mi",
/// "session.recording" (case_roles() has them all). It is copied to the role's place.
struct NewCaseFile {
  std::string role;
  std::filesystem::path from;
};

struct NewCase {
  std::string id;  ///< also the folder's name where the folder is made by id; never the patient's name
  std::string kind = "patient";
  PatientIdentity patient;  ///< into [patient] of case.toml and nowhere else
  std::vector<NewCaseFile> files;
  std::string more_toml;  ///< goes behind the rest: [[plane]] and the like
};

/// Makes `folder` (0700, its files 0600), whole or not at all. Refused (kUsage): a folder that exists, an id
/// that is none or holds a name of the patient; (kInput): a file that does not exist or is of a wrong type
/// for its role. Needs no scans: they may come later.
Result<CaseFile> create_case(const std::filesystem::path& folder, const NewCase& what, Clock& clock);

/// Copies more files into an existing case and names them in its case.toml, which is rewritten line by line:
/// what a person wrote there stays. A role that is taken is refused (kUsage) unless `force`.
Status add_case_files(const std::filesystem::path& folder, const std::vector<NewCaseFile>& files, bool force);

/// One file that case.toml names.
struct CaseFileEntry {
  std::string role;            ///< "scans.maxilla_mi"
  std::filesystem::path path;  ///< absolute or relative as the case's folder is
  std::string shown;           ///< as case.toml has it
  std::uint64_t bytes = 0;
};

/// What a list shows of a case; never who the patient is.
struct CaseSummary {
  std::string id;
  std::filesystem::path folder;
  std::string kind;        ///< "patient", "phantom"; empty where case.toml cannot be read
  std::string created;     ///< UTC, as case.toml has it; may be empty
  std::string verdict;     ///< of results/design.json: "pass", "fail", "not_realizable"; empty: not designed
  std::string results_at;  ///< UTC of the last run; empty: never
  std::string toml_sha256;
  std::vector<CaseFileEntry> files;
  std::string problem;  ///< why the case cannot be used, one line; empty: it can
};

/// Every file the case names, in the order of case.toml's roles.
std::vector<CaseFileEntry> case_files(const CaseFile& files);
/// Never fails: what is wrong with the case stands in `problem`.
CaseSummary summarize_case(const std::filesystem::path& folder, CaseTrust trust = CaseTrust::kOwner);
/// The folders of `root` that hold a case.toml, by id. Hidden folders and links are passed over. Refused
/// (kInput): a root that cannot be read.
Result<std::vector<CaseSummary>> list_cases(const std::filesystem::path& root,
                                            CaseTrust trust = CaseTrust::kOwner);

}  // namespace gnathion
