// The mesh file kinds one by one, behind mesh_io.h. Each parser gives what the file says, checked against
// its own announcements; the checks that all kinds share are done afterwards, once (mesh_io.cc).
#pragma once

#include <charconv>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

#include "core/mesh_io.h"

namespace gnathion::mesh_format {

inline constexpr char kCannotRead[] = "cannot read mesh";

/// Text of a file that the mesh file refers to by a relative name, if it can be had.
using Companion = std::function<std::optional<std::string>(const std::string& relative_name)>;

/// Collects a file's polygons. Each is cut from its first corner at once; those of more than three corners
/// are looked at again when all vertices are known, for that cut is wrong where a polygon is not convex.
class Polygons {
 public:
  void add(const std::vector<std::uint32_t>& polygon, std::vector<Triangle>& triangles);
  /// The vertices must be finite and all indices in range.
  void recut_where_not_convex(TriangleMesh& mesh) const;

 private:
  struct Place {
    std::size_t first_triangle, first_corner, corners;
  };
  std::vector<Place> places_;
  std::vector<std::uint32_t> corners_;
};

struct ParsedMesh {
  TriangleMesh mesh;
  Polygons polygons;
};

Result<ParsedMesh> parse_stl_binary(std::string_view bytes, const std::string& name);
Result<ParsedMesh> parse_stl_ascii(std::string_view text, const std::string& name);
Result<ParsedMesh> parse_ply(std::string_view bytes, const std::string& name);
Result<ParsedMesh> parse_obj(std::string_view text, const std::string& name, const Companion& companion);

std::string format_stl_binary(const TriangleMesh& mesh);
std::string format_stl_ascii(const TriangleMesh& mesh);
std::string format_ply(const TriangleMesh& mesh, MeshFormat format);
std::string format_obj(const TriangleMesh& mesh);

inline bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == '\f' || c == '\v';
}

/// Reads words and numbers from text, whatever the locale; counts lines for messages.
class TextScanner {
 public:
  explicit TextScanner(std::string_view text) : at_(text.data()), end_(text.data() + text.size()) {}

  bool at_end() const { return at_ == end_; }
  std::size_t line() const { return line_; }
  std::size_t remaining() const { return static_cast<std::size_t>(end_ - at_); }

  /// Next word, past blanks and line ends; empty at the end of the text.
  std::string_view word() {
    while (at_ != end_ && (is_blank(*at_) || *at_ == '\n')) line_ += *at_++ == '\n';
    return take_word();
  }
  /// Next word of this line; empty at the line's end.
  std::string_view word_in_line() {
    while (at_ != end_ && is_blank(*at_)) ++at_;
    return take_word();
  }
  /// Rest of the line without its surrounding blanks; moves past the line end.
  std::string_view rest_of_line() {
    while (at_ != end_ && is_blank(*at_)) ++at_;
    const char* begin = at_;
    while (at_ != end_ && *at_ != '\n') ++at_;
    const char* last = at_;
    if (at_ != end_) ++at_, ++line_;
    while (last != begin && is_blank(last[-1])) --last;
    return {begin, static_cast<std::size_t>(last - begin)};
  }

 private:
  std::string_view take_word() {
    const char* begin = at_;
    while (at_ != end_ && !is_blank(*at_) && *at_ != '\n') ++at_;
    return {begin, static_cast<std::size_t>(at_ - begin)};
  }

  const char* at_;
  const char* end_;
  std::size_t line_ = 1;
};

/// A whole word as a number: "1.5", "+2e-3", "nan", "-inf". Too large gives infinity, too small zero.
inline std::optional<double> to_number(std::string_view word) {
  if (!word.empty() && word[0] == '+') word.remove_prefix(1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (word.empty() || end != word.data() + word.size()) return std::nullopt;
  if (error == std::errc::result_out_of_range) {
    const bool tiny = word.find("e-") != word.npos || word.find("E-") != word.npos;
    return tiny ? 0.0 : std::numeric_limits<double>::infinity();
  }
  if (error != std::errc()) return std::nullopt;
  return value;
}

inline std::optional<std::int64_t> to_integer(std::string_view word) {
  if (!word.empty() && word[0] == '+') word.remove_prefix(1);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (word.empty() || end != word.data() + word.size() || error != std::errc()) return std::nullopt;
  return value;
}

/// Shortest text that reads back as the same double.
inline void append_number(std::string& out, double value) {
  char buffer[32];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof buffer, value);
  out.append(buffer, end);
}

/// A word of the file made fit for a one-line message.
std::string quoted(std::string_view word);

}  // namespace gnathion::mesh_format
