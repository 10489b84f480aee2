// --config and --set of the commands that design a splint.
#pragma once

#include <string>
#include <vector>

#include "core/result.h"
#include "design/edits.h"
#include "design/parameters.h"

namespace CLI {
class App;
}

namespace gnathion {

struct ParameterOptions {
  std::string config;
  std::vector<std::string> set;
  std::vector<std::string> teeth;    ///< "16=missing", "24=x,y,z"
  std::vector<std::string> margins;  ///< files of points
  std::string label, kind;
};
void add_parameter_options(CLI::App& command, ParameterOptions& o);
/// --tooth, --margin, --label: edits by hand over those of the --config file; --kind.
void add_edit_options(CLI::App& command, ParameterOptions& o);

Result<SplintParameters> effective_parameters(const ParameterOptions& o, const SplintParameters& base = {});
/// Edits of the --config file; they take the place of `base` where there are any.
Result<SplintEdits> effective_edits(const ParameterOptions& o, const SplintEdits& base = {});

}  // namespace gnathion
