// The OpenIGTLink server, read by the example clients of the OpenIGTLink library, as processes of their own.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <set>
#include <thread>

#include "acquisition/igtl/igtl_messages.h"
#include "acquisition/igtl/igtl_protocol.h"
#include "acquisition/igtl/igtl_writer.h"
#include "core/mesh_io.h"
#include "tests/daemon/daemon_process.h"

namespace gnathion::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

#ifndef IGTL_CLIENTS
#define IGTL_CLIENTS ""
#endif

TriangleMesh tetrahedron() {
  TriangleMesh mesh;
  mesh.vertices_mm = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {0, 0, 10}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  return mesh;
}

class DaemonIgtl : public ::testing::Test {
 protected:
  void SetUp() override {
    port_ = free_port();
    daemon_ = std::make_unique<DaemonProcess>(
        folder_.path(), "[openigtlink]\nport = " + std::to_string(port_) + "\nclients = 4\n");
    const fs::path film = folder_.path() / "cases/incoming/film.mcap";
    fs::create_directories(film.parent_path());
    write_small_recording(film, SmallRecording{});
    ASSERT_TRUE(daemon_->start()) << daemon_->log();
    client_ = daemon_->connect();
    ASSERT_TRUE(client_->create_case("case-1"));
    ASSERT_TRUE(write_mesh(daemon_->cases() / "case-1/splint.stl", tetrahedron()));
    ASSERT_TRUE(client_->configure_devices(replay_devices(film)));
    ASSERT_TRUE(client_->arm("case-1"));
  }
  static int free_port() {
    const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in place{};
    place.sin_family = AF_INET;
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ::bind(fd, reinterpret_cast<sockaddr*>(&place), sizeof place);
    socklen_t size = sizeof place;
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&place), &size);
    ::close(fd);
    return ntohs(place.sin_port);
  }
  int connect() const {
    const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in place{};
    place.sin_family = AF_INET;
    place.sin_port = htons(static_cast<std::uint16_t>(port_));
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(fd, reinterpret_cast<sockaddr*>(&place), sizeof place), 0);
    const timeval limit{20, 0};
    ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    return fd;
  }
  /// What an example client prints within `limit_s` of listening.
  std::string output_of(const std::string& name, std::vector<std::string> more, double limit_s) const {
    std::vector<std::string> words = {std::string(IGTL_CLIENTS) + "/igtl_" + name, "127.0.0.1",
                                      std::to_string(port_)};
    words.insert(words.end(), more.begin(), more.end());
    std::string text;
    run_program(words, &text, limit_s);
    return text;
  }
  TemporaryFolder folder_;
  std::unique_ptr<DaemonProcess> daemon_;
  std::unique_ptr<client::DaemonClient> client_;
  int port_ = 0;
};

TEST_F(DaemonIgtl, TheLibrarysExampleClientsReadIt) {
  if (std::string(IGTL_CLIENTS).empty())
    GTEST_SKIP() << "the sources of openigtlink-examples are not installed";
  const std::string received = output_of("ReceiveClient", {}, 3);
  EXPECT_THAT(received, HasSubstr("Receiving TRANSFORM data type."));
  EXPECT_THAT(received, HasSubstr("Receiving STATUS data type."));
  EXPECT_THAT(received, HasSubstr("Receiving IMAGE data type."));
  EXPECT_THAT(received, HasSubstr("in transmitter"));  // the STATUS of a valid pose
  EXPECT_THAT(received, HasSubstr("64, 48, 1"));       // the image's dimensions
  EXPECT_THAT(received, HasSubstr("camera_0"));
  const std::string tracking = output_of("TrackingDataClient", {"30"}, 4);
  EXPECT_THAT(tracking, HasSubstr("Receiving TDATA data type."));
  EXPECT_THAT(tracking, HasSubstr("sensor_1"));
  const std::string poly = output_of("PolyDataClient", {}, 4);
  EXPECT_THAT(poly, HasSubstr("Receiving POLYDATA data type."));
  EXPECT_THAT(poly, HasSubstr("= (10, 0, 0)"));
}

