// What is half-made goes when the program is interrupted: SIGINT, SIGTERM, SIGHUP.
#pragma once

#include <filesystem>
#include <mutex>
#include <utility>

namespace gnathion {

/// From now on these signals remove what is registered and then end the program as they would have without
/// this. For main() of a command; a part that handles such a signal itself (a recording) takes it over.
void clean_up_when_interrupted();

/// A file or folder that goes if the program is interrupted from now on, until it is released by the same
/// path. Thread-safe; costs a lock.
void goes_when_interrupted(const std::filesystem::path& path);
void stays_when_interrupted(const std::filesystem::path& path);

/// While it lives nothing is removed and the program is not ended: for the renames that put what was
/// registered in its place. Once the removing has begun, making one waits for the end.
class InterruptsWait {
 public:
  InterruptsWait();
  /// stays_when_interrupted(), from within.
  void stays(const std::filesystem::path& path) const;

 private:
  std::unique_lock<std::mutex> lock_;
};

/// Goes if the program is interrupted while this object lives.
class GoesWhenInterrupted {
 public:
  explicit GoesWhenInterrupted(std::filesystem::path path) : path_(std::move(path)) {
    goes_when_interrupted(path_);
  }
  ~GoesWhenInterrupted() { stays_when_interrupted(path_); }
  GoesWhenInterrupted(const GoesWhenInterrupted&) = delete;
  GoesWhenInterrupted& operator=(const GoesWhenInterrupted&) = delete;

 private:
  const std::filesystem::path path_;
};

}  // namespace gnathion
