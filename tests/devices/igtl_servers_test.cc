// The OpenIGTLink client against the example servers of the OpenIGTLink library, as processes of their own.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>

#include <chrono>
#include <future>

#include "acquisition/igtl/igtl_device.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "tests/devices/igtl_peer.h"

namespace gnathion {
namespace {

using namespace std::chrono_literals;

#ifndef IGTL_SERVERS
#define IGTL_SERVERS ""
#define IGTL_EXAMPLE_IMAGES ""
#endif

int free_port() {
  Peer peer([](const Peer::Connection&, int) {});
  return peer.port();
}

class Server {
 public:
  Server(const std::string& name, std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), std::string(IGTL_SERVERS) + "/igtl_" + name);
    std::vector<char*> argv;
    for (std::string& a : arguments) argv.push_back(a.data());
    argv.push_back(nullptr);
    posix_spawn_file_actions_t quiet;
    ::posix_spawn_file_actions_init(&quiet);
    for (const int fd : {1, 2}) ::posix_spawn_file_actions_addopen(&quiet, fd, "/dev/null", O_WRONLY, 0);
    started_ = ::posix_spawn(&pid_, argv[0], &quiet, nullptr, argv.data(), environ) == 0;
    ::posix_spawn_file_actions_destroy(&quiet);
  }
  void end() {
    if (!started_) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
    started_ = false;
  }
  ~Server() { end(); }
  bool started() const { return started_; }

 private:
  pid_t pid_ = 0;
  bool started_ = false;
};

class IgtlServers : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::string(IGTL_SERVERS).empty())
      GTEST_SKIP()
          << "the sources of openigtlink-examples are not installed (Debian package openigtlink-examples)";
  }
  std::unique_ptr<Device> open(int port, std::map<std::string, ConfigValue> more = {}) {
    DeviceConfig config{"openigtlink", "igtl", std::move(more), "devices.toml: igtl", {}};
    config.settings["port"] = std::int64_t{port};
    auto device = open_device(config, clock_);
    EXPECT_TRUE(device) << device.error().line();
    return std::move(*device);
  }
  /// `count` samples but for the device's own events.
  std::vector<Sample> pull(Device& device, std::size_t count) {
    auto all = std::async(std::launch::async, [&] {
      std::vector<Sample> samples;
      while (samples.size() < count) {
        auto next = device.next();
        EXPECT_TRUE(next);
        if (!next || !*next) break;
        if (header_of(**next).stream != "igtl/state") samples.push_back(std::move(**next));
      }
      return samples;
    });
    if (all.wait_for(60s) != std::future_status::ready) {
      ADD_FAILURE() << "not enough came: " << device.health().message;
      device.stop();
    }
    return all.get();
  }
  SystemClock clock_;
};

/// The pose that the example programs make of two angles: their own formulas, with the quaternion that they
/// leave at a length of 0.88 normalised.
Rigid3 example_pose(double phi, double theta) {
  const Eigen::Quaterniond q(0.6666666666 * std::sin(theta), 0, 0.6666666666 * std::cos(theta),
                             0.577350269189626);
  return {q.normalized().toRotationMatrix(), {50 * std::cos(phi), 50 * std::sin(phi), 50 * std::cos(phi)}};
}
void expect_same(const Rigid3& got, const Rigid3& truth) {
  const double angle_rad = log_so3(got.rotation * truth.rotation.transpose()).norm();
  EXPECT_LT(angle_rad, 2e-5);  // their angles add up in single precision
  EXPECT_LT((got.translation_mm - truth.translation_mm).norm(), 2e-3);
}

TEST_F(IgtlServers, TrackerServer) {
  const int port = free_port();
  Server server("TrackerServer", {std::to_string(port), "200"});
  ASSERT_TRUE(server.started());
  const auto device = open(port);
  const auto samples = pull(*device, 60);
  ASSERT_EQ(samples.size(), 60u);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& pose = std::get<PoseSample>(samples[i]);
    EXPECT_EQ(pose.header.stream, "igtl/Tracker");
    EXPECT_EQ(pose.header.sequence, i);
    EXPECT_EQ(pose.header.device.ns, 0);  // this server stamps nothing
    EXPECT_EQ(pose.header.capture, pose.header.arrival);
    expect_same(pose.reference_from_body,
                example_pose(0.2 * static_cast<double>(i), 0.1 * static_cast<double>(i)));
  }
}

TEST_F(IgtlServers, ItComesBackWhenTheServerIsKilled) {
  const int port = free_port();
  const std::vector<std::string> arguments = {std::to_string(port), "200"};
  auto server = std::make_unique<Server>("TrackerServer", arguments);
  // The server never reads this request; so its end resets the connection, and the port is free again at
  // once.
  const auto device = open(port, {{"request", std::vector<std::string>{"GET_TRANSFORM"}}});
  for (std::uint64_t i = 0; i < 5; ++i) {
    while (device->health().reconnects < i) ASSERT_EQ(pull(*device, 1).size(), 1u);
    ASSERT_EQ(pull(*device, 5).size(), 5u);
    server->end();
    server = std::make_unique<Server>("TrackerServer", arguments);
  }
  while (device->health().reconnects < 5) ASSERT_EQ(pull(*device, 1).size(), 1u);
  EXPECT_EQ(device->health().state, DeviceState::kRunning);
}

