// The OpenIGTLink server, read by the example clients of the OpenIGTLink library, as processes of their own.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
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
  /// A daemon with a session armed. `more`: further lines of [openigtlink].
  void start(const SmallRecording& what = {}, const std::string& more = {}) {
    port_ = free_port();
    daemon_ = std::make_unique<DaemonProcess>(folder_.path(),
                                              "[openigtlink]\nport = " + std::to_string(port_) + "\n" + more);
    const fs::path film = folder_.path() / "cases/incoming/film.mcap";
    fs::create_directories(film.parent_path());
    write_small_recording(film, what);
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
    const int room = 64 << 10;  // so that one who does not read is full soon
    ::setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
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
  start();
  ASSERT_FALSE(HasFatalFailure());
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
  start();
  ASSERT_FALSE(HasFatalFailure());
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
      if (const auto* mesh = std::get_if<TriangleMesh>(&*body)) {
        EXPECT_NEAR(signed_volume_mm3(*mesh), 1000.0 / 6, 1e-3);
      }
      if (const auto* state = std::get_if<igtl::State>(&*body)) refused = refused || state->code == 5;
    }
    return kinds.size() == 5 && refused;
  }));
  EXPECT_EQ(kinds, (std::set<std::string>{"IMAGE", "POLYDATA", "STATUS", "TDATA", "TRANSFORM"}));
  EXPECT_TRUE(refused);
  ::close(fd);
}

/// One client of eight. It reads until told not to.
class Reader {
 public:
  explicit Reader(int socket) : socket_(socket), thread_([this] { run(); }) {}
  ~Reader() {
    over_ = true;
    ::shutdown(socket_, SHUT_RDWR);
    thread_.join();
    ::close(socket_);
  }
  void stop_reading() { reads_ = false; }
  /// False: the connection is over.
  bool send(const std::string& bytes) const {
    for (std::size_t done = 0; done < bytes.size();) {
      const ssize_t n = ::send(socket_, bytes.data() + done, bytes.size() - done, MSG_NOSIGNAL);
      if (n <= 0) return false;
      done += static_cast<std::size_t>(n);
    }
    return true;
  }
  int poses() const { return poses_; }
  int splints() const { return splints_; }
  int rejected() const { return rejected_; }
  bool ended() const { return ended_; }

 private:
  void run() {
    char block[65536];
    while (!over_) {
      if (!reads_) {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        continue;
      }
      const ssize_t n = ::recv(socket_, block, sizeof block, 0);
      if (n <= 0) break;
      framer_.feed({block, static_cast<std::size_t>(n)});
      while (const auto item = framer_.next()) {
        rejected_ += item->kind == igtl::Item::Kind::kRejected;
        poses_ += item->header.type == "TRANSFORM";
        splints_ += item->header.type == "POLYDATA";
      }
    }
    ended_ = true;
  }
  const int socket_;
  igtl::Framer framer_;
  std::atomic<bool> reads_{true}, over_{false}, ended_{false};
  std::atomic<int> poses_{0}, splints_{0}, rejected_{0};
  std::thread thread_;
};

TEST_F(DaemonIgtl, OfEightClientsOneStallsAndOneIsHostile) {
  start({90, 30, 2, 128, 96, true}, "clients = 8\nimage_rate_hz = 30\n");
  ASSERT_FALSE(HasFatalFailure());
  const auto logged = [&](const std::string& text) {
    return eventually([&] { return daemon_->log().find(text) != std::string::npos; }, 60);
  };
  std::vector<std::unique_ptr<Reader>> readers;
  for (int i = 0; i < 8; ++i) readers.push_back(std::make_unique<Reader>(connect()));
  const auto all_read = [&](std::size_t count, int poses) {
    return eventually([&] {
      for (std::size_t i = 0; i < count; ++i)
        if (readers[i]->poses() < poses) return false;
      return true;
    });
  };
  EXPECT_TRUE(all_read(8, 5));
  {
    const Reader ninth(connect());
    EXPECT_TRUE(eventually([&] { return ninth.ended(); }));
    EXPECT_EQ(ninth.poses(), 0);
  }
  EXPECT_TRUE(logged("8 clients are there"));

  readers[6]->stop_reading();
  // The hostile one asks for the splint without end, and then sends what is no message at all.
  const std::string ask = igtl::pack("GET_POLYDATA", "", "");
  std::string asks;
  for (int i = 0; i < 20'000; ++i) asks += ask;
  EXPECT_TRUE(readers[7]->send(asks));
  EXPECT_TRUE(eventually([&] { return readers[7]->splints() >= 2; }));  // on connection, and asked for
  EXPECT_LT(readers[7]->splints(), 200);
  const std::string noise(65536, '\x7f');
  EXPECT_TRUE(eventually([&] { return !readers[7]->send(noise); }));
  EXPECT_TRUE(logged("is let go: what it sends is no OpenIGTLink"));
  EXPECT_TRUE(eventually([&] { return readers[7]->ended(); }));
  EXPECT_TRUE(logged("is let go: it took nothing for too long"));

  // Nobody else has noticed, neither here nor at the API; and there is room again.
  const int before = readers[0]->poses();
  EXPECT_TRUE(all_read(6, before + 30));
  for (int i = 0; i < 6; ++i) EXPECT_EQ(readers[static_cast<std::size_t>(i)]->rejected(), 0) << i;
  for (int i = 0; i < 6; ++i) EXPECT_FALSE(readers[static_cast<std::size_t>(i)]->ended()) << i;
  std::atomic<int> poses{0};
  const auto live = client_->poses([&](const auto&) { ++poses; });
  EXPECT_TRUE(eventually([&] { return poses > 10; }));
  const auto health = client_->health();
  EXPECT_TRUE(health && health->well);
  EXPECT_THAT(daemon_->log(), HasSubstr("read-only on 127.0.0.1"));
  const Reader later(connect());
  EXPECT_TRUE(eventually([&] { return later.poses() > 5; }));
  // A client that reads nothing keeps nobody from going down.
  readers[0]->stop_reading();
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(), 0);
}

}  // namespace
}  // namespace gnathion::testing
