#include "core/mesh_io.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <numeric>
#include <tuple>
#include <utility>

#include <fmt/format.h>

#include "core/file.h"
#include "core/mesh_edges.h"
#include "core/mesh_io_formats.h"
#include "core/triangle_polygon.h"

namespace gnathion {
namespace mesh_format {

void Polygons::add(const std::vector<std::uint32_t>& polygon, std::vector<Triangle>& triangles) {
  if (polygon.size() > 3) {
    places_.push_back({triangles.size(), corners_.size(), polygon.size()});
    corners_.insert(corners_.end(), polygon.begin(), polygon.end());
  }
  for (std::size_t k = 2; k < polygon.size(); ++k)
    triangles.push_back({polygon[0], polygon[k - 1], polygon[k]});
}

void Polygons::recut_where_not_convex(TriangleMesh& mesh) const {
  std::vector<Vector3> points;
  for (const Place& place : places_) {
    const std::uint32_t* polygon = &corners_[place.first_corner];
    points.clear();
    for (std::size_t k = 0; k < place.corners; ++k) points.push_back(mesh.vertices_mm[polygon[k]]);
    std::size_t next = place.first_triangle;
    for (const auto& [a, b, c] : triangulated_polygon(points))
      mesh.triangles[next++] = {polygon[a], polygon[b], polygon[c]};
  }
}

std::string quoted(std::string_view word) {
  std::string out = "\"";
  for (char c : word.substr(0, 30)) out += std::isprint(static_cast<unsigned char>(c)) ? c : '?';
  return out + (word.size() > 30 ? "…\"" : "\"");
}

}  // namespace mesh_format

namespace {

using namespace mesh_format;

/// Larger than anything that is scanned, in any unit, and small enough for single precision.
constexpr double kLargestCoordinate = 1e12;
constexpr double kSmallestJawMm = 35.0, kLargestJawMm = 110.0;

std::string lower_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

bool starts_with_word(std::string_view text, std::string_view word) {
  return text.size() > word.size() && text.substr(0, word.size()) == word &&
         std::isspace(static_cast<unsigned char>(text[word.size()]));
}

/// False for NaN too.
bool within(const Vector3& p, double limit) {
  return std::abs(p.x()) <= limit && std::abs(p.y()) <= limit && std::abs(p.z()) <= limit;
}

bool is_text(std::string_view bytes) {
  return std::none_of(bytes.begin(), bytes.end(), [](unsigned char c) { return c == 0 || c == 0x7f; });
}

/// A binary STL tells its own size; the name "solid" at its start means nothing then.
bool has_size_of_binary_stl(std::string_view bytes) {
  if (bytes.size() < 84) return false;
  std::uint32_t count;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  return bytes.size() == 84 + 50 * std::size_t{count};
}

bool looks_like_ascii_stl(std::string_view bytes) {
  const std::size_t start = std::min(bytes.find_first_not_of(" \t\r\n"), bytes.size());
  std::string head(bytes.substr(start, 6));
  std::transform(head.begin(), head.end(), head.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return (starts_with_word(head, "solid") || head == "solid") && is_text(bytes.substr(0, 1024));
}

bool looks_like_obj(std::string_view bytes) {
  if (!is_text(bytes.substr(0, 1024))) return false;
  TextScanner scanner(bytes.substr(0, 65536));
  while (!scanner.at_end()) {
    const std::string_view line = scanner.rest_of_line();
    if (line.empty() || line[0] == '#') continue;
    for (std::string_view word : {"v", "vn", "vt", "f", "mtllib", "usemtl", "o", "g", "s"})
      if (starts_with_word(line, word)) return true;
    return false;
  }
  return false;
}

enum class Kind { kStlBinary, kStlAscii, kPly, kObj };

/// By content first, then by the name's extension; nothing if neither tells.
std::optional<Kind> kind_of(std::string_view bytes, const std::string& name) {
  if (has_size_of_binary_stl(bytes)) return Kind::kStlBinary;
  if (starts_with_word(bytes, "ply")) return Kind::kPly;
  if (looks_like_ascii_stl(bytes)) return Kind::kStlAscii;
  const std::string extension = lower_extension(name);
  if (extension == ".stl") return Kind::kStlBinary;
  if (extension == ".obj" && is_text(bytes.substr(0, 1024))) return Kind::kObj;
  if (extension != ".ply" && looks_like_obj(bytes)) return Kind::kObj;
  return std::nullopt;
}

Result<ParsedMesh> parse_kind(Kind kind, std::string_view bytes, const std::string& name,
                              const Companion& companion) {
  switch (kind) {
    case Kind::kStlBinary:
      return parse_stl_binary(bytes, name);
    case Kind::kStlAscii:
      return parse_stl_ascii(bytes, name);
    case Kind::kPly:
      return parse_ply(bytes, name);
    case Kind::kObj:
      break;
  }
  return parse_obj(bytes, name, companion);
}

/// Drops what is no surface: triangles with a repeated index, then vertices that none uses.
void drop_useless(TriangleMesh& mesh) {
  std::vector<bool> keep(mesh.triangles.size()), used(mesh.vertices_mm.size(), false);
  bool all = true;
  for (std::size_t i = 0; i < keep.size(); ++i) {
    keep[i] = !has_repeated_index(mesh.triangles[i]);
    all = all && keep[i];
    if (keep[i])
      for (std::uint32_t v : mesh.triangles[i]) used[v] = true;
  }
  if (!all || std::find(used.begin(), used.end(), false) != used.end()) mesh = submesh(mesh, keep);
}

/// The checks that every kind of file has to pass.
Result<TriangleMesh> checked(ParsedMesh parsed, const std::string& name, bool is_stl) {
  TriangleMesh& mesh = parsed.mesh;
  if (mesh.vertices_mm.size() >= 0xffffffffu || mesh.triangles.size() >= 0xffffffffu / 3)
    return bad_input(kCannotRead, name, "more vertices or triangles than this program can number");
  if (mesh.triangles.empty()) return bad_input(kCannotRead, name, "no triangles in it");
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    const Vector3& p = mesh.vertices_mm[i];
    if (within(p, kLargestCoordinate)) continue;
    return bad_input(kCannotRead, name,
                     fmt::format("{} {} {}", is_stl ? "triangle" : "vertex", (is_stl ? i / 3 : i) + 1,
                                 p.allFinite() ? "has a coordinate beyond all measure"
                                               : "has a NaN or infinite coordinate"));
  }
  parsed.polygons.recut_where_not_convex(mesh);
  if (is_stl) mesh = welded_exactly(mesh);
  drop_useless(mesh);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    if (face_normal_scaled(mesh, i).squaredNorm() > 0.0) return std::move(mesh);
  return bad_input(kCannotRead, name, "only degenerate triangles (no area) in it");
}

Result<TriangleMesh> parse_checked(std::string_view bytes, const std::string& name,
                                   const Companion& companion) {
  if (bytes.empty()) return bad_input(kCannotRead, name, "the file is empty");
  const std::optional<Kind> kind = kind_of(bytes, name);
  if (!kind)
    return bad_input(kCannotRead, name,
                     lower_extension(name) == ".ply" ? "not a PLY file: it does not begin with \"ply\""
                                                     : "neither STL nor PLY nor OBJ by its content");
  GNATHION_TRY(ParsedMesh parsed, parse_kind(*kind, bytes, name, companion));
  return checked(std::move(parsed), name, *kind == Kind::kStlBinary || *kind == Kind::kStlAscii);
}

}  // namespace

Result<TriangleMesh> parse_mesh(const std::string& bytes, const std::string& name) {
  return parse_checked(bytes, name, [](const std::string&) { return std::nullopt; });
}

Result<TriangleMesh> read_mesh(const std::filesystem::path& path) {
  auto bytes = read_file(path);
  if (!bytes) return bad_input(kCannotRead, path.string(), bytes.error().why);
  const auto companion = [&path](const std::string& relative_name) -> std::optional<std::string> {
    auto text = read_file(path.parent_path() / relative_name);
    if (!text) return std::nullopt;
    return std::move(*text);
  };
  return parse_checked(*bytes, path.string(), companion);
}

std::string format_mesh(const TriangleMesh& mesh, MeshFormat format) {
  switch (format) {
    case MeshFormat::kStlBinary:
      return format_stl_binary(mesh);
    case MeshFormat::kStlAscii:
      return format_stl_ascii(mesh);
    case MeshFormat::kPlyBinary:
    case MeshFormat::kPlyBinaryBigEndian:
    case MeshFormat::kPlyAscii:
      return format_ply(mesh, format);
    case MeshFormat::kObj:
      break;
  }
  return format_obj(mesh);
}

Status write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh, MeshFormat format) {
  // Nothing is written that read_mesh would refuse.
  if (mesh.empty())
    return fail(ErrorCode::kInternal, "cannot write mesh", path.string(), "it has no triangles");
  for (const Vector3& p : mesh.vertices_mm)
    if (!within(p, kLargestCoordinate))
      return fail(ErrorCode::kInternal, "cannot write mesh", path.string(),
                  "it has a NaN, infinite or absurd coordinate");
  return write_file(path, format_mesh(mesh, format));
}

