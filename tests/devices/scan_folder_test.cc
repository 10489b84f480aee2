// The watched folder against the real file system and inotify: writers that are slow, clever, careless or
// dead.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <fstream>
#include <set>
#include <thread>

#include "acquisition/device.h"
#include "acquisition/scanner/scan_devices.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "core/random.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

/// A wavy sheet in millimetres, as large as a face; other seeds, other noise.
TriangleMesh sheet(std::uint64_t seed, double size_mm = 120, double noise_mm = 0.05) {
  constexpr int kSide = 61;
  Random random(seed);
  TriangleMesh mesh;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const double u = x / double(kSide - 1), v = y / double(kSide - 1);
      const double scale = size_mm / 120;
      mesh.vertices_mm.push_back(
          {size_mm * u, size_mm * v,
           scale * (8 * std::sin(4 * u) * std::cos(3 * v) + noise_mm * random.normal())});
    }
  for (std::uint32_t y = 0; y + 1 < kSide; ++y)
    for (std::uint32_t x = 0; x + 1 < kSide; ++x) {
      const std::uint32_t a = y * kSide + x, b = a + 1, c = a + kSide, d = c + 1;
      mesh.triangles.push_back({a, b, d});
      mesh.triangles.push_back({a, d, c});
    }
  return mesh;
}

std::string ply(std::uint64_t seed) {
  return format_mesh(sheet(seed), MeshFormat::kPlyBinary);
}

void put(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

class ScanFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("gnathion_scan_" + std::to_string(::getpid()) + "_" +
                                         ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(root_);
    fs::create_directories(inbox());
  }
  void TearDown() override {
    device_.reset();
    fs::remove_all(root_);
  }
  fs::path inbox() const { return root_ / "inbox"; }

  void open(std::map<std::string, ConfigValue> settings = {}) {
    auto opened = try_open(std::move(settings));
    ASSERT_TRUE(opened) << opened.error().line();
    device_ = std::move(*opened);
  }
  Result<std::unique_ptr<Device>> try_open(std::map<std::string, ConfigValue> settings) {
    DeviceConfig config;
    config.kind = "scan_folder";
    config.stream = "face";
    config.where = "devices.toml: face";
    config.folder = root_;
    config.settings = {{"folder", std::string("inbox")},
                       {"settle_ms", 60.0},
                       {"settle_unseen_ms", 300.0},
                       {"poll_ms", 50.0}};
    for (auto& [key, value] : settings) config.settings[key] = value;
    return open_device(config, clock_);
  }

  /// The next sample of a type within a generous time; others are kept aside.
  template <class T>
  std::optional<T> next_of(std::chrono::seconds patience = 30s) {
    std::atomic<bool> got = false;
    // The watchdog stops the device, so that a test which waits in vain fails and does not hang.
    std::thread watchdog([&] {
      const auto end = std::chrono::steady_clock::now() + patience;
      while (!got && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(5ms);
      if (!got) device_->stop();
    });
    std::optional<T> found;
    while (!found) {
      auto sample = device_->next();
      if (!sample || !*sample) break;
      if (T* wanted = std::get_if<T>(&**sample))
        found = std::move(*wanted);
      else
        others_.push_back(std::move(**sample));
    }
    got = true;
    watchdog.join();
    return found;
  }
  std::optional<ScanSample> scan() { return next_of<ScanSample>(); }
  std::optional<LedgerSample> line() { return next_of<LedgerSample>(); }

  SystemClock clock_;
  fs::path root_;
  std::unique_ptr<Device> device_;
  std::vector<Sample> others_;
};

TEST_F(ScanFolder, TakesAFileWithItsBytesHashAndDeviation) {
  open();
  put(inbox() / "patient.ply", ply(1));
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->name, "patient.ply");
  EXPECT_EQ(s->files.at("patient.ply"), ply(1));
  EXPECT_EQ(s->sha256, sha256_hex(ply(1)));
  EXPECT_NEAR(s->deviation_mm, 0.05, 0.01);  // the sheet's noise
  EXPECT_EQ(s->header.stream, "face");
  EXPECT_LE(s->header.capture.ns, s->header.arrival.ns);
  EXPECT_EQ(device_->health().received, 1u);
}

TEST_F(ScanFolder, WaitsForASlowWriter) {
  open();
  const std::string bytes = ply(2);
  // Pauses longer than settle_ms: only the open file tells that it goes on.
  std::thread writer([&] {
    std::ofstream out(inbox() / "slow.ply", std::ios::binary);
    for (std::size_t at = 0; at < bytes.size(); at += bytes.size() / 8 + 1) {
      out << bytes.substr(at, bytes.size() / 8 + 1) << std::flush;
      std::this_thread::sleep_for(120ms);
    }
  });
  const auto s = scan();
  writer.join();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->files.at("slow.ply"), bytes);
  EXPECT_TRUE(others_.empty());
}

