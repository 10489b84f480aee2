#include <fmt/format.h>

#include <atomic>
#include <deque>
#include <mutex>
#include <set>

#include "acquisition/scanner/folder_watch.h"
#include "acquisition/scanner/scan_devices.h"
#include "acquisition/scanner/scan_files.h"
#include "acquisition/scanner/surface_deviation.h"
#include "acquisition/scanner/taken_scans.h"
#include "core/file.h"
#include "core/mesh_io.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

/// From handing a scan over until it is remembered as taken. A session writes a sample within 60 ms and syncs
/// every 300 ms; the rest is for a disk that is slow.
constexpr std::int64_t kRemember_ns = 10'000'000'000;

struct FolderSettings {
  fs::path folder, taken_list;
  IntakeOptions intake;
  int poll_ms = 500;
  std::int64_t companion_ns = 0;
  std::uint64_t largest_bytes = 0;
  bool take_existing = false, use_events = true, subfolders = false;
};

std::int64_t ns_from_s(double seconds) {
  return static_cast<std::int64_t>(seconds * 1e9);
}

Result<FolderSettings> settings_from(const DeviceConfig& config) {
  SettingsReader read(config);
  FolderSettings s;
  const auto folder = read.path("folder");
  if (!folder) read.refuse("folder", "is missing: name the folder that the scanner exports to");
  s.folder = folder.value_or(fs::path());
  s.taken_list = read.path("taken_list").value_or(config.folder / (config.stream + ".taken"));
  s.intake.settle_ns = ns_from_s(read.number_in("settle_ms", 0, 60000, 300) * 1e-3);
  s.intake.settle_unseen_ns = ns_from_s(read.number_in("settle_unseen_ms", 100, 600000, 2000) * 1e-3);
  s.intake.incomplete_ns = ns_from_s(read.number_in("incomplete_s", 0.1, 3600, 60));
  s.companion_ns = ns_from_s(read.number_in("companion_s", 0, 3600, 20));
  s.poll_ms = static_cast<int>(read.number_in("poll_ms", 20, 60000, 500));
  s.largest_bytes = static_cast<std::uint64_t>(read.number_in("max_mib", 1, 4096, 1024) * 1048576.0);
  s.take_existing = read.choice("existing", {"ignore", "take"}, "ignore") == "take";
  s.use_events = read.choice("watch", {"events", "poll"}, "events") == "events";
  s.subfolders = read.flag("subfolders").value_or(false);
  GNATHION_CHECK_OK(read.finish());
  return s;
}

/// A complete scan with all that it refers to.
struct Export {
  std::string name;  ///< relative to the folder
  FileState state;
  std::string mesh;
  std::map<std::string, std::string> companions;
};

/// A scan that was made a sample and may not be in the recording yet.
struct Unrecorded {
  std::string sha256, name;             ///< as in the sample
  std::string path;                     ///< from the folder on
  std::optional<HostTime> handed_over;  ///< by next()
};

class ScanFolderDevice : public Device, public RemembersScans {
 public:
  ScanFolderDevice(const DeviceConfig& config, FolderSettings settings, TakenScans taken,
                   ScansUnderway underway, Clock& clock)
      : kind_(config.kind),
        stream_(config.stream),
        settings_(std::move(settings)),
        clock_(clock),
        watch_(settings_.folder, settings_.use_events, settings_.subfolders),
        intake_(settings_.intake),
        taken_(std::move(taken)),
        underway_(std::move(underway)) {}

  /// Samples are written by now, whatever their age, unless the recording failed.
  ~ScanFolderDevice() override {
    if (recording_failed_) return;
    remember(std::nullopt);
    ended_ ? (void)underway_.set({}) : note_underway(clock_.now());
  }

  Status begin() {
    GNATHION_TRY(Listing listing, watch_.list());
    started_ = clock_.now();
    if (!watch_.has_events() || !watch_.why_no_events().empty())
      polled_ =
          fmt::format("the folder is only polled ({}): a file is taken {:.1f} s after its last change",
                      watch_.why_no_events(), static_cast<double>(settings_.intake.settle_unseen_ns) * 1e-9);
    set_state(DeviceState::kRunning, fmt::format("watching {}", settings_.folder.string()));
    for (const std::string& name : underway_.names())
      if (listing.erase(name) > 0)
        tell(started_, "warning", true,
             fmt::format("{} was on its way when the last recording broke off: it is looked at again", name));
    if (settings_.take_existing) return {};
    intake_.ignore_present(listing);
    std::uint32_t count = 0;
    for (const auto& [name, state] : listing) count += is_mesh_name(name) ? 1 : 0;
    if (count > 0)
      reject(started_, {}, count,
             fmt::format("{} mesh file(s) were there at the start; existing = \"take\" takes them", count));
    return {};
  }

