#include "client/daemon_client.h"

#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <fstream>

#include "client/convert.h"
#include "client/grpc_client.h"
#include "gnathion/v1/capture.grpc.pb.h"
#include "gnathion/v1/cases.grpc.pb.h"
#include "gnathion/v1/devices.grpc.pb.h"
#include "gnathion/v1/jobs.grpc.pb.h"
#include "gnathion/v1/live.grpc.pb.h"

namespace gnathion::client {

namespace api = ::gnathion::v1;
namespace {

constexpr const char* kDefaultSocket = "/run/gnathion/gnathiond.sock";

std::string socket_path(const std::string& given) {
  if (!given.empty()) return given;
  const char* variable = std::getenv("GNATHION_SOCKET");
  return variable && *variable ? variable : kDefaultSocket;
}

class GrpcClient : public DaemonClient {
 public:
  explicit GrpcClient(std::shared_ptr<grpc::Channel> channel)
      : devices_(api::Devices::NewStub(channel)),
        capture_(api::Capture::NewStub(channel)),
        live_(api::Live::NewStub(channel)),
        jobs_(api::Jobs::NewStub(channel)),
        cases_(api::Cases::NewStub(channel)),
        catalogue_(api::Catalogue::NewStub(channel)) {}

  Result<std::vector<DeviceInfo>> devices() override {
    api::ListDevicesResponse response;
    GNATHION_CHECK_OK(call("cannot list devices", devices_.get(), &api::Devices::Stub::List, {}, &response));
    std::vector<DeviceInfo> list;
    for (const api::Device& device : response.device()) list.push_back(plain(device));
    return list;
  }
  Result<std::vector<std::string>> configure_devices(const std::string& toml) override {
    api::ConfigureRequest request;
    request.set_configuration(toml);
    api::ConfigureResponse response;
    GNATHION_CHECK_OK(
        call("cannot configure devices", devices_.get(), &api::Devices::Stub::Configure, request, &response));
    return std::vector<std::string>(response.stream().begin(), response.stream().end());
  }
  Result<Health> health() override {
    api::HealthResponse response;
    GNATHION_CHECK_OK(
        call("cannot ask for health", devices_.get(), &api::Devices::Stub::Health, {}, &response));
    return plain(response);
  }

  Result<Session> session() override {
    return session_call("cannot ask for the session", &api::Capture::Stub::GetState, api::GetStateRequest());
  }
  Result<Session> arm(const std::string& case_id) override {
    api::ArmRequest request;
    request.set_case_id(case_id);
    return session_call("cannot arm", &api::Capture::Stub::Arm, request);
  }
  Result<Session> start(const std::string& recording_name) override {
    api::StartRequest request;
    request.set_name(recording_name);
    return session_call("cannot start", &api::Capture::Stub::Start, request);
  }
  Result<HostTime> mark(const std::string& kind, const std::string& text) override {
    api::MarkRequest request;
    request.set_kind(kind);
    request.set_text(text);
    api::MarkResponse response;
    GNATHION_CHECK_OK(call("cannot mark", capture_.get(), &api::Capture::Stub::Mark, request, &response));
    return HostTime{response.capture_ns()};
  }
  Result<int> request_scan() override {
    api::ScanResponse response;
    GNATHION_CHECK_OK(
        call("cannot scan", capture_.get(), &api::Capture::Stub::RequestScan, api::ScanRequest(), &response));
    return static_cast<int>(response.scanners());
  }
  Result<Session> stop() override {
    return session_call("cannot stop", &api::Capture::Stub::Stop, api::StopRequest());
  }
  Result<Session> disarm() override {
    return session_call("cannot disarm", &api::Capture::Stub::Disarm, api::DisarmRequest());
  }

