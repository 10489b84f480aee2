// Workspaces of dpVision as a tree: .dpw and .atmdl (text), .dpvision (a zip with structure.xml).
//
// What their reader drops the whole file for, an unknown word, is told here with its line and passed over.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "core/rigid.h"

namespace gnathion {

struct DpFrame {
  std::string label;
  double duration_s = 0;  ///< "delay" or "time": until the next frame
  Matrix4 matrix = Matrix4::Identity();
};

struct DpNode {
  enum class Kind { kTransformation, kShell, kPlane, kPoint, kSphere, kTriangle, kAnimation, kGroup };
  Kind kind = Kind::kGroup;
  std::string label = {}, description = {};
  std::vector<std::string> keywords = {};
  Matrix4 matrix =
      Matrix4::Identity();  ///< of a transformation: children's coordinates into its own parent's
  std::string file = {};    ///< of a shell, as written
  std::array<double, 3> centre_mm{},
      normal{};                      ///< of planes, points, spheres; a triangle's first two corners
  std::array<double, 3> third_mm{};  ///< of a triangle
  double size_mm = 0;                ///< of a plane; a sphere's radius
  std::vector<DpFrame> frames = {};  ///< of an animation
  std::vector<DpNode> children = {};

  bool has_keyword(std::string_view keyword) const;
};

struct DpWorkspace {
  std::vector<DpNode> nodes;
  std::vector<std::string> notes;  ///< "line 12: unknown word 'glow' is passed over"
};

/// Refused (kInput), by line: nesting that does not close or is deeper than 64, matrices that are not 16
/// finite numbers, numbers beyond 1e7, a file of more than 64 MB, macros that grow without end.
Result<DpWorkspace> parse_dpw(std::string_view text, const std::string& name);
/// The same tree as text that parse_dpw, and dpVision, read; numbers round-trip.
std::string format_dpw(const DpWorkspace& workspace);

/// A .dpvision: the tree, and the files in it that it names.
struct DpArchive {
  DpWorkspace workspace;
  std::map<std::string, std::string> files;  ///< by the name that DpNode::file has
};
/// Refused (kInput): what is no zip, lacks structure.xml, names files outside itself or that are not in it,
/// holds more than 10,000 entries, 1 GB in one or 2 GB in all (however small they are packed), parents that
/// make a loop.
Result<DpArchive> read_dpvision(const std::filesystem::path& path);
/// The same from memory; `name` stands in errors.
Result<DpArchive> parse_dpvision(std::string_view zip, const std::string& name);
/// structure.xml alone.
Result<DpWorkspace> parse_dpvision_structure(std::string_view xml, const std::string& name);

}  // namespace gnathion
