// PLY: ASCII and binary of both endians. Vertices, colours and polygons are taken, all else is skipped.
// (Turk, The PLY Polygon File Format, 1994; type names of both generations.)
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include <fmt/format.h>

#include "core/mesh_io_formats.h"

namespace gnathion::mesh_format {
namespace {

static_assert(std::endian::native == std::endian::little, "little-endian values are copied as they are");

enum class Type : std::uint8_t { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

std::optional<Type> type_named(std::string_view word) {
  constexpr std::pair<std::string_view, Type> kNames[] = {
      {"char", Type::kInt8},      {"int8", Type::kInt8},       {"uchar", Type::kUint8},
      {"uint8", Type::kUint8},    {"short", Type::kInt16},     {"int16", Type::kInt16},
      {"ushort", Type::kUint16},  {"uint16", Type::kUint16},   {"int", Type::kInt32},
      {"int32", Type::kInt32},    {"uint", Type::kUint32},     {"uint32", Type::kUint32},
      {"float", Type::kFloat32},  {"float32", Type::kFloat32}, {"double", Type::kFloat64},
      {"float64", Type::kFloat64}};
  for (const auto& [name, type] : kNames)
    if (name == word) return type;
  return std::nullopt;
}

std::size_t size_of(Type type) {
  constexpr std::size_t kSizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}
bool is_real(Type type) {
  return type == Type::kFloat32 || type == Type::kFloat64;
}

/// What a property means to a triangle mesh.
enum class Role : std::uint8_t { kSkip, kX, kY, kZ, kRed, kGreen, kBlue, kPolygon };

struct Property {
  std::optional<Type> count_type;  // set for lists
  Type type = Type::kFloat32;
  Role role = Role::kSkip;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
  bool has_list() const {
    return std::any_of(properties.begin(), properties.end(), [](const Property& p) { return p.count_type; });
  }
  bool has(Role role) const {
    return std::any_of(properties.begin(), properties.end(),
                       [&](const Property& p) { return p.role == role; });
  }
  /// Least bytes that one row can take.
  std::size_t least_bytes(bool binary) const {
    std::size_t sum = 0;
    for (const Property& p : properties) sum += binary ? size_of(p.count_type.value_or(p.type)) : 1;
    return sum;
  }
};

enum class Encoding { kAscii, kLittle, kBig };

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  std::string texture_file;
  std::size_t body = 0;  // offset of the first byte after the header
};

Role role_of(const std::string& element, std::string_view property, bool is_list) {
  if (element == "face" && is_list && (property == "vertex_indices" || property == "vertex_index"))
    return Role::kPolygon;
  if (element != "vertex" || is_list) return Role::kSkip;
  constexpr std::pair<std::string_view, Role> kRoles[] = {{"x", Role::kX},
                                                          {"y", Role::kY},
                                                          {"z", Role::kZ},
                                                          {"red", Role::kRed},
                                                          {"green", Role::kGreen},
                                                          {"blue", Role::kBlue},
                                                          {"diffuse_red", Role::kRed},
                                                          {"diffuse_green", Role::kGreen},
                                                          {"diffuse_blue", Role::kBlue},
                                                          {"r", Role::kRed},
                                                          {"g", Role::kGreen},
                                                          {"b", Role::kBlue}};
  for (const auto& [name, role] : kRoles)
    if (name == property) return role;
  return Role::kSkip;
}

/// Why the header is not one, or nothing.
using Complaint = std::optional<std::string>;

Complaint read_property(TextScanner& line, Element& element) {
  Property property;
  std::string_view word = line.word_in_line();
  const bool is_list = word == "list";
  if (is_list) {
    property.count_type = type_named(line.word_in_line());
    if (!property.count_type || is_real(*property.count_type)) return "a list whose length has no whole type";
    word = line.word_in_line();
  }
  const std::optional<Type> type = type_named(word);
  if (!type) return "the unknown type " + quoted(word);
  property.type = *type;
  const std::string_view name = line.word_in_line();
  property.role = role_of(element.name, name, is_list);
  if (property.role != Role::kSkip && element.has(property.role)) property.role = Role::kSkip;
  if (property.role == Role::kPolygon && is_real(property.type))
    return "vertex indices that are not whole numbers";
  element.properties.push_back(property);
  return std::nullopt;
}

Complaint read_header_line(std::string_view text, Header& header) {
  TextScanner line(text);
  const std::string_view keyword = line.word_in_line();
  if (keyword == "format") {
    const std::string_view word = line.word_in_line();
    if (word == "ascii")
      header.encoding = Encoding::kAscii;
    else if (word == "binary_little_endian")
      header.encoding = Encoding::kLittle;
    else if (word == "binary_big_endian")
      header.encoding = Encoding::kBig;
    else
      return "the unknown format " + quoted(word);
  } else if (keyword == "element") {
    Element element;
    element.name = std::string(line.word_in_line());
    const std::string_view word = line.word_in_line();
    const std::optional<std::int64_t> count = to_integer(word);
    if (!count || *count < 0) return "the impossible number of rows " + quoted(word);
    element.count = static_cast<std::uint64_t>(*count);
    header.elements.push_back(std::move(element));
  } else if (keyword == "property") {
    if (header.elements.empty()) return "a property before any element";
    return read_property(line, header.elements.back());
  } else if (keyword == "comment") {
    if (line.word_in_line() == "TextureFile") header.texture_file = std::string(line.rest_of_line());
  } else if (!keyword.empty() && keyword != "obj_info" && keyword != "ply") {
    return "the unknown word " + quoted(keyword);
  }
  return std::nullopt;
}

Complaint read_header(std::string_view bytes, Header& header) {
  TextScanner scanner(bytes);
  bool has_format = false;
  while (!scanner.at_end()) {
    const std::size_t number = scanner.line();
    const std::string_view line = scanner.rest_of_line();
    if (line == "end_header") {
      header.body = bytes.size() - scanner.remaining();
      if (!has_format) return "the header does not say its format";
      return std::nullopt;
    }
    has_format = has_format || line.substr(0, 7) == "format ";
    if (const Complaint why = read_header_line(line, header))
      return fmt::format("line {} of the header has {}", number, *why);
  }
  return "truncated: ends inside the header";
}

double little_endian_value(Type type, const char* bytes) {
  const auto as = [bytes](auto value) {
    std::memcpy(&value, bytes, sizeof value);
    return static_cast<double>(value);
  };
  switch (type) {
    case Type::kInt8:
      return as(std::int8_t{});
    case Type::kUint8:
      return as(std::uint8_t{});
    case Type::kInt16:
      return as(std::int16_t{});
    case Type::kUint16:
      return as(std::uint16_t{});
    case Type::kInt32:
      return as(std::int32_t{});
    case Type::kUint32:
      return as(std::uint32_t{});
    case Type::kFloat32:
      return as(float{});
    case Type::kFloat64:
      break;
  }
  return as(double{});
}

/// The values of the body one after another, whatever the encoding.
class Values {
 public:
  Values(std::string_view body, Encoding encoding) : encoding_(encoding), bytes_(body), text_(body) {}