TEST_F(ScanFolder, TakesWhatIsRenamedIntoPlace) {
  open();
  put(inbox() / "face.stl.part", format_mesh(sheet(3), MeshFormat::kStlBinary));
  put(inbox() / "~face.stl", "half");
  put(inbox() / "face.stl.tmp", "half");
  fs::rename(inbox() / "face.stl.part", inbox() / "face.stl");
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->name, "face.stl");
  EXPECT_TRUE(others_.empty());
}

TEST_F(ScanFolder, AnObjWaitsForMaterialAndTexture) {
  open();
  put(inbox() / "face.obj", "mtllib face.mtl\n" + format_mesh(sheet(4), MeshFormat::kObj));
  std::thread exporter([&] {
    std::this_thread::sleep_for(300ms);
    put(inbox() / "face.mtl", "newmtl skin\nmap_Kd C:\\export\\skin colour.png\n");
    std::this_thread::sleep_for(300ms);
    std::ofstream png(inbox() / "skin colour.png", std::ios::binary);
    png << "first half " << std::flush;
    std::this_thread::sleep_for(300ms);
    png << "second half";
  });
  const auto s = scan();
  exporter.join();
  ASSERT_TRUE(s);
  ASSERT_EQ(s->files.size(), 3u);
  EXPECT_EQ(s->files.at("skin colour.png"), "first half second half");
  EXPECT_TRUE(s->files.count("face.mtl"));
  EXPECT_TRUE(others_.empty());
}

TEST_F(ScanFolder, AnObjWhoseTextureNeverComesIsTakenAndSaysSo) {
  open({{"companion_s", 0.4}});
  put(inbox() / "face.obj", "mtllib lost.mtl\n" + format_mesh(sheet(5), MeshFormat::kObj));
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->files.size(), 1u);
  ASSERT_EQ(others_.size(), 1u);
  const auto& warning = std::get<EventSample>(others_[0]);
  EXPECT_EQ(warning.header.stream, "face/state");
  EXPECT_NE(warning.text.find("lost.mtl"), std::string::npos) << warning.text;
}

TEST_F(ScanFolder, NeverTakesTheSameContentTwice) {
  open();
  put(inbox() / "a.ply", ply(6));
  ASSERT_TRUE(scan());
  put(inbox() / "b.ply", ply(6));  // another name
  const auto twin = line();
  ASSERT_TRUE(twin);
  EXPECT_EQ(twin->fate, LedgerSample::Fate::kRejected);
  EXPECT_NE(twin->reason.find("same content as a.ply"), std::string::npos) << twin->reason;
  put(inbox() / "a.ply", ply(6));  // the same name, written again
  const auto again = line();
  ASSERT_TRUE(again);
  EXPECT_NE(again->reason.find("a.ply: same content"), std::string::npos) << again->reason;
  put(inbox() / "a.ply", ply(7));  // another scan under the old name
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->name, "a_2.ply");
  EXPECT_EQ(s->files.at("a_2.ply"), ply(7));
  EXPECT_EQ(device_->health().rejected, 2u);
}

TEST_F(ScanFolder, RemembersAcrossARestart) {
  open({{"existing", std::string("take")}});
  put(inbox() / "a.ply", ply(8));
  ASSERT_TRUE(scan());
  put(inbox() / "b.ply", ply(9));
  device_.reset();  // closed before b came
  open({{"existing", std::string("take")}});
  const auto b = scan();
  ASSERT_TRUE(b);
  EXPECT_EQ(b->name, "b.ply");
  std::size_t refused_a = 0;
  for (const Sample& s : others_) refused_a += std::get<LedgerSample>(s).reason.find("a.ply") == 0;
  EXPECT_EQ(refused_a, 1u);
}

TEST_F(ScanFolder, AKilledProgramGetsAgainWhatMayNotBeRecorded) {
  put(inbox() / "old.ply", ply(30));
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    open();
    const auto wait_for = [&](const char* name) {
      for (;;) {
        const auto sample = device_->next();
        if (!sample || !*sample) ::_exit(1);
        const auto* scan = std::get_if<ScanSample>(&**sample);
        if (scan && scan->name == name) return;
      }
    };
    put(inbox() / "a.ply", ply(31));
    wait_for("a.ply");
    put(inbox() / "b.ply", ply(32));
    wait_for("b.ply");  // a was handed over long ago, as next() goes
    ::raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  open();
  std::set<std::string> got;
  for (int i = 0; i < 2; ++i) {
    const auto s = scan();
    ASSERT_TRUE(s);
    got.insert(s->name);
  }
  EXPECT_EQ(got, (std::set<std::string>{"a.ply", "b.ply"}));  // old.ply was never on its way
  std::size_t told = 0;
  for (const Sample& s : others_)
    if (const auto* event = std::get_if<EventSample>(&s)) told += event->kind == "warning";
  EXPECT_EQ(told, 2u);
}