Status write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh) {
  const std::string extension = lower_extension(path);
  if (extension == ".stl") return write_mesh(path, mesh, MeshFormat::kStlBinary);
  if (extension == ".ply") return write_mesh(path, mesh, MeshFormat::kPlyBinary);
  if (extension == ".obj") return write_mesh(path, mesh, MeshFormat::kObj);
  return fail(ErrorCode::kUsage, "cannot write mesh", path.string(),
              "the name should end in .stl, .ply or .obj");
}

Status check_jaw_size(const TriangleMesh& mesh, const std::string& name) {
  const double extent = mesh.vertices_mm.empty() ? 0.0 : bounding_box(mesh).size_mm().maxCoeff();
  if (extent >= kSmallestJawMm && extent <= kLargestJawMm) return {};
  struct Unit {
    const char* name;
    double mm;
  };
  // Where two units are possible (3.6 to 4.3: inches or centimetres), the one that makes the arch's
  // size the more usual is named.
  constexpr double kUsualJawMm = 62.0;
  const Unit* likely = nullptr;
  constexpr Unit kUnits[] = {
      {"metres", 1000.0}, {"micrometres", 0.001}, {"inches", 25.4}, {"centimetres", 10.0}};
  const auto oddness = [&](const Unit& unit) { return std::abs(std::log(extent * unit.mm / kUsualJawMm)); };
  for (const Unit& unit : kUnits) {
    const double mm = extent * unit.mm;
    if (mm < kSmallestJawMm || mm > kLargestJawMm) continue;
    if (likely == nullptr || oddness(unit) < oddness(*likely)) likely = &unit;
  }
  return bad_input("cannot use as a jaw", name,
                   fmt::format("its largest extent is {:.4g} units, a jaw's is {:.0f} to {:.0f} mm: {}",
                               extent, kSmallestJawMm, kLargestJawMm,
                               likely ? fmt::format("probably it is in {}", likely->name)
                                      : std::string("not a jaw in millimetres")));
}

