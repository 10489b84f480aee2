// A client of gnathiond in plain C++: what viewer and command line know of the daemon. gRPC stays behind it.
//
// Thread rule: every function may be called from any thread. Callbacks of a subscription come one at a time,
// from the subscription's own thread; a callback that is slow makes this subscriber miss updates (each says
// how many), nobody else. A subscription ends when it is destroyed (its callback is not called after that; do
// not destroy it from inside its callback). A broken connection is told by `ended`, once; subscribe again to
// go on.
//
// Errors: kUsage for a request that the daemon refuses (wrong state, wrong name, a bound), kInput for what is
// not there, kInternal for the connection. Their text says what to do.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/result.h"
#include "core/rigid.h"
#include "core/time.h"

namespace gnathion::client {

enum class SessionState : std::uint8_t { kIdle, kArmed, kRecording, kStopping };
const char* name_of(SessionState state);  ///< "idle", "armed", ...

struct Session {
  SessionState state = SessionState::kIdle;
  std::string case_id, recording, message;
  double elapsed_s = 0;
  std::uint64_t file_bytes = 0, synced_bytes = 0, marks = 0;
  std::vector<std::string> devices_missing;
};

struct DeviceInfo {
  std::string stream, kind, state, message;  ///< state: "closed", "running", ...
  std::string vendor, model, serial;
  std::vector<std::string> settings, warnings;
  double rate_hz = 0;
  std::uint64_t received = 0, rejected = 0, missing = 0, reconnects = 0;
  double clock_jitter_ms = 0, clock_drift_ppm = 0;
};

struct Pose {
  std::string body, reference;  ///< "bow" in "rig", "jaw" in "dental" or "head_frame"
  bool valid = false;
  std::string reason;
  Rigid3 reference_from_body;  ///< "jaw" in "dental": the mandible's motion from MI
  std::vector<double>
      covariance;  ///< 36 numbers, (rotation rad, translation mm), left perturbation; or empty
  double rms_px = 0;
  unsigned tags = 0;
  std::string mi;
};
struct PoseUpdate {
  std::uint64_t index = 0, missed = 0;
  std::uint32_t sequence = 0;
  HostTime capture, arrival, published, sent;
  std::vector<Pose> poses;
};

struct EventUpdate {
  std::string stream, kind, text;
  bool pressed = true;
  std::uint32_t sequence = 0;
  HostTime capture;
  std::uint64_t missed = 0;
};

struct TagOutline {
  int id = 0;
  std::string body;
  std::vector<float> corners_px;  ///< x, y of four corners, pixels of the camera (not of the preview)
};
struct Preview {
  std::string stream;
  std::uint32_t sequence = 0;
  HostTime capture;
  Image8 image;
  int full_width_px = 0, full_height_px = 0;
  std::vector<TagOutline> tags;
  std::uint64_t missed = 0;
};
struct PreviewOptions {
  std::vector<std::string> streams;  ///< empty: every camera
  double max_rate_hz = 10;
  int max_width_px = 480;
};

struct StreamCounts {
  std::string stream, last_reason;
  std::uint64_t received = 0, missing = 0, rejected = 0;
  double rate_hz = 0;
};
struct LedgerUpdate {
  HostTime time;
  std::vector<StreamCounts> streams;
  std::vector<DeviceInfo> devices;
  double queue_fill = 0, disk_mib_s = 0, longest_sync_s = 0;
  std::uint64_t poses = 0, pose_frames_skipped = 0, missed = 0;
  double pose_rate_hz = 0, pose_latency_ms = 0;
};

enum class JobState : std::uint8_t { kQueued, kRunning, kDone, kGateFailed, kFailed, kCancelled };
const char* name_of(JobState state);
struct Job {
  std::string id, case_id, kind, step, message, who;
  JobState state = JobState::kQueued;
  double step_fraction = 0, fraction = 0;
  HostTime submitted, started, ended;
  int exit_code = 0;
  bool finished() const { return state != JobState::kQueued && state != JobState::kRunning; }
};
struct JobResult {
  Job job;
  std::string json;                  ///< as the command printed it
  std::vector<std::string> outputs;  ///< paths inside the case's folder
};
struct JobRequest {
  std::string case_id, kind;                                ///< "design", "calibrate camera", ...
  std::vector<std::pair<std::string, std::string>> values;  ///< {"maxilla", "scans/maxilla_mi.ply"}
  bool force = false;
};
struct JobOption {
  std::string name, type;  ///< "text", "number", "numbers", "flag", "input", "output"
  bool required = false, repeated = false;
};
struct JobKind {
  std::string name, help;
  std::vector<JobOption> options;
};

struct CaseFile {
  std::string path, role, sha256;
  std::uint64_t bytes = 0;
  std::int64_t modified_ns = 0;  ///< since 1970
};
struct Case {
  std::string id, kind, problem;
  std::vector<CaseFile> files;
};
struct ImportOptions {
  std::string case_id;  ///< of the new case; empty: one is made
  std::string source;   ///< of import_files: which of the files is imported; empty: the folder of all
  std::map<std::string, std::string> roles;  ///< {"maxilla_mi", "scan2.stl"} where names do not tell
  bool trust_names = false;
};
struct ImportedFile {
  std::string name;  ///< a plain name, no path
  std::filesystem::path from;
};
struct AuditLine {
  std::uint64_t number = 0;
  std::string time;  ///< UTC
  std::string who, action, case_id, detail;
};
struct Health {
  bool well = false;
  std::string version;
  double memory_mib = 0;
  unsigned connections = 0, streams = 0;
  struct Loop {
    std::string name;
    double age_s = 0, limit_s = 0;
  };
  std::vector<Loop> loops;
  std::vector<DeviceInfo> devices;
  std::vector<std::string> faults;  ///< what else is wrong, as lines missing from the audit trail
};

/// A running stream of updates. Destroying it ends it.
class Subscription {
 public:
  virtual ~Subscription() = default;
};
using Ended =
    std::function<void(const Status&)>;  ///< once, from the subscription's thread; not when destroyed

class DaemonClient {
 public:
  /// Connects to the daemon's socket; empty: $GNATHION_SOCKET, or "/run/gnathion/gnathiond.sock".
  static Result<std::unique_ptr<DaemonClient>> connect(const std::string& socket = {}, double wait_s = 3.0);
  virtual ~DaemonClient() = default;

