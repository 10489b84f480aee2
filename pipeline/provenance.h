// Where each result comes from: inputs by SHA-256, parameters, version and time, back to the frames.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"
#include "core/time.h"

namespace gnathion {

/// A file as it was when a step read or wrote it.
struct FileRecord {
  std::string role;  ///< of an input, "scans.maxilla_mi"; of another step's result, that step's name
  /// Relative to the case's folder where it lies in it, else its name alone; of results: to the step's
  /// folder.
  std::string path;
  std::string sha256;  ///< of a folder: of the names and hashes in it
  bool from_step = false;
  bool outside = false;  ///< of the case's folder: where it lay is nobody else's business
};

/// One step as it ran.
struct StepRecord {
  std::string step, key, program, time;
  std::string build;  ///< build_id.h; empty in records of old
  int version = 0;
  std::vector<FileRecord> inputs, outputs;
  std::string parameters;          ///< JSON
  std::vector<std::string> facts;  ///< for people: "camera_0: 960 frames tracked, 0 missing, 0 rejected"
};

nlohmann::json step_json(const StepRecord& record);
Result<StepRecord> step_from_json(const nlohmann::json& j, const std::string& where);

/// SHA-256 of a file of any size, read block by block; of a folder, of all that is in it, by name.
Result<std::string> sha256_of(const std::filesystem::path& path);

/// results/provenance.json.
struct Provenance {
  std::string case_id, program, time;
  std::vector<StepRecord> steps;  ///< in the order they ran
};
nlohmann::json provenance_json(const Provenance& provenance);
Result<Provenance> read_provenance(const std::filesystem::path& case_folder);

/// One line of the tree: a file, what made it, and below it what that was made from.
struct ProvenanceNode {
  std::string file;    ///< "results/splint.stl", "scans/maxilla_mi.ply"
  std::string sha256;  ///< then
  /// "unchanged", "changed since", "is gone"; of a file outside the case that case.toml no longer names: "not
  /// compared"
  std::string state;
  StepRecord made_by;  ///< step empty: from outside
  std::vector<ProvenanceNode> from;
};
/// From a result back to all that came from outside, each file held against what it is now. `result` is a
/// name in results/ ("splint.stl"; empty: every last result). Refused (kInput): a case that was not run, a
/// result that no step made.
Result<std::vector<ProvenanceNode>> trace_provenance(const std::filesystem::path& case_folder,
                                                     const std::string& result);
std::string provenance_text(const std::vector<ProvenanceNode>& tree);
nlohmann::json provenance_tree_json(const std::vector<ProvenanceNode>& tree);
/// Files of the tree that are not what they were, each once.
std::vector<std::string> changed_files(const std::vector<ProvenanceNode>& tree);

}  // namespace gnathion
