// The depth camera through the real libusb: a UVC device of umockdev with a bulk endpoint. Isochronous
// endpoints cannot be served by the mock, nor by the driver, which refuses them.
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <thread>

#include "acquisition/device.h"
#include "acquisition/scanner/scan_devices.h"
#include "core/camera_model.h"
#include "core/mesh_io.h"
#include "core/random.h"
#include "tests/support/mock_usb.h"
#include "tests/support/pull.h"
#include "tests/support/uvc_depth.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr int kWidth = 80, kHeight = 60;
constexpr double kNoise_mm = 1.0;

mock::Bed& bed() {
  static mock::Bed the_bed;
  return the_bed;
}

/// A camera that looks at a tilted plane and streams as fast as it is read.
class Camera {
 public:
  explicit Camera(std::string configuration = depth_configuration(streaming_descriptors(kWidth, kHeight)))
      : usb(bed(), spec(std::move(configuration))) {
    usb.on_control = [this](const std::string& setup, const std::string& data) {
      return control(setup, data);
    };
    usb.on_idle = [this] { return committed ? next_payload() : std::string(); };
  }
  static double truth_mm(int x, int y) { return 400 + 0.6 * x - 0.4 * y; }

  std::atomic<bool> committed = false;
  std::atomic<int> probes = 0, frames = 0;
  std::function<std::string(int, std::string)> spoil;  ///< of the n-th payload
  mock::Usb usb;

 private:
  static mock::UsbSpec spec(std::string configuration) {
    mock::UsbSpec s;
    s.vendor = 0x8086;
    s.product = 0x0b5b;
    s.serial = "D1";
    s.configuration = std::move(configuration);
    return s;
  }
  std::optional<std::string> control(const std::string& setup, const std::string& data) {
    const auto request = static_cast<std::uint8_t>(setup[1]), selector = static_cast<std::uint8_t>(setup[3]);
    if (setup[4] != 1) return std::nullopt;  // another interface
    if (request == 0x01 && selector == 0x01) {
      ++probes;
      control_ = data;
      return "";
    }
    if (request == 0x81 && selector == 0x01) {
      std::string answer = control_;
      answer.replace(18, 8, little_endian(2 * kWidth * kHeight, 4) + little_endian(1012, 4));
      return answer;
    }
    if (request == 0x01 && selector == 0x02) {
      committed = probes > 0 && data.substr(2, 2) == control_.substr(2, 2);
      return "";
    }
    return std::nullopt;
  }
  std::string next_payload() {
    if (pending_.empty()) {
      std::vector<std::uint16_t> units;
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
          units.push_back(
              static_cast<std::uint16_t>(std::lround(truth_mm(x, y) + kNoise_mm * random_.normal())));
      const int n = frames++;
      for (const std::string& p :
           payloads_of(z16_bytes(units), n % 2 == 1, static_cast<std::uint32_t>(n), 1000))
        pending_.push_back(p);
    }
    std::string payload = pending_.front();
    pending_.erase(pending_.begin());
    return spoil ? spoil(payloads_++, std::move(payload)) : payload;
  }
  std::string control_;
  std::vector<std::string> pending_;
  int payloads_ = 0;
  Random random_{4};
};

bool wait_until(const std::function<bool()>& what, double seconds = 60) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!what() && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  return what();
}

class DepthCamera : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("gnathion_depth_" + std::to_string(::getpid()));
    fs::create_directories(root_);
    write_intrinsics(kWidth, kHeight);
    config_ = {"depth_camera", "face", {}, "devices.toml: face", root_};
    config_.settings = {{"vendor", std::string("8086")},
                        {"product", std::string("0b5b")},
                        {"intrinsics", std::string("depth.toml")},
                        {"frames", 12.0},
                        {"warm_up_frames", 2.0},
                        {"trigger", std::string("once")},
                        {"timeout_s", 60.0}};
  }
  void TearDown() override { fs::remove_all(root_); }
  void write_intrinsics(int width, int height) const {
    Rig rig;
    RigCamera camera;
    camera.name = "depth";
    camera.model.width_px = width;
    camera.model.height_px = height;
    camera.model.fx_px = camera.model.fy_px = 90;
    camera.model.cx_px = 39.5;
    camera.model.cy_px = 29.5;
    rig.cameras = {camera};
    rig.bow.name = "bow";
    rig.head_frame.name = "head_frame";
    ASSERT_TRUE(write_rig(root_ / "depth.toml", rig));
  }
  void open() {
    auto opened = open_device(config_, clock_);
    ASSERT_TRUE(opened) << opened.error().line();
    pull_.reset();  // it holds the device before
    device_ = std::move(*opened);
    pull_ = std::make_unique<Pull>(*device_);
  }
  bool wait_scan(double seconds = 60) {
    return pull_->wait(
        [](const Pull::Samples& s) {
          return Pull::count<ScanSample>(s, [](const auto&) { return true; }) > 0;
        },
        seconds);
  }
  bool wait_line(double seconds = 60) {
    return pull_->wait(
        [](const Pull::Samples& s) {
          return Pull::count<LedgerSample>(s, [](const auto&) { return true; }) > 0;
        },
        seconds);
  }
  /// The one reason of the one refusal.
  std::string refusal() {
    open();
    if (!wait_line()) return "nothing came";
    return Pull::all<LedgerSample>(pull_->stop()).front().reason;
  }
  void expect_plane(const ScanSample& scan) {
    const auto mesh = parse_mesh(scan.files.at(scan.name), scan.name);
    ASSERT_TRUE(mesh) << mesh.error().line();
    ASSERT_GT(mesh->vertices_mm.size(), 4000u);
    double sum = 0;
    for (const Vector3& p : mesh->vertices_mm) {
      const double x = p.x() / p.z() * 90 + 39.5, y = p.y() / p.z() * 90 + 29.5;
      const double error = p.z() - (400 + 0.6 * x - 0.4 * y);
      sum += error * error;
    }
    const double rms = std::sqrt(sum / static_cast<double>(mesh->vertices_mm.size()));
    EXPECT_NEAR(rms, kNoise_mm / std::sqrt(12.0), 0.06);  // of twelve frames
    EXPECT_NEAR(scan.deviation_mm, rms, 0.12);
  }
  fs::path root_;
  DeviceConfig config_;
  SystemClock clock_;
  std::unique_ptr<Device> device_;
  std::unique_ptr<Pull> pull_;
};

