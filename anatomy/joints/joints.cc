#include "anatomy/joints/joints.h"

#include <Eigen/Eigenvalues>
#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "core/transform_io.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr double kHeadMm = 8.0;         ///< height of the condylar head
constexpr double kHeadAcrossMm = 14.0;  ///< nothing of it lies farther from its top

/// condyle_left.stl and so on; an empty path where there is none.
fs::path mesh_file(const fs::path& folder, const std::string& bone, Side side) {
  for (const char* extension : {".stl", ".ply", ".obj"}) {
    const fs::path file = folder / (bone + "_" + side_name(side) + extension);
    std::error_code ec;
    if (fs::is_regular_file(file, ec)) return file;
  }
  return {};
}

Result<std::optional<Joint>> read_side(const fs::path& folder, Side side, const Vector3& up,
                                       const Vector3& left) {
  const fs::path condyle = mesh_file(folder, "condyle", side), fossa = mesh_file(folder, "fossa", side);
  if (condyle.empty() && fossa.empty()) return std::optional<Joint>();
  if (condyle.empty() || fossa.empty())
    return bad_input("cannot read joint", (condyle.empty() ? fossa : condyle).string(),
                     std::string("its ") + (condyle.empty() ? "condyle" : "fossa") + " is not beside it");
  Joint joint;
  joint.side = side;
  GNATHION_TRY(joint.condyle, read_mesh(condyle));
  GNATHION_TRY(joint.fossa, read_mesh(fossa));
  const double size = bounding_box(joint.condyle).size_mm().maxCoeff();
  if (size < 5.0 || size > 200.0)
    return bad_input("cannot read joint", condyle.string(), "its size is no condyle's in millimetres");
  const CondylarPoles poles = condylar_poles(joint.condyle, side, up, left);
  joint.medial_pole_mm = poles.medial_mm;
  joint.lateral_pole_mm = poles.lateral_mm;
  return std::optional(std::move(joint));
}

}  // namespace

CondylarPoles condylar_poles(const TriangleMesh& condyle, Side side, const Vector3& up, const Vector3& left) {
  double top = -1e300;
  Vector3 highest = Vector3::Zero();
  for (const Vector3& v : condyle.vertices_mm)
    if (up.dot(v) > top) top = up.dot(v), highest = v;
  const auto level = [&](const Vector3& v) { return Vector3(v - up.dot(v) * up); };
  std::vector<Vector3> head;
  for (const Vector3& v : condyle.vertices_mm)
    if (up.dot(v) > top - kHeadMm && level(v - highest).norm() < kHeadAcrossMm) head.push_back(v);
  if (head.empty()) return {};
  Vector3 mean = Vector3::Zero();
  for (const Vector3& v : head) mean += v / static_cast<double>(head.size());
  Matrix3 spread = Matrix3::Zero();
  for (const Vector3& v : head) spread += level(v - mean) * level(v - mean).transpose();
  Vector3 axis = Eigen::SelfAdjointEigenSolver<Matrix3>(spread).eigenvectors().col(2);
  if (std::abs(axis.dot(left)) < 0.7) axis = left;  // no head is longer from front to back
  if (axis.dot(left) < 0.0) axis = -axis;
  const auto farther_left = [&](const Vector3& a, const Vector3& b) { return axis.dot(a) < axis.dot(b); };
  const auto [right_end, left_end] = std::minmax_element(head.begin(), head.end(), farther_left);
  return side == Side::kLeft ? CondylarPoles{*right_end, *left_end} : CondylarPoles{*left_end, *right_end};
}

bool holds_joint_meshes(const fs::path& folder) {
  for (const Side side : {Side::kLeft, Side::kRight})
    for (const char* bone : {"condyle", "fossa"})
      if (!mesh_file(folder, bone, side).empty()) return true;
  return false;
}

Result<Joints> read_joint_meshes(const fs::path& folder, const Vector3& up, const Vector3& left) {
  Joints joints;
  joints.source = "meshes";  // a folder may bear a patient's name
  GNATHION_TRY(joints.left, read_side(folder, Side::kLeft, up, left));
  GNATHION_TRY(joints.right, read_side(folder, Side::kRight, up, left));
  if (joints.empty())
    return bad_input("cannot read joint", folder.string(),
                     "neither condyle_left nor condyle_right with its fossa");
  const fs::path facts = folder / "joints.json";
  std::error_code ec;
  if (!fs::is_regular_file(facts, ec)) return joints;
  GNATHION_TRY(const nlohmann::json j, read_json(facts));
  if (!j.is_object() || j.value("kind", nlohmann::json()) != "joints")
    return bad_input("cannot read joint", facts.string(), "not a file of kind joints");
  if (j.contains("source") && j["source"].is_string()) joints.source = j["source"].get<std::string>();
  if (j.contains("surface_sigma_mm") && j["surface_sigma_mm"].is_number())
    joints.surface_sigma_mm = j["surface_sigma_mm"].get<double>();
  if (j.contains("condyle_covariance") && !j["condyle_covariance"].is_null()) {
    GNATHION_TRY(joints.condyle_covariance, covariance_from_json(j["condyle_covariance"], facts.string()));
  }
  if (j.contains("fossa_covariance") && !j["fossa_covariance"].is_null()) {
    GNATHION_TRY(joints.fossa_covariance, covariance_from_json(j["fossa_covariance"], facts.string()));
  }
  joints.mi_assumed = j.value("mi_assumed", nlohmann::json()) == true;
  if (j.contains("warnings") && j["warnings"].is_array())
    for (const auto& w : j["warnings"])
      if (w.is_string()) joints.warnings.push_back(w.get<std::string>());
  return joints;
}

}  // namespace gnathion
