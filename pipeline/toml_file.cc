#include "pipeline/toml_file.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/file.h"

namespace gnathion {

namespace {

/// toml++ stops the program at a section whose name is none ("[[[", "[=]"); such a line is found before. 0:
/// none.
int line_without_name(const std::string& text) {
  int line = 1;
  for (std::size_t at = 0; at < text.size(); ++line) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    std::size_t i = text.find_first_not_of(" \t", at);
    if (i < end && text[i] == '[') {
      i += i + 1 < end && text[i + 1] == '[' ? 2 : 1;
      while (i < end && (text[i] == ' ' || text[i] == '\t')) ++i;
      if (i < end && (text[i] == '[' || text[i] == '=' || text[i] == '.')) return line;
    }
    at = end + 1;
  }
  return 0;
}

}  // namespace

Result<toml::table> read_toml(const std::filesystem::path& path, const char* what) {
  GNATHION_TRY(const std::string text, read_file(path));
  if (const int line = line_without_name(text); line > 0)
    return bad_input(what, path.string(), fmt::format("line {}: a section needs a name", line));
  toml::parse_result parsed = toml::parse(text, path.string());
  if (parsed) return std::move(parsed).table();
  const toml::parse_error& e = parsed.error();
  return bad_input(what, path.string(),
                   fmt::format("line {}, column {}: {}", e.source().begin.line, e.source().begin.column,
                               std::string(e.description())));
}

}  // namespace gnathion