  Result<std::optional<Sample>> next() override {
    for (;;) {
      remember(clock_.now());
      if (stopped_) settle_accounts();
      if (!outbox_.empty()) {
        Sample sample = std::move(outbox_.front());
        outbox_.pop_front();
        if (const auto* scan = std::get_if<ScanSample>(&sample)) mark_handed_over(*scan);
        return std::optional<Sample>(std::move(sample));
      }
      if (stopped_) {
        set_state(DeviceState::kStopped, "stopped");
        return std::optional<Sample>();
      }
      look();
      if (outbox_.empty() && !stopped_) watch_.wait(intake_.waiting().empty() ? settings_.poll_ms : 30);
    }
  }

  void recording_failed() override { recording_failed_ = true; }

  void stop() override {
    stopped_ = true;
    watch_.wake();
  }

  DeviceDescription description() const override {
    DeviceDescription d;
    d.kind = kind_;
    d.stream = stream_;
    d.settings = {fmt::format("folder: {}", settings_.folder.string()),
                  fmt::format("taken_list: {}", settings_.taken_list.string()),
                  fmt::format("settle_ms: {}", settings_.intake.settle_ns / 1000000),
                  fmt::format("settle_unseen_ms: {}", settings_.intake.settle_unseen_ns / 1000000),
                  fmt::format("existing: {}", settings_.take_existing ? "take" : "ignore"),
                  fmt::format("subfolders: {}", settings_.subfolders)};
    if (!polled_.empty()) d.warnings.push_back(polled_);
    return d;
  }

  DeviceHealth health() const override {
    std::lock_guard lock(mutex_);
    return health_;
  }

 private:
  /// One look at the folder: what is new, what is complete, what never will be.
  void look() {
    for (const auto& [name, event] : watch_.events()) intake_.note(name, event);
    const auto listing = watch_.list();
    const HostTime now = clock_.now();
    if (!note_presence(listing, now)) return;
    intake_.update(*listing, now);
    for (const std::string& name : intake_.ready(now)) consider(name, now);
    for (const auto& given_up : intake_.overdue(now)) reject(now, given_up.name, 1, given_up.reason);
    note_underway(now);
  }

  /// At the stop, once: files that were still to come get their line.
  void settle_accounts() {
    if (ended_) return;
    ended_ = true;
    const HostTime now = clock_.now();
    if (const auto listing = watch_.list()) intake_.update(*listing, now);
    note_underway(now);  // should the recording fail now
    for (const std::string& name : intake_.waiting())
      reject(now, name, 1, "not complete when the recording ended; existing = \"take\" takes it next time");
  }

  /// What a crash from here on must not make us forget.
  void note_underway(HostTime now) {
    std::set<std::string> names;
    for (std::string& name : intake_.waiting()) names.insert(std::move(name));
    for (const Unrecorded& scan : unrecorded_) names.insert(scan.path);
    if (const Status written = underway_.set(std::move(names)); !written) complain(now, written.error());
  }

  /// False while the folder is away. Its coming and going are events.
  bool note_presence(const Result<Listing>& listing, HostTime now) {
    const bool here = listing.has_value();
    if (here == present_) return here;
    present_ = here;
    const std::string why = here ? fmt::format("{} is back", settings_.folder.string())
                                 : fmt::format("{}: {}; mount or create it again", settings_.folder.string(),
                                               listing.error().why);
    tell(now, "device", here, why);
    set_state(here ? DeviceState::kRunning : DeviceState::kRecovering, why);
    if (here) {
      std::lock_guard lock(mutex_);
      ++health_.reconnects;
    }
    return here;
  }

