// All that a case folder holds, read once: what is there, and what is not and why.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "calibration/frames_graph.h"
#include "core/mesh.h"
#include "core/result.h"
#include "core/transform_io.h"
#include "occlusion/arch.h"
#include "pipeline/case_file.h"
#include "tracking/motion_file.h"
#include "tracking/session_motion.h"

namespace gnathion {

using SharedMesh = std::shared_ptr<const TriangleMesh>;
using SharedJson = std::shared_ptr<const nlohmann::json>;

/// The steps of the work, in order: the window's tabs.
enum class Step { kCapture, kMotion, kCalibrate, kTransformation, kDesign, kEvaluate };
inline constexpr int kStepCount = 6;
const char* step_name(Step step);

/// Something that a step lacks, and what to do about it.
struct Absence {
  Step step = Step::kDesign;
  std::string what, why;
  bool broken = false;  ///< it is there, but cannot be read
};

/// Immutable once loaded; shared with background jobs.
struct CaseContent {
  std::filesystem::path folder;
  std::string title, kind;
  CaseFile files;  ///< paths that the case names; empty ones are absent
  std::map<std::string, SharedMesh>
      meshes;  ///< by role: "maxilla_mi", "splint", "face_mi", "condyle_left", …
  std::optional<ArchFrame> arch;
  std::optional<MotionFile> therapeutic, by_camera, by_faces;
  std::optional<JawMotion> motion;               ///< from MI, in Dental
  std::shared_ptr<const SessionMotion> session;  ///< motion.mcap: events and poses
  std::optional<FramesGraph> frames;
  SharedJson chain, design, feasibility, displacement, camera_source;
  std::filesystem::path evaluation;  ///< evaluation.toml of the case; empty: none
  std::vector<Absence> absences;
  double load_s = 0.0;

  std::filesystem::path results() const { return folder / "results"; }
  SharedMesh mesh(const std::string& role) const;
};

/// Reads whatever can be read, in parallel; never fails: what is wrong is told in `absences`. Any thread.
std::shared_ptr<const CaseContent> load_case(const std::filesystem::path& folder);

}  // namespace gnathion
