#include "pipeline/case_path.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

#include "pipeline/case_folder.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "path refused";
constexpr std::size_t kLongestPath = 4096, kLongestName = 255;

/// A descriptor that closes itself.
class Fd {
 public:
  explicit Fd(int fd) : fd_(fd) {}
  ~Fd() {
    if (fd_ >= 0) ::close(fd_);
  }
  Fd(const Fd&) = delete;
  Fd& operator=(const Fd&) = delete;
  Fd& operator=(Fd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  int get() const { return fd_; }

 private:
  int fd_;
};

/// Safe to show in a log: control characters and what is too long are taken out.
std::string shown(std::string_view given) {
  std::string text;
  for (const char c : given.substr(0, 200)) {
    const auto u = static_cast<unsigned char>(c);
    text += u < 0x20 || u == 0x7f ? '?' : c;
  }
  return given.size() > 200 ? text + "..." : text;
}

tl::unexpected<Error> refuse(std::string_view given, const std::string& why) {
  return fail(ErrorCode::kUsage, kWhat, shown(given), why);
}

Result<std::vector<std::string>> components_of(std::string_view given, const fs::path& root) {
  if (given.empty()) return refuse(given, "is empty; give a path inside the case root");
  if (given.size() > kLongestPath) return refuse(given, "is longer than any path");
  for (const char c : given)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) return refuse(given, "holds a control character");
  std::string_view rest = given;
  const std::string inside = root == "/" ? "/" : root.string() + "/";
  if (rest.front() == '/') {
    if (rest == root.string()) return std::vector<std::string>{};
    if (rest.substr(0, inside.size()) != inside)
      return refuse(given, "lies outside the case root; give a path relative to it");
    rest.remove_prefix(inside.size());
  }
  std::vector<std::string> names;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('/'), rest.size());
    const std::string_view name = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (name.empty() || name == ".") continue;
    if (name == "..") return refuse(given, "'..' is not allowed; give a path inside the case root");
    if (name.size() > kLongestName) return refuse(given, "a name in it is longer than 255 bytes");
    names.emplace_back(name);
  }
  return names;
}

std::string errno_text(int error) {
  switch (error) {
    case ELOOP:
      return "a symbolic link is on the way; links are not followed";
    case ENOENT:
      return "does not exist";
    case ENOTDIR:
      return "a file or a link stands where a folder is needed";
    case EACCES:
      return "permission denied";
    default:
      return std::strerror(error);
  }
}

}  // namespace

Result<CaseRoot> CaseRoot::open(const fs::path& root) {
  std::error_code ec;
  const fs::path real = fs::canonical(root, ec);
  if (ec) return bad_input("cannot open case root", root.string(), ec.message());
  if (!fs::is_directory(real, ec))
    return bad_input("cannot open case root", root.string(), "is not a folder");
  return CaseRoot(real);
}

Result<fs::path> CaseRoot::resolve(std::string_view given, PathUse use) const {
  GNATHION_TRY(const std::vector<std::string> names, components_of(given, path_));
  Fd at(::open(path_.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  if (at.get() < 0) return refuse(given, errno_text(errno));
  fs::path result = path_;
  // Component by component, each without following a link: what a link elsewhere in the tree does to the
  // name of the whole path cannot matter.
  for (std::size_t i = 0; i < names.size(); ++i) {
    const bool last = i + 1 == names.size();
    result /= names[i];
    Fd next(::openat(at.get(), names[i].c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC));
    if (next.get() < 0) {
      if (last && use == PathUse::kNew && errno == ENOENT) return result;
      return refuse(given, errno_text(errno));
    }
    struct stat status {};
    if (::fstat(next.get(), &status) != 0) return refuse(given, errno_text(errno));
    if (S_ISLNK(status.st_mode)) return refuse(given, errno_text(ELOOP));
    if (!last && !S_ISDIR(status.st_mode)) return refuse(given, errno_text(ENOTDIR));
    if (!S_ISDIR(status.st_mode) && !S_ISREG(status.st_mode))
      return refuse(given, "is neither a file nor a folder");
    at = std::move(next);
  }
  return result;
}

Result<fs::path> CaseRoot::case_folder(std::string_view id, PathUse use) const {
  GNATHION_CHECK_OK(check_case_id(id));
  GNATHION_TRY(fs::path folder, resolve(id, use));
  if (use == PathUse::kNew) return folder;
  if (!resolve(std::string(id) + "/case.toml"))
    return fail(ErrorCode::kUsage, "no such case", std::string(id), "has no case.toml of its own");
  return folder;
}

}  // namespace gnathion
