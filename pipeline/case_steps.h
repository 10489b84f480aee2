// Steps of a case that are redone only when what they were made from changed, and go on after any kill.
//
// Each step writes into CASE/.steps/.NAME.part, which becomes CASE/.steps/NAME by rename, with step.json in
// it: key, inputs, parameters, outputs. The key is the SHA-256 of the step's name and version, the program's
// version and build, the effective parameters, the SHA-256 of each input file and the keys of the steps it
// builds on. A step whose key is the same and whose outputs still have their SHA-256 is not run again.
// results/ is put together from all steps (hard links where the file system has them) and takes the place of
// the old one in one rename.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"
#include "core/time.h"
#include "pipeline/case_lock.h"
#include "pipeline/provenance.h"

namespace gnathion {

struct StepInput {
  std::string role;            ///< "scans.maxilla_mi"
  std::filesystem::path path;  ///< empty: there is none, and that it is missing is part of the key
};

struct StepSpec {
  std::string name;
  int version = 1;  ///< raise it whenever the same inputs give other bytes
  std::vector<StepInput> inputs;
  /// Results of earlier steps that it reads: {"track", "motion.mcap"}.
  std::vector<std::pair<std::string, std::string>> uses;
  std::string parameters;  ///< JSON of the effective ones
};

/// What became of a step.
struct StepOutcome {
  std::string step;
  bool reused = false;
  std::string why;  ///< "nothing changed"; "scans.maxilla_mi changed", "never ran", "wall_mm: 1.0 became 1.5"
};

/// Removes what a run that was killed left half-made; the steps that it had done stay. False: there is
/// nothing, or something works in the case.
bool clean_interrupted_run(const std::filesystem::path& case_folder);

class CaseSteps {
 public:
  /// Takes the case's lock. `files` are named relative to `folder` where they lie in it. Refused (kUsage):
  /// another run in it, results that no run made (unless `force`).
  static Result<CaseSteps> open(const std::filesystem::path& folder, const std::string& case_id, bool force,
                                Clock& clock);
  CaseSteps(CaseSteps&&) = default;

  /// Hashes an input before anybody reads it. What is read later and is no longer that file ends the run.
  Status know(const std::filesystem::path& input);

  /// Writes into the folder given; the record is what results say of themselves. It may add facts to it.
  using Work = std::function<Status(const std::filesystem::path& out, StepRecord& record)>;
  /// Runs `work` unless what it made before still stands. JSON objects it writes get a "provenance".
  Result<std::filesystem::path> run(const StepSpec& spec, const Work& work);

  const std::vector<StepOutcome>& outcomes() const { return outcomes_; }
  /// results/ from all steps that were run or reused. Files in it that no run made stay.
  Status publish();

 private:
  CaseSteps(std::filesystem::path folder, std::string id, bool force, Clock& clock, CaseLock lock);
  Result<StepRecord> record_for(const StepSpec& spec);
  Status make(const StepSpec& spec, const Work& work, StepRecord& record);
  Result<std::string> hash_of(const std::filesystem::path& path);
  Status inputs_stand() const;
  bool published(const Provenance& now) const;
  Status keep_foreign(const std::filesystem::path& staging) const;

  std::filesystem::path folder_;
  std::string id_;
  bool force_;
  Clock* clock_;
  CaseLock lock_;
  std::vector<StepRecord> records_;
  std::vector<StepOutcome> outcomes_;
  struct Known {
    std::string sha256;
    std::string stamp;  ///< which file it was and when it was written, taken before it was hashed
  };
  std::map<std::string, Known> hashes_;  ///< of inputs, once a run
};

}  // namespace gnathion
