// gRPC's own services, files that clients send, and what the daemon says of itself when something is wrong.
#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <fstream>

#include "core/file.h"
#include "core/mesh_io.h"
#include "gnathion/v1/cases.grpc.pb.h"
#include "occlusion/test_jaws.h"
#include "tests/daemon/daemon_process.h"

namespace gnathion::testing {
namespace {

namespace fs = std::filesystem;
namespace api = ::gnathion::v1;
using grpc::StatusCode;
using ::testing::HasSubstr;

/// One call of any method, message by message as bytes.
class RawCall {
 public:
  RawCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method) : stub_(channel) {
    context_.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
    call_ = stub_.PrepareCall(&context_, method, &queue_);
    call_->StartCall(this);
    done();
  }
  ~RawCall() {
    context_.TryCancel();
    if (!finished_) finish();
    queue_.Shutdown();
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok)) {
    }
  }
  void write(const std::string& bytes) {
    const grpc::Slice slice(bytes);
    call_->Write(grpc::ByteBuffer(&slice, 1), this);
    done();
  }
  /// Empty: the call is over.
  std::string read() {
    grpc::ByteBuffer buffer;
    call_->Read(&buffer, this);
    if (!done()) return {};
    std::vector<grpc::Slice> slices;
    EXPECT_TRUE(buffer.Dump(&slices).ok());
    std::string bytes;
    for (const grpc::Slice& s : slices) bytes.append(reinterpret_cast<const char*>(s.begin()), s.size());
    return bytes;
  }
  StatusCode finish() {
    grpc::Status status;
    call_->Finish(&status, this);
    done();
    finished_ = true;
    return status.error_code();
  }

 private:
  bool done() {
    void* tag = nullptr;
    bool ok = false;
    return queue_.Next(&tag, &ok) && ok;
  }
  grpc::GenericStub stub_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call_;
  bool finished_ = false;
};

const std::string kReflection = "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo";
const std::string kListServices = "\x3a\x01*";  // ServerReflectionRequest.list_services = 7

class DaemonServices : public ::testing::Test {
 protected:
  void start(const std::string& more = {}) {
    daemon_ = std::make_unique<DaemonProcess>(folder_.path() / "d", more);
    ASSERT_TRUE(daemon_->start()) << daemon_->log();
    client_ = daemon_->connect();
    channel_ = grpc::CreateChannel("unix:" + daemon_->socket(), grpc::InsecureChannelCredentials());
  }
  /// Two jaws with telling names, a link to a file outside, and one of the patient's papers.
  fs::path scans() const {
    static const SimpleJaws jaws = simple_jaws();
    const fs::path folder = folder_.path() / "from";
    fs::create_directories(folder);
    EXPECT_TRUE(write_mesh(folder / "upper.stl", jaws.maxilla));
    EXPECT_TRUE(write_mesh(folder / "lower.stl", jaws.mandible));
    EXPECT_TRUE(write_mesh(folder_.path() / "elsewhere.stl", jaws.maxilla));
    std::error_code ec;
    fs::create_symlink(folder_.path() / "elsewhere.stl", folder / "face.stl", ec);
    return folder;
  }
  std::string run(std::vector<std::string> words, int code) const {
    words.insert(words.begin(), DaemonProcess::program());
    words.insert(words.end(), {"--socket", daemon_->socket()});
    std::string text;
    EXPECT_EQ(run_program(words, &text), code) << text;
    return text;
  }
  /// Sends these chunks; what the daemon says.
  grpc::Status send(const std::vector<std::pair<std::string, std::string>>& files, const std::string& id) {
    const auto cases = api::Cases::NewStub(channel_);
    grpc::ClientContext context;
    api::CaseInfo made;
    const auto writer = cases->ImportFiles(&context, &made);
    api::ImportChunk chunk;
    chunk.mutable_options()->set_case_id(id);
    bool goes = writer->Write(chunk);
    for (const auto& [name, bytes] : files) {
      chunk.Clear();
      chunk.set_name(name);
      chunk.set_data(bytes);
      goes = goes && writer->Write(chunk);
    }
    writer->WritesDone();
    return writer->Finish();
  }
  TemporaryFolder folder_;
  std::unique_ptr<DaemonProcess> daemon_;
  std::unique_ptr<client::DaemonClient> client_;
  std::shared_ptr<grpc::Channel> channel_;
};

TEST_F(DaemonServices, HealthAndReflectionAnswerAndCountAsStreams) {
  start("[limits]\nstreams = 3\ncalls = 4\n");
  RawCall check(channel_, "/grpc.health.v1.Health/Check");
  check.write("");
  EXPECT_EQ(check.read(), std::string("\x08\x01"));  // HealthCheckResponse.status = SERVING
  EXPECT_EQ(check.finish(), StatusCode::OK);
  std::vector<std::unique_ptr<RawCall>> open;
  for (int i = 0; i < 2; ++i) {
    open.push_back(std::make_unique<RawCall>(channel_, kReflection));
    open.back()->write(kListServices);
    const std::string services = open.back()->read();
    for (const char* name : {"Devices", "Capture", "Live", "Cases", "Catalogue", "Jobs"})
      EXPECT_THAT(services, HasSubstr(std::string("gnathion.v1.") + name));
    EXPECT_THAT(services, HasSubstr("grpc.health.v1.Health"));
  }
  open.push_back(std::make_unique<RawCall>(channel_, "/grpc.health.v1.Health/Watch"));
  open.back()->write("");
  EXPECT_EQ(open.back()->read(), std::string("\x08\x01"));
  // However many more somebody opens, none begins, and others are served.
  for (int i = 0; i < 40; ++i) {
    RawCall more(channel_, i % 2 ? kReflection : "/grpc.health.v1.Health/Watch");
    more.write(i % 2 ? kListServices : "");
    EXPECT_EQ(more.finish(), StatusCode::CANCELLED);
  }
  const auto health = client_->health();
  ASSERT_TRUE(health) << health.error().line();
  EXPECT_EQ(health->streams, 3u);
  open.clear();
  EXPECT_TRUE(eventually([&] { return client_->health()->streams == 0; }));
  RawCall again(channel_, kReflection);
  again.write(kListServices);
  EXPECT_THAT(again.read(), HasSubstr("gnathion.v1.Cases"));
}