TEST_F(ScanFolder, AFailedRecordingGivesItsLastScansBack) {
  open();
  put(inbox() / "a.ply", ply(33));
  ASSERT_TRUE(scan());
  dynamic_cast<RemembersScans&>(*device_).recording_failed();
  device_.reset();
  open();
  const auto again = scan();
  ASSERT_TRUE(again);
  EXPECT_EQ(again->name, "a.ply");
  device_->stop();
  EXPECT_FALSE(*device_->next());
  device_.reset();  // this recording is sound
  open({{"existing", std::string("take")}});
  const auto refused = line();
  ASSERT_TRUE(refused);
  EXPECT_NE(refused->reason.find("taken before"), std::string::npos) << refused->reason;
}

TEST_F(ScanFolder, AStopLosesNoScanAndNoLine) {
  for (std::uint64_t i = 0; i < 3; ++i) put(inbox() / ("s" + std::to_string(i) + ".ply"), ply(40 + i));
  open({{"existing", std::string("take")}});
  ASSERT_TRUE(scan());  // all three settle in one look
  std::ofstream half(inbox() / "half.ply", std::ios::binary);
  half << "ply" << std::flush;
  device_->stop();
  std::vector<Sample> rest;
  for (auto s = device_->next(); s && *s; s = device_->next()) rest.push_back(**s);
  ASSERT_EQ(rest.size(), 3u);
  EXPECT_TRUE(std::holds_alternative<ScanSample>(rest[0]));
  EXPECT_TRUE(std::holds_alternative<ScanSample>(rest[1]));
  const auto& left = std::get<LedgerSample>(rest[2]);
  EXPECT_EQ(left.reason.find("half.ply: not complete when the recording ended"), 0u) << left.reason;
  device_.reset();
  EXPECT_FALSE(fs::exists(root_ / "face.taken.underway"));
}

TEST_F(ScanFolder, WhatWasThereBeforeIsLeftUntilItChanges) {
  put(inbox() / "old.ply", ply(10));
  open();
  const auto summary = line();
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->count, 1u);
  put(inbox() / "new.ply", ply(11));
  const auto first = scan();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->name, "new.ply");
  put(inbox() / "old.ply", ply(12));
  const auto second = scan();
  ASSERT_TRUE(second);
  EXPECT_EQ(second->name, "old.ply");
}

TEST_F(ScanFolder, TakesABurstWhole) {
  open();
  std::set<std::string> sent, got;
  for (int i = 0; i < 20; ++i) {
    const std::string name = "burst_" + std::to_string(i) + ".ply";
    put(inbox() / name, ply(100 + static_cast<std::uint64_t>(i)));
    sent.insert(name);
  }
  std::set<std::uint32_t> sequences;
  for (int i = 0; i < 20; ++i) {
    const auto s = scan();
    ASSERT_TRUE(s) << i;
    got.insert(s->name);
    sequences.insert(s->header.sequence);
  }
  EXPECT_EQ(got, sent);
  EXPECT_EQ(sequences.size(), 20u);
  EXPECT_TRUE(others_.empty());
}

TEST_F(ScanFolder, AnUnreadableFileIsGivenUpByNameAndTakenWhenMended) {
  open({{"incomplete_s", 0.5}});
  fs::create_symlink(root_ / "nowhere.ply", inbox() / "broken.ply");
  const auto lost = line();
  ASSERT_TRUE(lost);
  EXPECT_EQ(lost->reason.find("broken.ply: not complete"), 0u) << lost->reason;
  EXPECT_NE(lost->reason.find("No such file"), std::string::npos) << lost->reason;
  put(root_ / "nowhere.ply", ply(13));
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->name, "broken.ply");
}

/// Root reads everything; as nobody it does not.
class AsNobody {
 public:
  AsNobody() : was_root_(::geteuid() == 0) {
    if (was_root_) {
      EXPECT_EQ(::seteuid(65534), 0);
    }
  }
  ~AsNobody() {
    if (was_root_) {
      EXPECT_EQ(::seteuid(0), 0);
    }
  }

 private:
  const bool was_root_;
};