TEST_F(DepthCamera, ABurstBecomesAScan) {
  Camera camera;
  camera.usb.plug();
  HostTime before_kept{0};  // frames 0 and 1 are warm-up
  camera.spoil = [&](int, std::string payload) {
    if (camera.frames == 3 && before_kept.ns == 0) before_kept = clock_.now();
    return payload;
  };
  open();
  ASSERT_TRUE(wait_scan()) << device_->health().message;
  const auto samples = pull_->stop();
  ASSERT_EQ(samples.size(), 1u);
  expect_plane(std::get<ScanSample>(samples[0]));
  const SampleHeader& header = std::get<ScanSample>(samples[0]).header;
  EXPECT_GT(header.capture.ns, before_kept.ns);
  EXPECT_LE(header.capture.ns, header.arrival.ns);
  EXPECT_EQ(camera.probes, 1);
  EXPECT_TRUE(camera.committed);
  EXPECT_EQ(device_->description().serial, "D1");
  camera.usb.unplug();
}

TEST_F(DepthCamera, LostPayloadsCostTheirFramesOnly) {
  Camera camera;
  camera.spoil = [](int n, std::string payload) {
    if (n % 37 == 5) return payload.substr(0, payload.size() / 2);       // short
    if (n % 41 == 7) payload[1] = static_cast<char>(payload[1] | 0x40);  // error bit
    if (n % 53 == 9) payload[0] = 1;                                     // a header that cannot be
    return payload;
  };
  camera.usb.plug();
  open();
  ASSERT_TRUE(wait_scan()) << device_->health().message;
  const auto samples = pull_->stop();
  const auto warnings = Pull::all<EventSample>(samples);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].text.find("were lost"), std::string::npos);
  expect_plane(Pull::all<ScanSample>(samples).front());
  camera.usb.unplug();
}

TEST_F(DepthCamera, UnpluggedInTheMiddleItGoesOnWhenItIsBack) {
  Camera camera;
  config_.settings["frames"] = 300.0;
  camera.usb.plug();
  open();
  ASSERT_TRUE(wait_until([&] { return camera.frames > 10; }));
  camera.usb.unplug();
  ASSERT_TRUE(pull_->wait([](const Pull::Samples& s) {
    return Pull::count<EventSample>(
               s, [](const EventSample& e) { return e.kind == "device" && !e.pressed; }) == 1;
  }));
  camera.committed = false;
  const int before = camera.frames;
  const HostTime replugged = clock_.now();
  camera.usb.plug();
  ASSERT_TRUE(wait_scan()) << device_->health().message;
  const auto samples = pull_->stop();
  // All of the scan is of the time after it came back, warm-up included.
  EXPECT_GE(camera.frames - before, 300 + 2);
  const auto scans = Pull::all<ScanSample>(samples);
  ASSERT_EQ(scans.size(), 1u);
  EXPECT_GT(scans[0].header.capture.ns, replugged.ns);
  EXPECT_EQ(
      Pull::count<EventSample>(samples, [](const EventSample& e) { return e.kind == "device" && e.pressed; }),
      1u);
  EXPECT_EQ(camera.probes, 2);
  EXPECT_EQ(device_->health().reconnects, 1u);
  camera.usb.unplug();
}

TEST_F(DepthCamera, SaysWhatIsWrongInOneLine) {
  config_.settings["timeout_s"] = 0.3;
  EXPECT_NE(refusal().find("no camera 8086:0b5b is plugged in"), std::string::npos);
  {
    Camera camera(depth_configuration(streaming_descriptors(kWidth, kHeight), 1));
    camera.usb.plug();
    EXPECT_NE(refusal().find("isochronous"), std::string::npos);
    camera.usb.unplug();
  }
  {
    Camera camera(depth_configuration(streaming_descriptors(640, 480)));
    camera.usb.plug();
    EXPECT_NE(refusal().find("it offers 640x480"), std::string::npos);
    camera.usb.unplug();
  }
  {
    Camera camera(depth_configuration(streaming_descriptors(kWidth, kHeight, "YUY2" + z16_guid().substr(4))));
    camera.usb.plug();
    EXPECT_NE(refusal().find("no depth as Z16"), std::string::npos);
    camera.usb.unplug();
  }
  config_.settings["vendor"] = std::string("80x6");
  EXPECT_NE(open_device(config_, clock_).error().line().find("'vendor'"), std::string::npos);
}

}  // namespace
}  // namespace gnathion
