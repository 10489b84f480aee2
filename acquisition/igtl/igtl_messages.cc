#include "acquisition/igtl/igtl_messages.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

#include "acquisition/igtl/igtl_bytes.h"
#include "acquisition/luma.h"

namespace gnathion::igtl {
namespace {

constexpr const char* kWhat = "cannot read OpenIGTLink message";
/// Trackers send rotations that they rounded or filtered: recorded ones of the PLUS toolkit deviate by up to
/// 5e-4. Twice the size of a scale of 1 ‰ is no rotation any more.
constexpr double kRotationTolerance = 2e-3;

tl::unexpected<Error> refuse(const std::string& type, std::string why) {
  return bad_input(kWhat, type, std::move(why));
}

/// Judges a matrix and takes the nearest rotation; of an instrument without orientation the position alone.
void set_pose(ToolPose& tool, const Matrix4& m) {
  const Vector3 position = m.topRightCorner<3, 1>();
  if (tool.position_only && position.allFinite()) {
    tool.reference_from_tool = Rigid3::from_translation(position);
    return;
  }
  const RigidityDeviation deviation = rigidity_deviation(m);
  if (!deviation.finite)
    tool.fault = "not finite";
  else if (!deviation.is_rigid(kRotationTolerance))
    tool.fault = "not a rotation";  // one reason for the ledger, whatever the numbers
  else
    tool.reference_from_tool = nearest_rigid(m);
}

/// 12 numbers, three columns of the rotation, then the translation in mm.
Matrix4 matrix_at(std::string_view b, std::size_t at) {
  Matrix4 m = Matrix4::Identity();
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 3; ++row)
      m(row, column) = f32(b, at + 4 * static_cast<std::size_t>(3 * column + row));
  return m;
}

Result<Body> decode_transform(std::string_view b) {
  if (b.size() != 48) return refuse("TRANSFORM", fmt::format("{} bytes; it has 48", b.size()));
  Poses poses;
  poses.tools.resize(1);
  set_pose(poses.tools[0], matrix_at(b, 0));
  return Body(std::move(poses));
}

/// TDATA: 12 matrix entries an instrument; QTDATA: position (mm) and quaternion x y z w.
Result<Body> decode_tracking(const std::string& type, std::string_view b, const DecodeOptions& options) {
  const bool quaternions = type == "QTDATA";
  const std::size_t each = quaternions ? 50 : 70;
  if (b.size() % each != 0)
    return refuse(type, fmt::format("{} bytes; each instrument has {}", b.size(), each));
  Poses poses;
  for (std::size_t at = 0; at < b.size(); at += each) {
    ToolPose tool;
    tool.name = text_field(b, at, 20);
    tool.position_only = b[at + 20] == 3;
    if (quaternions) {
      const Vector3 position(f32(b, at + 22), f32(b, at + 26), f32(b, at + 30));
      const Eigen::Quaterniond q(f32(b, at + 46), f32(b, at + 34), f32(b, at + 38), f32(b, at + 42));
      Matrix4 m = Matrix4::Identity();
      m.topRightCorner<3, 1>() = position;
      const bool usable = options.normalise_quaternions ? q.norm() > 0.1 && q.norm() < 1e3
                                                        : std::abs(q.norm() - 1) < kRotationTolerance;
      if (!usable && !tool.position_only)  // also for NaN
        tool.fault = "not a unit quaternion";
      else if (usable)
        m.topLeftCorner<3, 3>() = q.normalized().toRotationMatrix();
      if (tool.fault.empty()) set_pose(tool, m);
    } else {
      set_pose(tool, matrix_at(b, at + 22));
    }
    poses.tools.push_back(std::move(tool));
  }
  return Body(std::move(poses));
}

const char* scalar_name(int type) {
  switch (type) {
    case 2:
      return "int8";
    case 3:
      return "uint8";
    case 4:
      return "int16";
    case 5:
      return "uint16";
    case 6:
      return "int32";
    case 7:
      return "uint32";
    case 10:
      return "float32";
    case 11:
      return "float64";
  }
  return "unknown scalars";
}

std::uint8_t grey(const char* rgb) {
  return luma_from_rgb(static_cast<std::uint8_t>(rgb[0]), static_cast<std::uint8_t>(rgb[1]),
                       static_cast<std::uint8_t>(rgb[2]));
}

Result<Body> decode_image(std::string_view b) {
  constexpr std::size_t kHead = 72;
  constexpr const char* type = "IMAGE";
  if (b.size() < kHead)
    return refuse(type, fmt::format("{} bytes; its header alone has {}", b.size(), kHead));
  const std::size_t components = static_cast<unsigned char>(b[2]);
  const int scalars = static_cast<unsigned char>(b[3]), coordinates = static_cast<unsigned char>(b[5]);
  std::array<std::size_t, 3> size{}, offset{}, part{};
  for (std::size_t i = 0; i < 3; ++i) {
    size[i] = u16(b, 6 + 2 * i);
    offset[i] = u16(b, 60 + 2 * i);
    part[i] = u16(b, 66 + 2 * i);
  }
  if (scalars != 3)
    return refuse(type, fmt::format("{}; 8-bit grey or colour is read", scalar_name(scalars)));
  if (components != 1 && components != 3 && components != 4)
    return refuse(type, fmt::format("{} components; 1, 3 or 4 are read", components));
  if (size[2] != 1) return refuse(type, fmt::format("a volume of {} slices; one is read", size[2]));
  if (offset != std::array<std::size_t, 3>{} || part != size) return refuse(type, "a part of an image");
  const std::size_t pixels = size[0] * size[1];
  if (pixels == 0) return refuse(type, "no pixels");
  if (b.size() != kHead + pixels * components)
    return refuse(type, fmt::format("{}×{} pixels of {} components in {} bytes", size[0], size[1], components,
                                    b.size() - kHead));
  Picture picture;
  picture.lps = coordinates == 2;
  picture.image.width_px = static_cast<int>(size[0]);
  picture.image.height_px = static_cast<int>(size[1]);
  picture.image.pixels.resize(pixels);
  const char* from = b.data() + kHead;
  for (std::size_t i = 0; i < pixels; ++i)
    picture.image.pixels[i] =
        components == 1 ? static_cast<std::uint8_t>(from[i]) : grey(from + i * components);
  return Body(std::move(picture));
}

/// Cells as (n, i1 … in) in 32 bits; gives false where they do not fill `b` or name points that are not
/// there.
template <class Take>
bool for_each_cell(std::string_view b, std::uint32_t cells, std::uint32_t points, const Take& take) {
  std::size_t at = 0;
  std::vector<std::uint32_t> corners;
  for (std::uint32_t cell = 0; cell < cells; ++cell) {
    if (b.size() - at < 4) return false;
    const std::size_t n = u32(b, at);
    at += 4;
    if ((b.size() - at) / 4 < n) return false;
    corners.resize(n);
    for (std::size_t i = 0; i < n; ++i, at += 4)
      if ((corners[i] = u32(b, at)) >= points) return false;
    take(corners);
  }
  return at == b.size();
}

Result<Body> decode_polydata(std::string_view b) {
  constexpr std::size_t kHead = 40;
  constexpr const char* type = "POLYDATA";
  if (b.size() < kHead)
    return refuse(type, fmt::format("{} bytes; its header alone has {}", b.size(), kHead));
  const std::uint32_t points = u32(b, 0);
  const std::uint64_t point_bytes = std::uint64_t{points} * 12;
  const std::uint64_t vertex_bytes = u32(b, 8), line_bytes = u32(b, 16), polygon_bytes = u32(b, 24),
                      strip_bytes = u32(b, 32);
  if (kHead + point_bytes + vertex_bytes + line_bytes + polygon_bytes + strip_bytes > b.size())
    return refuse(type, fmt::format("{} points and their cells do not fit into {} bytes", points, b.size()));
  TriangleMesh mesh;
  mesh.vertices_mm.reserve(points);
  for (std::size_t i = 0; i < points; ++i) {
    const std::size_t at = kHead + 12 * i;
    mesh.vertices_mm.emplace_back(f32(b, at), f32(b, at + 4), f32(b, at + 8));
    if (!mesh.vertices_mm.back().allFinite()) return refuse(type, fmt::format("point {} is not finite", i));
  }
  const std::string_view cells = b.substr(kHead + point_bytes + vertex_bytes + line_bytes);
  const auto polygon = [&](const std::vector<std::uint32_t>& c) {
    for (std::size_t i = 2; i < c.size(); ++i) mesh.triangles.push_back({c[0], c[i - 1], c[i]});
  };
  const auto strip = [&](const std::vector<std::uint32_t>& c) {
    for (std::size_t i = 2; i < c.size(); ++i) {
      const bool odd = i % 2 == 1;  // every other triangle of a strip is wound the other way
      mesh.triangles.push_back({c[i - 2], c[odd ? i : i - 1], c[odd ? i - 1 : i]});
    }
  };
  if (!for_each_cell(cells.substr(0, polygon_bytes), u32(b, 20), points, polygon) ||
      !for_each_cell(cells.substr(polygon_bytes, strip_bytes), u32(b, 28), points, strip))
    return refuse(type, "polygons and their sizes do not agree");
  if (mesh.triangles.empty()) return refuse(type, "no polygons: points and lines are no surface");
  return Body(std::move(mesh));
}

Result<Body> decode_status(std::string_view b) {
  if (b.size() < 30) return refuse("STATUS", fmt::format("{} bytes; it has 30 at least", b.size()));
  State state;
  state.code = u16(b, 0);
  state.subcode = static_cast<std::int64_t>(u64(b, 2));
  state.name = text_field(b, 10, 20);
  state.text = text_field(b, 30, b.size() - 30);
  return Body(std::move(state));
}

}  // namespace