TEST_F(DaemonServices, FilesOfAClientBecomeACase) {
  start("[limits]\nimport_mib = 8\n");
  EXPECT_THAT(run({"cases", "import", scans().string(), "case-7"}, 0), HasSubstr("scans/maxilla_mi.stl"));
  const fs::path made = daemon_->cases() / "case-7/scans";
  EXPECT_EQ(*read_file(made / "maxilla_mi.stl"), *read_file(scans() / "upper.stl"));
  EXPECT_FALSE(fs::exists(made / "face_mi.stl"));  // the link was not followed
  EXPECT_TRUE(client_->open_case("case-7")->problem.empty());
  EXPECT_THAT(run({"cases", "list"}, 0), HasSubstr("case-7"));
  EXPECT_THAT(run({"cases", "import", scans().string(), "case-7"}, 2), HasSubstr("choose another id"));
  // A link in incoming/ is not followed either.
  fs::create_directories(daemon_->cases() / "incoming/two");
  for (const auto& entry : fs::directory_iterator(scans()))
    fs::copy(entry.path(), daemon_->cases() / "incoming/two" / entry.path().filename(),
             fs::copy_options::copy_symlinks);
  run({"cases", "import", "two", "case-8", "--incoming"}, 0);
  EXPECT_FALSE(fs::exists(daemon_->cases() / "case-8/scans/face_mi.stl"));
  const auto refusal = run({"cases", "import", "../case-7", "case-9", "--incoming"}, 2);
  EXPECT_THAT(refusal, HasSubstr("leads out"));

  for (const char* name : {"../x.stl", "/etc/x.stl", "a/../../x.stl", ".hidden", "1/2/3/4/5/6/7/8/d.stl"})
    EXPECT_EQ(send({{name, "x"}}, "case-9").error_code(), StatusCode::PERMISSION_DENIED) << name;
  EXPECT_EQ(send({}, "case-9").error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(send({{"a.stl", "x"}, {"a.stl", "x"}}, "case-9").error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(send({{"upper.stl", "no mesh"}, {"lower.stl", "none"}}, "case-9").error_code(),
            StatusCode::INVALID_ARGUMENT);
  const std::string much(3 << 20, 'x');
  const grpc::Status large = send({{"a", much}, {"b", much}, {"c", much}}, "case-9");
  EXPECT_EQ(large.error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(large.error_message(), HasSubstr("import_mib"));
  EXPECT_EQ(send({{"upper.stl", "x"}}, "a/b").error_code(), StatusCode::INVALID_ARGUMENT);
  {  // One that stops in the middle leaves nothing either.
    const auto cases = api::Cases::NewStub(channel_);
    grpc::ClientContext context;
    api::CaseInfo info;
    const auto writer = cases->ImportFiles(&context, &info);
    api::ImportChunk chunk;
    chunk.set_name("upper.stl");
    EXPECT_TRUE(writer->Write(chunk));
    context.TryCancel();
    EXPECT_FALSE(writer->Finish().ok());
  }
  EXPECT_FALSE(fs::exists(daemon_->cases() / "case-9"));
  EXPECT_TRUE(eventually([&] { return fs::is_empty(daemon_->state() / "imports"); }));
  for (const auto& entry : fs::directory_iterator(daemon_->cases()))
    EXPECT_NE(entry.path().filename().string().front(), '.') << entry.path();
}

TEST_F(DaemonServices, WhatIsWrongIsSaid) {
  start();
  ASSERT_TRUE(client_->create_case("case-1"));
  EXPECT_TRUE(client_->health()->well);
  // The trail's head record says something else than the trail: no line can be added any more.
  ASSERT_TRUE(write_file(daemon_->state() / "audit.jsonl.head", "{}\n"));
  ASSERT_TRUE(client_->create_case("case-2"));  // the work goes on
  const auto health = client_->health();
  ASSERT_TRUE(health);
  EXPECT_FALSE(health->well);
  ASSERT_EQ(health->faults.size(), 1u);
  EXPECT_THAT(health->faults[0], HasSubstr("could not be written"));
  EXPECT_THAT(run({"devices", "health"}, 3), HasSubstr("fault: audit trail"));
  // A folder that somebody copied still has the id of the other.
  fs::copy(daemon_->cases() / "case-1", daemon_->cases() / "case-3", fs::copy_options::recursive);
  EXPECT_THAT(client_->open_case("case-3")->problem, HasSubstr("give both the same name"));
}

}  // namespace
}  // namespace gnathion::testing
