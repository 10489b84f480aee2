// case.toml: what a case folder holds, by role. Paths are relative to the folder.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/result.h"
#include "design/edits.h"
#include "design/parameters.h"

namespace gnathion {

/// Who the patient is: in [patient] of case.toml and nowhere else, no log, result, name or export.
struct PatientIdentity {
  std::string name, number, born, sex, remarks;
  bool empty() const {
    return name.empty() && number.empty() && born.empty() && sex.empty() && remarks.empty();
  }
};

/// How far a case.toml is trusted with paths.
enum class CaseTrust {
  kOwner,    ///< written by who runs the program: may name any file
  kConfined  ///< written by a client: every file must lie in the case's folder, links included
};

/// A plane that a user drew, Dental: kept for those who read it again.
struct CasePlane {
  std::string name;
  std::array<double, 3> centre_mm{}, normal{};
  double size_mm = 0;
};

/// Paths are absolute once read; absent entries are empty.
struct CaseFile {
  std::filesystem::path folder;
  std::string id;       ///< [case] id, or the folder's name
  std::string kind;     ///< "phantom" or "patient"
  std::string created;  ///< UTC; empty in cases of old
  PatientIdentity patient;
  std::filesystem::path maxilla_mi, mandible_mi, maxilla_tp, mandible_tp, mandible_clutch, face_mi, face_tp;
  std::filesystem::path occlusal_surface;  ///< S_occ of the maxilla, where it lies in MI
  std::filesystem::path cbct;              ///< file or folder
  std::filesystem::path bow_model, head_frame_model;
  std::filesystem::path rig, recording;
  std::filesystem::path motion;     ///< jaw motion made elsewhere, motion.csv in the dental frame
  std::filesystem::path chain;      ///< [calibrations]: chain.json made elsewhere, in place of solving it
  std::filesystem::path transform;  ///< [position]: T_th given by hand, in place of measuring it
  std::filesystem::path truth;      ///< phantoms only
  /// [extra]: other files of the case, by a name of the user's; nothing here reads them.
  std::map<std::string, std::filesystem::path> extra;
  std::vector<CasePlane> planes;  ///< [[plane]]
  SplintParameters parameters;    ///< [design], over the defaults
  SplintEdits edits;              ///< [[design.stroke]] and the like

  std::filesystem::path toml() const { return folder / "case.toml"; }
};

/// Reads FOLDER/case.toml. Refused with kInput: what is not TOML (line and column are named), an unknown key,
/// a file that is named but does not exist, a case without both jaws in MI.
Result<CaseFile> read_case(const std::filesystem::path& folder, CaseTrust trust = CaseTrust::kOwner);
/// The same without asking for the jaws: a case that is still being filled.
Result<CaseFile> read_unfinished_case(const std::filesystem::path& folder,
                                      CaseTrust trust = CaseTrust::kOwner);

}  // namespace gnathion
