// What a case keeps to its owner: files 0600, folders 0700.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "core/result.h"

namespace gnathion {

/// Sets the modes of everything below `path` and of itself; links are left alone.
Status make_private(const std::filesystem::path& path);
enum class LinkUse {
  kFollow,  ///< of a path that the user typed: a link is his business
  kRefuse   ///< of a name that stood in a file or a folder of somebody else
};
/// A copy (0600; a folder: 0700 with all its plain files) that appears whole, by rename. Refused (kInput):
/// links (`from` itself as `links` says) and what is neither file nor folder; (kInternal) no room.
Status copy_private(const std::filesystem::path& from, const std::filesystem::path& to,
                    LinkUse links = LinkUse::kFollow);
/// write_file, 0600.
Status write_private(const std::filesystem::path& path, std::string_view bytes);
/// Renames a folder to a name that must be free, in one step: of two, one wins and the other is told
/// (kUsage).
Status rename_to_free(const std::filesystem::path& from, const std::filesystem::path& to);
/// Text as TOML has it, in quotes.
std::string toml_quoted(std::string_view text);

}  // namespace gnathion