TEST_F(IgtlServers, TrackingDataServer) {
  const int port = free_port();
  Server server("TrackingDataServer", {std::to_string(port)});
  const auto device =
      open(port, {{"request", std::vector<std::string>{"STT_TDATA"}}, {"request_interval_ms", 10.0}});
  const auto samples = pull(*device, 90);
  const double phi[3] = {0.1, 0.2, 0.3}, theta[3] = {0.2, 0.1, 0.05};
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& pose = std::get<PoseSample>(samples[i]);
    const std::size_t tool = i % 3, k = i / 3;
    EXPECT_EQ(pose.header.stream, "igtl/Channel_" + std::to_string(tool));
    EXPECT_EQ(pose.body, "Channel " + std::to_string(tool));
    EXPECT_EQ(pose.reference, "Tracker");
    EXPECT_EQ(pose.header.sequence, k);
    expect_same(pose.reference_from_body,
                example_pose(phi[tool] * static_cast<double>(k), theta[tool] * static_cast<double>(k)));
  }
}

/// This server's quaternions have a length of 0.88: no rotation, unless that is allowed.
TEST_F(IgtlServers, QuaternionTrackingDataServer) {
  const std::vector<std::string> request = {"STT_QTDATA"};
  for (const bool normalise : {false, true}) {
    const int port = free_port();
    Server server("QuaternionTrackingDataServer", {std::to_string(port)});
    const auto device = open(
        port, {{"request", request}, {"request_interval_ms", 10.0}, {"normalise_quaternions", normalise}});
    const auto samples = pull(*device, 60);
    const double phi[3] = {0.1, 0.2, 0.3}, theta[3] = {0.2, 0.1, 0.05};
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const std::size_t tool = i % 3, k = i / 3;
      EXPECT_EQ(header_of(samples[i]).stream, "igtl/Channel_" + std::to_string(tool));
      EXPECT_EQ(header_of(samples[i]).sequence, k);
      if (normalise)
        expect_same(std::get<PoseSample>(samples[i]).reference_from_body,
                    example_pose(phi[tool] * static_cast<double>(k), theta[tool] * static_cast<double>(k)));
      else
        EXPECT_EQ(std::get<LedgerSample>(samples[i]).reason, "not a unit quaternion");
    }
  }
}

TEST_F(IgtlServers, ImagerServer) {
  const int port = free_port();
  Server server("ImagerServer", {std::to_string(port), "100", IGTL_EXAMPLE_IMAGES});
  const auto device = open(port);
  const auto samples = pull(*device, 15);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& frame = std::get<FrameSample>(samples[i]);
    EXPECT_EQ(frame.header.stream, "igtl/ImagerClient/image");
    EXPECT_EQ(frame.header.sequence, i);
    EXPECT_EQ(frame.image.width_px, 256);
    const auto truth =
        read_file(std::string(IGTL_EXAMPLE_IMAGES) + "/igtlTestImage" + std::to_string(i % 5 + 1) + ".raw");
    ASSERT_TRUE(truth);
    EXPECT_EQ(std::string(frame.image.pixels.begin(), frame.image.pixels.end()), *truth) << i;
  }
}

TEST_F(IgtlServers, PolyDataServer) {
  const int port = free_port();
  Server server("PolyDataServer", {std::to_string(port)});
  const auto device = open(
      port, {{"request", std::vector<std::string>{"GET_POLYDATA"}}, {"request_device", std::string("cube")}});
  const auto samples = pull(*device, 1);
  ASSERT_EQ(samples.size(), 1u);
  const auto& scan = std::get<ScanSample>(samples[0]);
  EXPECT_EQ(scan.header.stream, "igtl/cube/scan");
  const auto mesh = parse_mesh(scan.files.at(scan.name), scan.name);
  ASSERT_TRUE(mesh) << mesh.error().line();
  EXPECT_NEAR(signed_volume_mm3(*mesh), 1, 1e-6);  // the unit cube, its faces outwards
  EXPECT_TRUE(mesh_topology(*mesh).watertight());
  EXPECT_EQ(scan.sha256, sha256_hex(scan.files.at(scan.name)));
}

TEST_F(IgtlServers, StatusAndStringServer) {
  int port = free_port();
  Server status("StatusServer", {std::to_string(port)});
  const auto device = open(port);
  const auto samples = pull(*device, 2);
  ASSERT_EQ(samples.size(), 2u);
  const auto& event = std::get<EventSample>(samples[1]);
  EXPECT_EQ(event.header.stream, "igtl/Device/status");
  EXPECT_EQ(event.header.sequence, 1u);
  EXPECT_TRUE(event.pressed);
  EXPECT_EQ(event.text, "OK (OK!): This is a test to send status message.");

  port = free_port();
  Server text("StringServer", {std::to_string(port), "100"});
  const auto other = open(port);
  for (const Sample& s : pull(*other, 10))
    EXPECT_EQ(std::get<LedgerSample>(s).reason, "type STRING is not read");
  EXPECT_EQ(other->health().received, 0u);
  EXPECT_GE(other->health().rejected, 10u);
}

}  // namespace
}  // namespace gnathion
