// RIG.toml and the files of its bodies.
#include <fmt/format.h>
#define TOML_EXCEPTIONS \
  0  // as everywhere: toml++ built both ways in one program has two layouts of one class
#include <toml++/toml.h>

#include "core/camera_model.h"
#include "core/file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot read rig";

Result<toml::table> parse_toml(const fs::path& path) {
  GNATHION_TRY(const std::string text, read_file(path));
  toml::parse_result parsed = toml::parse(text, path.string());
  if (!parsed)
    return bad_input(kWhat, path.string(),
                     fmt::format("line {}: {}", parsed.error().source().begin.line,
                                 std::string(parsed.error().description())));
  return std::move(parsed).table();
}

Result<double> number(const toml::table& t, const char* key, const std::string& where) {
  const auto value = t[key].value<double>();
  if (!value || !std::isfinite(*value))
    return bad_input(kWhat, where, fmt::format("key '{}' is missing or not a number", key));
  return *value;
}

Result<std::vector<double>> numbers(const toml::node_view<const toml::node>& node, std::size_t count,
                                    const std::string& where, const std::string& key) {
  std::vector<double> values;
  if (const auto* array = node.as_array())
    for (const auto& item : *array)
      if (const auto v = item.value<double>(); v && std::isfinite(*v)) values.push_back(*v);
  if (values.size() != count || node.as_array()->size() != count)
    return bad_input(kWhat, where, fmt::format("key '{}' needs {} finite numbers", key, count));
  return values;
}

Result<RigCamera> parse_camera(const toml::table& t, const std::string& where) {
  RigCamera camera;
  const auto name = t["name"].value<std::string>();
  if (!name || name->empty()) return bad_input(kWhat, where, "a [[camera]] has no name");
  camera.name = *name;
  CameraModel& m = camera.model;
  const std::pair<const char*, double*> keys[] = {
      {"fx_px", &m.fx_px}, {"fy_px", &m.fy_px}, {"cx_px", &m.cx_px}, {"cy_px", &m.cy_px}, {"k1", &m.k1},
      {"k2", &m.k2},       {"p1", &m.p1},       {"p2", &m.p2},       {"k3", &m.k3}};
  for (const auto& [key, target] : keys) {
    GNATHION_TRY(*target, number(t, key, where));
  }
  GNATHION_TRY(const double width, number(t, "width_px", where));
  GNATHION_TRY(const double height, number(t, "height_px", where));
  if (width < 1 || height < 1 || width > 65536 || height > 65536 || m.fx_px <= 0 || m.fy_px <= 0)
    return bad_input(kWhat, where, fmt::format("camera '{}' has an impossible size or focal length", *name));
  m.width_px = static_cast<int>(width);
  m.height_px = static_cast<int>(height);
  GNATHION_TRY(const auto pose, numbers(t["rig_from_camera"], 16, where, "rig_from_camera"));
  const Matrix4 matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(pose.data());
  const RigidityDeviation d = rigidity_deviation(matrix);
  if (!d.is_rigid())
    return bad_input(kWhat, where,
                     fmt::format("rig_from_camera of '{}' is not rigid: determinant {:.6f}, "
                                 "orthogonality off by {:.2g}",
                                 *name, d.determinant, d.orthogonality));
  camera.rig_from_camera = nearest_rigid(matrix);
  if (t.contains("focal_sigma_px")) {
    GNATHION_TRY(camera.focal_sigma_px, number(t, "focal_sigma_px", where));
    if (!(*camera.focal_sigma_px > 0))
      return bad_input(kWhat, where, fmt::format("focal_sigma_px of '{}' is not positive", *name));
  }
  if (t.contains("line_time_ns")) {
    GNATHION_TRY(camera.line_time_ns, number(t, "line_time_ns", where));
    if (!(std::abs(*camera.line_time_ns) * height <= 1e9))
      return bad_input(kWhat, where,
                       fmt::format("line_time_ns of '{}' makes a frame of more than a second", *name));
  }
  return camera;
}

