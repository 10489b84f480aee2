#include "pipeline/case_private.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "core/file.h"
#include "core/xml.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

tl::unexpected<Error> cannot(const char* what, const fs::path& where, const std::error_code& ec) {
  return fail(ErrorCode::kInternal, what, where.string(), ec.message());
}

Status make_one_private(const fs::path& path) {
  std::error_code ec;
  const fs::file_status status = fs::symlink_status(path, ec);
  if (ec) return cannot("cannot make private", path, ec);
  if (fs::is_symlink(status)) return {};
  const fs::perms mode =
      fs::is_directory(status) ? fs::perms::owner_all : fs::perms::owner_read | fs::perms::owner_write;
  if ((status.permissions() & fs::perms::mask) == mode) return {};
  fs::permissions(path, mode, ec);
  return ec ? Status(cannot("cannot make private", path, ec)) : Status();
}

Status copy_tree(const fs::path& from, const fs::path& to) {
  std::error_code ec;
  const fs::file_status status = fs::symlink_status(from, ec);
  if (fs::is_regular_file(status)) {
    fs::copy_file(from, to, ec);
    if (ec) return cannot("cannot copy", from, ec);
    return make_one_private(to);
  }
  if (!fs::is_directory(status))
    return bad_input("cannot copy", from.string(), "is a link, or neither a file nor a folder");
  fs::create_directory(to, ec);
  if (ec) return cannot("cannot copy", to, ec);
  GNATHION_CHECK_OK(make_one_private(to));
  for (auto it = fs::directory_iterator(from, ec); !ec && it != fs::directory_iterator(); it.increment(ec))
    GNATHION_CHECK_OK(copy_tree(it->path(), to / it->path().filename()));
  return ec ? Status(cannot("cannot copy", from, ec)) : Status();
}

}  // namespace

Status make_private(const fs::path& path) {
  GNATHION_CHECK_OK(make_one_private(path));
  std::error_code ec;
  if (!fs::is_directory(fs::symlink_status(path, ec))) return {};
  for (auto it = fs::recursive_directory_iterator(path, ec); !ec && it != fs::recursive_directory_iterator();
       it.increment(ec))
    GNATHION_CHECK_OK(make_one_private(it->path()));
  return ec ? Status(cannot("cannot make private", path, ec)) : Status();
}

Status copy_private(const fs::path& from, const fs::path& to, LinkUse links) {
  std::error_code ec;
  const fs::path source = links == LinkUse::kFollow ? fs::canonical(from, ec) : from;
  if (ec) return bad_input("cannot copy", from.string(), ec.message());
  const fs::path part =
      to.parent_path() / ("." + to.filename().string() + ".part." + std::to_string(::getpid()));
  fs::remove_all(part, ec);
  const Status copied = copy_tree(source, part);
  if (!copied) {
    fs::remove_all(part, ec);
    return copied;
  }
  fs::rename(part, to, ec);
  if (!ec) return {};
  const std::error_code why = ec;
  fs::remove_all(part, ec);
  return cannot("cannot copy", to, why);
}

Status write_private(const fs::path& path, std::string_view bytes) {
  GNATHION_CHECK_OK(write_file(path, bytes));
  return make_one_private(path);
}

Status rename_to_free(const fs::path& from, const fs::path& to) {
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return {};
  std::error_code ec;
  if (errno == EEXIST || errno == ENOTEMPTY)
    return fail(ErrorCode::kUsage, "cannot write", to.string(), "exists already");
  if (errno == EINVAL || errno == ENOSYS) {  // a file system that cannot: the check and the rename, apart
    if (fs::exists(fs::symlink_status(to, ec)))
      return fail(ErrorCode::kUsage, "cannot write", to.string(), "exists already");
    fs::rename(from, to, ec);
    return ec ? Status(cannot("cannot write", to, ec)) : Status();
  }
  return fail(ErrorCode::kInternal, "cannot write", to.string(), std::strerror(errno));
}

std::string toml_quoted(std::string_view text) {
  std::string out = "\"";
  for (const char c : valid_utf8(text)) {
    const auto u = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\')
      out += std::string("\\") + c;
    else if (u < 0x20 || u == 0x7f)
      out += fmt::format("\\u{:04x}", u);
    else
      out += c;
  }
  return out + "\"";
}

}  // namespace gnathion
