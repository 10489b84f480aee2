#include "acquisition/igtl/igtl_writer.h"

#include <bit>

#include "acquisition/igtl/igtl_bytes.h"

namespace gnathion::igtl {
namespace {

void append_f32(std::string& out, double value) {
  append_big_endian(out, std::bit_cast<std::uint32_t>(static_cast<float>(value)), 4);
}

void append_text(std::string& out, std::string text, std::size_t bytes) {
  text.resize(bytes, '\0');
  out += text;
}

/// The rotation column by column, then the translation.
void append_pose(std::string& out, const Rigid3& pose) {
  for (int column = 0; column < 3; ++column)
    for (int row = 0; row < 3; ++row) append_f32(out, pose.rotation(row, column));
  for (int row = 0; row < 3; ++row) append_f32(out, pose.translation_mm[row]);
}

}  // namespace

std::uint64_t timestamp_of(HostTime time) {
  if (time.ns <= 0) return 0;
  const auto ns = static_cast<std::uint64_t>(time.ns);
  const std::uint64_t seconds = ns / 1'000'000'000, rest = ns % 1'000'000'000;
  return seconds << 32 | (rest << 32) / 1'000'000'000;
}

std::string transform_body(const Rigid3& reference_from_body) {
  std::string body;
  append_pose(body, reference_from_body);
  return body;
}

std::string tdata_body(const std::vector<ToolPose>& tools) {
  constexpr std::uint64_t kSixDegrees = 2;
  std::string body;
  for (const ToolPose& tool : tools) {
    append_text(body, tool.name, 20);
    append_big_endian(body, kSixDegrees, 1);
    append_big_endian(body, 0, 1);
    append_pose(body, tool.reference_from_tool);
  }
  return body;
}

std::string tracking_reply_body(bool granted) {
  return std::string(1, granted ? '\0' : '\1');
}

std::string status_body(std::uint16_t code, std::int64_t subcode, std::string name, std::string_view text) {
  std::string body;
  append_big_endian(body, code, 2);
  append_big_endian(body, static_cast<std::uint64_t>(subcode), 8);
  append_text(body, std::move(name), 20);
  body += text;
  body += '\0';
  return body;
}

std::string image_body(const Image8& image) {
  constexpr std::uint64_t kVersion = 1, kUint8 = 3, kLittleEndian = 2, kRas = 1;
  std::string body;
  append_big_endian(body, kVersion, 2);
  append_big_endian(body, 1, 1);  // component
  append_big_endian(body, kUint8, 1);
  append_big_endian(body, kLittleEndian, 1);
  append_big_endian(body, kRas, 1);
  const std::uint64_t size[3] = {static_cast<std::uint64_t>(image.width_px),
                                 static_cast<std::uint64_t>(image.height_px), 1};
  for (const std::uint64_t n : size) append_big_endian(body, n, 2);
  append_pose(body, Rigid3::identity());
  for (int i = 0; i < 3; ++i) append_big_endian(body, 0, 2);  // the whole image is sent
  for (const std::uint64_t n : size) append_big_endian(body, n, 2);
  body.append(reinterpret_cast<const char*>(image.pixels.data()), image.pixels.size());
  return body;
}

std::string polydata_body(const TriangleMesh& mesh) {
  constexpr std::uint64_t kCellBytes = 16;
  std::string body;
  body.reserve(40 + 12 * mesh.vertices_mm.size() + kCellBytes * mesh.triangles.size());
  const std::uint64_t polygons = mesh.triangles.size();
  // Points; then count and bytes of vertices, lines, polygons and strips; then attributes.
  for (const std::uint64_t n : {std::uint64_t{mesh.vertices_mm.size()}, std::uint64_t{0}, std::uint64_t{0},
                                std::uint64_t{0}, std::uint64_t{0}, polygons, polygons * kCellBytes,
                                std::uint64_t{0}, std::uint64_t{0}, std::uint64_t{0}})
    append_big_endian(body, n, 4);
  for (const Vector3& v : mesh.vertices_mm)
    for (int i = 0; i < 3; ++i) append_f32(body, v[i]);
  for (const Triangle& t : mesh.triangles) {
    append_big_endian(body, 3, 4);
    for (const auto corner : t) append_big_endian(body, static_cast<std::uint64_t>(corner), 4);
  }
  return body;
}

}  // namespace gnathion::igtl
