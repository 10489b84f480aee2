// The OpenIGTLink client against a peer that misbehaves, over real sockets.
#include "acquisition/igtl/igtl_device.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <future>

#include "acquisition/recording.h"
#include "acquisition/session.h"
#include "core/mesh_io.h"
#include "core/random.h"
#include "tests/devices/igtl_pack.h"
#include "tests/devices/igtl_peer.h"

namespace gnathion {
namespace {

using namespace std::chrono_literals;
using Connection = Peer::Connection;
constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;
constexpr std::int64_t kStep_ns = 10'000'000;

class IgtlDeviceTest : public ::testing::Test {
 protected:
  std::unique_ptr<Device> open(int port, std::map<std::string, ConfigValue> more = {},
                               const std::string& name = "plus") {
    DeviceConfig config;
    config.kind = "openigtlink";
    config.stream = name;
    config.where = "devices.toml: " + name;
    config.settings = std::move(more);
    config.settings["port"] = std::int64_t{port};
    auto device = open_device(config, clock_);
    EXPECT_TRUE(device) << device.error().line();
    return std::move(*device);
  }

  /// Pulls until `enough`; fails when that does not come within a generous time.
  std::vector<Sample> pull(Device& device, const std::function<bool(const std::vector<Sample>&)>& enough) {
    auto all = std::async(std::launch::async, [&] {
      std::vector<Sample> samples;
      while (!enough(samples)) {
        auto next = device.next();
        EXPECT_TRUE(next) << next.error().line();
        if (!next || !*next) break;
        samples.push_back(std::move(**next));
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

std::string message(int i, const std::string& device = "StylusToTracker") {
  return igtl_pack::transform(device, Rigid3::from_translation({i * 1.0, 2, 3}).matrix(),
                              kStart_ns + i * kStep_ns);
}
std::vector<int> indices(const std::vector<Sample>& samples,
                         const std::string& stream = "plus/StylusToTracker") {
  std::vector<int> out;
  for (const Sample& s : samples)
    if (const auto* pose = std::get_if<PoseSample>(&s); pose && pose->header.stream == stream)
      out.push_back(static_cast<int>(std::lround(pose->reference_from_body.translation_mm.x())));
  return out;
}
std::vector<int> count_to(int n) {
  std::vector<int> out(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) out[static_cast<std::size_t>(i)] = i;
  return out;
}
auto until_pose(int last) {
  return [last](const std::vector<Sample>& s) {
    const auto got = indices(s);
    return !got.empty() && got.back() == last;
  };
}
std::map<std::string, std::uint64_t> rejected(const std::vector<Sample>& samples) {
  std::map<std::string, std::uint64_t> out;
  for (const Sample& s : samples)
    if (const auto* line = std::get_if<LedgerSample>(&s); line && line->fate == LedgerSample::Fate::kRejected)
      out[line->reason] += line->count;
  return out;
}
std::uint64_t missing(const std::vector<Sample>& samples, const std::string& stream) {
  std::uint64_t n = 0;
  for (const Sample& s : samples)
    if (const auto* line = std::get_if<LedgerSample>(&s);
        line && line->fate == LedgerSample::Fate::kMissing && line->header.stream == stream)
      n += line->count;
  return n;
}

TEST_F(IgtlDeviceTest, PosesWithNamesTimesAndCounters) {
  Peer peer([](const Connection& c, int) {
    for (int i = 0; i < 50; ++i) {
      c.send(message(i));
      std::this_thread::sleep_for(2ms);
    }
    c.hold();
  });
  const auto device = open(peer.port(), {{"latency_ms", 3.0}});
  const auto samples = pull(*device, until_pose(49));
  EXPECT_EQ(indices(samples), count_to(50));
  std::optional<HostTime> last;
  for (const Sample& s : samples) {
    const auto& pose = std::get<PoseSample>(s);
    const int i = static_cast<int>(std::lround(pose.reference_from_body.translation_mm.x()));
    EXPECT_EQ(pose.body, "Stylus");
    EXPECT_EQ(pose.reference, "Tracker");
    EXPECT_TRUE(pose.valid);
    EXPECT_EQ(pose.header.sequence, static_cast<std::uint32_t>(i));
    EXPECT_NEAR(static_cast<double>(pose.header.device.ns - (kStart_ns + i * kStep_ns)), 0, 30);
    // Poses that come in one burst are a nanosecond apart.
    EXPECT_LE(pose.header.capture.ns, pose.header.arrival.ns - 2'999'000);
    if (last) {
      EXPECT_GT(pose.header.capture, *last);
    }
    last = pose.header.capture;
  }
  const DeviceHealth health = device->health();
  EXPECT_EQ(health.state, DeviceState::kRunning);
  EXPECT_EQ(health.received, 50u);
  EXPECT_EQ(health.rejected + health.missing + health.reconnects, 0u);
  EXPECT_TRUE(health.clock.known);
  EXPECT_GT(health.rate_hz, 0);
}

TEST_F(IgtlDeviceTest, EachKindOfMessageIsASampleOfItsOwnStream) {
  Image8 picture(32, 24);
  for (std::size_t i = 0; i < picture.pixels.size(); ++i)
    picture.pixels[i] = static_cast<std::uint8_t>(i * 7);
  Peer peer([&](const Connection& c, int) {
    c.send(message(0, "X"));
    c.send(igtl_pack::tdata("NDI", {{"probe", {}}, {"bow frame", {}}}, kStart_ns));
    c.send(igtl_pack::qtdata("NDI", {{"probe", {}}}, kStart_ns));
    c.send(igtl_pack::image("X", picture, kStart_ns));
    auto mesh = ::igtl::PolyDataMessage::New();
    auto points = ::igtl::PolyDataPointArray::New();
    const float corners[3][3] = {{0, 0, 0}, {2, 0, 0}, {0, 3, 0}};
    for (const auto& corner : corners) points->AddPoint(const_cast<float*>(corner));
    mesh->SetPoints(points);
    auto polygons = ::igtl::PolyDataCellArray::New();
    igtlUint32 triangle[3] = {0, 1, 2};
    polygons->AddCell(3, triangle);
    mesh->SetPolygons(polygons);
    c.send(igtl_pack::packed(mesh, "X", kStart_ns));
    c.send(igtl_pack::status("X", 1, "fine", "ready", kStart_ns));
    c.send(igtl::pack("STRING", "X", std::string("\0\3\0\2hi", 6)));
    c.send(message(99));
    c.hold();
  });
  const auto device = open(peer.port());
  const auto samples = pull(*device, until_pose(99));
  std::map<std::string, const Sample*> by_stream;
  for (const Sample& s : samples) by_stream[header_of(s).stream] = &s;
  for (const char* name : {"plus/X", "plus/probe", "plus/bow_frame", "plus/probe_2"}) {
    ASSERT_TRUE(by_stream.count(name)) << name;
    EXPECT_TRUE(std::holds_alternative<PoseSample>(*by_stream[name])) << name;
  }
  EXPECT_EQ(std::get<PoseSample>(*by_stream["plus/bow_frame"]).body, "bow frame");
  EXPECT_EQ(std::get<PoseSample>(*by_stream["plus/bow_frame"]).reference, "NDI");
  EXPECT_EQ(std::get<FrameSample>(*by_stream.at("plus/X/image")).image.pixels, picture.pixels);
  const auto& scan = std::get<ScanSample>(*by_stream.at("plus/X/scan"));
  ASSERT_EQ(scan.files.size(), 1u);
  const auto mesh = parse_mesh(scan.files.begin()->second, scan.name);
  ASSERT_TRUE(mesh) << mesh.error().line();
  EXPECT_NEAR(surface_area_mm2(*mesh), 3, 1e-5);
  const auto& event = std::get<EventSample>(*by_stream.at("plus/X/status"));
  EXPECT_EQ(event.text, "OK (fine): ready");
  EXPECT_TRUE(event.pressed);
  EXPECT_EQ(rejected(samples), (std::map<std::string, std::uint64_t>{{"type STRING is not read", 1}}));
}

TEST_F(IgtlDeviceTest, ADripOfSingleBytes) {
  Peer peer([](const Connection& c, int) {
    for (int i = 0; i < 5; ++i)
      for (const char byte : message(i)) {
        c.send(std::string_view(&byte, 1));
        std::this_thread::sleep_for(1ms);
      }
    c.hold();
  });
  const auto device = open(peer.port());
  EXPECT_EQ(indices(pull(*device, until_pose(4))), count_to(5));
}

TEST_F(IgtlDeviceTest, DamageBetweenMessagesCostsNothingElse) {
  Random random(static_cast<std::uint64_t>(std::chrono::steady_clock::now().time_since_epoch().count()));
  const int garbage = 1 + static_cast<int>(random.below(500));
  Peer peer([&](const Connection& c, int) {
    c.send(message(0));
    std::string noise;
    for (int i = 0; i < garbage; ++i) noise += static_cast<char>(random.below(256));
    c.send(noise + message(1));
    std::string bad = message(1000);
    bad[60] ^= 4;  // in the body
    c.send(bad + message(2));
    std::string endless = message(1000);
    endless[42] = '\x80';  // 2^63 bytes
    c.send(endless + message(3));
    std::string greedy = igtl_pack::image("liar", Image8(8, 8), kStart_ns);
    greedy[47] = '\x02';  // 128 KiB more than it has
    c.send(greedy);
    for (int i = 4; i < 1500; ++i) c.send(message(i));
    c.hold();
  });
  const auto device = open(peer.port());
  const auto samples = pull(*device, until_pose(1499));
  EXPECT_EQ(indices(samples), count_to(1500));
  const auto faults = rejected(samples);
  EXPECT_GE(faults.at("checksum of the body is wrong"), 1u);  // the greedy image's too, unless it took long
  std::uint64_t total = 0;
  for (const auto& [reason, n] : faults) total += n;
  EXPECT_EQ(total, 4u);
  EXPECT_EQ(device->health().rejected, 4u);
  EXPECT_EQ(device->health().reconnects, 0u);
}

TEST_F(IgtlDeviceTest, AWrongLengthDoesNotSwallowASlowStream) {
  Peer peer([](const Connection& c, int) {
    c.send(message(0));
    std::string greedy = igtl_pack::image("liar", Image8(8, 8), kStart_ns);
    greedy[46] = '\x03';  // 48 MiB more than it has: days of poses
    if (!c.send(greedy)) return;
    for (int i = 1; c.send(message(i)); ++i) std::this_thread::sleep_for(10ms);
  });
  const auto device = open(peer.port());
  const auto samples = pull(*device, [](const std::vector<Sample>& s) { return indices(s).size() >= 150; });
  EXPECT_EQ(indices(samples), count_to(150));
  const auto faults = rejected(samples);
  ASSERT_EQ(faults.size(), 1u);
  EXPECT_EQ(faults.begin()->first.rfind("announces 5033", 0), 0u) << faults.begin()->first;
  EXPECT_EQ(device->health().reconnects, 0u);
}

TEST_F(IgtlDeviceTest, ClosedInTheMiddleItComesBack) {
  Peer peer([](const Connection& c, int n) {
    c.send(message(2 * n) + message(2 * n + 1));
    if (n < 4) {
      c.send(message(999).substr(0, n % 2 ? 30 : 80));  // half a header, or half a body
      return;
    }
    c.hold();
  });
  const auto device = open(peer.port());
  const auto samples = pull(*device, until_pose(9));
  EXPECT_EQ(indices(samples), count_to(10));
  int lost = 0, back = 0;
  for (const Sample& s : samples)
    if (const auto* event = std::get_if<EventSample>(&s)) {
      EXPECT_EQ(event->header.stream, "plus/state");
      EXPECT_EQ(event->kind, "device");
      ++(event->pressed ? back : lost);
    }
  EXPECT_EQ(lost, 4);
  EXPECT_EQ(back, 4);
  EXPECT_EQ(device->health().reconnects, 4u);
  EXPECT_EQ(rejected(samples), (std::map<std::string, std::uint64_t>{{"30 bytes are no message: cut off", 2},
                                                                     {"cut off after 80 of 106 bytes", 2}}));
}

TEST_F(IgtlDeviceTest, AHundredReconnectsLoseNothing) {
  Peer peer([](const Connection& c, int n) {
    c.send(message(n));
    if (n >= 100) c.hold();
  });
  const auto device = open(peer.port());
  EXPECT_EQ(indices(pull(*device, until_pose(100))), count_to(101));
  EXPECT_EQ(device->health().reconnects, 100u);
}

TEST_F(IgtlDeviceTest, APeerThatNeverAnswersIsNoticedAndTriedAgain) {
  std::atomic<bool> speak = false;
  Peer peer([&](const Connection& c, int n) {
    if (n >= 2 && speak.exchange(true)) return;
    if (n >= 2) c.send(message(7));
    c.hold();
  });
  const auto device = open(peer.port(), {{"silence_s", 0.3}});
  const auto samples = pull(*device, until_pose(7));
  ASSERT_EQ(samples.size(), 3u);  // lost once, back once, the pose
  EXPECT_FALSE(std::get<EventSample>(samples[0]).pressed);
  EXPECT_NE(std::get<EventSample>(samples[0]).text.find("silent for"), std::string::npos);
  EXPECT_TRUE(std::get<EventSample>(samples[1]).pressed);
}

TEST_F(IgtlDeviceTest, DuplicatesAndOldMessagesAreToldApart) {
  Peer peer([](const Connection& c, int) {
    c.send(message(0) + message(1) + message(1) + message(2) + message(1) + message(3));
    c.hold();
  });
  const auto device = open(peer.port());
  const auto samples = pull(*device, until_pose(3));
  EXPECT_EQ(indices(samples), count_to(4));
  EXPECT_EQ(rejected(samples), (std::map<std::string, std::uint64_t>{{"duplicate", 1}, {"out of order", 1}}));
}

TEST_F(IgtlDeviceTest, MessageNumbersTellWhatIsMissing) {
  const auto numbered = [](int i, const std::string& device = "StylusToTracker") {
    return igtl_pack::with_extended_header(message(i, device), static_cast<std::uint32_t>(i));
  };
  Peer peer([&](const Connection& c, int) {
    for (const int i : {5, 6, 9, 10}) c.send(numbered(i) + numbered(i, "Other"));  // 7 and 8 never come
    std::string bad = numbered(11);
    bad.back() = static_cast<char>(bad.back() ^ 1);
    c.send(bad + numbered(12) + numbered(11) + numbered(14));  // 11 once damaged, once late; 13 lost
    c.hold();
  });
  const auto device = open(peer.port());
  const auto samples = pull(*device, until_pose(14));
  EXPECT_EQ(indices(samples), (std::vector<int>{5, 6, 9, 10, 12, 14}));
  EXPECT_EQ(missing(samples, "plus/StylusToTracker"), 3u);
  EXPECT_EQ(missing(samples, "plus/Other"), 2u);
  EXPECT_EQ(rejected(samples), (std::map<std::string, std::uint64_t>{{"checksum of the body is wrong", 1},
                                                                     {"out of order", 1}}));
  for (const Sample& s : samples)
    if (const auto* pose = std::get_if<PoseSample>(&s)) {
      EXPECT_EQ(pose->header.sequence, std::lround(pose->reference_from_body.translation_mm.x()));
    }
}

TEST_F(IgtlDeviceTest, NumbersOfTheWholeConnection) {
  Peer peer([&](const Connection& c, int) {
    std::uint32_t id = 1;
    for (int i = 0; i < 6; ++i)
      for (const char* name : {"StylusToTracker", "Other"}) {
        if (i == 3) id += 2;  // lost: which stream's nobody knows
        c.send(igtl_pack::with_extended_header(message(i, name), id++));
      }
    c.hold();
  });
  const auto device = open(peer.port(), {{"message_ids", std::string("connection")}});
  const auto samples = pull(*device, until_pose(5));
  EXPECT_EQ(indices(samples), count_to(6));
  EXPECT_EQ(missing(samples, "plus"), 4u);
  EXPECT_EQ(missing(samples, "plus/StylusToTracker"), 0u);
}

TEST_F(IgtlDeviceTest, ToolsThatAreNotSeenOrNotTrusted) {
  Peer peer([](const Connection& c, int) {
    const std::vector<igtl_pack::Tool> both = {{"a", {}}, {"b", {}}};
    c.send(igtl_pack::tdata("NDI", both, kStart_ns));
    c.send(igtl_pack::tdata("NDI", {{"a", {}}}, kStart_ns + kStep_ns));
    c.send(igtl_pack::status("b", 13, "", "not there", kStart_ns + kStep_ns));
    c.send(igtl_pack::tdata("NDI", both, kStart_ns + 2 * kStep_ns));
    c.send(igtl_pack::status("b", 1, "", "", kStart_ns + 2 * kStep_ns));
    c.send(igtl_pack::tdata("NDI", both, kStart_ns + 3 * kStep_ns));
    c.send(igtl_pack::with_extended_header(
        message(1), 1, {{"TransformValid", "False"}, {"TransformStatus", "OUT_OF_VIEW"}}));
    c.send(igtl_pack::tdata("NDI", {{"a", {}, 3}, {"b", {}}}, kStart_ns + 4 * kStep_ns));
    Matrix4 scaled = 2 * Matrix4::Identity();
    scaled(3, 3) = 1;
    c.send(igtl_pack::transform("StylusToTracker", scaled, kStart_ns + 5 * kStep_ns));
    c.send(message(9));
    c.hold();
  });
  const auto device = open(peer.port());
  const auto samples = pull(*device, until_pose(9));
  std::map<std::string, std::vector<std::string>> reasons;
  for (const Sample& s : samples)
    if (const auto* pose = std::get_if<PoseSample>(&s)) {
      EXPECT_EQ(pose->valid, pose->reason.empty());
      reasons[pose->header.stream].push_back(pose->reason);
    }
  EXPECT_EQ(reasons["plus/a"], (std::vector<std::string>{"", "", "", "", "position only"}));
  EXPECT_EQ(reasons["plus/b"],
            (std::vector<std::string>{"", "not in the message", "status: not ready", "", ""}));
  EXPECT_EQ(reasons["plus/StylusToTracker"], (std::vector<std::string>{"OUT_OF_VIEW", ""}));
  EXPECT_EQ(rejected(samples), (std::map<std::string, std::uint64_t>{{"not a rotation", 1}}));
}

TEST_F(IgtlDeviceTest, APeerThatInventsNamesIsCutShort) {
  Peer peer([](const Connection& c, int) {
    for (int i = 0; i < 1000; ++i) c.send(message(i, "device" + std::to_string(i)));
    c.send(message(5, "device5"));
    c.hold();
  });
  const auto device = open(peer.port());
  std::set<std::string> names;
  const auto samples = pull(*device, [](const auto& s) { return s.size() >= 1001; });
  for (const Sample& s : samples) names.insert(header_of(s).stream);
  EXPECT_EQ(names.size(), 257u);
  EXPECT_EQ(rejected(samples)["more than 256 devices"], 744u);
}

/// A session with a peer that fails in every way and one that does not: both recorded, nothing whole lost.
TEST_F(IgtlDeviceTest, ASessionRecordsItBesideOthers) {
  constexpr int kEach = 20, kConnections = 10;
  Peer good([&](const Connection& c, int) {
    for (int i = 0; i < 200; ++i) {
      c.send(message(i) +
             igtl_pack::image("cam", Image8(16, 8, static_cast<std::uint8_t>(i)), kStart_ns + i * kStep_ns));
      std::this_thread::sleep_for(1ms);
    }
    c.hold();
  });
  Peer bad([&](const Connection& c, int n) {
    for (int i = 0; i < kEach; ++i) {
      std::string damaged = message(5000);
      damaged[static_cast<std::size_t>(i < 10 ? i : 42 + 3 * i)] ^= 0x21;  // version, type, body
      c.send(damaged + message(n * kEach + i) + std::string(static_cast<std::size_t>(i), 'x'));
    }
    if (n + 1 >= kConnections) c.hold();
  });
  const auto path =
      std::filesystem::temp_directory_path() / ("gnathion_igtl_" + std::to_string(::getpid()) + ".mcap");
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open(good.port()));
  devices.push_back(open(bad.port(), {}, "bad"));
  auto session = Session::start(path, std::move(devices), {}, clock_);
  ASSERT_TRUE(session) << session.error().line();
  const auto received = [&](const std::string& stream) {
    const SessionStatus status = (*session)->status();
    const auto found = status.ledger.find(stream);
    return found == status.ledger.end() ? std::uint64_t{0} : found->second.received;
  };
  for (int i = 0; i < 3000 && (received("plus/cam/image") < 200 ||
                               received("bad/StylusToTracker") < kEach * kConnections);
       ++i)
    std::this_thread::sleep_for(20ms);
  const Status finished = (*session)->finish();
  EXPECT_TRUE(finished) << finished.error().line();
  std::vector<Sample> samples;
  auto source = RecordingSource::open(path);
  ASSERT_TRUE(source) << source.error().line();
  while (auto next = (*source)->next()) {
    if (!*next) break;
    samples.push_back(std::move(**next));
  }
  std::filesystem::remove(path);
  EXPECT_EQ(indices(samples), count_to(200));
  EXPECT_EQ(indices(samples, "bad/StylusToTracker"), count_to(kEach * kConnections));
  int images = 0;
  for (const Sample& s : samples)
    if (const auto* frame = std::get_if<FrameSample>(&s)) {
      EXPECT_EQ(frame->header.stream, "plus/cam/image");
      EXPECT_EQ(frame->image.pixels[5], images++);
    }
  EXPECT_EQ(images, 200);
}

TEST_F(IgtlDeviceTest, StopEndsEveryWait) {
  Peer silent([](const Connection& c, int) { c.hold(); });
  Peer busy([](const Connection& c, int) {
    for (int i = 0; c.send(message(i)); ++i) {
    }
  });
  int dead_port = 0;
  {
    Peer gone([](const Connection&, int) {});
    dead_port = gone.port();
  }
  for (const int port : {silent.port(), busy.port(), dead_port}) {
    const auto device = open(port);
    auto end = std::async(std::launch::async, [&] {
      while (true) {
        auto next = device->next();
        if (!next || !*next) return next.has_value();
      }
    });
    std::this_thread::sleep_for(50ms);
    device->stop();
    device->stop();
    ASSERT_EQ(end.wait_for(30s), std::future_status::ready);
    EXPECT_TRUE(end.get());
    EXPECT_EQ(device->health().state, DeviceState::kStopped);
    const auto again = device->next();
    EXPECT_TRUE(again && !*again);
  }
}

TEST_F(IgtlDeviceTest, AsksForWhatIsConfigured) {
  std::promise<std::string> asked;
  Peer peer([&](const Connection& c, int) {
    asked.set_value(c.receive(58 + 36 + 58));
    c.hold();
  });
  const auto device = open(peer.port(), {{"request", std::vector<std::string>{"STT_TDATA", "GET_POLYDATA"}},
                                         {"request_interval_ms", std::int64_t{35}},
                                         {"request_device", std::string("Jaw")},
                                         {"coordinate_system", std::string("Patient")}});
  auto pulling = std::async(std::launch::async, [&] { return device->next(); });
  std::string bytes = asked.get_future().get();
  device->stop();
  // Read back by the library.
  auto start = ::igtl::StartTrackingDataMessage::New();
  start->InitPack();
  std::memcpy(start->GetPackPointer(), bytes.data(), 58);
  start->Unpack();
  EXPECT_STREQ(start->GetDeviceType(), "STT_TDATA");
  start->AllocatePack();
  std::memcpy(start->GetPackBodyPointer(), bytes.data() + 58, 36);
  EXPECT_TRUE(start->Unpack(1) & ::igtl::MessageHeader::UNPACK_BODY);
  EXPECT_EQ(start->GetResolution(), 35);
  EXPECT_STREQ(start->GetCoordinateName(), "Patient");
  EXPECT_STREQ(start->GetDeviceName(), "Jaw");
  EXPECT_EQ(bytes.substr(58 + 36 + 2, 12), std::string("GET_POLYDATA"));
}

TEST_F(IgtlDeviceTest, BadConfigurationIsOneClearLine) {
  const auto refusal = [&](std::map<std::string, ConfigValue> settings) {
    DeviceConfig config{"openigtlink", "plus", std::move(settings), "devices.toml: plus", {}};
    const auto device = open_device(config, clock_);
    return device ? std::string("taken") : device.error().line();
  };
  EXPECT_NE(refusal({{"prot", std::int64_t{18944}}}).find("unknown key 'prot'; 'port' is meant?"),
            std::string::npos);
  EXPECT_NE(refusal({{"port", std::int64_t{0}}}).find("'port' is 0"), std::string::npos);
  EXPECT_NE(refusal({{"request", std::vector<std::string>{"STT_DATA"}}}).find("STT_DATA"), std::string::npos);
  EXPECT_NE(refusal({{"host", std::string("no such host.invalid")}}).find("no such host.invalid"),
            std::string::npos);
}

}  // namespace
}  // namespace gnathion