  bool binary() const { return encoding_ != Encoding::kAscii; }
  std::size_t remaining() const { return binary() ? bytes_.size() : text_.remaining(); }
  bool skip_bytes(std::size_t n) {
    if (bytes_.size() < n) return false;
    bytes_.remove_prefix(n);
    return true;
  }
  /// Nothing at the end of the body, and at a word that is no number.
  std::optional<double> next(Type type) {
    if (!binary()) {
      const std::string_view word = text_.word();
      if (!word.empty()) bad_word_ = word;
      const auto value = to_number(word);
      if (value) bad_word_ = {};
      return value;
    }
    const std::size_t size = size_of(type);
    if (bytes_.size() < size) return std::nullopt;
    char swapped[8];
    std::memcpy(swapped, bytes_.data(), size);
    if (encoding_ == Encoding::kBig) std::reverse(swapped, swapped + size);
    bytes_.remove_prefix(size);
    return little_endian_value(type, swapped);
  }
  /// The word that stopped next(), if it was not the end.
  std::string_view bad_word() const { return bad_word_; }

 private:
  Encoding encoding_;
  std::string_view bytes_;
  TextScanner text_;
  std::string_view bad_word_;
};

/// Reads the elements' rows into a mesh.
class PlyBody {
 public:
  PlyBody(Values values, ParsedMesh& parsed)
      : values_(values), mesh_(parsed.mesh), polygons_(parsed.polygons) {}

