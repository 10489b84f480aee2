#include "pipeline/toml_file.h"

#include <fmt/format.h>

#include "core/file.h"

namespace gnathion {

Result<toml::table> read_toml(const std::filesystem::path& path, const char* what) {
  GNATHION_TRY(const std::string text, read_file(path));
  toml::parse_result parsed = toml::parse(text, path.string());
  if (parsed) return std::move(parsed).table();
  const toml::parse_error& e = parsed.error();
  return bad_input(what, path.string(),
                   fmt::format("line {}, column {}: {}", e.source().begin.line, e.source().begin.column,
                               std::string(e.description())));
}

}  // namespace gnathion