  std::unique_ptr<Subscription> watch_session(std::function<void(const Session&)> callback, bool hold,
                                              Ended ended) override {
    api::WatchRequest request;
    request.set_hold(hold);
    return subscribe<api::SessionState>(
        "session", [=, this](auto* context) { return capture_->Watch(context, request); },
        std::move(callback), std::move(ended));
  }
  std::unique_ptr<Subscription> poses(std::function<void(const PoseUpdate&)> callback, Ended ended) override {
    return subscribe<api::PoseUpdate>(
        "poses", [this](auto* context) { return live_->Poses(context, api::PosesRequest()); },
        std::move(callback), std::move(ended));
  }
  std::unique_ptr<Subscription> events(std::function<void(const EventUpdate&)> callback,
                                       Ended ended) override {
    return subscribe<api::EventUpdate>(
        "events", [this](auto* context) { return live_->Events(context, api::EventsRequest()); },
        std::move(callback), std::move(ended));
  }
  std::unique_ptr<Subscription> previews(const PreviewOptions& options,
                                         std::function<void(const Preview&)> callback, Ended ended) override {
    api::PreviewsRequest request;
    for (const std::string& stream : options.streams) request.add_stream(stream);
    request.set_max_rate_hz(options.max_rate_hz);
    request.set_max_width_px(static_cast<unsigned>(std::max(0, options.max_width_px)));
    return subscribe<api::Preview>(
        "previews", [=, this](auto* context) { return live_->Previews(context, request); },
        std::move(callback), std::move(ended));
  }
  std::unique_ptr<Subscription> ledger(double interval_s, std::function<void(const LedgerUpdate&)> callback,
                                       Ended ended) override {
    api::LedgerRequest request;
    request.set_interval_s(interval_s);
    return subscribe<api::LedgerUpdate>(
        "ledger", [=, this](auto* context) { return live_->Ledger(context, request); }, std::move(callback),
        std::move(ended));
  }

  Result<std::vector<JobKind>> job_kinds() override {
    api::DescribeJobsResponse response;
    GNATHION_CHECK_OK(call("cannot describe jobs", jobs_.get(), &api::Jobs::Stub::Describe, {}, &response));
    std::vector<JobKind> kinds;
    for (const api::JobKind& kind : response.kind()) kinds.push_back(plain(kind));
    return kinds;
  }
  Result<Job> submit(const JobRequest& order) override {
    api::SubmitJobRequest request;
    request.set_case_id(order.case_id);
    request.set_kind(order.kind);
    request.set_force(order.force);
    for (const auto& [name, value] : order.values) {
      api::JobValue& v = *request.add_value();
      v.set_name(name);
      v.set_value(value);
    }
    return job_call("cannot submit", &api::Jobs::Stub::Submit, request);
  }
  std::unique_ptr<Subscription> job_progress(const std::string& id, std::function<void(const Job&)> callback,
                                             Ended ended) override {
    return subscribe<api::Job>(
        "job", [request = job_request(id), this](auto* context) { return jobs_->Progress(context, request); },
        std::move(callback), std::move(ended));
  }
  Result<Job> cancel(const std::string& id) override {
    return job_call("cannot cancel", &api::Jobs::Stub::Cancel, job_request(id));
  }
  Result<JobResult> job_result(const std::string& id) override {
    api::JobResult response;
    GNATHION_CHECK_OK(
        call("cannot fetch result", jobs_.get(), &api::Jobs::Stub::Result, job_request(id), &response));
    return JobResult{
        plain(response.job()), response.json(), {response.output().begin(), response.output().end()}};
  }
  Result<std::vector<Job>> jobs(const std::string& case_id) override {
    api::ListJobsRequest request;
    request.set_case_id(case_id);
    api::ListJobsResponse response;
    GNATHION_CHECK_OK(call("cannot list jobs", jobs_.get(), &api::Jobs::Stub::List, request, &response));
    std::vector<Job> list;
    for (const api::Job& job : response.job()) list.push_back(plain(job));
    return list;
  }