TEST_F(ScanFolder, RightsThatComeLate) {
  fs::permissions(root_, fs::perms::all);
  fs::permissions(inbox(), fs::perms::all);
  const AsNobody nobody;
  open({{"incomplete_s", 0.5}});
  put(inbox() / ".hidden", ply(14));
  ::chmod((inbox() / ".hidden").c_str(), 0);
  fs::rename(inbox() / ".hidden", inbox() / "locked.ply");
  const auto lost = line();
  ASSERT_TRUE(lost);
  EXPECT_NE(lost->reason.find("Permission denied"), std::string::npos) << lost->reason;
  ::chmod((inbox() / "locked.ply").c_str(), 0644);
  EXPECT_TRUE(scan());
}

TEST_F(ScanFolder, HalfAFileForEverIsRejectedAndStillTakenWhenItIsFinished) {
  open({{"incomplete_s", 0.5}});
  const std::string bytes = ply(15);
  put(inbox() / "half.ply", bytes.substr(0, bytes.size() / 2));  // its writer died
  const auto lost = line();
  ASSERT_TRUE(lost);
  EXPECT_EQ(lost->reason.find("half.ply: not complete"), 0u) << lost->reason;
  EXPECT_EQ(lost->fate, LedgerSample::Fate::kRejected);
  put(inbox() / "half.ply", bytes);
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->files.at("half.ply"), bytes);
}

TEST_F(ScanFolder, AWriterThatNeverClosesIsReportedAndTakenWhenItDoes) {
  open({{"incomplete_s", 0.5}});
  const std::string bytes = ply(16);
  std::ofstream out(inbox() / "open.ply", std::ios::binary);
  out << bytes << std::flush;  // whole, but still open
  const auto lost = line();
  ASSERT_TRUE(lost);
  EXPECT_NE(lost->reason.find("has not closed it"), std::string::npos) << lost->reason;
  out.close();
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->files.at("open.ply"), bytes);
}

TEST_F(ScanFolder, AFolderThatVanishesComesBack) {
  open();
  put(inbox() / "a.ply", ply(17));
  ASSERT_TRUE(scan());
  fs::rename(inbox(), root_ / "unmounted");
  const auto gone = next_of<EventSample>();
  ASSERT_TRUE(gone);
  EXPECT_EQ(gone->kind, "device");
  EXPECT_FALSE(gone->pressed);
  EXPECT_EQ(device_->health().state, DeviceState::kRecovering);
  put(root_ / "unmounted" / "b.ply", ply(18));
  fs::rename(root_ / "unmounted", inbox());
  const auto back = next_of<EventSample>();
  ASSERT_TRUE(back);
  EXPECT_TRUE(back->pressed);
  const auto b = scan();
  ASSERT_TRUE(b);
  EXPECT_EQ(b->name, "b.ply");
  put(inbox() / "c.ply", ply(19));
  const auto c = scan();
  ASSERT_TRUE(c);
  EXPECT_EQ(c->name, "c.ply");
  EXPECT_TRUE(others_.empty());
  EXPECT_EQ(device_->health().reconnects, 1u);
}

TEST_F(ScanFolder, MetresAreTakenAndReported) {
  open();
  put(inbox() / "metres.ply", format_mesh(sheet(20, 0.12), MeshFormat::kPlyBinary));
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->deviation_mm, 0);
  ASSERT_EQ(others_.size(), 1u);
  EXPECT_NE(std::get<EventSample>(others_[0]).text.find("metres?"), std::string::npos)
      << std::get<EventSample>(others_[0]).text;
}

TEST_F(ScanFolder, PollsWhereTheSystemTellsNothing) {
  open({{"watch", std::string("poll")}, {"subfolders", true}});
  ASSERT_EQ(device_->description().warnings.size(), 1u);
  fs::create_directories(inbox() / "scan_1");
  put(inbox() / "scan_1" / "face.ply", ply(21));
  const auto s = scan();
  ASSERT_TRUE(s);
  EXPECT_EQ(s->name, "face.ply");
  EXPECT_EQ(s->files.at("face.ply"), ply(21));
}

TEST_F(ScanFolder, StopsAtOnceAndRefusesWhatItDoesNotKnow) {
  open();
  std::thread stopper([&] {
    std::this_thread::sleep_for(50ms);
    device_->stop();
  });
  const auto end = device_->next();
  stopper.join();
  ASSERT_TRUE(end);
  EXPECT_FALSE(*end);
  EXPECT_EQ(device_->health().state, DeviceState::kStopped);

  const auto wrong_key = try_open({{"setle_ms", 5.0}});
  ASSERT_FALSE(wrong_key);
  EXPECT_NE(wrong_key.error().line().find("settle_ms"), std::string::npos);
  const auto no_folder = try_open({{"folder", std::string("nowhere")}});
  ASSERT_FALSE(no_folder);
  EXPECT_NE(no_folder.error().line().find("does not exist"), std::string::npos);
  put(root_ / "face.taken", "rubbish\n");
  EXPECT_FALSE(try_open({}));
}

}  // namespace
}  // namespace gnathion
