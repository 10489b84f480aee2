// What the viewer shows of a case folder: what is there, and what is not.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"
#include "core/transform.h"
#include "occlusion/arch.h"
#include "rendering/scene.h"

namespace gnathion {

/// One surface that can be shown, hidden and cut, in Dental.
struct Layer {
  std::string name;
  TriangleMesh mesh;
  Color color_3d = palette::kToothIvory;
  Color color_2d = {0, 0, 0};  ///< of its profile, the method's colours
  double width_2d_px = 1.5;
  double opacity = 1.0;
  bool visible = true;
};

/// A gate of design.json as the list shows it.
struct GateLine {
  std::string name;
  double value = 0, limit = 0;
  bool pass = false;
};

struct CaseScene {
  std::string title;
  std::vector<Layer> layers;
  std::optional<ArchFrame> arch;  ///< for named views and for the section's start
  std::string verdict;            ///< of the design; empty without one
  std::vector<GateLine> gates;
  std::vector<std::string> missing;  ///< what the case lacks, with the reason, in words
};

/// Opens a case folder. What is missing or broken is told in `missing`; refused (kInput) is only a folder
/// without a readable case.toml.
Result<CaseScene> open_case(const std::filesystem::path& folder);

}  // namespace gnathion
