// Recordings and the virtual patient as devices: a session of them is the same samples again, bit for bit.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "acquisition/exchange/export_recording.h"
#include "acquisition/exchange/import_recording.h"
#include "acquisition/recording.h"
#include "acquisition/session.h"
#include "phantom/film.h"
#include "phantom/film_scene.h"
#include "phantom/patient.h"
#include "pipeline/phantom_device.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t kSeed = 11;

FilmOptions short_film() {
  FilmOptions film;
  film.seed = kSeed;
  film.duration_s = 3;
  film.rate_hz = 10;
  film.drop_fraction = 0.1;
  film.border_movements = false;
  return film;
}

std::vector<Sample> all_of(Source& source) {
  std::vector<Sample> samples;
  while (true) {
    auto next = source.next();
    EXPECT_TRUE(next) << next.error().line();
    if (!next || !*next) return samples;
    samples.push_back(std::move(**next));
  }
}
std::vector<Sample> all_in(const fs::path& path) {
  auto source = RecordingSource::open(path);
  EXPECT_TRUE(source) << source.error().line();
  return source ? all_of(**source) : std::vector<Sample>();
}

/// Everything equal, times but for a constant shift.
void expect_same(const std::vector<Sample>& got, const std::vector<Sample>& truth, std::int64_t shift_ns) {
  ASSERT_EQ(got.size(), truth.size());
  for (std::size_t i = 0; i < got.size(); ++i) {
    ASSERT_EQ(got[i].index(), truth[i].index()) << i;
    const SampleHeader &a = header_of(got[i]), &b = header_of(truth[i]);
    EXPECT_EQ(a.stream, b.stream);
    EXPECT_EQ(a.sequence, b.sequence);
    EXPECT_EQ(a.capture.ns, b.capture.ns + shift_ns);
    EXPECT_EQ(a.arrival.ns, b.arrival.ns + shift_ns);
    EXPECT_EQ(a.device, b.device);
    if (const auto* frame = std::get_if<FrameSample>(&truth[i])) {
      EXPECT_EQ(std::get<FrameSample>(got[i]).image.pixels, frame->image.pixels);
    } else if (const auto* event = std::get_if<EventSample>(&truth[i])) {
      EXPECT_EQ(std::get<EventSample>(got[i]).kind, event->kind);
      EXPECT_EQ(std::get<EventSample>(got[i]).pressed, event->pressed);
    } else if (const auto* line = std::get_if<LedgerSample>(&truth[i])) {
      EXPECT_EQ(std::get<LedgerSample>(got[i]).fate, line->fate);
      EXPECT_EQ(std::get<LedgerSample>(got[i]).count, line->count);
      EXPECT_EQ(std::get<LedgerSample>(got[i]).reason, line->reason);
    }
  }
}

class ExchangeSession : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("gnathion_e2e_exchange_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
    PhantomFilm film(film_scene(make_phantom_patient(kSeed)), short_film());
    SilentProgress progress;
    ASSERT_TRUE(record(film, folder_ / "filmed.mcap", {}, film.frames_per_camera(), progress));
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }

  /// One session with one device, until it is at its end.
  std::vector<Sample> session_of(const DeviceConfig& config, const std::string& name) {
    auto device = open_device(config, clock_);
    EXPECT_TRUE(device) << device.error().line();
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(std::move(*device));
    auto session = Session::start(folder_ / name, std::move(devices), {}, clock_);
    EXPECT_TRUE(session) << session.error().line();
    EXPECT_TRUE((*session)->wait_for(120));
    const Status finished = (*session)->finish();
    EXPECT_TRUE(finished) << finished.error().line();
    return all_in(folder_ / name);
  }
  static fs::path folder_;
  SystemClock clock_;
};
fs::path ExchangeSession::folder_;

TEST_F(ExchangeSession, AReplayedSessionRecordedAgainIsTheSame) {
  const auto truth = all_in(folder_ / "filmed.mcap");
  ASSERT_GT(truth.size(), 30u);
  for (const double speed : {0.0, 20.0}) {
    const DeviceConfig config{"replay",
                              "again",
                              {{"path", std::string("filmed.mcap")}, {"speed", speed}},
                              "devices.toml: again",
                              folder_};
    expect_same(session_of(config, "again_" + std::to_string(static_cast<int>(speed)) + ".mcap"), truth, 0);
  }
}

TEST_F(ExchangeSession, ThePhantomIsADeviceLikeAnyOther) {
  const DeviceConfig refused{"phantom", "patient", {}, "devices.toml: patient", folder_};
  EXPECT_FALSE(open_device(refused, clock_));  // nobody below the pipeline knows it
  add_phantom_device();
  const FilmOptions film = short_film();
  const DeviceConfig config{"phantom",
                            "patient",
                            {{"seed", static_cast<std::int64_t>(kSeed)},
                             {"duration_s", film.duration_s},
                             {"rate_hz", film.rate_hz},
                             {"drop_fraction", film.drop_fraction},
                             {"border_movements", false},
                             {"speed", 0.0}},
                            "devices.toml: patient",
                            folder_};
  const HostTime before = clock_.now();
  const auto got = session_of(config, "phantom.mcap");
  const auto truth = all_in(folder_ / "filmed.mcap");
  ASSERT_FALSE(got.empty());
  const std::int64_t shift_ns = header_of(got[0]).arrival.ns - header_of(truth[0]).arrival.ns;
  EXPECT_GE(header_of(got[0]).arrival, before);
  expect_same(got, truth, shift_ns);
}

TEST_F(ExchangeSession, ExportedPicturesImportedAreTheSamePictures) {
  SilentProgress progress;
  fs::create_directories(folder_ / "out");
  const auto done =
      export_recording(folder_ / "filmed.mcap", {true, true, "", "", false}, folder_ / "out", progress);
  ASSERT_TRUE(done) << done.error().line();
  ASSERT_TRUE(
      import_images({{"camera_0", folder_ / "out" / "camera_0"}}, 10, folder_ / "back.mcap", progress));
  const auto back = all_in(folder_ / "back.mcap");
  std::size_t i = 0;
  for (const Sample& s : all_in(folder_ / "filmed.mcap")) {
    const auto* frame = std::get_if<FrameSample>(&s);
    if (!frame || frame->header.stream != "camera_0") continue;
    ASSERT_LT(i, back.size());
    EXPECT_EQ(std::get<FrameSample>(back[i++]).image.pixels, frame->image.pixels);
  }
  EXPECT_EQ(i, back.size());
}

}  // namespace
}  // namespace gnathion
