// Wavefront OBJ: vertices (with colours where exporters put them behind the coordinates), polygons of every
// index form, and the texture that the material of most faces refers to.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include <fmt/format.h>

#include "core/mesh_io_formats.h"

namespace gnathion::mesh_format {
namespace {

std::uint8_t colour_from_unit(double value) {
  return static_cast<std::uint8_t>(
      std::lround(std::isnan(value) ? 0.0 : std::clamp(value * 255.0, 0.0, 255.0)));
}

/// Last word of a map_Kd statement without its options. Names may hold blanks, options begin with '-'.
std::string texture_of_map(std::string_view rest) {
  TextScanner scanner(rest);
  std::string_view last = rest;
  if (!rest.empty() && rest[0] == '-')
    for (std::string_view word = scanner.word_in_line(); !word.empty(); word = scanner.word_in_line())
      last = word;
  return std::string(last);
}

/// Texture of each material of an MTL file, relative to the OBJ's folder.
std::map<std::string, std::string> textures_of(std::string_view mtl, const std::string& mtl_name) {
  std::map<std::string, std::string> textures;
  std::string material;
  TextScanner scanner(mtl);
  while (!scanner.at_end()) {
    const std::string_view keyword = scanner.word_in_line();
    const std::string_view rest = scanner.rest_of_line();
    if (keyword == "newmtl") material = std::string(rest);
    if (keyword != "map_Kd" || rest.empty()) continue;
    textures[material] =
        (std::filesystem::path(mtl_name).parent_path() / texture_of_map(rest)).generic_string();
  }
  return textures;
}

class ObjReader {
 public:
  explicit ObjReader(std::string_view text) : scanner_(text) {}

  /// False when a line is wrong; why() tells.
  bool read(ParsedMesh& parsed) {
    TriangleMesh& mesh = parsed.mesh;
    while (!scanner_.at_end()) {
      line_ = scanner_.line();
      const std::string_view keyword = scanner_.word_in_line();
      bool good = true;
      if (keyword == "v") {
        good = read_vertex(mesh);
      } else if (keyword == "f") {
        good = read_face(parsed);
      } else if (keyword == "mtllib") {
        mtl_names_.emplace_back(scanner_.rest_of_line());
      } else if (keyword == "usemtl") {
        material_ = std::string(scanner_.rest_of_line());
      } else if (keyword == "#") {
        read_announcement();
      } else {
        scanner_.rest_of_line();  // normals, texture coordinates, groups, lines, curves: not needed
      }
      if (!good) return false;
    }
    return check_counts(mesh);
  }
  const std::string& why() const { return why_; }

  /// The texture of the material that most faces have, among those that have one.
  std::string texture(const Companion& companion) const {
    std::map<std::string, std::string> textures;
    for (const std::string& name : mtl_names_)
      if (const std::optional<std::string> mtl = companion(name)) textures.merge(textures_of(*mtl, name));
    std::string best;
    std::size_t most = 0;
    for (const auto& [material, faces] : faces_of_material_) {
      const auto found = textures.find(material);
      if (found == textures.end() || faces <= most) continue;
      best = found->second;
      most = faces;
    }
    return best;
  }

 private:
  bool complain(std::string why) {
    why_ = fmt::format("line {}: {}", line_, why);
    return false;
  }

  /// Next word of the statement; a backslash at the end of a line continues it in the next.
  std::string_view next_word() {
    std::string_view word = scanner_.word_in_line();
    while (word == "\\") {
      scanner_.rest_of_line();
      word = scanner_.word_in_line();
    }
    return word;
  }

  bool read_vertex(TriangleMesh& mesh) {
    double values[7];
    int n = 0;
    for (std::string_view word = next_word(); !word.empty(); word = next_word()) {
      const std::optional<double> value = to_number(word);
      if (!value) return complain(fmt::format("{} is no number", quoted(word)));
      if (n == 7) return complain("a vertex with more than 7 numbers");
      values[n++] = *value;
    }
    if (n < 3) return complain(fmt::format("a vertex with {} coordinates", n));
    mesh.vertices_mm.emplace_back(values[0], values[1], values[2]);
    // "x y z r g b" or "x y z w r g b"; four numbers are a weight, not a colour.
    if (n >= 6) {
      if (mesh.colors_rgb.size() + 1 == mesh.vertices_mm.size())
        mesh.colors_rgb.push_back({colour_from_unit(values[n - 3]), colour_from_unit(values[n - 2]),
                                   colour_from_unit(values[n - 1])});
    }
    return true;
  }

