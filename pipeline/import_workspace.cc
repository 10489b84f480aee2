// A workspace of dpVision as a case.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "pipeline/case_path.h"
#include "pipeline/case_private.h"
#include "pipeline/case_roles.h"
#include "pipeline/import_draft.h"
#include "tracking/motion_file.h"

#include <nlohmann/json.hpp>

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot import";

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// A role of ours, "extra.NAME", or nothing.
std::string role_by_keyword(const DpNode& node) {
  if (node.has_keyword("upper")) return "scans.maxilla_mi";
  if (node.has_keyword("lower")) return "scans.mandible_mi";
  if (node.has_keyword("occlusion")) return "scans.occlusal_surface";
  for (const char* name : {"inv_jaw", "new_upper", "cut_plane"})
    if (node.has_keyword(name)) return std::string("extra.") + name;
  return "";
}

std::string role_by_label(const DpNode& node) {
  const std::string label = lower(node.label);
  const auto has = [&](const char* word) { return label.find(word) != std::string::npos; };
  const bool up = has("upper") || has("szczeka"), low = has("lower") || has("zuchwa");
  if (has("occlusion")) return "scans.occlusal_surface";
  if (up == low) return "";
  return up ? "scans.maxilla_mi" : "scans.mandible_mi";
}

/// A shell with what stands above it.
struct Shell {
  const DpNode* node;
  Matrix4 place = Matrix4::Identity();   ///< into the workspace, without T
  Matrix4 above = Matrix4::Identity();   ///< into the workspace, from where T acts
  Matrix4 motion = Matrix4::Identity();  ///< T: of a node labelled "transformation"
  bool moved = false, animated = false;
};

class Importer {
 public:
  Importer(const CaseImport& what, const DpArchive* archive, ImportDraft& draft)
      : what_(what), archive_(archive), draft_(draft) {}

  Status run(const DpWorkspace& workspace) {
    for (const std::string& note : workspace.notes) draft_.report.notes.push_back(note);
    for (const DpNode& node : workspace.nodes) GNATHION_CHECK_OK(walk(node, Shell{nullptr}));
    GNATHION_CHECK_OK(choose_roles());
    for (std::size_t i = 0; i < shells_.size(); ++i) GNATHION_CHECK_OK(take_shell(i));
    GNATHION_CHECK_OK(take_motion_of_lower());
    if (left_out_ > 0)
      draft_.report.notes.push_back(fmt::format("{} points, spheres and triangles are left out", left_out_));
    return confirm_jaws(what_, draft_);
  }

 private:
  tl::unexpected<Error> bad(const std::string& where, const std::string& why) const {
    return bad_input(kWhat, what_.from.filename().string() + ": " + where, why);
  }

  Status walk(const DpNode& node, Shell at) {
    using Kind = DpNode::Kind;
    switch (node.kind) {
      case Kind::kTransformation:
        if (lower(node.label) == "transformation" && !at.moved) {
          at.moved = true;
          at.above = at.place;
          at.motion = node.matrix;
        } else {
          at.place = at.place * node.matrix;
        }
        break;
      case Kind::kShell:
        if (node.file.empty()) return bad("a shell", "names no file");
        at.node = &node;
        shells_.push_back(at);
        break;
      case Kind::kPlane:
        GNATHION_CHECK_OK(take_plane(node, at.place));
        break;
      case Kind::kAnimation:
        GNATHION_CHECK_OK(take_animation(node, at.place));
        at.animated = true;
        break;
      case Kind::kPoint:
      case Kind::kSphere:
      case Kind::kTriangle:
        ++left_out_;
        break;
      case Kind::kGroup:
        break;
    }
    for (const DpNode& child : node.children) GNATHION_CHECK_OK(walk(child, at));
    return {};
  }

  /// Keywords first, then what was given by hand, then labels; a role that a keyword gives is not given
  /// again.
  Status choose_roles() {
    roles_.assign(shells_.size(), "");
    for (const auto& [given, label] : what_.roles) {
      const CaseRole* role = find_case_role(given);
      if (role == nullptr) return fail(ErrorCode::kUsage, kWhat, given, "is no role");
      bool found = false;
      for (std::size_t i = 0; i < shells_.size() && !found; ++i)
        if (roles_[i].empty() && shells_[i].node->label == label) {
          roles_[i] = role->name();
          found = true;
        }
      if (!found) return bad(label, "no shell has this label");
    }
    for (const auto choose : {role_by_keyword, role_by_label})
      for (std::size_t i = 0; i < shells_.size(); ++i) {
        if (!roles_[i].empty() || shells_[i].animated) continue;
        const std::string role = choose(*shells_[i].node);
        const bool taken = std::find(roles_.begin(), roles_.end(), role) != roles_.end();
        if (!role.empty() && taken && choose == role_by_keyword)
          return bad(role, "two shells have the keyword for it");
        if (!role.empty() && taken && choose == role_by_label) continue;
        roles_[i] = role;
      }
    return {};
  }

  Result<std::string> bytes_of(const std::string& file) const {
    if (archive_ != nullptr) return archive_->files.at(file);
    GNATHION_TRY(const CaseRoot beside,
                 CaseRoot::open(what_.from.has_parent_path() ? what_.from.parent_path() : "."));
    const auto path = beside.resolve(file);
    if (!path) return bad(file, path.error().why + "; meshes lie in the workspace's folder");
    return read_file(*path);
  }