  virtual Result<std::vector<DeviceInfo>> devices() = 0;
  virtual Result<std::vector<std::string>> configure_devices(const std::string& toml) = 0;
  virtual Result<Health> health() = 0;

  virtual Result<Session> session() = 0;
  virtual Result<Session> arm(const std::string& case_id) = 0;
  virtual Result<Session> start(const std::string& recording_name = {}) = 0;
  virtual Result<HostTime> mark(const std::string& kind, const std::string& text = {}) = 0;
  virtual Result<int> request_scan() = 0;  ///< how many scanners were asked
  virtual Result<Session> stop() = 0;
  virtual Result<Session> disarm() = 0;

  virtual std::unique_ptr<Subscription> watch_session(std::function<void(const Session&)> callback, bool hold,
                                                      Ended ended = {}) = 0;
  virtual std::unique_ptr<Subscription> poses(std::function<void(const PoseUpdate&)> callback,
                                              Ended ended = {}) = 0;
  virtual std::unique_ptr<Subscription> events(std::function<void(const EventUpdate&)> callback,
                                               Ended ended = {}) = 0;
  virtual std::unique_ptr<Subscription> previews(const PreviewOptions& options,
                                                 std::function<void(const Preview&)> callback,
                                                 Ended ended = {}) = 0;
  virtual std::unique_ptr<Subscription> ledger(double interval_s,
                                               std::function<void(const LedgerUpdate&)> callback,
                                               Ended ended = {}) = 0;

  virtual Result<std::vector<JobKind>> job_kinds() = 0;
  virtual Result<Job> submit(const JobRequest& request) = 0;
  virtual std::unique_ptr<Subscription> job_progress(const std::string& id,
                                                     std::function<void(const Job&)> callback,
                                                     Ended ended = {}) = 0;
  virtual Result<Job> cancel(const std::string& id) = 0;
  virtual Result<JobResult> job_result(const std::string& id) = 0;
  virtual Result<std::vector<Job>> jobs(const std::string& case_id = {}) = 0;

  virtual Result<Case> create_case(const std::string& case_id, const std::string& kind = "patient") = 0;
  virtual Result<std::vector<Case>> cases() = 0;
  virtual Result<Case> open_case(const std::string& case_id) = 0;
  /// Of what lies under the daemon's CASE_ROOT/incoming/.
  virtual Result<Case> import_incoming(const std::string& source, const ImportOptions& options) = 0;
  /// Of files of this machine, which go through the connection. `files`: which, and under what name each.
  virtual Result<Case> import_files(const std::vector<ImportedFile>& files, const ImportOptions& options) = 0;
  virtual Result<std::string> read_case_file(const std::string& case_id, const std::string& path) = 0;
  virtual Result<std::vector<AuditLine>> audit(const std::string& case_id, unsigned limit) = 0;
  virtual Result<std::string> verify_audit() = 0;  ///< empty: sound; else the fault
};

}  // namespace gnathion::client
