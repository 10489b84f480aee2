#include "daemon/server.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/impl/codegen/service_type.h>
#include <grpcpp/server_posix.h>
#include <grpcpp/support/server_interceptor.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>

#include "core/log.h"
#include "daemon/igtl/igtl_server.h"
#include "daemon/igtl/splint_of_case.h"
#include "daemon/services/support.h"
#include "daemon/system_notify.h"
#include "pipeline/version.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot start gnathiond";
constexpr const char* kSelf = "gnathiond";

/// One daemon a state folder: the lock goes with the process, however it ends.
Result<int> lock_state(const fs::path& state) {
  std::error_code ec;
  fs::create_directories(state, ec);
  const fs::path file = state / "gnathiond.lock";
  const int fd = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd < 0) return bad_input(kWhat, file.string(), std::strerror(errno));
  if (::flock(fd, LOCK_EX | LOCK_NB) == 0) return fd;
  ::close(fd);
  return bad_input(kWhat, state.string(), "another gnathiond works with this state folder; stop it first");
}

Result<CaseRoot> open_case_root(const fs::path& root) {
  std::error_code ec;
  if (!fs::exists(root, ec)) fs::create_directories(root, ec);
  return CaseRoot::open(root);
}

/// Made anew from the folders at each start: what was changed in them meanwhile is in it. A disk that
/// takes no more, or a file that somebody keeps locked, is no reason not to serve: then the old one, or one
/// beside the socket (in memory under systemd) until the next start, which knows no head of the audit trail.
Result<Catalogue> open_catalogue(const DaemonConfig& config, const CaseRoot& root) {
  const fs::path usual = config.catalogue_file();
  const fs::path spare = config.socket.parent_path() / (usual.filename().string() + ".spare");
  Error first;
  for (const fs::path& file : {usual, spare}) {
    extend_start_timeout();
    const auto rebuilt = Catalogue::rebuild(file, root.path(), CaseTrust::kConfined);
    auto opened = Catalogue::open(file);
    if (rebuilt && opened) return opened;
    const Error& error = rebuilt ? opened.error() : rebuilt.error();
    if (first.why.empty()) first = error;
    log(LogLevel::kWarning, error.line() + (opened ? "; the catalogue is not up to date" : ""));
    if (opened) return opened;
  }
  return tl::unexpected<Error>(first);
}

fs::path program_of(const DaemonConfig& config) {
  if (!config.program.empty()) return config.program;
  std::error_code ec;
  return fs::read_symlink("/proc/self/exe", ec).parent_path() / "gnathion";
}

/// Streams of gRPC's own services (reflection, health) keep a thread or memory like those of ours, and come
/// out of the same number: beyond it a call is cancelled before it begins.
class StreamBound : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  explicit StreamBound(Slots& streams) : streams_(streams) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(grpc::experimental::ServerRpcInfo* info) override {
    const std::string method = info->method();
    const bool counted =
        method.rfind("/grpc.", 0) == 0 && info->type() != grpc::experimental::ServerRpcInfo::Type::UNARY;
    return counted ? new Bound(streams_, *info) : nullptr;
  }

 private:
  class Bound : public grpc::experimental::Interceptor {
   public:
    Bound(Slots& streams, grpc::experimental::ServerRpcInfo& info) : slot_(streams.take()), info_(info) {}
    void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
      using Point = grpc::experimental::InterceptionHookPoints;
      if (!slot_ && methods->QueryInterceptionHookPoint(Point::POST_RECV_INITIAL_METADATA))
        info_.server_context()->TryCancel();
      methods->Proceed();
    }

   private:
    const ApiResult<Slots::Slot> slot_;
    grpc::experimental::ServerRpcInfo& info_;
  };
  Slots& streams_;
};

}  // namespace

struct Daemon::State {
  State(const DaemonConfig& c, Clock& k, CaseRoot r, Catalogue cat, AuditTrail trail)
      : config(c),
        clock(k),
        root(std::move(r)),
        catalogue(std::move(cat)),
        audit(std::move(trail), catalogue, clock),
        heartbeats(clock),
        session(config, root, channels, heartbeats, clock, [this](const std::string& id) { refresh(id); }),
        jobs({program_of(config), config.jobs_parallel, config.limits.jobs_queued, config.jobs_nice,
              [this](const std::string& id) { refresh(id); }},
             root, clock),
        importer({program_of(config), config.state / "imports",
                  static_cast<std::uint64_t>(config.limits.import_mib) << 20, config.jobs_nice},
                 root, clock),
        context{session, jobs, importer, root, channels, catalogue, audit, heartbeats, clock} {
    context.audit_file = config.audit_file();
    context.started = clock.now();
    context.streams.set_limit(config.limits.streams);
    apply(config);
  }
  /// The catalogue knows what jobs and recordings have made of a case.
  void refresh(const std::string& case_id) {
    if (const Status done = catalogue.refresh(case_id, root.path(), CaseTrust::kConfined); !done)
      log(LogLevel::kWarning, "catalogue: " + done.error().line());
  }
  void apply(const DaemonConfig& c) { context.holder_grace_s = c.holder_grace_s; }
  Status serve();
  Status listen_for_igtl();
  void end();

  DaemonConfig config;
  Clock& clock;
  int lock = -1;
  const CaseRoot root;
  Catalogue catalogue;
  AuditLog audit;
  Heartbeats heartbeats;
  LiveChannels channels;
  SessionControl session;
  JobRunner jobs;
  CaseImporter importer;
  ServiceContext context;
  std::vector<std::unique_ptr<grpc::Service>> services;
  std::unique_ptr<grpc::Server> server;
  std::unique_ptr<PeerSocket> socket;
  SplintOfCase splint{root, clock};  ///< of the OpenIGTLink server's thread
  std::unique_ptr<IgtlServer> igtl;
};

