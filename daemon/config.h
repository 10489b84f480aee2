// gnathiond.toml: how the daemon is set. docs/daemon.md has a commented example.
#pragma once

#include <filesystem>
#include <string>

#include "core/log.h"
#include "core/result.h"

namespace gnathion::daemon {

struct Limits {
  int connections = 64, streams = 64, calls = 64;  ///< calls that run at one time, streams apart
  int jobs_queued = 64;
  int message_kib = 4096;  ///< of a request
  int import_mib = 4096;   ///< of the files that a client sends for one case
};

struct IgtlOptions {
  bool enabled = true;
  std::string address = "127.0.0.1";
  int port = 18944;
  int clients = 8;
  double image_rate_hz = 10;  ///< of each camera; 0: none
  int image_width_px = 640;
};

struct DaemonConfig {
  std::filesystem::path file;  ///< empty: all defaults
  std::filesystem::path case_root = "/var/lib/gnathion/cases";
  std::filesystem::path state = "/var/lib/gnathion";  ///< audit trail, catalogue, what must outlive a crash
  std::filesystem::path socket = "/run/gnathion/gnathiond.sock";
  std::string group;  ///< who may connect; empty: the daemon's own group
  LogLevel log_level = LogLevel::kInfo;

  std::filesystem::path devices = "/var/lib/gnathion/devices.toml";
  std::filesystem::path rig, chain;  ///< for cases that have none of their own; may be empty
  int queue_mib = 256;
  double holder_grace_s = 2;  ///< how long an armed session waits for its holder to come back

  std::filesystem::path program;  ///< `gnathion`; empty: beside the daemon
  int jobs_parallel = 1;
  int jobs_nice = 10;

  Limits limits;
  IgtlOptions igtl;

  std::filesystem::path audit_file() const { return state / "audit.jsonl"; }
  std::filesystem::path catalogue_file() const { return state / "catalogue.sqlite"; }
};

/// Refused (kInput): what is not TOML, an unknown key, a value out of its range. Relative paths start at the
/// file's folder. The file system is not looked at.
Result<DaemonConfig> read_daemon_config(const std::filesystem::path& path);

/// --check-config: the file, the folders, the group, the devices file and what else can be known without
/// opening a device. One line a fault; none: it will run.
std::vector<std::string> faults_of(const DaemonConfig& config);

/// What a reload can change while the daemon runs; one line for each other setting that differs and waits
/// for a restart.
std::vector<std::string> needs_restart(const DaemonConfig& running, const DaemonConfig& wanted);

}  // namespace gnathion::daemon