namespace {

/// By vertex, a number that vertices at the same place share.
std::vector<std::uint32_t> places_of(const TriangleMesh& mesh) {
  const auto& p = mesh.vertices_mm;
  std::vector<std::uint32_t> order(p.size()), place(p.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::tie(p[a].x(), p[a].y(), p[a].z()) < std::tie(p[b].x(), p[b].y(), p[b].z());
  });
  for (std::size_t n = 0; n < order.size(); ++n)
    place[order[n]] = n > 0 && p[order[n]] == p[order[n - 1]] ? place[order[n - 1]] : order[n];
  return place;
}

/// Without triangles that are there already, whichever way they face: some exports hold their shell twice.
TriangleMesh without_repeats(TriangleMesh mesh) {
  const std::vector<std::uint32_t> place = places_of(mesh);
  std::vector<std::pair<Triangle, std::uint32_t>> all(mesh.triangles.size());
  for (std::uint32_t t = 0; t < all.size(); ++t) {
    Triangle corners = mesh.triangles[t];
    for (std::uint32_t& v : corners) v = place[v];
    std::sort(corners.begin(), corners.end());
    all[t] = {corners, t};
  }
  std::sort(all.begin(), all.end());
  std::vector<bool> keep(all.size(), true);
  bool any = false;
  for (std::size_t n = 1; n < all.size(); ++n)
    if (all[n].first == all[n - 1].first) {
      keep[all[n].second] = false;
      any = true;
    }
  return any ? submesh(mesh, keep) : mesh;
}

}  // namespace

Result<TriangleMesh> read_jaw(const std::filesystem::path& path) {
  GNATHION_TRY(TriangleMesh mesh, read_mesh(path));
  GNATHION_CHECK_OK(check_jaw_size(mesh, path.string()));
  return without_repeats(std::move(mesh));
}

}  // namespace gnathion
