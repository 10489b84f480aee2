// frames.json:
// {"kind":"frames","unit":"mm","teeth_mm":[[3]…],"edges":[…],"cross_covariances":[…],"loops":[…],
// "suspects":[…]} (docs/formats.md).
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "calibration/frames_graph.h"

namespace gnathion {

/// Edges, cross covariances, and what follows from them: loops and suspects.
nlohmann::json frames_json(const FramesGraph& graph);
nlohmann::json path_json(const FramesGraph& graph, const FramePath& path);
/// Edges and cross covariances; loops are found again. `where` stands in errors.
Result<FramesGraph> frames_from_json(const nlohmann::json& j, const std::string& where);

/// Tables for people: edges, loops, what contradicts.
std::string frames_text(const FramesGraph& graph);
std::string path_text(const FramesGraph& graph, const FramePath& path);

}  // namespace gnathion
