#include "daemon/config.h"

#include <fmt/format.h>
#include <grp.h>
#include <sys/un.h>
#include <unistd.h>

#include <set>

#include "acquisition/device_config.h"
#include "pipeline/capture_setup.h"
#include "pipeline/toml_file.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot read daemon configuration";

/// A section of the file behind the reader of settings that devices use: types, ranges, unknown keys.
class Section {
 public:
  static Result<std::unique_ptr<Section>> of(const toml::table& file, const std::string& name,
                                             const fs::path& path) {
    auto section = std::unique_ptr<Section>(new Section);
    section->config_.where = fmt::format("{}: [{}]", path.string(), name);
    section->config_.folder = path.parent_path();
    const toml::node* node = file.get(name);
    if (!node) return section;
    if (!node->is_table())
      return bad_input(kWhat, path.string(), fmt::format("'{}' must be a section", name));
    for (const auto& [key, value] : *node->as_table()) {
      auto& setting = section->config_.settings[std::string(key.str())];
      if (const auto* b = value.as_boolean())
        setting = b->get();
      else if (const auto* i = value.as_integer())
        setting = i->get();
      else if (const auto* d = value.as_floating_point())
        setting = d->get();
      else if (const auto* s = value.as_string())
        setting = s->get();
      else
        return bad_input(kWhat, section->config_.where, fmt::format("'{}' is not a value", key.str()));
    }
    return section;
  }
  SettingsReader& operator*() { return reader_; }
  void path(const char* key, fs::path& to) {
    if (const auto value = reader_.path(key)) to = *value;
  }
  void whole(const char* key, double low, double high, int& to) {
    to = static_cast<int>(reader_.number_in(key, low, high, to));
  }
  Status finish() {
    if (Status status = reader_.finish(); !status)
      return bad_input(kWhat, status.error().where, status.error().why);
    return {};
  }

 private:
  Section() : reader_(config_) {}
  DeviceConfig config_;
  SettingsReader reader_;
};

Status read_daemon_section(Section& s, DaemonConfig& c) {
  s.path("case_root", c.case_root);
  s.path("state", c.state);
  s.path("socket", c.socket);
  c.group = (*s).text("group").value_or(c.group);
  const std::string level = (*s).choice("log_level", {"debug", "info", "warning", "error"}, "info");
  c.log_level = level == "debug"     ? LogLevel::kDebug
                : level == "warning" ? LogLevel::kWarning
                : level == "error"   ? LogLevel::kError
                                     : LogLevel::kInfo;
  if (c.socket.string().size() >= sizeof(sockaddr_un::sun_path))
    (*s).refuse("socket", fmt::format("is longer than the {} bytes that a socket's path can have",
                                      sizeof(sockaddr_un::sun_path) - 1));
  return s.finish();
}

Status read_capture_section(Section& s, DaemonConfig& c) {
  s.path("devices", c.devices);
  s.path("rig", c.rig);
  s.path("chain", c.chain);
  s.whole("queue_mib", 16, 65536, c.queue_mib);
  c.holder_grace_s = (*s).number_in("holder_grace_s", 0, 3600, c.holder_grace_s);
  return s.finish();
}

Status read_jobs_section(Section& s, DaemonConfig& c) {
  s.path("program", c.program);
  s.whole("parallel", 1, 64, c.jobs_parallel);
  s.whole("nice", 0, 19, c.jobs_nice);
  return s.finish();
}

Status read_limits_section(Section& s, Limits& l) {
  s.whole("connections", 1, 10000, l.connections);
  s.whole("streams", 1, 10000, l.streams);
  s.whole("calls", 1, 1000, l.calls);
  s.whole("jobs_queued", 1, 10000, l.jobs_queued);
  s.whole("message_kib", 64, 65536, l.message_kib);
  s.whole("import_mib", 1, 1 << 20, l.import_mib);
  return s.finish();
}

Status read_igtl_section(Section& s, IgtlOptions& o) {
  o.enabled = (*s).flag("enabled").value_or(o.enabled);
  o.address = (*s).text("address").value_or(o.address);
  s.whole("port", 0, 65535, o.port);
  s.whole("clients", 1, 64, o.clients);
  o.image_rate_hz = (*s).number_in("image_rate_hz", 0, 120, o.image_rate_hz);
  s.whole("image_width_px", 16, 4096, o.image_width_px);
  return s.finish();
}

}  // namespace

