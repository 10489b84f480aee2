#include "acquisition/scanner/scan_ply.h"

#include <fmt/format.h>

#include <cstring>
#include <string_view>

#include "core/check.h"

namespace gnathion {
namespace {

template <class T>
void append(std::string& out, T value) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);  // hosts are little-endian
  out.append(bytes, sizeof value);
}

constexpr const char* kWhat = "cannot read deviations";

/// What format_scan_ply writes: an optional colour between coordinates and deviation.
struct Layout {
  std::size_t vertices = 0, stride = 0, deviation_at = 0, body = 0;
};

Result<Layout> layout_of(std::string_view bytes, const std::string& name) {
  const std::size_t end = bytes.find("end_header\n");
  if (bytes.substr(0, 4) != "ply\n" || end == std::string_view::npos ||
      bytes.find("format binary_little_endian 1.0\n") != 4)
    return bad_input(kWhat, name, "not a binary little-endian PLY");
  Layout layout;
  layout.body = end + 11;
  bool in_vertex = false, found = false;
  for (std::size_t at = 0; at < end;) {
    const std::size_t stop = bytes.find('\n', at);
    const std::string line(bytes.substr(at, stop - at));
    at = stop + 1;
    if (line.rfind("element vertex ", 0) == 0) {
      in_vertex = true;
      layout.vertices = std::strtoull(line.c_str() + 15, nullptr, 10);
    } else if (line.rfind("element ", 0) == 0) {
      if (!in_vertex) return bad_input(kWhat, name, "vertices do not come first");
      break;
    } else if (in_vertex && line.rfind("property ", 0) == 0) {
      const std::string type = line.substr(9, line.find(' ', 9) - 9);
      const std::size_t size = type == "double" ? 8 : type == "float" ? 4 : type == "uchar" ? 1 : 0;
      if (size == 0) return bad_input(kWhat, name, "a vertex property of type " + type);
      if (line == "property float deviation") {
        found = true;
        layout.deviation_at = layout.stride;
      }
      layout.stride += size;
    }
  }
  if (!found) return bad_input(kWhat, name, "its vertices have no 'deviation'");
  if (layout.vertices > (bytes.size() - layout.body) / layout.stride)
    return bad_input(kWhat, name, "truncated");
  return layout;
}

}  // namespace

std::string format_scan_ply(const ScanSurface& surface) {
  const TriangleMesh& mesh = surface.mesh;
  GNATHION_CHECK(surface.deviation_mm.size() == mesh.vertices_mm.size());
  const bool coloured = mesh.colors_rgb.size() == mesh.vertices_mm.size() && !mesh.colors_rgb.empty();
  std::string out = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment Gnathion, millimetres; deviation: 1 sigma along the "
      "normal\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n{}"
      "property float deviation\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.vertices_mm.size(),
      coloured ? "property uchar red\nproperty uchar green\nproperty uchar blue\n" : "",
      mesh.triangles.size());
  out.reserve(out.size() + mesh.vertices_mm.size() * 31 + mesh.triangles.size() * 13);
  for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
    for (int k = 0; k < 3; ++k) append(out, mesh.vertices_mm[v][k]);
    if (coloured)
      for (const std::uint8_t c : mesh.colors_rgb[v]) append(out, c);
    append(out, static_cast<float>(surface.deviation_mm[v]));
  }
  for (const Triangle& t : mesh.triangles) {
    append(out, std::uint8_t{3});
    for (const std::uint32_t v : t) append(out, static_cast<std::int32_t>(v));
  }
  return out;
}

Result<std::vector<double>> scan_ply_deviation(const std::string& bytes, const std::string& name) {
  GNATHION_TRY(const Layout layout, layout_of(bytes, name));
  std::vector<double> deviations(layout.vertices);
  for (std::size_t v = 0; v < layout.vertices; ++v) {
    float value;
    std::memcpy(&value, bytes.data() + layout.body + v * layout.stride + layout.deviation_at, sizeof value);
    deviations[v] = static_cast<double>(value);
  }
  return deviations;
}

}  // namespace gnathion
