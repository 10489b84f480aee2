// A case as a workspace of dpVision.
#include <fmt/format.h>

#include "core/file.h"
#include "core/transform_io.h"
#include "pipeline/case_private.h"
#include "pipeline/dpvision_workspace.h"
#include "pipeline/import_case.h"
#include "tracking/motion_file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot export";
using Kind = DpNode::Kind;

/// Meshes go into one folder beside the workspace, named by their role.
class Exporter {
 public:
  Exporter(const CaseFile& files, fs::path folder, std::string folder_name)
      : files_(files), folder_(std::move(folder)), folder_name_(std::move(folder_name)) {}

  Result<DpNode> shell(const std::string& role, const fs::path& from,
                       const std::vector<std::string>& keywords) {
    DpNode node;
    node.kind = Kind::kShell;
    node.label = role;
    node.keywords = keywords;
    const std::string name = role + from.extension().string();
    GNATHION_CHECK_OK(copy_private(from, folder_ / name));
    node.file = folder_name_ + "/" + name;
    return node;
  }

  Result<DpWorkspace> workspace() {
    DpWorkspace out;
    GNATHION_CHECK_OK(add(out.nodes, "maxilla_mi", files_.maxilla_mi, {"upper"}));
    GNATHION_CHECK_OK(add_lower(out));
    GNATHION_CHECK_OK(add(out.nodes, "occlusal_surface", files_.occlusal_surface, {"occlusion"}));
    for (const auto& [name, path] : files_.extra) {
      const bool theirs = name == "inv_jaw" || name == "new_upper" || name == "cut_plane";
      GNATHION_CHECK_OK(
          add(out.nodes, name, path, theirs ? std::vector<std::string>{name} : std::vector<std::string>{}));
    }
    std::error_code ec;
    const fs::path splint = files_.folder / "results" / "splint.stl";
    if (fs::exists(splint, ec)) GNATHION_CHECK_OK(add(out.nodes, "splint", splint, {"splint"}));
    for (const CasePlane& p : files_.planes) {
      DpNode node;
      node.kind = Kind::kPlane;
      node.label = p.name;
      if (p.name == "cut_plane") node.keywords = {"cut_plane"};
      node.centre_mm = p.centre_mm;
      node.normal = p.normal;
      node.size_mm = p.size_mm;
      out.nodes.push_back(std::move(node));
    }
    GNATHION_CHECK_OK(add_motion(out));
    return out;
  }

 private:
  Status add(std::vector<DpNode>& to, const std::string& role, const fs::path& from,
             const std::vector<std::string>& keywords) {
    if (from.empty()) return {};
    GNATHION_TRY(DpNode node, shell(role, from, keywords));
    to.push_back(std::move(node));
    return {};
  }

  fs::path position() const {
    std::error_code ec;
    const fs::path measured = files_.folder / "results" / "T_th.json";
    return fs::exists(measured, ec) ? measured : files_.transform;
  }

  Status add_lower(DpWorkspace& out) {
    if (position().empty()) return add(out.nodes, "mandible_mi", files_.mandible_mi, {"lower"});
    GNATHION_TRY(const MotionFile read, read_motion(position()));
    DpNode node;
    node.kind = Kind::kTransformation;
    node.label = "transformation";
    node.matrix = read.motion.rigid.matrix();
    GNATHION_CHECK_OK(add(node.children, "mandible_mi", files_.mandible_mi, {"lower"}));
    out.nodes.push_back(std::move(node));
    return {};
  }

  /// Rows that are not valid hold the frame before them.
  Status add_motion(DpWorkspace& out) {
    std::error_code ec;
    const fs::path measured = files_.folder / "results" / "motion.csv";
    const fs::path path = fs::exists(measured, ec) ? measured : files_.motion;
    if (path.empty()) return {};
    GNATHION_TRY(const JawMotion motion, read_motion_csv(path));
    if (motion.frame != "dental") return {};  // cannot be shown on the teeth
    DpNode node;
    node.kind = Kind::kAnimation;
    node.label = "jaw motion";
    double last_s = 0;
    for (const JawMotionRow& row : motion.rows) {
      if (!row.valid) continue;
      if (!node.frames.empty()) node.frames.back().duration_s = row.time_s - last_s;
      last_s = row.time_s;
      node.frames.push_back({"", 0, row.motion.matrix()});
    }
    if (node.frames.empty()) return {};
    DpNode shown;
    shown.kind = Kind::kShell;
    shown.label = "moving jaw";
    shown.file = folder_name_ + "/mandible_mi" + files_.mandible_mi.extension().string();
    node.children.push_back(std::move(shown));
    out.nodes.push_back(std::move(node));
    return {};
  }

  const CaseFile& files_;
  fs::path folder_;
  std::string folder_name_;
};

}  // namespace

Result<std::vector<std::string>> export_dpw(const fs::path& case_folder, const fs::path& dpw, bool force) {
  GNATHION_TRY(const CaseFile files, read_case(case_folder));
  if (dpw.extension() != ".dpw" && dpw.extension() != ".atmdl")
    return fail(ErrorCode::kUsage, kWhat, dpw.string(), "a workspace's name ends with .dpw or .atmdl");
  std::error_code ec;
  if (fs::exists(dpw, ec) && !force)
    return fail(ErrorCode::kUsage, kWhat, dpw.string(), "exists; --force replaces it");
  const std::string folder_name = dpw.stem().string() + "_files";
  GNATHION_TRY(StagedDirectory meshes,
               StagedDirectory::create(dpw.parent_path() / folder_name, force,
                                       {"maxilla_mi" + files.maxilla_mi.extension().string()}));
  GNATHION_CHECK_OK(make_private(meshes.path()));
  Exporter exporter(files, meshes.path(), folder_name);
  GNATHION_TRY(const DpWorkspace workspace, exporter.workspace());
  std::vector<std::string> written = {dpw.string()};
  for (const auto& entry : fs::directory_iterator(meshes.path(), ec))
    written.push_back((dpw.parent_path() / folder_name / entry.path().filename()).string());
  GNATHION_CHECK_OK(meshes.commit());
  GNATHION_CHECK_OK(write_private(dpw, format_dpw(workspace)));
  return written;
}

}  // namespace gnathion