  void consider(const std::string& name, HostTime now) {
    const FileState state = *intake_.state_of(name);
    if (state.size > settings_.largest_bytes) {
      reject(now, name, 1,
             fmt::format("{} MiB large; max_mib allows {}", state.size >> 20, settings_.largest_bytes >> 20));
      return intake_.close_case(name);
    }
    Export scan;
    if (held_ && held_->name == name && held_->state == state) {
      scan.mesh = std::move(held_->mesh);  // it waited for a texture; it need not be read again
      held_.reset();
    } else {
      auto bytes = read_file(settings_.folder / name);
      if (!bytes) return intake_.set_aside(name, bytes.error().why);
      // Written to while it was read: the next look sees it changed.
      if (bytes->size() != state.size) return;
      scan.mesh = std::move(*bytes);
    }
    scan.name = name;
    scan.state = state;
    if (!companions_are_there(scan, now)) {
      held_ = std::move(scan);
      return;
    }
    const auto mesh = parse_mesh(scan.mesh, name);
    if (!mesh) return intake_.set_aside(name, mesh.error().why);
    intake_.close_case(name);
    take(std::move(scan), *mesh, now);
  }

  /// Gathers material and texture; false while one is still to come.
  bool companions_are_there(Export& scan, HostTime now) {
    std::deque<std::pair<std::string, std::string>> open;  // referring file's folder, reference
    const std::string folder = folder_of(scan.name);
    for (const std::string& r : referred_files(scan.name, scan.mesh))
      open.emplace_back(folder, local_name(r));
    std::vector<std::string> missing;
    while (!open.empty()) {
      const auto [base, reference] = open.front();
      open.pop_front();
      if (reference.empty() || scan.companions.count(reference)) continue;
      const std::string path = found_near(base, reference);
      const auto bytes = complete_file(path, now);
      if (!bytes) {
        missing.push_back(reference);
        continue;
      }
      scan.companions[reference] = *bytes;
      for (const std::string& r : referred_files(path, *bytes))
        open.emplace_back(folder_of(path), local_name(r));
    }
    if (missing.empty()) return true;
    const std::string why = fmt::format("refers to {}, which is not there", fmt::join(missing, ", "));
    if (now.ns - intake_.last_change(scan.name)->ns < settings_.companion_ns) {
      intake_.hold(scan.name, why);
      return false;
    }
    // The shape is what the chain needs; it is not thrown away for a picture.
    tell(now, "warning", true, fmt::format("{} {}: taken without", scan.name, why));
    return true;
  }

  static std::string folder_of(const std::string& name) {
    const std::size_t slash = name.find_last_of('/');
    return slash == std::string::npos ? std::string() : name.substr(0, slash + 1);
  }

  /// The reference as it stands, or its last part where an exporter's own directory was in it.
  std::string found_near(const std::string& base, const std::string& reference) const {
    if (fs::exists(settings_.folder / (base + reference))) return base + reference;
    return base + reference.substr(reference.find_last_of('/') + 1);
  }

  std::optional<std::string> complete_file(const std::string& path, HostTime now) const {
    // A texture in a subfolder that is not watched has no history: that it is there must do.
    if (intake_.exists(path) && !intake_.is_settled(path, now)) return std::nullopt;
    std::error_code ec;
    const auto size = fs::file_size(settings_.folder / path, ec);
    if (ec || size == 0 || size > settings_.largest_bytes) return std::nullopt;
    auto bytes = read_file(settings_.folder / path);
    if (!bytes || bytes->size() != size) return std::nullopt;
    return std::move(*bytes);
  }

  void take(Export scan, const TriangleMesh& mesh, HostTime now) {
    const std::string sha256 = sha256_hex(scan.mesh);
    if (const auto queued = queued_.find(sha256); queued != queued_.end())
      return reject(now, scan.name, 1, fmt::format("same content as {}, which was taken", queued->second));
    if (const std::string* known = taken_.find(sha256))
      return reject(now, scan.name, 1, fmt::format("same content as {}, which was taken before", *known));
    ScanSample sample;
    sample.header = header(scan.name, now);
    sample.header.device.ns = scan.state.modified_ns;
    sample.name = unique_name(scan.name);
    sample.sha256 = sha256;
    const auto unit = suspected_unit(mesh);
    if (unit) {
      tell(now, "warning", true,
           fmt::format("{} is {:.4g} units large: {}? The chain wants a face in millimetres; set the "
                       "scanner's export unit",
                       scan.name, bounding_box(mesh).size_mm().maxCoeff(), *unit));
    } else if (const auto deviation = measure_surface_deviation(mesh)) {
      sample.deviation_mm = deviation->sigma_mm;
    }
    sample.files = std::move(scan.companions);
    sample.files[sample.name] = std::move(scan.mesh);
    queued_[sha256] = sample.name;
    unrecorded_.push_back({sha256, sample.name, scan.name, std::nullopt});
    {
      std::lock_guard lock(mutex_);
      ++health_.received;
      health_.message = fmt::format("took {}", sample.name);
    }
    outbox_.push_back(std::move(sample));
  }

