#pragma once

#include <string>

namespace gnathion {

/// The first 16 digits of the SHA-256 of the program that runs: two builds of one version are not the same.
/// The shared libraries of the system are not in it.
const std::string& build_id();

}  // namespace gnathion