  Result<Case> create_case(const std::string& case_id, const std::string& kind) override {
    api::CreateCaseRequest request;
    request.set_case_id(case_id);
    request.set_kind(kind);
    return case_call("cannot create case", &api::Cases::Stub::Create, request);
  }
  Result<std::vector<Case>> cases() override {
    std::vector<Case> list;
    api::ListCasesRequest request;
    request.set_limit(1000);
    while (true) {
      api::ListCasesResponse response;
      GNATHION_CHECK_OK(call("cannot list cases", cases_.get(), &api::Cases::Stub::List, request, &response));
      for (const api::CaseInfo& info : response.case_()) list.push_back(plain(info));
      if (!response.more() || list.empty()) return list;
      request.set_after(list.back().id);
    }
  }
  Result<Case> open_case(const std::string& case_id) override {
    api::OpenCaseRequest request;
    request.set_case_id(case_id);
    return case_call("cannot open case", &api::Cases::Stub::Open, request);
  }
  Result<Case> import_incoming(const std::string& source, const ImportOptions& options) override {
    api::ImportCaseRequest request = import_request(options);
    request.set_source(source);
    return case_call("cannot import case", &api::Cases::Stub::Import, request);
  }
  Result<Case> import_files(const std::vector<ImportedFile>& files, const ImportOptions& options) override {
    constexpr const char* what = "cannot import case";
    grpc::ClientContext context;
    api::CaseInfo response;
    const auto writer = cases_->ImportFiles(&context, &response);
    api::ImportChunk chunk;
    *chunk.mutable_options() = import_request(options);
    bool goes = writer->Write(chunk);
    std::string block(std::size_t{256} << 10, '\0');
    const auto unreadable = [&](const std::filesystem::path& file, const char* why) {
      context.TryCancel();
      (void)writer->Finish();
      return bad_input(what, file.string(), why);
    };
    for (const ImportedFile& file : files) {
      std::ifstream in(file.from, std::ios::binary);
      if (!in) return unreadable(file.from, "cannot be read");
      chunk.Clear();
      chunk.set_name(file.name);
      goes = goes && writer->Write(chunk);
      while (goes && (in.read(block.data(), static_cast<std::streamsize>(block.size())) || in.gcount() > 0)) {
        chunk.Clear();
        chunk.set_data(block.data(), static_cast<std::size_t>(in.gcount()));
        goes = writer->Write(chunk);
      }
      if (in.bad()) return unreadable(file.from, "cannot be read to its end");
    }
    writer->WritesDone();
    GNATHION_CHECK_OK(status_of(writer->Finish(), what));
    return plain(response);
  }
  Result<std::string> read_case_file(const std::string& case_id, const std::string& path) override {
    api::ReadFileRequest request;
    request.set_case_id(case_id);
    request.set_path(path);
    grpc::ClientContext context;
    const auto reader = cases_->ReadFile(&context, request);
    std::string bytes;
    api::FileChunk chunk;
    std::uint64_t total = 0;
    while (reader->Read(&chunk)) {
      bytes += chunk.data();
      total = chunk.total_bytes();
    }
    GNATHION_CHECK_OK(status_of(reader->Finish(), "cannot read file of case"));
    if (bytes.size() < total)
      return fail(ErrorCode::kInternal, "cannot read file of case", path,
                  "it did not come whole; read it again");
    return bytes;
  }
  Result<std::vector<AuditLine>> audit(const std::string& case_id, unsigned limit) override {
    api::ReadAuditRequest request;
    request.set_case_id(case_id);
    request.set_limit(limit);
    api::ReadAuditResponse response;
    GNATHION_CHECK_OK(call("cannot read audit trail", catalogue_.get(), &api::Catalogue::Stub::ReadAudit,
                           request, &response));
    std::vector<AuditLine> lines;
    for (const api::AuditLine& l : response.line())
      lines.push_back({l.number(), l.time(), l.who(), l.action(), l.case_id(), l.detail()});
    return lines;
  }
  Result<std::string> verify_audit() override {
    api::VerifyAuditResponse response;
    GNATHION_CHECK_OK(call("cannot verify audit trail", catalogue_.get(), &api::Catalogue::Stub::VerifyAudit,
                           {}, &response));
    return response.sound() ? std::string() : response.fault();
  }