  Status take_shell(std::size_t i) {
    const Shell& shell = shells_[i];
    if (roles_[i].empty()) {
      if (shell.animated) return {};  // what the animation moves, once more
      roles_[i] = fmt::format("extra.mesh_{}", ++extras_);
    }
    GNATHION_TRY(const std::string bytes, bytes_of(shell.node->file));
    const std::string ext = lower(fs::path(shell.node->file).extension().string());
    const fs::path out = draft_.work / fmt::format("mesh_{}{}", i, ext);
    const bool lower_jaw = roles_[i] == "scans.mandible_mi";
    Matrix4 place = shell.place;
    if (shell.moved && !lower_jaw) place = shell.above * shell.motion * shell.above.inverse() * place;
    GNATHION_TRY(TriangleMesh mesh, parse_mesh(bytes, shell.node->file));
    if (place.isIdentity(1e-12)) {
      GNATHION_CHECK_OK(write_private(out, bytes));
      return draft_.take(roles_[i], out, "from " + how(i));
    }
    GNATHION_TRY(const Rigid3 rigid, rigid_of(place, "the transformation above " + roles_[i]));
    const fs::path moved = draft_.work / fmt::format("mesh_{}.ply", i);
    GNATHION_CHECK_OK(write_mesh(moved, transformed(rigid, mesh)));
    return draft_.take(roles_[i], moved, "from " + how(i) + ", moved into the workspace's frame");
  }

  std::string how(std::size_t i) const {
    return !role_by_keyword(*shells_[i].node).empty() ? "its keyword"
           : !role_by_label(*shells_[i].node).empty() ? "its label"
                                                      : "the workspace";
  }

  Result<Rigid3> rigid_of(const Matrix4& m, const std::string& where) const {
    const RigidityDeviation deviation = rigidity_deviation(m);
    if (!m.allFinite() || !deviation.is_rigid())
      return bad(where, fmt::format("is not a rigid motion, its determinant is {:.6g}",
                                    m.topLeftCorner<3, 3>().determinant()));
    return nearest_rigid(m);
  }

  /// T_th in the workspace's frame, which is the case's dental frame.
  Status take_motion_of_lower() {
    for (std::size_t i = 0; i < shells_.size(); ++i) {
      if (roles_[i] != "scans.mandible_mi" || !shells_[i].moved) continue;
      const Shell& s = shells_[i];
      GNATHION_TRY(const Rigid3 motion, rigid_of(s.above * s.motion * s.above.inverse(), "T_th"));
      const fs::path out = draft_.work / "T_th.json";
      GNATHION_CHECK_OK(write_json(
          out, motion_json(Motion<Dental>(motion), std::nullopt, {{"route", "workspace of dpVision"}})));
      return draft_.take("position.transform", out, "the node 'transformation' above the lower jaw");
    }
    return {};
  }

  Status take_plane(const DpNode& node, const Matrix4& place) {
    GNATHION_TRY(const Rigid3 rigid, rigid_of(place, "the transformation above a plane"));
    const Vector3 centre = rigid * Vector3(node.centre_mm[0], node.centre_mm[1], node.centre_mm[2]);
    const Vector3 normal = rigid.rotation * Vector3(node.normal[0], node.normal[1], node.normal[2]);
    if (!(normal.norm() > 1e-9)) return bad("a plane", "has no normal");
    const std::string name = node.has_keyword("cut_plane") ? "cut_plane" : fmt::format("plane_{}", ++planes_);
    draft_.made.more_toml += fmt::format(
        "\n[[plane]]\nname = \"{}\"\ncentre_mm = [{:#}, {:#}, {:#}]\nnormal = [{:#}, {:#}, {:#}]\nsize_mm = "
        "{:#}\n",
        name, centre.x(), centre.y(), centre.z(), normal.x(), normal.y(), normal.z(), node.size_mm);
    draft_.report.taken.push_back("plane: " + name);
    return {};
  }

  /// Each frame places the children anew; relative to their own place that is a motion of the mandible from
  /// MI.
  Status take_animation(const DpNode& node, const Matrix4& place) {
    if (node.frames.empty()) {
      draft_.report.notes.push_back("an animation without frames is left out");
      return {};
    }
    if (!draft_.file_of("session.motion").empty()) {
      draft_.report.notes.push_back("a second animation is left out");
      return {};
    }
    JawMotion motion;
    double time_s = 0;
    for (const DpFrame& frame : node.frames) {
      JawMotionRow row;
      row.time_s = time_s;
      row.valid = true;
      GNATHION_TRY(row.motion, rigid_of(place * frame.matrix * place.inverse(), "a frame of an animation"));
      motion.rows.push_back(row);
      time_s += frame.duration_s;
    }
    const fs::path out = draft_.work / "motion.csv";
    GNATHION_CHECK_OK(write_motion_csv(out, motion));
    return draft_.take("session.motion", out,
                       fmt::format("an animation of {} frames, {:.2f} s", motion.rows.size(), time_s));
  }

  const CaseImport& what_;
  const DpArchive* archive_;
  ImportDraft& draft_;
  std::vector<Shell> shells_;
  std::vector<std::string> roles_;
  int extras_ = 0, planes_ = 0, left_out_ = 0;
};

}  // namespace

Status import_workspace(const CaseImport& what, const DpWorkspace& workspace, const DpArchive* archive,
                        ImportDraft& draft) {
  return Importer(what, archive, draft).run(workspace);
}

}  // namespace gnathion