bool is_read(std::string_view type) {
  for (const char* known : {"TRANSFORM", "TDATA", "QTDATA", "IMAGE", "POLYDATA", "STATUS"})
    if (type == known) return true;
  return false;
}

Result<Body> decode(const std::string& type, std::string_view content, const DecodeOptions& options) {
  if (type == "TRANSFORM") return decode_transform(content);
  if (type == "TDATA" || type == "QTDATA") return decode_tracking(type, content, options);
  if (type == "IMAGE") return decode_image(content);
  if (type == "POLYDATA") return decode_polydata(content);
  if (type == "STATUS") return decode_status(content);
  return refuse(type, "this type is not read");
}

std::string status_name(std::uint16_t code) {
  static constexpr std::array<const char*, 20> names = {"invalid packet",
                                                        "OK",
                                                        "unknown error",
                                                        "panic",
                                                        "not found",
                                                        "access denied",
                                                        "busy",
                                                        "connection lost",
                                                        "overflow",
                                                        "checksum error",
                                                        "configuration error",
                                                        "not enough resources",
                                                        "unknown instruction",
                                                        "not ready",
                                                        "manual mode",
                                                        "disabled",
                                                        "not present",
                                                        "version unknown",
                                                        "hardware failure",
                                                        "shutting down"};
  return code < names.size() ? names[code] : fmt::format("status {}", code);
}

}  // namespace gnathion::igtl
