// TOML files as this module reads them: for its .cc files only, since the parser comes along.
#pragma once

#include <filesystem>
#include <string>

// As everywhere: toml++ built with and without exceptions in one program has two layouts of one class.
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include "core/result.h"

namespace gnathion {

/// The whole file. Refused (kInput) with `what` and the line of the fault.
Result<toml::table> read_toml(const std::filesystem::path& path, const char* what);

}  // namespace gnathion
