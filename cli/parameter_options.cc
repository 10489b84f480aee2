#include "cli/parameter_options.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "core/file.h"

namespace gnathion {

void add_parameter_options(CLI::App& command, ParameterOptions& o) {
  command.add_option("--config", o.config, "TOML file with a [design] table, and edits by hand");
  std::string names;
  for (const ParameterHelp& p : parameter_help())
    names += fmt::format("\n    design.{}={} [{}] {}..{}", p.name, p.default_value, p.unit, p.low, p.high);
  command.add_option("--set", o.set,
                     "one parameter, design.NAME=VALUE; repeatable. Defaults and ranges:" + names);
}

Result<SplintParameters> effective_parameters(const ParameterOptions& o, const SplintParameters& base) {
  SplintParameters p = base;
  if (!o.config.empty()) {
    GNATHION_TRY(p, read_parameters(o.config, p));
  }
  for (const std::string& s : o.set) GNATHION_CHECK_OK(set_parameter(p, s));
  GNATHION_CHECK_OK(check_parameters(p));
  return p;
}

Result<SplintEdits> effective_edits(const ParameterOptions& o, const SplintEdits& base) {
  if (o.config.empty()) return base;
  GNATHION_TRY(const std::string text, read_file(o.config));
  GNATHION_TRY(SplintEdits edits, parse_edits(text, o.config));
  return edits.empty() ? base : edits;
}

}  // namespace gnathion