Result<std::vector<RigCamera>> parse_cameras(const toml::table& t, const std::string& where) {
  std::vector<RigCamera> cameras;
  const auto* entries = t["camera"].as_array();
  if (!entries || entries->empty()) return bad_input(kWhat, where, "no [[camera]]");
  for (const auto& node : *entries) {
    if (!node.is_table()) return bad_input(kWhat, where, "[[camera]] is not a table");
    GNATHION_TRY(RigCamera camera, parse_camera(*node.as_table(), where));
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

std::string body_toml(const TaggedBody& body) {
  std::string text = fmt::format(
      "# A rigid body with AprilTags. Corners in the body's own frame, mm, in the order lower left,\n"
      "# lower right, upper right, upper left of the upright tag seen from its front.\n"
      "name = \"{}\"\nfamily = \"{}\"\n",
      body.name, body.family);
  if (body.up)
    text +=
        fmt::format("up = [{:.17g}, {:.17g}, {:.17g}]  # the patient's cranial direction when it is worn\n",
                    body.up->x(), body.up->y(), body.up->z());
  for (const BodyTag& tag : body.tags) {
    text += fmt::format("\n[[tag]]\nid = {}\ncorners_mm = [", tag.id);
    for (const Vector3& c : tag.corners_in_body_mm)
      text += fmt::format("\n  [{:.17g}, {:.17g}, {:.17g}],", c.x() + 0.0, c.y() + 0.0, c.z() + 0.0);
    text += "\n]\n";
  }
  return text;
}

std::string camera_entry(const RigCamera& camera) {
  const CameraModel& m = camera.model;
  std::string text = fmt::format(
      "\n[[camera]]\nname = \"{}\"  # also its stream in recordings\nwidth_px = {}\nheight_px = {}\n"
      "fx_px = {:.17g}\nfy_px = {:.17g}\ncx_px = {:.17g}\ncy_px = {:.17g}\n"
      "k1 = {:.17g}\nk2 = {:.17g}\np1 = {:.17g}\np2 = {:.17g}\nk3 = {:.17g}\nrig_from_camera = [",
      camera.name, m.width_px, m.height_px, m.fx_px, m.fy_px, m.cx_px, m.cy_px, m.k1, m.k2, m.p1, m.p2, m.k3);
  const Matrix4 pose = camera.rig_from_camera.matrix();
  for (int r = 0; r < 4; ++r)
    text += fmt::format("\n  {:.17g}, {:.17g}, {:.17g}, {:.17g},", pose(r, 0), pose(r, 1), pose(r, 2),
                        pose(r, 3));
  text += "\n]\n";
  if (camera.focal_sigma_px) text += fmt::format("focal_sigma_px = {:.4g}\n", *camera.focal_sigma_px);
  if (camera.line_time_ns) text += fmt::format("line_time_ns = {:.17g}\n", *camera.line_time_ns);
  return text;
}

}  // namespace

std::string rig_camera_toml(const RigCamera& camera) {
  return camera_entry(camera);
}

Result<TaggedBody> read_body(const fs::path& path) {
  GNATHION_TRY(const toml::table t, parse_toml(path));
  const std::string where = path.string();
  TaggedBody body;
  body.name = t["name"].value_or(std::string());
  body.family = t["family"].value_or(std::string("tag36h11"));
  if (body.family != "tag36h11")
    return bad_input(kWhat, where, "tag family '" + body.family + "' is not supported");
  const auto* tags = t["tag"].as_array();
  if (body.name.empty() || !tags || tags->empty())
    return bad_input(kWhat, where, "needs a name and [[tag]] entries");
  for (const auto& node : *tags) {
    const auto* tag_table = node.as_table();
    const auto id = tag_table ? (*tag_table)["id"].value<std::int64_t>() : std::nullopt;
    if (!id || *id < 0 || *id > 586) return bad_input(kWhat, where, "a [[tag]] has no id in 0..586");
    BodyTag tag;
    tag.id = static_cast<int>(*id);
    for (const BodyTag& other : body.tags)
      if (other.id == tag.id) return bad_input(kWhat, where, fmt::format("tag {} stands twice", tag.id));
    const auto corners = (*tag_table)["corners_mm"];
    if (!corners.as_array() || corners.as_array()->size() != 4)
      return bad_input(kWhat, where, fmt::format("tag {} needs four corners_mm", tag.id));
    for (std::size_t k = 0; k < 4; ++k) {
      GNATHION_TRY(const auto xyz,
                   numbers(corners[k], 3, where, fmt::format("corners_mm of tag {}", tag.id)));
      tag.corners_in_body_mm[k] = {xyz[0], xyz[1], xyz[2]};
    }
    body.tags.push_back(tag);
  }
  if (t.contains("up")) {
    GNATHION_TRY(const auto up, numbers(t["up"], 3, where, "up"));
    body.up = Vector3(up[0], up[1], up[2]);
    if (body.up->norm() < 1e-6) return bad_input(kWhat, where, "key 'up' has no direction");
  }
  return body;
}

Result<std::vector<RigCamera>> read_rig_cameras(const fs::path& path) {
  GNATHION_TRY(const toml::table t, parse_toml(path));
  return parse_cameras(t, path.string());
}

Result<Rig> read_rig(const fs::path& path) {
  GNATHION_TRY(const toml::table t, parse_toml(path));
  const std::string where = path.string();
  Rig rig;
  GNATHION_TRY(rig.cameras, parse_cameras(t, where));
  const auto bow = t["bow"].value<std::string>(), head = t["head_frame"].value<std::string>();
  if (!bow || !head) return bad_input(kWhat, where, "needs 'bow' and 'head_frame' file names");
  GNATHION_TRY(rig.bow, read_body(path.parent_path() / *bow));
  GNATHION_TRY(rig.head_frame, read_body(path.parent_path() / *head));
  for (const BodyTag& a : rig.bow.tags)
    for (const BodyTag& b : rig.head_frame.tags)
      if (a.id == b.id) return bad_input(kWhat, where, fmt::format("tag {} is on both bodies", a.id));
  return rig;
}

Status write_rig(const fs::path& path, const Rig& rig) {
  std::string text =
      "# The camera rig and the two tagged bodies. Intrinsics: pinhole with Brown-Conrady distortion\n"
      "# (OpenCV's order), pixel (0, 0) is the centre of the upper left pixel. rig_from_camera is\n"
      "# row-major, mm; the rig's frame is the first camera's.\n"
      "bow = \"bow.toml\"\nhead_frame = \"head_frame.toml\"\n";
  for (const RigCamera& camera : rig.cameras) text += camera_entry(camera);
  GNATHION_CHECK_OK(write_file(path, text));
  GNATHION_CHECK_OK(write_file(path.parent_path() / "bow.toml", body_toml(rig.bow)));
  return write_file(path.parent_path() / "head_frame.toml", body_toml(rig.head_frame));
}

Status write_body(const fs::path& path, const TaggedBody& body, const std::string& comment) {
  std::string head;
  if (!comment.empty()) head = "# " + comment;
  for (std::size_t at = 0; (at = head.find('\n', at)) != std::string::npos; at += 3)
    head.replace(at, 1, "\n# ");
  if (!head.empty()) head += "\n";
  return write_file(path, head + body_toml(body));
}

}  // namespace gnathion
