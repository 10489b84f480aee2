// A live session: devices, one thread each, into one recording.
//
//   device thread ─┐
//   device thread ─┼─ queue, bounded in bytes ─ writer thread (compresses, writes) ─ file
//   device thread ─┘                            sync thread (fdatasync)
//
// Queue policy. Frames wait in a queue of `queue_bytes`; when it is full the newest frame is rejected and its
// ledger line "queue full" takes its place. Events, poses, ledger lines and transfers may go on for another
// `reserve_bytes`; when that is full too they are rejected in the same way, their lines added up to one a
// stream until there is room. Scans wait. So the session's memory is queue_bytes + reserve_bytes, one sample
// a device, and one chunk twice.
//
// What a crash can lose. A chunk is closed 60 ms after its first sample at the latest and handed to the
// kernel at once: the end of the process (kill -9 included) loses less than 200 ms. Every `sync_interval_ms`
// the file is synced (fdatasync): a power loss loses less than 1 s as long as the disk syncs within 0.4 s.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/device.h"
#include "acquisition/recording.h"
#include "acquisition/rig_watch.h"
#include "core/time.h"

namespace gnathion {

struct SessionOptions {
  std::size_t queue_bytes = std::size_t{256} << 20;
  std::size_t reserve_bytes = std::size_t{32} << 20;
  int sync_interval_ms = 300;
  RecordingOptions recording{"zstd", 60'000'000, std::size_t{4} << 20, true};
  std::vector<RigOptions> rigs;                    ///< cameras whose frames should come in sets
  std::string software_version;                    ///< kept in the recording's session.json
  std::map<std::string, std::string> attachments;  ///< name → bytes: configuration, calibration files
};

/// What became of one device.
struct SessionDevice {
  DeviceDescription description;
  DeviceHealth health;
  bool ended = false;  ///< no further samples: failed, stopped or at its end
};

/// A snapshot. Counts of the ledger are those of the samples that have come to the writer.
struct SessionStatus {
  bool running = true;         ///< some device still delivers and the disk takes it
  std::optional<Error> error;  ///< why the recording stopped: full disk, yanked disk
  double elapsed_s = 0;
  std::vector<SessionDevice> devices;
  std::map<std::string, LedgerCounts> ledger;  ///< by stream
  std::vector<RigCounts> rigs;
  std::size_t queue_bytes = 0, queue_peak_bytes = 0, queue_capacity_bytes = 0;
  std::uint64_t file_bytes = 0, synced_bytes = 0;
  double disk_mib_s = 0;                           ///< over the last second
  double longest_sync_s = 0, longest_write_s = 0;  ///< of one chunk
};

/// start(), status(), stop() and finish() may be called from any thread.
class Session {
 public:
  /// Creates the recording and starts every device's thread. `clock` outlives the session.
  static Result<std::unique_ptr<Session>> start(const std::filesystem::path& path,
                                                std::vector<std::unique_ptr<Device>> devices,
                                                SessionOptions options, Clock& clock);
  ~Session();  ///< finishes, if nobody did

  SessionStatus status() const;
  /// Waits until no device delivers any more, the disk fails, or the time is over. True: it ended by itself.
  bool wait_for(double seconds);
  /// Stops the devices, writes what is queued, closes the file. An error when the recording had to stop; what
  /// was written by then is a valid file unless the disk itself is gone. A device that does not stop within
  /// 3 s is left behind and named in the status. Idempotent.
  Status finish();

 private:
  struct State;
  explicit Session(std::shared_ptr<State> state);
  std::shared_ptr<State> state_;
};

}  // namespace gnathion