  Complaint read(const Element& element) {
    const std::size_t least = element.least_bytes(values_.binary());
    if (least == 0) return std::nullopt;  // rows without any property take no bytes
    // A header may lie: memory is taken for what the file can hold, never for what it announces.
    const std::uint64_t room = (values_.remaining() + (values_.binary() ? 0 : 1)) / least;
    const bool useful = element.name == "vertex" || element.name == "face";
    if (values_.binary() && !element.has_list() && !useful) {
      if (element.count > room || !values_.skip_bytes(least * element.count)) return cut(element, room);
      return std::nullopt;
    }
    if (!element.has_list() && element.count > room) return cut(element, room);
    if (element.name == "vertex") mesh_.vertices_mm.reserve(std::min(element.count, room));
    if (element.name == "face") mesh_.triangles.reserve(std::min(element.count, room));
    colours_ = element.has(Role::kRed) && element.has(Role::kGreen) && element.has(Role::kBlue);
    for (std::uint64_t row = 0; row < element.count; ++row)
      if (Complaint why = read_row(element, row)) return why;
    return std::nullopt;
  }
  /// Largest vertex index that a face named.
  std::int64_t largest_index() const { return largest_index_; }

 private:
  Complaint cut(const Element& element, std::uint64_t present) const {
    if (!values_.bad_word().empty())
      return fmt::format("row {} of element {} has {} where a number should be", present + 1, element.name,
                         quoted(values_.bad_word()));
    return fmt::format("truncated: {} rows of element {} announced, {} present", element.count, element.name,
                       present);
  }

  Complaint read_row(const Element& element, std::uint64_t row) {
    Vector3 point = Vector3::Zero();
    std::array<std::uint8_t, 3> colour{};
    for (const Property& property : element.properties) {
      if (property.count_type) {
        if (Complaint why = read_list(element, property, row)) return why;
        continue;
      }
      const std::optional<double> value = values_.next(property.type);
      if (!value) return cut(element, row);
      if (property.role >= Role::kX && property.role <= Role::kZ)
        point[static_cast<int>(property.role) - static_cast<int>(Role::kX)] = *value;
      else if (property.role >= Role::kRed && property.role <= Role::kBlue)
        colour[static_cast<std::size_t>(property.role) - static_cast<std::size_t>(Role::kRed)] =
            colour_from(*value, property.type);
    }
    if (element.name == "vertex") {
      mesh_.vertices_mm.push_back(point);
      if (colours_) mesh_.colors_rgb.push_back(colour);
    }
    return std::nullopt;
  }

  Complaint read_list(const Element& element, const Property& property, std::uint64_t row) {
    const std::optional<double> length = values_.next(*property.count_type);
    if (!length) return cut(element, row);
    if (*length < 0.0 || *length != std::floor(*length))
      return fmt::format("row {} of element {} has a list of {} entries", row + 1, element.name, *length);
    polygon_.clear();
    for (double i = 0; i < *length; ++i) {
      const std::optional<double> value = values_.next(property.type);
      if (!value) return cut(element, row);
      if (property.role != Role::kPolygon) continue;
      if (!(*value >= 0.0 && *value < 4294967295.0) || *value != std::floor(*value))
        return fmt::format("face {} names vertex {}: index out of range", row + 1, *value);
      polygon_.push_back(static_cast<std::uint32_t>(*value));
      largest_index_ = std::max(largest_index_, static_cast<std::int64_t>(*value));
    }
    polygons_.add(polygon_, mesh_.triangles);
    return std::nullopt;
  }

  /// Whole types run to 255 (16 bits: 65535), real ones to 1.
  static std::uint8_t colour_from(double value, Type type) {
    if (is_real(type)) value *= 255.0;
    if (type == Type::kUint16) value /= 257.0;
    return static_cast<std::uint8_t>(std::lround(std::isnan(value) ? 0.0 : std::clamp(value, 0.0, 255.0)));
  }