TEST_F(DaemonIgtl, MessagesDecodeToWhatWasSent) {
  const int fd = connect();
  const std::string ask = igtl::pack("STT_TDATA", "", igtl::start_tracking_body(20, ""));
  ASSERT_EQ(::send(fd, ask.data(), ask.size(), 0), static_cast<ssize_t>(ask.size()));
  const std::string forbidden = igtl::pack("TRANSFORM", "Jaw", igtl::transform_body(Rigid3::identity()));
  ASSERT_EQ(::send(fd, forbidden.data(), forbidden.size(), 0), static_cast<ssize_t>(forbidden.size()));
  igtl::Framer framer;
  std::set<std::string> kinds;
  bool refused = false;
  ASSERT_TRUE(eventually([&] {
    char block[65536];
    const ssize_t n = ::recv(fd, block, sizeof block, 0);
    if (n <= 0) return true;
    framer.feed({block, static_cast<std::size_t>(n)});
    while (const auto item = framer.next()) {
      EXPECT_EQ(item->kind, igtl::Item::Kind::kMessage) << item->reason;
      if (!igtl::is_read(item->header.type)) continue;
      const auto body = igtl::decode(item->header.type, item->body);
      EXPECT_TRUE(body) << body.error().line();
      if (!body) continue;
      kinds.insert(item->header.type);
      if (const auto* poses = std::get_if<igtl::Poses>(&*body)) {
        EXPECT_EQ(poses->tools.size(), 1u);
        EXPECT_TRUE(poses->tools[0].fault.empty()) << poses->tools[0].fault;
        // The replayed pose: a turn about z of 0.001 rad a sample, at (sin(0.01 i), 2, 3).
        const Vector3 t = poses->tools[0].reference_from_tool.translation_mm;
        const double angle = poses->tools[0].reference_from_tool.angle_rad();
        EXPECT_NEAR(t.x(), std::sin(10 * angle), 1e-3);
        EXPECT_NEAR(t.y(), 2, 1e-6);
        EXPECT_GT(poses->tools[0].reference_from_tool.rotation(1, 0), -1e-6);  // to the left, not mirrored
      }
      if (const auto* mesh = std::get_if<TriangleMesh>(&*body))
        EXPECT_NEAR(signed_volume_mm3(*mesh), 1000.0 / 6, 1e-3);
      if (const auto* state = std::get_if<igtl::State>(&*body)) refused = refused || state->code == 5;
    }
    return kinds.size() == 5 && refused;
  }));
  EXPECT_EQ(kinds, (std::set<std::string>{"IMAGE", "POLYDATA", "STATUS", "TDATA", "TRANSFORM"}));
  EXPECT_TRUE(refused);
  ::close(fd);
}

TEST_F(DaemonIgtl, StalledAndHostileClientsAreBounded) {
  std::vector<int> sockets;
  for (int i = 0; i < 4; ++i) sockets.push_back(connect());  // none of them reads
  std::string noise(200'000, '\x7f');
  (void)!::send(sockets[0], noise.data(), noise.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  EXPECT_TRUE(eventually([&] { return daemon_->log().find("is let go") != std::string::npos; }));
  for (int i = 0; i < 4; ++i) sockets.push_back(connect());
  EXPECT_TRUE(eventually([&] { return daemon_->log().find("clients are there") != std::string::npos; }));
  std::atomic<int> poses{0};
  const auto live = client_->poses([&](const auto&) { ++poses; });
  EXPECT_TRUE(eventually([&] { return poses > 60; }));  // nobody else is slowed
  EXPECT_TRUE(client_->health()->well);
  EXPECT_THAT(daemon_->log(), HasSubstr("read-only on 127.0.0.1"));
  for (const int fd : sockets) ::close(fd);
}

}  // namespace
}  // namespace gnathion::testing