Status Daemon::State::serve() {
  services.push_back(make_devices_service(context));
  services.push_back(make_capture_service(context));
  services.push_back(make_live_service(context));
  services.push_back(make_cases_service(context));
  services.push_back(make_catalogue_service(context));
  services.push_back(make_jobs_service(context));
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  for (const auto& service : services) builder.RegisterService(service.get());
  // A stalled subscriber keeps a thread, so there is one for each stream and call, and no more.
  grpc::ResourceQuota quota("gnathiond");
  quota.SetMaxThreads(config.limits.streams + config.limits.calls + 16);
  builder.SetResourceQuota(quota);
  builder.SetMaxReceiveMessageSize(config.limits.message_kib << 10);
  builder.SetMaxSendMessageSize(32 << 20);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, config.limits.streams + config.limits.calls);
  builder.AddChannelArgument(GRPC_ARG_MAX_METADATA_SIZE, 16 << 10);
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.SetSyncServerOption(grpc::ServerBuilder::SyncServerOption::NUM_CQS, 2);
  builder.SetSyncServerOption(grpc::ServerBuilder::SyncServerOption::MIN_POLLERS, 1);
  builder.SetSyncServerOption(grpc::ServerBuilder::SyncServerOption::MAX_POLLERS, 4);
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> bounds;
  bounds.push_back(std::make_unique<StreamBound>(context.streams));
  builder.experimental().SetInterceptorCreators(std::move(bounds));
  server = builder.BuildAndStart();
  if (!server) return fail(ErrorCode::kInternal, kWhat, "gRPC", "the server could not be made");
  auto opened = PeerSocket::open(
      {config.socket, config.group, config.limits.connections},
      [s = server.get()](int fd) { grpc::AddInsecureChannelFromFd(s, fd); }, heartbeats);
  if (!opened) return tl::unexpected<Error>(opened.error());
  socket = std::move(*opened);
  context.peers = socket.get();
  return {};
}

Status Daemon::State::listen_for_igtl() {
  if (!config.igtl.enabled) return {};
  IgtlServerOptions options;
  options.address = config.igtl.address;
  options.port = config.igtl.port;
  options.clients = config.igtl.clients;
  options.image_rate_hz = config.igtl.image_rate_hz;
  options.image_width_px = config.igtl.image_width_px;
  options.splint = [this] { return splint.newest(session.view().case_id); };
  auto opened = IgtlServer::open(options, channels, heartbeats, clock);
  if (!opened) return tl::unexpected<Error>(opened.error());
  igtl = std::move(*opened);
  log(LogLevel::kInfo,
      fmt::format("OpenIGTLink: read-only on {}:{}{}", options.address, igtl->port(),
                  options.address == "127.0.0.1" ? ", reachable from this machine alone"
                                                 : ": reachable by whoever reaches that address, without "
                                                   "encryption or password"));
  return {};
}

void Daemon::State::end() {
  context.going_down = true;
  session.terminate();  // a recording is finished first of all
  jobs.stop();
  session.enter_recordings();  // what waited for a job's end
  igtl.reset();
  channels.close();
  if (server) {
    server->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(2));
    server->Wait();
  }
  socket.reset();
}

Result<std::unique_ptr<Daemon>> Daemon::start(const DaemonConfig& config, Clock& clock) {
  set_log_level(config.log_level);
  GNATHION_TRY(const int lock, lock_state(config.state));
  GNATHION_TRY(CaseRoot root, open_case_root(config.case_root));
  extend_start_timeout();
  const std::vector<std::string> recovered = recover_after_crash(config, root);
  const std::vector<std::string> cleaned = clean_after_crash(root);
  GNATHION_TRY(Catalogue catalogue, open_catalogue(config, root));
  GNATHION_TRY(AuditTrail trail, AuditTrail::open(config.audit_file()));
  auto state =
      std::make_unique<State>(config, clock, std::move(root), std::move(catalogue), std::move(trail));
  state->lock = lock;
  state->audit.note(kSelf, "daemon.start", {}, fmt::format("version {} pid {}", kVersion, ::getpid()));
  for (const auto* lines : {&recovered, &cleaned})
    for (const std::string& line : *lines) {
      log(LogLevel::kWarning, line);
      state->audit.note(kSelf, "daemon.recovered", {}, line);
    }
  GNATHION_CHECK_OK(state->serve());
  GNATHION_CHECK_OK(state->listen_for_igtl());
  log(LogLevel::kInfo, fmt::format("gnathiond {} serves {} with the cases of {}", kVersion,
                                   config.socket.string(), config.case_root.string()));
  return std::unique_ptr<Daemon>(new Daemon(std::move(state)));
}

Daemon::Daemon(std::unique_ptr<State> state) : state_(std::move(state)) {}

Daemon::~Daemon() {
  state_->end();
  state_->audit.note(kSelf, "daemon.stop");
  ::close(state_->lock);
}

bool Daemon::well(std::string* why) const {
  for (const LoopHealth& loop : state_->heartbeats.health())
    if (!loop.well()) {
      *why = fmt::format("loop '{}' has not gone on for {:.1f} s", loop.name, loop.age_s);
      return false;
    }
  return true;
}

std::vector<std::string> Daemon::reload(const DaemonConfig& config) {
  std::vector<std::string> waiting = needs_restart(state_->config, config);
  set_log_level(config.log_level);
  state_->apply(config);
  state_->session.reload(config);
  state_->audit.note(kSelf, "daemon.reload");
  return waiting;
}

int Daemon::igtl_port() const {
  return state_->igtl ? state_->igtl->port() : 0;
}

}  // namespace gnathion::daemon