  Values values_;
  TriangleMesh& mesh_;
  Polygons& polygons_;
  bool colours_ = false;
  std::int64_t largest_index_ = -1;
  std::vector<std::uint32_t> polygon_;
};

}  // namespace

Result<ParsedMesh> parse_ply(std::string_view bytes, const std::string& name) {
  Header header;
  if (const Complaint why = read_header(bytes, header)) return bad_input(kCannotRead, name, *why);
  const auto find = [&](const char* element) {
    return std::find_if(header.elements.begin(), header.elements.end(),
                        [&](const Element& e) { return e.name == element; });
  };
  const auto vertex = find("vertex"), face = find("face");
  if (vertex == header.elements.end() || !vertex->has(Role::kX) || !vertex->has(Role::kY) ||
      !vertex->has(Role::kZ))
    return bad_input(kCannotRead, name, "no vertices with x, y and z in it");
  if (face == header.elements.end() || !face->has(Role::kPolygon))
    return bad_input(kCannotRead, name, "no faces with vertex_indices in it (a point cloud?)");

  ParsedMesh parsed;
  TriangleMesh& mesh = parsed.mesh;
  mesh.texture_file = header.texture_file;
  PlyBody body(Values(bytes.substr(header.body), header.encoding), parsed);
  for (const Element& element : header.elements)
    if (const Complaint why = body.read(element)) return bad_input(kCannotRead, name, *why);
  if (body.largest_index() >= static_cast<std::int64_t>(mesh.vertices_mm.size()))
    return bad_input(
        kCannotRead, name,
        fmt::format("a face names vertex {}, but there are only {} (numbered from 0): index out of range",
                    body.largest_index(), mesh.vertices_mm.size()));
  return parsed;
}

namespace {

template <class T>
void append_bytes(std::string& out, T value, bool big_endian) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  if (big_endian) std::reverse(bytes, bytes + sizeof value);
  out.append(bytes, sizeof value);
}

void append_ascii_body(std::string& out, const TriangleMesh& mesh, bool coloured) {
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      if (k > 0) out += ' ';
      append_number(out, mesh.vertices_mm[i][k]);
    }
    if (coloured) {
      const auto& c = mesh.colors_rgb[i];
      out += fmt::format(" {} {} {}", c[0], c[1], c[2]);
    }
    out += '\n';
  }
  for (const Triangle& t : mesh.triangles) out += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
}

void append_binary_body(std::string& out, const TriangleMesh& mesh, bool coloured, bool big_endian) {
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    for (int k = 0; k < 3; ++k) append_bytes(out, mesh.vertices_mm[i][k], big_endian);
    if (coloured)
      for (std::uint8_t c : mesh.colors_rgb[i]) out += static_cast<char>(c);
  }
  for (const Triangle& t : mesh.triangles) {
    out += '\3';
    for (std::uint32_t v : t) append_bytes(out, v, big_endian);
  }
}

}  // namespace

std::string format_ply(const TriangleMesh& mesh, MeshFormat format) {
  const bool coloured = mesh.colors_rgb.size() == mesh.vertices_mm.size() && !mesh.colors_rgb.empty();
  const bool ascii = format == MeshFormat::kPlyAscii, big = format == MeshFormat::kPlyBinaryBigEndian;
  std::string out =
      fmt::format("ply\nformat {} 1.0\ncomment Gnathion, millimetres\n", ascii ? "ascii"
                                                                         : big ? "binary_big_endian"
                                                                               : "binary_little_endian");
  if (!mesh.texture_file.empty()) out += fmt::format("comment TextureFile {}\n", mesh.texture_file);
  out += fmt::format("element vertex {}\n", mesh.vertices_mm.size());
  // Doubles, so that what is read back is what was written.
  for (const char* axis : {"x", "y", "z"}) out += fmt::format("property double {}\n", axis);
  if (coloured)
    for (const char* channel : {"red", "green", "blue"}) out += fmt::format("property uchar {}\n", channel);
  // Many readers know signed indices only.
  out += fmt::format("element face {}\nproperty list uchar {} vertex_indices\nend_header\n",
                     mesh.triangles.size(), mesh.vertices_mm.size() <= 0x7fffffffu ? "int" : "uint");
  out.reserve(out.size() + mesh.vertices_mm.size() * (ascii ? 70u : 27u) +
              mesh.triangles.size() * (ascii ? 24u : 13u));
  if (ascii)
    append_ascii_body(out, mesh, coloured);
  else
    append_binary_body(out, mesh, coloured, big);
  return out;
}

}  // namespace gnathion::mesh_format