  std::string unique_name(const std::string& path) {
    const fs::path file = fs::path(path).filename();
    std::string name = file.string();
    for (int n = 2; !names_.insert(name).second; ++n)
      name = fmt::format("{}_{}{}", file.stem().string(), n, file.extension().string());
    return name;
  }

  void mark_handed_over(const ScanSample& scan) {
    for (Unrecorded& waiting : unrecorded_)
      if (waiting.sha256 == scan.sha256) waiting.handed_over = clock_.now();
  }

  /// Scans that were handed over long ago are in the recording: they are never to come again. Without a time:
  /// all that were handed over.
  void remember(std::optional<HostTime> now) {
    for (auto scan = unrecorded_.begin(); scan != unrecorded_.end();) {
      if (!scan->handed_over || (now && now->ns - scan->handed_over->ns < kRemember_ns)) {
        ++scan;
        continue;
      }
      if (const Status written = taken_.add(scan->sha256, scan->name); !written)
        complain(clock_.now(), written.error());
      scan = unrecorded_.erase(scan);
    }
  }

  void complain(HostTime now, const Error& error) {
    if (list_complained_) return;
    list_complained_ = true;
    tell(now, "warning", true,
         fmt::format("{}: {}: a restart may take scans again, or miss those that were on their way",
                     settings_.taken_list.string(), error.why));
  }

  SampleHeader header(const std::string& name, HostTime now) {
    SampleHeader h;
    h.stream = stream_;
    h.sequence = sequence_++;
    h.capture = intake_.first_seen(name).value_or(now);
    h.arrival = now;
    return h;
  }

  void reject(HostTime now, const std::string& name, std::uint32_t count, const std::string& why) {
    LedgerSample line;
    line.header = header(name, now);
    line.fate = LedgerSample::Fate::kRejected;
    line.count = count;
    line.reason = name.empty() ? why : fmt::format("{}: {}", name, why);
    sequence_ += count - 1;
    std::lock_guard lock(mutex_);
    health_.rejected += count;
    health_.message = line.reason;
    outbox_.push_back(std::move(line));
  }

  void tell(HostTime now, const char* kind, bool pressed, const std::string& text) {
    EventSample event;
    event.header.stream = stream_ + "/state";
    event.header.sequence = event_sequence_++;
    event.header.capture = event.header.arrival = now;
    event.kind = kind;
    event.pressed = pressed;
    event.text = text;
    outbox_.push_back(std::move(event));
  }

  void set_state(DeviceState state, const std::string& message) {
    std::lock_guard lock(mutex_);
    health_.state = state;
    health_.message = message;
  }

  const std::string kind_, stream_;
  std::string polled_;  ///< set before anyone else knows the device
  const FolderSettings settings_;
  Clock& clock_;
  FolderWatch watch_;
  ScanIntake intake_;
  TakenScans taken_;
  ScansUnderway underway_;
  std::deque<Sample> outbox_;
  std::optional<Export> held_;                 ///< the last that waits for its texture
  std::map<std::string, std::string> queued_;  ///< sha256 → name, of this session
  std::set<std::string> names_;                ///< of this session's samples
  std::vector<Unrecorded> unrecorded_;
  std::uint32_t sequence_ = 0, event_sequence_ = 0;
  bool present_ = true, list_complained_ = false;
  bool ended_ = false;  ///< stopped, and every file has its scan or its line
  std::atomic<bool> recording_failed_ = false;
  HostTime started_;
  std::atomic<bool> stopped_ = false;
  mutable std::mutex mutex_;
  DeviceHealth health_;
};

}  // namespace

Result<std::unique_ptr<Device>> open_scan_folder(const DeviceConfig& config, Clock& clock) {
  GNATHION_TRY(FolderSettings settings, settings_from(config));
  std::error_code ec;
  if (!fs::is_directory(settings.folder, ec))
    return bad_input(
        "cannot open device", config.where,
        fmt::format("folder {} does not exist; create it or mount the share", settings.folder.string()));
  GNATHION_TRY(TakenScans taken, TakenScans::load(settings.taken_list));
  GNATHION_TRY(ScansUnderway underway, ScansUnderway::load(settings.taken_list.string() + ".underway"));
  auto device = std::make_unique<ScanFolderDevice>(config, std::move(settings), std::move(taken),
                                                   std::move(underway), clock);
  GNATHION_CHECK_OK(device->begin());
  return device;
}

}  // namespace gnathion
