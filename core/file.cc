#include "core/file.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

#include "core/check.h"
#include "core/interrupt.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

std::string errno_text() {
  return std::strerror(errno);
}

Status write_and_sync(const fs::path& path, std::string_view bytes) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) return fail(ErrorCode::kInternal, "cannot write", path.string(), errno_text());
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      const std::string why = errno_text();
      ::close(fd);
      return fail(ErrorCode::kInternal, "cannot write", path.string(), why);
    }
    done += static_cast<std::size_t>(n);
  }
  const bool synced = ::fsync(fd) == 0;
  const std::string why = synced ? "" : errno_text();
  if (::close(fd) != 0 || !synced)
    return fail(ErrorCode::kInternal, "cannot write", path.string(), why.empty() ? errno_text() : why);
  return {};
}

fs::path beside(const fs::path& path, const char* kind) {
  const fs::path folder = path.parent_path();
  return folder / ("." + path.filename().string() + "." + kind + "." + std::to_string(::getpid()));
}

}  // namespace

Result<std::string> read_file(const fs::path& path) {
  std::error_code ec;
  if (fs::is_directory(path, ec)) return bad_input("cannot read", path.string(), "is a directory");
  std::ifstream in(path, std::ios::binary);
  if (!in) return bad_input("cannot read", path.string(), errno_text());
  std::string bytes;
  const auto size = fs::file_size(path, ec);
  if (!ec) bytes.reserve(size);
  std::array<char, 1 << 16> block{};
  while (in.read(block.data(), block.size()) || in.gcount() > 0)
    bytes.append(block.data(), static_cast<std::size_t>(in.gcount()));
  if (in.bad()) return bad_input("cannot read", path.string(), errno_text());
  return bytes;
}

Status write_file(const fs::path& path, std::string_view bytes) {
  const fs::path temporary = beside(path, "part");
  const GoesWhenInterrupted while_writing(temporary);
  const Status written = write_and_sync(temporary, bytes);
  std::error_code ec;
  if (!written) {
    fs::remove(temporary, ec);
    return written;
  }
  fs::rename(temporary, path, ec);
  if (ec) {
    const std::string why = ec.message();
    fs::remove(temporary, ec);
    return fail(ErrorCode::kInternal, "cannot write", path.string(), why);
  }
  return {};
}

std::string sha256_hex(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int length = 0;
  GNATHION_CHECK(EVP_Digest(bytes.data(), bytes.size(), digest.data(), &length, EVP_sha256(), nullptr) == 1);
  static const char* hex = "0123456789abcdef";
  std::string text;
  for (unsigned int i = 0; i < length; ++i) {
    text += hex[digest[i] >> 4];
    text += hex[digest[i] & 15];
  }
  return text;
}

Result<std::string> sha256_of_file(const fs::path& path) {
  GNATHION_TRY(const std::string bytes, read_file(path));
  return sha256_hex(bytes);
}

namespace {

/// Whether an existing target may be replaced: a folder of ours, or an empty one.
Status may_replace(const fs::path& target, const std::vector<std::string>& own_files) {
  const auto refuse = [&](const char* why) {
    return fail(ErrorCode::kUsage, "cannot replace", target.string(), why);
  };
  std::error_code ec;
  if (!fs::is_directory(fs::symlink_status(target, ec))) return refuse("is not a folder");
  const fs::path real = fs::canonical(target, ec), here = fs::current_path(ec);
  if (std::mismatch(real.begin(), real.end(), here.begin(), here.end()).first == real.end())
    return refuse("holds the current directory");
  if (own_files.empty() || fs::is_empty(target, ec)) return {};
  for (const std::string& name : own_files)
    if (fs::exists(target / name, ec)) return {};
  return refuse("is not a folder that gnathion wrote");
}

}  // namespace

Result<StagedDirectory> StagedDirectory::create(const fs::path& target_given, bool force,
                                                const std::vector<std::string>& own_files) {
  fs::path target = target_given.lexically_normal();
  if (!target.has_filename()) target = target.parent_path();
  std::error_code ec;
  if (fs::exists(fs::symlink_status(target, ec))) {
    if (!force)
      return fail(ErrorCode::kUsage, "cannot write", target.string(), "exists; --force replaces it");
    GNATHION_CHECK_OK(may_replace(target, own_files));
  }
  if (target.has_parent_path()) fs::create_directories(target.parent_path(), ec);
  const fs::path staging = beside(target, "staging");
  fs::remove_all(staging, ec);
  if (!fs::create_directory(staging, ec))
    return fail(ErrorCode::kInternal, "cannot create", target.string(), ec.message());
  goes_when_interrupted(staging);
  return StagedDirectory(staging, target);
}

StagedDirectory::StagedDirectory(StagedDirectory&& other) noexcept
    : staging_(std::move(other.staging_)), target_(std::move(other.target_)) {
  other.staging_.clear();
}

StagedDirectory::~StagedDirectory() {
  std::error_code ec;
  if (staging_.empty()) return;
  fs::remove_all(staging_, ec);
  stays_when_interrupted(staging_);
}

Status StagedDirectory::commit() {
  std::error_code ec;
  const fs::path old = beside(target_, "old");
  const InterruptsWait interrupts_wait;
  const bool replaces = fs::exists(target_, ec);
  if (replaces) fs::rename(target_, old, ec);
  if (!ec) fs::rename(staging_, target_, ec);
  if (ec) {
    const std::string why = ec.message();
    if (replaces && !fs::exists(target_, ec)) fs::rename(old, target_, ec);
    return fail(ErrorCode::kInternal, "cannot write", target_.string(), why);
  }
  interrupts_wait.stays(staging_);
  staging_.clear();
  if (replaces) fs::remove_all(old, ec);
  return {};
}

}  // namespace gnathion
