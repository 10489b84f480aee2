// Imports on behalf of clients: files of strangers are read by a process of `gnathion` of its own, so that
// none of them can hurt the daemon; what a client sends lies in a folder that goes with the call.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>

#include "core/time.h"
#include "daemon/api_error.h"
#include "pipeline/case_path.h"

namespace gnathion::daemon {

struct ImportOrder {
  std::string case_id;                       ///< empty: one is made from the time
  std::map<std::string, std::string> roles;  ///< as `gnathion case import --role`
  bool trust_names = false;
};

struct ImporterOptions {
  std::filesystem::path program;  ///< `gnathion`
  std::filesystem::path folder;   ///< of its own; whatever lies in it goes at the start
  std::uint64_t most_bytes = 0;   ///< that one client may send for one case
  int nice = 10;
};

/// Files that a client sends, until its import has ended. One thread.
class Upload {
 public:
  static constexpr int kMostFiles = 1000;
  ~Upload();  ///< they are removed
  /// `name` is a plain name, or a short path of plain names, below the upload's own folder. Refused: anything
  /// else, a name twice, too many.
  ApiStatus begin_file(const std::string& name);
  ApiStatus write(std::string_view bytes);
  /// The files are whole; what is imported: `source` among them, or the folder of all when it is empty.
  ApiResult<std::filesystem::path> finish(const std::string& source);
  int files() const { return files_; }
  std::uint64_t bytes() const { return bytes_; }

 private:
  friend class CaseImporter;
  Upload(std::filesystem::path folder, std::uint64_t most_bytes, std::atomic<int>& count)
      : folder_(std::move(folder)), most_bytes_(most_bytes), count_(count) {}
  void close_file();
  const std::filesystem::path folder_;
  const std::uint64_t most_bytes_;
  std::atomic<int>& count_;
  int fd_ = -1, files_ = 0;
  std::uint64_t bytes_ = 0;
};

/// Thread-safe.
class CaseImporter {
 public:
  CaseImporter(ImporterOptions options, const CaseRoot& root, Clock& clock);
  /// Makes the case; its id. Refused while another is at work, and as the command refuses it, in its words.
  /// `cancelled` is asked all the time.
  ApiResult<std::string> import(const std::filesystem::path& source, const ImportOrder& order,
                                const std::function<bool()>& cancelled);
  /// Refused: two others are sending files already.
  ApiResult<std::unique_ptr<Upload>> upload();

 private:
  std::filesystem::path own_folder(const char* kind);
  const ImporterOptions options_;
  const CaseRoot& root_;
  Clock& clock_;
  std::mutex one_at_a_time_;
  std::atomic<std::uint64_t> number_{0};
  std::atomic<int> uploads_{0};
};

/// From the time: "case-20260131-120000".
std::string made_case_id(Clock& clock);

}  // namespace gnathion::daemon
