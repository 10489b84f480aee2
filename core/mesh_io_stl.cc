// STL, binary and ASCII. No unit inside: taken as millimetres.
#include <algorithm>
#include <bit>
#include <cctype>
#include <cstring>

#include <fmt/format.h>

#include "core/mesh_io_formats.h"

namespace gnathion::mesh_format {
namespace {

static_assert(std::endian::native == std::endian::little, "binary STL is read and written in place");

constexpr std::size_t kHeaderBytes = 84, kTriangleBytes = 50;

bool is_keyword(std::string_view word, std::string_view keyword) {
  return std::equal(word.begin(), word.end(), keyword.begin(), keyword.end(),
                    [](char a, char b) { return std::tolower(static_cast<unsigned char>(a)) == b; });
}

/// Reads the body of an ASCII STL and remembers why it could not.
class AsciiStl {
 public:
  explicit AsciiStl(std::string_view text) : scanner_(text) {}

  /// True at the end of a complete file; else why() tells what is wrong.
  bool read(TriangleMesh& mesh) {
    while (true) {  // several solids may follow each other
      const std::string_view word = scanner_.word();
      if (word.empty()) return true;
      if (!is_keyword(word, "solid")) return expected("solid", word);
      scanner_.rest_of_line();
      if (!read_facets(mesh)) return false;
      scanner_.rest_of_line();
    }
  }
  const std::string& why() const { return why_; }

 private:
  bool expected(std::string_view what, std::string_view found) {
    if (found.empty())
      why_ = fmt::format("truncated: ends in line {} after {} whole triangles, where \"{}\" should follow",
                         scanner_.line(), triangles_, what);
    else
      why_ = fmt::format("line {}: \"{}\" expected, {} found", scanner_.line(), what, quoted(found));
    return false;
  }
  bool keyword(std::string_view what) {
    const std::string_view word = scanner_.word();
    return is_keyword(word, what) || expected(what, word);
  }

  bool read_facets(TriangleMesh& mesh) {
    while (true) {
      const std::string_view word = scanner_.word();
      if (is_keyword(word, "endsolid")) return true;
      if (!is_keyword(word, "facet")) return expected(word.empty() ? "endsolid" : "facet", word);
      if (!keyword("normal")) return false;
      // The normal is recomputed from the corners; exporters write "nan" or leave it zero.
      for (int k = 0; k < 3; ++k)
        if (scanner_.word().empty()) return expected("normal", {});
      if (!keyword("outer") || !keyword("loop")) return false;
      const auto base = static_cast<std::uint32_t>(mesh.vertices_mm.size());
      for (int k = 0; k < 3; ++k)
        if (!read_vertex(mesh)) return false;
      if (!keyword("endloop") || !keyword("endfacet")) return false;
      mesh.triangles.push_back({base, base + 1, base + 2});
      ++triangles_;
    }
  }

  bool read_vertex(TriangleMesh& mesh) {
    if (!keyword("vertex")) return false;
    Vector3 p;
    for (int k = 0; k < 3; ++k) {
      const std::string_view word = scanner_.word();
      const std::optional<double> value = to_number(word);
      if (!value) return expected("number", word);
      p[k] = *value;
    }
    mesh.vertices_mm.push_back(p);
    return true;
  }

  TextScanner scanner_;
  std::size_t triangles_ = 0;
  std::string why_;
};

}  // namespace

Result<ParsedMesh> parse_stl_binary(std::string_view bytes, const std::string& name) {
  if (bytes.size() < kHeaderBytes)
    return bad_input(kCannotRead, name,
                     fmt::format("truncated: {} bytes, but the header of a binary STL alone has {}",
                                 bytes.size(), kHeaderBytes));
  std::uint32_t announced;
  std::memcpy(&announced, bytes.data() + 80, sizeof announced);
  const std::size_t present = (bytes.size() - kHeaderBytes) / kTriangleBytes;
  if (present < announced)
    return bad_input(kCannotRead, name,
                     fmt::format("truncated: {} triangles announced, {} present", announced, present));
  if (present > announced)
    return bad_input(kCannotRead, name,
                     fmt::format("{} triangles announced, but there are bytes for {}", announced, present));

  TriangleMesh mesh;
  mesh.vertices_mm.resize(3 * present);
  mesh.triangles.resize(present);
  for (std::uint32_t i = 0; i < present; ++i) {
    float corners[9];
    std::memcpy(corners, bytes.data() + kHeaderBytes + i * kTriangleBytes + 12, sizeof corners);
    for (std::uint32_t k = 0; k < 3; ++k)
      mesh.vertices_mm[3 * std::size_t{i} + k] =
          Vector3(corners[3 * k], corners[3 * k + 1], corners[3 * k + 2]);
    mesh.triangles[i] = {3 * i, 3 * i + 1, 3 * i + 2};
  }
  return ParsedMesh{std::move(mesh), {}};
}

Result<ParsedMesh> parse_stl_ascii(std::string_view text, const std::string& name) {
  TriangleMesh mesh;
  mesh.vertices_mm.reserve(text.size() / 80);  // a facet takes about 250 bytes
  AsciiStl reader(text);
  if (!reader.read(mesh)) return bad_input(kCannotRead, name, reader.why());
  return ParsedMesh{std::move(mesh), {}};
}

std::string format_stl_binary(const TriangleMesh& mesh) {
  std::string out(kHeaderBytes + kTriangleBytes * mesh.triangles.size(), '\0');
  constexpr std::string_view kTitle = "Gnathion: binary STL, millimetres";
  std::copy(kTitle.begin(), kTitle.end(), out.begin());
  const auto count = static_cast<std::uint32_t>(mesh.triangles.size());
  std::memcpy(out.data() + 80, &count, sizeof count);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    float values[12];
    const Vector3 normal = face_normal_scaled(mesh, i).stableNormalized();
    for (int k = 0; k < 3; ++k) values[k] = static_cast<float>(normal[k]);
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k) values[3 + 3 * c + k] = static_cast<float>(mesh.corner(i, c)[k]);
    std::memcpy(out.data() + kHeaderBytes + kTriangleBytes * i, values, sizeof values);
  }
  return out;
}

std::string format_stl_ascii(const TriangleMesh& mesh) {
  std::string out = "solid gnathion\n";
  out.reserve(mesh.triangles.size() * 300);
  const auto append_point = [&out](const Vector3& p) {
    for (int k = 0; k < 3; ++k) {
      out += ' ';
      append_number(out, p[k]);
    }
    out += '\n';
  };
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    out += "facet normal";
    append_point(face_normal_scaled(mesh, i).stableNormalized());
    out += " outer loop\n";
    for (int c = 0; c < 3; ++c) {
      out += "  vertex";
      append_point(mesh.corner(i, c));
    }
    out += " endloop\nendfacet\n";
  }
  out += "endsolid gnathion\n";
  return out;
}

}  // namespace gnathion::mesh_format