Result<DaemonConfig> read_daemon_config(const fs::path& path) {
  std::error_code ec;
  const fs::path whole = fs::absolute(path, ec);
  GNATHION_TRY(const toml::table file, read_toml(whole, kWhat));
  static const std::set<std::string> known = {"daemon", "capture", "jobs", "limits", "openigtlink"};
  for (const auto& [key, node] : file)
    if (!known.count(std::string(key.str())))
      return bad_input(kWhat, path.string(), fmt::format("unknown section '{}'", key.str()));
  DaemonConfig config;
  config.file = whole;
  GNATHION_TRY(const auto general, Section::of(file, "daemon", whole));
  GNATHION_CHECK_OK(read_daemon_section(*general, config));
  GNATHION_TRY(const auto capture, Section::of(file, "capture", whole));
  GNATHION_CHECK_OK(read_capture_section(*capture, config));
  GNATHION_TRY(const auto jobs, Section::of(file, "jobs", whole));
  GNATHION_CHECK_OK(read_jobs_section(*jobs, config));
  GNATHION_TRY(const auto limits, Section::of(file, "limits", whole));
  GNATHION_CHECK_OK(read_limits_section(*limits, config.limits));
  GNATHION_TRY(const auto igtl, Section::of(file, "openigtlink", whole));
  GNATHION_CHECK_OK(read_igtl_section(*igtl, config.igtl));
  return config;
}

std::vector<std::string> faults_of(const DaemonConfig& c) {
  std::vector<std::string> faults;
  std::error_code ec;
  const auto folder = [&](const char* key, const fs::path& path) {
    if (!fs::is_directory(path, ec))
      faults.push_back(fmt::format("{}: {}: is not a folder; make it (mode 0700)", key, path.string()));
    else if (::access(path.c_str(), W_OK | X_OK) != 0)
      faults.push_back(fmt::format("{}: {}: cannot be written by this user", key, path.string()));
  };
  const auto file = [&](const char* key, const fs::path& path) {
    if (!path.empty() && ::access(path.c_str(), R_OK) != 0)
      faults.push_back(fmt::format("{}: {}: cannot be read", key, path.string()));
  };
  folder("case_root", c.case_root);
  folder("state", c.state);
  folder("socket", c.socket.parent_path());
  file("rig", c.rig);
  file("chain", c.chain);
  if (!c.group.empty() && !::getgrnam(c.group.c_str()))
    faults.push_back(
        fmt::format("group: {}: there is no such group; groupadd --system {}", c.group, c.group));
  if (!c.program.empty() && ::access(c.program.c_str(), X_OK) != 0)
    faults.push_back(fmt::format("program: {}: cannot be run", c.program.string()));
  if (fs::exists(c.devices, ec))  // a new installation has none yet: Configure brings it
    if (const auto setup = read_capture_setup(c.devices); !setup) faults.push_back(setup.error().line());
  return faults;
}

std::vector<std::string> needs_restart(const DaemonConfig& running, const DaemonConfig& wanted) {
  std::vector<std::string> lines;
  const auto differ = [&](bool different, const char* key) {
    if (different) lines.push_back(fmt::format("'{}' has changed: restart gnathiond for it", key));
  };
  differ(running.case_root != wanted.case_root, "case_root");
  differ(running.state != wanted.state, "state");
  differ(running.socket != wanted.socket, "socket");
  differ(running.group != wanted.group, "group");
  differ(running.program != wanted.program, "program");
  differ(running.jobs_parallel != wanted.jobs_parallel, "parallel");
  differ(running.jobs_nice != wanted.jobs_nice, "nice");
  const Limits &now = running.limits, &then = wanted.limits;
  differ(now.connections != then.connections, "connections");
  differ(now.streams != then.streams, "streams");
  differ(now.calls != then.calls, "calls");
  differ(now.jobs_queued != then.jobs_queued, "jobs_queued");
  differ(now.message_kib != then.message_kib, "message_kib");
  differ(now.import_mib != then.import_mib, "import_mib");
  const IgtlOptions &was = running.igtl, &is = wanted.igtl;
  differ(was.enabled != is.enabled, "enabled");
  differ(was.address != is.address, "address");
  differ(was.port != is.port, "port");
  differ(was.clients != is.clients, "clients");
  differ(was.image_rate_hz != is.image_rate_hz, "image_rate_hz");
  differ(was.image_width_px != is.image_width_px, "image_width_px");
  return lines;
}

}  // namespace gnathion::daemon
