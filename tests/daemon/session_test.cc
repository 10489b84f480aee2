// A session through the whole daemon: real process, real socket, real recording.
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/mount.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <mutex>
#include <thread>

#include "acquisition/recording.h"
#include "core/file.h"
#include "gnathion/v1/capture.grpc.pb.h"
#include "gnathion/v1/cases.grpc.pb.h"
#include "gnathion/v1/devices.grpc.pb.h"
#include "gnathion/v1/jobs.grpc.pb.h"
#include "gnathion/v1/live.grpc.pb.h"
#include "pipeline/case_file.h"
#include "pipeline/case_lock.h"
#include "tests/daemon/daemon_process.h"

namespace gnathion::testing {
namespace {

namespace fs = std::filesystem;
namespace api = ::gnathion::v1;
using client::SessionState;
using grpc::StatusCode;
using ::testing::HasSubstr;

class DaemonSession : public ::testing::Test {
 protected:
  void start(const std::string& more = {}, double duration_s = 60) {
    daemon_ = std::make_unique<DaemonProcess>(folder_.path(), more);
    SmallRecording what;
    what.duration_s = duration_s;
    fs::create_directories(folder_.path() / "cases/incoming");
    write_small_recording(film(), what);
    ASSERT_TRUE(daemon_->start()) << daemon_->log();
    client_ = daemon_->connect();
    ASSERT_TRUE(client_);
    ASSERT_TRUE(client_->create_case("case-1"));
    const auto streams = client_->configure_devices(replay_devices(film()));
    ASSERT_TRUE(streams) << streams.error().line();
  }
  fs::path film() const { return folder_.path() / "cases/incoming/film.mcap"; }
  client::Session arm_and_start() {
    const auto armed = client_->arm("case-1");
    EXPECT_TRUE(armed) << armed.error().line();
    const auto started = client_->start();
    EXPECT_TRUE(started) << started.error().line();
    return started ? *started : client::Session{};
  }
  SessionState state() {
    const auto session = client_->session();
    return session ? session->state : SessionState::kIdle;
  }
  /// What case.toml of case-1 names.
  fs::path named_recording() const {
    const auto files = read_unfinished_case(daemon_->cases() / "case-1");
    EXPECT_TRUE(files) << files.error().line();
    return files ? files->recording : fs::path();
  }
  TemporaryFolder folder_;
  std::unique_ptr<DaemonProcess> daemon_;
  std::unique_ptr<client::DaemonClient> client_;
};

TEST_F(DaemonSession, RecordsWithMarksAndEverySubscriberSeesIt) {
  start();
  std::atomic<int> poses{0}, events{0}, previews{0}, ledgers{0}, states{0};
  const auto a = client_->poses([&](const auto& p) { poses += p.poses.size() == 1 && p.poses[0].valid; });
  const auto b = client_->events([&](const auto& e) { events += e.kind == "MI"; });
  const auto c = client_->previews({}, [&](const auto& p) { previews += p.image.width_px == 64; });
  const auto d = client_->ledger(0.1, [&](const auto& l) { ledgers += !l.streams.empty(); });
  const auto e = client_->watch_session([&](const auto&) { ++states; }, false);
  const client::Session started = arm_and_start();
  EXPECT_EQ(started.recording, "recordings/recording_001.mcap");
  ASSERT_TRUE(client_->mark("MI", "first"));
  ASSERT_TRUE(client_->mark("TP"));
  EXPECT_TRUE(
      eventually([&] { return poses > 30 && events >= 2 && previews > 4 && ledgers > 3 && states > 3; }));
  const auto stopped = client_->stop();
  ASSERT_TRUE(stopped) << stopped.error().line();
  EXPECT_EQ(stopped->state, SessionState::kArmed);
  ASSERT_TRUE(client_->disarm());
  EXPECT_EQ(state(), SessionState::kIdle);
  EXPECT_EQ(named_recording(), daemon_->cases() / "case-1" / started.recording);  // `run` finds it

  const fs::path file = daemon_->cases() / "case-1" / started.recording;
  struct stat info {};
  ASSERT_EQ(::stat(file.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600u);
  const auto summary = summarise_recording(file);
  ASSERT_TRUE(summary) << summary.error().line();
  EXPECT_TRUE(summary->whole);
  for (const char* stream : {"camera_0", "camera_1", "tracker/1"}) {
    EXPECT_GT(summary->streams.at(stream).received, 20u) << stream;
    EXPECT_EQ(summary->streams.at(stream).missing, 0u) << stream;
    EXPECT_TRUE(summary->streams.at(stream).rejected.empty()) << stream;
  }
  EXPECT_EQ(summary->streams.at("marks").received, 4u);  // two marks, pressed and released

  const auto lines = client_->audit("case-1", 100);
  ASSERT_TRUE(lines);
  std::vector<std::string> actions;
  for (const auto& line : *lines) {
    actions.push_back(line.action);
    EXPECT_THAT(line.who, HasSubstr("uid " + std::to_string(::getuid())));
    EXPECT_THAT(line.who, HasSubstr("pid " + std::to_string(::getpid())));
  }
  EXPECT_EQ(actions, (std::vector<std::string>{"case.create", "capture.arm", "capture.start", "capture.mark",
                                               "capture.mark", "capture.stop", "capture.disarm"}));
  EXPECT_EQ(client_->verify_audit().value_or("not asked"), "");
  struct stat socket {};
  ASSERT_EQ(::stat(daemon_->socket().c_str(), &socket), 0);
  EXPECT_EQ(socket.st_mode & 0777, 0660u);
}

TEST_F(DaemonSession, SeveralRecordingsWhileTheDevicesGoOn) {
  start();
  ASSERT_TRUE(client_->arm("case-1"));
  std::int64_t last = -1;
  for (int i = 1; i <= 3; ++i) {
    const auto started = client_->start();
    ASSERT_TRUE(started) << started.error().line();
    std::this_thread::sleep_for(std::chrono::milliseconds(150));
    ASSERT_TRUE(client_->stop());
    const fs::path file = daemon_->cases() / "case-1" / started->recording;
    const auto source = RecordingSource::open(file);
    ASSERT_TRUE(source);
    std::int64_t first = -1;
    while (auto next = (*source)->next()) {
      if (!*next) break;
      const auto* frame = std::get_if<FrameSample>(&**next);
      if (!frame || frame->header.stream != "camera_0") continue;
      if (first < 0) first = frame->header.sequence;
      EXPECT_GT(frame->header.sequence, last);  // the same film went on
      last = frame->header.sequence;
    }
    EXPECT_GT(last, first);
  }
}

TEST_F(DaemonSession, CaseTomlNamesTheNewestRecording) {
  start();
  const fs::path folder = daemon_->cases() / "case-1";
  std::ofstream(folder / "case.toml", std::ios::app) << "\n# by hand\n[session]\n";
  arm_and_start();
  ASSERT_TRUE(client_->stop());
  EXPECT_EQ(named_recording(), folder / "recordings/recording_001.mcap");
  {  // Something works in the case: it is entered when that has ended.
    const auto lock = CaseLock::take(folder, "test");
    ASSERT_TRUE(lock);
    ASSERT_TRUE(client_->start());
    ASSERT_TRUE(client_->stop());
    EXPECT_EQ(named_recording(), folder / "recordings/recording_001.mcap");
  }
  EXPECT_TRUE(eventually([&] { return named_recording() == folder / "recordings/recording_002.mcap"; }));
  {  // So it is across a crash and a restart. The daemon lets go of the case a moment after it has written.
    ASSERT_TRUE(eventually([&] { return CaseLock::take(folder, "test").has_value(); }));
    const auto lock = CaseLock::take(folder, "test");
    ASSERT_TRUE(lock);
    ASSERT_TRUE(client_->start("held"));
    ASSERT_TRUE(client_->stop());
    daemon_->kill_and_wait();
    ASSERT_TRUE(daemon_->start()) << daemon_->log();
    EXPECT_EQ(named_recording(), folder / "recordings/recording_002.mcap");
  }
  EXPECT_TRUE(eventually([&] { return named_recording() == folder / "recordings/held.mcap"; }));
  EXPECT_TRUE(eventually([&] { return !fs::exists(daemon_->state() / "waiting_recordings.json"); }));
  client_ = daemon_->connect();
  ASSERT_TRUE(client_->arm("case-1"));
  // The daemon is killed while it records: the next start enters what it makes whole.
  ASSERT_TRUE(client_->start());
  ASSERT_TRUE(eventually([&] { return client_->session()->file_bytes > 100'000; }));
  daemon_->kill_and_wait();
  ASSERT_TRUE(daemon_->start()) << daemon_->log();
  client_ = daemon_->connect();
  EXPECT_EQ(named_recording(), folder / "recordings/recording_003.mcap");
  std::string text = read_file(folder / "case.toml").value_or("");
  EXPECT_THAT(text, HasSubstr("# by hand"));
  // One that lies elsewhere is a person's choice and stays; the session says so.
  fs::copy_file(film(), folder / "chosen.mcap");
  text.replace(text.find("recordings/recording_003.mcap"), 29, "chosen.mcap");
  std::ofstream(folder / "case.toml") << text;
  arm_and_start();
  const auto stopped = client_->stop();
  ASSERT_TRUE(stopped);
  EXPECT_THAT(stopped->message, HasSubstr("chosen.mcap stays the recording that case.toml names"));
  EXPECT_EQ(named_recording(), folder / "chosen.mcap");
}

/// A small disk at `folder`, as root; gone with its object.
class SmallDisk {
 public:
  explicit SmallDisk(const fs::path& folder) : folder_(folder) {
    fs::create_directories(folder);
    mounted_ = ::mount("tmpfs", folder.c_str(), "tmpfs", 0, "size=2m,mode=0700") == 0;
  }
  ~SmallDisk() {
    if (mounted_) ::umount2(folder_.c_str(), MNT_DETACH);
  }
  bool mounted() const { return mounted_; }
  void fill() const {
    std::ofstream filler(folder_ / "filler", std::ios::binary);
    const std::string block(4096, 'x');
    while (filler.write(block.data(), 4096).flush()) {
    }
  }
  void free() const { fs::remove(folder_ / "filler"); }

 private:
  fs::path folder_;
  bool mounted_ = false;
};

TEST_F(DaemonSession, AFullDiskOfStateCostsNoRecording) {
  const SmallDisk disk(folder_.path() / "state");
  if (!disk.mounted()) GTEST_SKIP() << "a small disk can only be made by root";
  start();
  const fs::path folder = daemon_->cases() / "case-1";
  {  // Neither the note that a recording waits for its case nor a line of the audit trail can be written.
    const auto lock = CaseLock::take(folder, "test");
    ASSERT_TRUE(lock);
    arm_and_start();
    disk.fill();
    ASSERT_TRUE(eventually([&] { return client_->session()->file_bytes > 100'000; }));
    const auto stopped = client_->stop();
    ASSERT_TRUE(stopped) << stopped.error().line();
    EXPECT_TRUE(named_recording().empty());
  }
  const fs::path made = folder / "recordings/recording_001.mcap";
  EXPECT_TRUE(eventually([&] { return named_recording() == made; })) << daemon_->log();
  EXPECT_EQ(run_program({DaemonProcess::program(), "recording", "verify", made.string()}), 0);
  // One that could not be made whole after a crash does not begin.
  const auto refused = client_->start();
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().line(), HasSubstr("No space left"));
  // With room again everything goes on, and the trail holds.
  disk.free();
  EXPECT_TRUE(eventually([&] { return client_->create_case("case-2").has_value(); })) << daemon_->log();
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(), 0);
  std::string said;
  EXPECT_EQ(
      run_program({DaemonProcess::program(), "audit", "verify", (daemon_->state() / "audit.jsonl").string()},
                  &said),
      0)
      << said;
}

TEST_F(DaemonSession, ServesWhileSomebodyKeepsTheCatalogueLocked) {
  start();
  daemon_->kill_and_wait();
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open((daemon_->state() / "catalogue.sqlite").c_str(), &other), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(other, "PRAGMA locking_mode=EXCLUSIVE; BEGIN EXCLUSIVE", nullptr, nullptr, nullptr),
            SQLITE_OK);
  EXPECT_TRUE(daemon_->start()) << daemon_->log();
  EXPECT_THAT(daemon_->log(), HasSubstr("catalogue"));
  client_ = daemon_->connect();
  const auto cases = client_->cases();
  ASSERT_TRUE(cases) << cases.error().line();
  EXPECT_EQ(cases->size(), 1u);
  arm_and_start();
  EXPECT_TRUE(client_->stop());
  sqlite3_close(other);
}

TEST_F(DaemonSession, ARecordingEndsByItselfWhenItsSourcesDo) {
  start({}, 0.5);
  arm_and_start();
  EXPECT_TRUE(eventually([&] { return state() == SessionState::kArmed; }));
  EXPECT_THAT(client_->session()->message, HasSubstr("no device delivers any more"));
  const auto summary = summarise_recording(daemon_->cases() / "case-1/recordings/recording_001.mcap");
  EXPECT_TRUE(summary && summary->whole);
}

TEST_F(DaemonSession, ClientsThatVanishAtEachPoint) {
  start("[capture]\ndevices = \"state/devices.toml\"\nholder_grace_s = 0.2\n");
  {  // idle: nothing
    const auto holder = daemon_->connect();
    const auto held = holder->watch_session([](const auto&) {}, true);
  }
  EXPECT_EQ(state(), SessionState::kIdle);
  {  // armed: disarmed
    const auto holder = daemon_->connect();
    std::atomic<int> seen{0};
    const auto held = holder->watch_session([&](const auto&) { ++seen; }, true);
    ASSERT_TRUE(eventually([&] { return seen > 0; }));
    ASSERT_TRUE(holder->arm("case-1"));
    EXPECT_EQ(state(), SessionState::kArmed);
  }
  EXPECT_TRUE(eventually([&] { return state() == SessionState::kIdle; }));
  {  // recording: it goes on, and says so
    const auto holder = daemon_->connect();
    std::atomic<int> seen{0};
    const auto held = holder->watch_session([&](const auto&) { ++seen; }, true);
    ASSERT_TRUE(eventually([&] { return seen > 0; }));
    ASSERT_TRUE(holder->arm("case-1"));
    ASSERT_TRUE(holder->start());
  }
  EXPECT_TRUE(eventually([&] { return client_->session()->message.find("has gone") != std::string::npos; }));
  EXPECT_EQ(state(), SessionState::kRecording);
  // A client that is killed in the middle of Stop: the recording is finished all the same.
  std::string text;
  std::thread stopper([&] {
    run_program({DaemonProcess::program(), "capture", "stop", "--socket", daemon_->socket()}, &text, 0.05);
  });
  stopper.join();
  if (state() == SessionState::kRecording) {
    ASSERT_TRUE(client_->stop());
  }
  EXPECT_TRUE(eventually([&] { return state() == SessionState::kArmed; }));
  const auto summary = summarise_recording(daemon_->cases() / "case-1/recordings/recording_001.mcap");
  EXPECT_TRUE(summary && summary->whole);
}

TEST_F(DaemonSession, SigtermFinishesARecordingAndSighupDoesNotTouchIt) {
  start();
  arm_and_start();
  daemon_->signal(SIGHUP);
  EXPECT_TRUE(
      eventually([&] { return daemon_->log().find("configuration read again") != std::string::npos; }));
  std::ofstream(daemon_->config(), std::ios::app) << "[nonsense]\n";
  daemon_->signal(SIGHUP);
  EXPECT_TRUE(
      eventually([&] { return daemon_->log().find("unknown section 'nonsense'") != std::string::npos; }));
  EXPECT_EQ(state(), SessionState::kRecording);
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(), 0);
  const auto summary = summarise_recording(daemon_->cases() / "case-1/recordings/recording_001.mcap");
  ASSERT_TRUE(summary);
  EXPECT_TRUE(summary->whole) << summary->damage;
  EXPECT_FALSE(fs::exists(daemon_->socket()));
  EXPECT_FALSE(fs::exists(daemon_->state() / "running_recording.json"));
}

template <class Stub, class Request, class Response>
grpc::Status ask(Stub& stub, grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                 const Request& request, Response* response) {
  grpc::ClientContext context;
  return (stub.*method)(&context, request, response);
}

TEST_F(DaemonSession, BadRequestsGetTheRightStatusAndWhatToDo) {
  start("[limits]\nstreams = 2\nmessage_kib = 64\n");
  const auto channel = grpc::CreateChannel("unix:" + daemon_->socket(), grpc::InsecureChannelCredentials());
  const auto capture = api::Capture::NewStub(channel);
  const auto cases = api::Cases::NewStub(channel);
  const auto jobs = api::Jobs::NewStub(channel);
  const auto devices = api::Devices::NewStub(channel);
  using Capture = api::Capture::Stub;
  const auto expect = [](const grpc::Status& status, StatusCode code, const std::string& text) {
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr(text));
  };
  api::SessionState session;
  api::MarkResponse marked;
  api::MarkRequest mark;
  mark.set_kind("MI");
  expect(ask(*capture, &Capture::Start, api::StartRequest(), &session), StatusCode::FAILED_PRECONDITION,
         "arm it first");
  expect(ask(*capture, &Capture::Mark, mark, &marked), StatusCode::FAILED_PRECONDITION, "arm it first");
  expect(ask(*capture, &Capture::Stop, api::StopRequest(), &session), StatusCode::FAILED_PRECONDITION,
         "start a recording first");
  api::ArmRequest arm;
  arm.set_case_id("nobody");
  expect(ask(*capture, &Capture::Arm, arm, &session), StatusCode::NOT_FOUND, "gnathion cases create");
  arm.set_case_id("../case-1");
  EXPECT_EQ(ask(*capture, &Capture::Arm, arm, &session).error_code(), StatusCode::NOT_FOUND);
  arm.set_case_id("case-1");
  EXPECT_TRUE(ask(*capture, &Capture::Arm, arm, &session).ok());
  expect(ask(*capture, &Capture::Arm, arm, &session), StatusCode::FAILED_PRECONDITION, "disarm it first");
  api::ConfigureRequest configure;
  api::ConfigureResponse configured;
  configure.set_configuration(replay_devices(film()));
  expect(ask(*devices, &api::Devices::Stub::Configure, configure, &configured),
         StatusCode::FAILED_PRECONDITION, "disarm");
  api::StartRequest begin;
  begin.set_name("../x");
  expect(ask(*capture, &Capture::Start, begin, &session), StatusCode::INVALID_ARGUMENT, "letters, digits");
  begin.set_name("one");
  EXPECT_TRUE(ask(*capture, &Capture::Start, begin, &session).ok());
  mark.set_kind("not a kind");
  expect(ask(*capture, &Capture::Mark, mark, &marked), StatusCode::INVALID_ARGUMENT, "letters");
  mark.set_kind("MI");
  mark.set_capture_ns(1);
  expect(ask(*capture, &Capture::Mark, mark, &marked), StatusCode::INVALID_ARGUMENT, "60 s back");
  expect(ask(*capture, &Capture::RequestScan, api::ScanRequest(),
             static_cast<api::ScanResponse*>(std::make_unique<api::ScanResponse>().get())),
         StatusCode::FAILED_PRECONDITION, "stereo_scanner");
  EXPECT_TRUE(ask(*capture, &Capture::Stop, api::StopRequest(), &session).ok());
  expect(ask(*capture, &Capture::Start, begin, &session), StatusCode::ALREADY_EXISTS, "choose another name");
  EXPECT_TRUE(ask(*capture, &Capture::Disarm, api::DisarmRequest(), &session).ok());
  configure.set_configuration("[[device]]\nkind = \"pedal\"\n");
  expect(ask(*devices, &api::Devices::Stub::Configure, configure, &configured), StatusCode::INVALID_ARGUMENT,
         "needs a 'name'");
  configure.set_configuration(replay_devices("/etc/hostname"));
  expect(ask(*devices, &api::Devices::Stub::Configure, configure, &configured), StatusCode::PERMISSION_DENIED,
         "case root");
  configure.set_configuration(std::string(100 << 10, '#'));
  EXPECT_EQ(ask(*devices, &api::Devices::Stub::Configure, configure, &configured).error_code(),
            StatusCode::RESOURCE_EXHAUSTED);

  api::CreateCaseRequest create;
  api::CaseInfo info;
  create.set_case_id("case-1");
  expect(ask(*cases, &api::Cases::Stub::Create, create, &info), StatusCode::ALREADY_EXISTS, "another id");
  create.set_case_id("a/b");
  EXPECT_EQ(ask(*cases, &api::Cases::Stub::Create, create, &info).error_code(), StatusCode::INVALID_ARGUMENT);
  const auto read = [&](const std::string& path) {
    grpc::ClientContext context;
    api::ReadFileRequest request;
    request.set_case_id("case-1");
    request.set_path(path);
    const auto reader = cases->ReadFile(&context, request);
    for (api::FileChunk chunk; reader->Read(&chunk);) {
    }
    return reader->Finish().error_code();
  };
  EXPECT_EQ(read("case.toml"), StatusCode::PERMISSION_DENIED);
  EXPECT_EQ(read("../incoming/film.mcap"), StatusCode::PERMISSION_DENIED);
  EXPECT_EQ(read("none.stl"), StatusCode::NOT_FOUND);
  EXPECT_EQ(read("recordings/one.mcap"), StatusCode::OK);

  api::SubmitJobRequest job;
  api::Job submitted;
  job.set_case_id("case-1");
  job.set_kind("sh");
  expect(ask(*jobs, &api::Jobs::Stub::Submit, job, &submitted), StatusCode::INVALID_ARGUMENT,
         "there are calibrate camera");
  api::JobRequest which;
  which.set_job_id("job-0");
  expect(ask(*jobs, &api::Jobs::Stub::Cancel, which, &submitted), StatusCode::NOT_FOUND, "lists them");

  std::atomic<int> open{0};
  const auto one = client_->watch_session([&](const auto&) { ++open; }, false);
  const auto other = client_->ledger(0.05, [&](const auto&) { open += 100; });
  ASSERT_TRUE(eventually([&] { return open > 100; }));
  std::mutex mutex;
  std::string why;
  const auto third = client_->poses([](const auto&) {},
                                    [&](const Status& s) {
                                      std::lock_guard lock(mutex);
                                      why = s ? "ended" : s.error().line();
                                    });
  EXPECT_TRUE(eventually([&] {
    std::lock_guard lock(mutex);
    return why.find("raise 'streams' in [limits]") != std::string::npos;
  })) << why;
  const auto lines = client_->audit({}, 1000);
  ASSERT_TRUE(lines);
  EXPECT_TRUE(std::any_of(lines->begin(), lines->end(),
                          [](const auto& l) { return l.action == "case.read.refused"; }));
}

/// Bytes that are no HTTP/2, half a preface, and silence: the daemon serves on, and its connections are
/// bounded.
TEST_F(DaemonSession, StrangersAtTheSocket) {
  start("[limits]\nconnections = 6\n");
  std::vector<int> sockets;
  for (int i = 0; i < 20; ++i) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, daemon_->socket().c_str(), sizeof address.sun_path - 1);
    const int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
    if (::connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0 && i % 3 == 0)
      (void)!::send(fd, "GET / HTTP/1.1\r\n\r\n", 18, MSG_NOSIGNAL);
    if (i % 3 == 1) (void)!::send(fd, "PRI * HTTP/2.0", 14, MSG_NOSIGNAL);
    sockets.push_back(fd);
  }
  const auto health = client_->health();
  ASSERT_TRUE(health) << health.error().line();
  EXPECT_LE(health->connections, 6u);
  EXPECT_TRUE(health->well);
  for (const int fd : sockets) ::close(fd);
  EXPECT_TRUE(eventually([&] { return client_->health()->connections <= 1; }));
  EXPECT_TRUE(daemon_->connect());
}

/// Two daemons may not have one state folder; the second says so and the first goes on.
TEST_F(DaemonSession, OneDaemonAStateFolder) {
  start();
  DaemonProcess second(folder_.path());
  std::string text;
  EXPECT_EQ(run_program({DaemonProcess::program() + "d", "--config", daemon_->config().string()}, &text), 4);
  EXPECT_THAT(text, HasSubstr("another gnathiond works with this state folder"));
  EXPECT_TRUE(client_->health());
  EXPECT_EQ(
      run_program({DaemonProcess::program() + "d", "--check-config", "--config", daemon_->config().string()},
                  &text),
      0);
}

/// The command line as a client.
TEST_F(DaemonSession, TheCommandLine) {
  start();
  const auto run = [&](std::vector<std::string> words, int code = 0) {
    words.insert(words.begin(), DaemonProcess::program());
    words.insert(words.end(), {"--socket", daemon_->socket()});
    std::string text;
    EXPECT_EQ(run_program(words, &text), code) << text;
    return text;
  };
  EXPECT_THAT(run({"cases", "create", "case-2"}), HasSubstr("case-2"));
  EXPECT_THAT(run({"cases", "list", "--json"}), HasSubstr("\"case-1\""));
  EXPECT_THAT(run({"devices", "list"}), HasSubstr("replay"));
  EXPECT_THAT(run({"capture", "start"}, 2), HasSubstr("arm it first"));
  run({"capture", "arm", "case-2"});
  run({"capture", "start", "take-1"});
  run({"mark", "MI"});
  EXPECT_THAT(run({"live", "--duration-s", "1"}), HasSubstr("sensor_1"));
  EXPECT_THAT(run({"capture", "stop"}), HasSubstr("armed"));
  EXPECT_THAT(run({"cases", "show", "case-2"}), HasSubstr("recordings/take-1.mcap"));
  run({"capture", "disarm"});
  EXPECT_THAT(run({"devices", "health"}), HasSubstr("loop session"));
  EXPECT_THAT(run({"audit", "show", "--case", "case-2"}), HasSubstr("capture.mark"));
  EXPECT_THAT(run({"jobs", "kinds"}), HasSubstr("transform motion"));
}

}  // namespace
}  // namespace gnathion::testing