  bool read_face(ParsedMesh& parsed) {
    TriangleMesh& mesh = parsed.mesh;
    polygon_.clear();
    const auto count = static_cast<std::int64_t>(mesh.vertices_mm.size());
    for (std::string_view word = next_word(); !word.empty(); word = next_word()) {
      // v, v/vt, v//vn, v/vt/vn: the first number is the vertex.
      const std::optional<std::int64_t> index = to_integer(word.substr(0, word.find('/')));
      if (!index) return complain(fmt::format("{} is no vertex index", quoted(word)));
      const std::int64_t vertex = *index > 0 ? *index - 1 : *index + count;
      if (*index == 0 || vertex < 0 || vertex >= 0xffffffffll)
        return complain(fmt::format("vertex index {} out of range", *index));
      polygon_.push_back(static_cast<std::uint32_t>(vertex));
      if (vertex > largest_index_) {
        largest_index_ = vertex;
        largest_index_line_ = line_;
      }
    }
    if (polygon_.size() < 3) return complain(fmt::format("a face with {} corners", polygon_.size()));
    parsed.polygons.add(polygon_, mesh.triangles);
    ++faces_;
    ++faces_of_material_[material_];
    return true;
  }

  /// MeshLab announces "# Vertices: N" and "# Faces: N": the only way to see that an OBJ was cut.
  void read_announcement() {
    const std::string_view what = scanner_.word_in_line();
    const std::optional<std::int64_t> count = to_integer(scanner_.word_in_line());
    const bool sensible = count && *count >= 0 && *count < 0xffffffffll;
    if (sensible && what == "Vertices:") announced_vertices_ = *count;
    if (sensible && what == "Faces:") announced_faces_ = *count;
    scanner_.rest_of_line();
  }

  bool check_counts(const TriangleMesh& mesh) {
    const auto vertices = static_cast<std::int64_t>(mesh.vertices_mm.size());
    if (vertices < announced_vertices_ || faces_ < announced_faces_) {
      why_ = fmt::format("truncated: {} vertices and {} faces announced, {} and {} present",
                         announced_vertices_, announced_faces_, vertices, faces_);
      return false;
    }
    if (largest_index_ < vertices) return true;
    line_ = largest_index_line_;
    return complain(
        fmt::format("vertex index {} out of range, there are {} vertices", largest_index_ + 1, vertices));
  }

  TextScanner scanner_;
  std::size_t line_ = 1, largest_index_line_ = 0;
  std::int64_t largest_index_ = -1, faces_ = 0, announced_vertices_ = 0, announced_faces_ = 0;
  std::vector<std::uint32_t> polygon_;
  std::vector<std::string> mtl_names_;
  std::string material_;
  std::map<std::string, std::size_t> faces_of_material_;
  std::string why_;
};

}  // namespace

Result<ParsedMesh> parse_obj(std::string_view text, const std::string& name, const Companion& companion) {
  ParsedMesh parsed;
  TriangleMesh& mesh = parsed.mesh;
  ObjReader reader(text);
  if (!reader.read(parsed)) return bad_input(kCannotRead, name, reader.why());
  if (mesh.colors_rgb.size() != mesh.vertices_mm.size()) mesh.colors_rgb.clear();  // not all had one
  mesh.texture_file = reader.texture(companion);
  return parsed;
}

std::string format_obj(const TriangleMesh& mesh) {
  const bool coloured = mesh.colors_rgb.size() == mesh.vertices_mm.size();
  std::string out = "# Gnathion, millimetres\n";
  out.reserve(mesh.vertices_mm.size() * 60 + mesh.triangles.size() * 24);
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    out += 'v';
    for (int k = 0; k < 3; ++k) {
      out += ' ';
      append_number(out, mesh.vertices_mm[i][k]);
    }
    if (coloured)
      for (std::uint8_t c : mesh.colors_rgb[i]) out += fmt::format(" {:.6f}", c / 255.0);
    out += '\n';
  }
  for (const Triangle& t : mesh.triangles)
    out += fmt::format("f {} {} {}\n", std::uint64_t{t[0]} + 1, std::uint64_t{t[1]} + 1,
                       std::uint64_t{t[2]} + 1);
  return out;
}

}  // namespace gnathion::mesh_format
