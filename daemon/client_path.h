// Paths that clients give, inside one case's folder.
#pragma once

#include <filesystem>
#include <string>

#include "daemon/api_error.h"
#include "pipeline/case_path.h"

namespace gnathion::daemon {

/// `given` is relative to the case's folder. kPermissionDenied: what leaves it, by "..", from the root or
/// through a link; kNotFound: what is not there; kInvalidArgument: what is no path.
ApiResult<std::filesystem::path> path_in_case(const CaseRoot& root, const std::filesystem::path& case_folder,
                                              const std::string& given, PathUse use);

/// The same for a file or folder that is to be made: folders on its way may be missing, and are not made
/// here.
ApiResult<std::filesystem::path> output_in_case(const CaseRoot& root,
                                                const std::filesystem::path& case_folder,
                                                const std::string& given);

/// case.toml, what editors and writers leave beside it (case.toml~, .case.toml.swp), and hidden files.
bool may_hold_identity(const std::filesystem::path& path);

}  // namespace gnathion::daemon