 private:
  template <class Stub, class Request, class Response>
  static Status call(const char* what, Stub* stub,
                     grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                     const std::type_identity_t<Request>& request, Response* response) {
    grpc::ClientContext context;
    context.set_wait_for_ready(false);
    return status_of((stub->*method)(&context, request, response), what);
  }
  template <class Request>
  Result<Session> session_call(const char* what,
                               grpc::Status (api::Capture::Stub::*method)(grpc::ClientContext*,
                                                                          const Request&, api::SessionState*),
                               const Request& request) {
    api::SessionState response;
    GNATHION_CHECK_OK(call(what, capture_.get(), method, request, &response));
    return plain(response);
  }
  template <class Request>
  Result<Job> job_call(const char* what,
                       grpc::Status (api::Jobs::Stub::*method)(grpc::ClientContext*, const Request&,
                                                               api::Job*),
                       const Request& request) {
    api::Job response;
    GNATHION_CHECK_OK(call(what, jobs_.get(), method, request, &response));
    return plain(response);
  }
  template <class Request>
  Result<Case> case_call(const char* what,
                         grpc::Status (api::Cases::Stub::*method)(grpc::ClientContext*, const Request&,
                                                                  api::CaseInfo*),
                         const Request& request) {
    api::CaseInfo response;
    GNATHION_CHECK_OK(call(what, cases_.get(), method, request, &response));
    return plain(response);
  }
  static api::ImportCaseRequest import_request(const ImportOptions& options) {
    api::ImportCaseRequest request;
    request.set_case_id(options.case_id);
    request.set_source(options.source);
    request.mutable_role()->insert(options.roles.begin(), options.roles.end());
    request.set_trust_names(options.trust_names);
    return request;
  }
  static api::JobRequest job_request(const std::string& id) {
    api::JobRequest request;
    request.set_job_id(id);
    return request;
  }
  template <class Message, class Open, class Callback>
  static std::unique_ptr<Subscription> subscribe(const std::string& what, Open open, Callback callback,
                                                 Ended ended) {
    return std::make_unique<StreamSubscription<Message>>(
        what, std::move(open),
        [callback = std::move(callback)](const Message& message) { callback(plain(message)); },
        std::move(ended));
  }

  std::unique_ptr<api::Devices::Stub> devices_;
  std::unique_ptr<api::Capture::Stub> capture_;
  std::unique_ptr<api::Live::Stub> live_;
  std::unique_ptr<api::Jobs::Stub> jobs_;
  std::unique_ptr<api::Cases::Stub> cases_;
  std::unique_ptr<api::Catalogue::Stub> catalogue_;
};

}  // namespace

Error error_of(const grpc::Status& status, const std::string& what) {
  using grpc::StatusCode;
  switch (status.error_code()) {
    case StatusCode::INVALID_ARGUMENT:
    case StatusCode::FAILED_PRECONDITION:
    case StatusCode::ALREADY_EXISTS:
    case StatusCode::RESOURCE_EXHAUSTED:
    case StatusCode::PERMISSION_DENIED:
      return {ErrorCode::kUsage, what, "gnathiond", status.error_message()};
    case StatusCode::NOT_FOUND:
      return {ErrorCode::kInput, what, "gnathiond", status.error_message()};
    case StatusCode::UNAVAILABLE:
      return {ErrorCode::kInternal, what, "gnathiond", "the connection is gone: " + status.error_message()};
    default:
      return {ErrorCode::kInternal, what, "gnathiond", status.error_message()};
  }
}

Status status_of(const grpc::Status& status, const std::string& what) {
  if (status.ok()) return {};
  return tl::unexpected<Error>(error_of(status, what));
}

Result<std::unique_ptr<DaemonClient>> DaemonClient::connect(const std::string& socket, double wait_s) {
  const std::string path = socket_path(socket);
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(32 << 20);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);  // a client, a connection
  arguments.SetString(GRPC_ARG_DEFAULT_AUTHORITY, "localhost");
  auto channel = grpc::CreateCustomChannel("unix:" + path, grpc::InsecureChannelCredentials(), arguments);
  const auto deadline =
      std::chrono::system_clock::now() +
      std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(wait_s));
  if (!channel->WaitForConnected(deadline))
    return fail(
        ErrorCode::kInternal, "cannot connect", path,
        "no gnathiond answers there, or you are not in its group; `systemctl status gnathiond` tells");
  return std::unique_ptr<DaemonClient>(std::make_unique<GrpcClient>(std::move(channel)));
}

const char* name_of(SessionState state) {
  constexpr std::array names = {"idle", "armed", "recording", "stopping"};
  return names[static_cast<std::size_t>(state)];
}

const char* name_of(JobState state) {
  constexpr std::array names = {"queued", "running", "done", "gate failed", "failed", "cancelled"};
  return names[static_cast<std::size_t>(state)];
}

}  // namespace gnathion::client
