#include "acquisition/scanner/scan_files.h"

#include <algorithm>
#include <cctype>
#include <string_view>

namespace gnathion {
namespace {

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '"'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

/// Calls f(keyword, rest) for each line of the text.
template <class F>
void for_each_statement(std::string_view text, const F& f) {
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    const std::string_view line = trimmed(text.substr(start, end - start));
    start = end + 1;
    const std::size_t blank = std::min(line.find_first_of(" \t"), line.size());
    f(line.substr(0, blank), trimmed(line.substr(blank)));
  }
}

/// Last word of a map statement without its options; names may hold blanks, options begin with '-'.
std::string_view texture_of(std::string_view rest) {
  if (rest.empty() || rest.front() != '-') return rest;
  return rest.substr(std::min(rest.find_last_of(" \t") + 1, rest.size()));
}

bool has_extension(const std::string& name, std::string_view extension) {
  if (name.size() < extension.size()) return false;
  return std::equal(extension.begin(), extension.end(), name.end() - static_cast<long>(extension.size()),
                    [](char a, char b) { return a == std::tolower(static_cast<unsigned char>(b)); });
}

void add(std::vector<std::string>& names, std::string_view name) {
  if (!name.empty() && std::find(names.begin(), names.end(), name) == names.end()) names.emplace_back(name);
}

}  // namespace

std::vector<std::string> referred_files(const std::string& name, const std::string& bytes) {
  std::vector<std::string> names;
  if (has_extension(name, ".obj")) {
    for_each_statement(bytes, [&](std::string_view keyword, std::string_view rest) {
      if (keyword == "mtllib") add(names, rest);
    });
  } else if (has_extension(name, ".mtl")) {
    for_each_statement(bytes, [&](std::string_view keyword, std::string_view rest) {
      if (keyword.substr(0, 4) == "map_") add(names, texture_of(rest));
    });
  } else if (has_extension(name, ".ply")) {
    constexpr std::string_view kEnd = "end_header", kTexture = "TextureFile";
    const std::string_view all(bytes);
    for_each_statement(all.substr(0, std::min(all.find(kEnd), all.size())),
                       [&](std::string_view keyword, std::string_view rest) {
                         if (keyword == "comment" && rest.substr(0, kTexture.size()) == kTexture)
                           add(names, trimmed(rest.substr(kTexture.size())));
                       });
  }
  return names;
}

std::string local_name(const std::string& reference) {
  std::string name = reference;
  std::replace(name.begin(), name.end(), '\\', '/');
  while (name.compare(0, 2, "./") == 0) name.erase(0, 2);
  const bool drive = name.size() > 1 && name[1] == ':';
  const bool leaves = ("/" + name + "/").find("/../") != std::string::npos;
  if (drive || leaves || name.compare(0, 1, "/") == 0) name.erase(0, name.find_last_of('/') + 1);
  const bool is_file = name != "." && name != ".." && name.find('\0') == std::string::npos;
  return is_file ? name : std::string();
}

std::optional<std::string> suspected_unit(const TriangleMesh& mesh) {
  constexpr double kSmallest_mm = 80, kLargest_mm = 800;  // as the chain takes face scans
  const double size = bounding_box(mesh).size_mm().maxCoeff();
  const auto fits = [&](double mm) { return size * mm >= kSmallest_mm && size * mm <= kLargest_mm; };
  if (fits(1)) return std::nullopt;
  struct Unit {
    const char* name;
    double mm;
  };
  // Where inches and centimetres are both possible, centimetres are what scanners write.
  for (const Unit& unit :
       {Unit{"metres", 1000}, Unit{"centimetres", 10}, Unit{"inches", 25.4}, Unit{"micrometres", 0.001}})
    if (fits(unit.mm)) return unit.name;
  return "an unknown unit";
}

}  // namespace gnathion
