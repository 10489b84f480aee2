#include "acquisition/camera/frame_sync.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <set>

#include "core/random.h"

namespace gnathion {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kPeriodNs = 16'666'667;

/// A frame as a camera of the rig sent it; its only pixel tells the instant it truly belongs to.
FrameSample frame_of(std::size_t camera, std::uint32_t instant, std::int64_t capture_ns,
                     std::int64_t arrival_ns) {
  FrameSample f;
  f.header.stream = "camera_" + std::to_string(camera);
  f.header.sequence = instant;
  f.header.capture = {1'700'000'000'000'000'000 + capture_ns};
  f.header.arrival = {1'700'000'000'000'000'000 + arrival_ns};
  f.header.device = {capture_ns};
  f.image = Image8(1, 1, static_cast<std::uint8_t>(instant));
  return f;
}

RigSyncOptions rig_of(std::size_t cameras) {
  RigSyncOptions o;
  for (std::size_t i = 0; i < cameras; ++i) o.streams.push_back("camera_" + std::to_string(i));
  return o;
}

class ListSource : public Source {
 public:
  explicit ListSource(std::vector<Sample> samples) : samples_(std::move(samples)) {}
  Result<std::optional<Sample>> next() override {
    if (next_ == samples_.size()) return std::nullopt;
    return samples_[next_++];
  }

 private:
  std::vector<Sample> samples_;
  std::size_t next_ = 0;
};

/// A rig filmed for `instants` periods. Each camera's frame of each instant, unless `lost`, in order of
/// arrival.
struct Film {
  std::size_t cameras = 2;
  std::uint32_t instants = 600;
  double jitter_ms = 0.5;     ///< of the capture times
  double drift_ppm = 0;       ///< of the last camera's own rate: it runs free
  std::int64_t phase_ns = 0;  ///< of the last camera
  std::function<bool(std::size_t, std::uint32_t)> lost = [](std::size_t, std::uint32_t) { return false; };
  std::function<std::int64_t(std::size_t, std::uint32_t)> delay_ns = [](std::size_t, std::uint32_t) {
    return 8 * kMs;
  };

  std::vector<Sample> samples(Random* random) const {
    std::vector<FrameSample> frames;
    std::vector<std::int64_t> last_arrival(cameras, 0);
    for (std::uint32_t k = 0; k < instants; ++k)
      for (std::size_t c = 0; c < cameras; ++c) {
        if (lost(c, k)) continue;
        const bool odd = c + 1 == cameras;
        const double period = static_cast<double>(kPeriodNs) * (odd ? 1 + drift_ppm * 1e-6 : 1);
        const std::int64_t t = std::llround(k * period) + (odd ? phase_ns : 0);
        const std::int64_t capture = t + std::llround(random->uniform(-1, 1) * jitter_ms * 1e6);
        last_arrival[c] = std::max<std::int64_t>(
            last_arrival[c] + 1, t + delay_ns(c, k) + std::llround(random->uniform(0, 3) * 1e6));
        frames.push_back(frame_of(c, k, capture, last_arrival[c]));
      }
    std::stable_sort(frames.begin(), frames.end(),
                     [](const auto& a, const auto& b) { return a.header.arrival < b.header.arrival; });
    return {frames.begin(), frames.end()};
  }
};

struct Outcome {
  std::vector<FrameSet> sets;
  std::size_t frames = 0, lone = 0, others = 0;
  std::string reason;
};

/// Through the decorator, then grouped again as a reader of the recording would.
Outcome grouped(const std::vector<Sample>& samples, const RigSyncOptions& options) {
  Outcome out;
  ListSource list(samples);
  RigSyncSource source(list, options);
  FrameGrouper again(options);
  std::set<std::pair<std::string, std::uint32_t>> seen;
  std::size_t position = 0;
  const auto keep = [&](const std::vector<FrameGrouper::Decision>& decisions) {
    for (const auto& d : decisions) {
      EXPECT_TRUE(d.lone.empty()) << "a frame that was kept is lone on replay";
      out.sets.push_back(d.set);
    }
  };
  for (;;) {
    auto sample = source.next();
    EXPECT_TRUE(sample);
    if (!sample || !*sample) break;
    const SampleHeader& h = header_of(**sample);
    // Everything comes out in the order in which it went in, once.
    EXPECT_EQ(h.stream, header_of(samples[position]).stream);
    EXPECT_EQ(h.sequence, header_of(samples[position]).sequence);
    ++position;
    EXPECT_TRUE(seen.emplace(h.stream, h.sequence).second);
    if (auto* frame = std::get_if<FrameSample>(&**sample)) {
      ++out.frames;
      EXPECT_EQ(frame->image.pixels.size(), 1u);
      keep(again.add(std::make_shared<const FrameSample>(std::move(*frame))));
    } else if (const auto* line = std::get_if<LedgerSample>(&**sample)) {
      out.lone += line->count;
      keep(again.note(*line));
      out.reason = line->reason;
      EXPECT_EQ(line->fate, LedgerSample::Fate::kRejected);
    } else {
      ++out.others;
    }
  }
  keep(again.finish());
  EXPECT_EQ(position, samples.size());
  std::size_t in_sets = 0;
  for (const FrameSet& s : out.sets) in_sets += s.count();
  EXPECT_EQ(in_sets, out.frames);
  EXPECT_EQ(out.frames + out.lone + out.others, samples.size());
  return out;
}

/// Sets whose members belong to different instants.
std::size_t mixed(const Outcome& out) {
  std::size_t wrong = 0;
  for (const FrameSet& s : out.sets) {
    std::set<std::uint32_t> instants;
    for (const auto& f : s.frames)
      if (f) instants.insert(f->header.sequence);
    wrong += instants.size() != 1;
  }
  return wrong;
}

TEST(FrameSync, FramesOfOneInstantAreASet) {
  Random random(1);
  for (const std::size_t cameras : {1u, 2u, 3u, 4u}) {
    Film film;
    film.cameras = cameras;
    const Outcome out = grouped(film.samples(&random), rig_of(cameras));
    EXPECT_EQ(out.sets.size(), film.instants);
    EXPECT_EQ(out.lone, 0u);
    EXPECT_EQ(mixed(out), 0u);
    for (const FrameSet& s : out.sets) EXPECT_EQ(s.count(), cameras);
  }
}

TEST(FrameSync, EachFrameWithoutPartnerHasItsLine) {
  Random random(2), losses(3);
  Film film;
  std::set<std::pair<std::size_t, std::uint32_t>> gone;
  for (int i = 0; i < 60; ++i) gone.emplace(losses.below(2), losses.below(600));
  film.lost = [&](std::size_t c, std::uint32_t k) { return gone.count({c, k}) > 0; };
  const Outcome out = grouped(film.samples(&random), rig_of(2));
  std::size_t whole = 0, lone = 0;
  for (std::uint32_t k = 0; k < film.instants; ++k) {
    const int there = !film.lost(0, k) + !film.lost(1, k);
    whole += there == 2;
    lone += there == 1;
  }
  EXPECT_EQ(out.sets.size(), whole);
  EXPECT_EQ(out.lone, lone);
  EXPECT_EQ(mixed(out), 0u);
  EXPECT_EQ(out.reason, "no partner within 4.0 ms");
}

TEST(FrameSync, TwoOfThreeDoWhereThatIsAsked) {
  Random random(4), losses(5);
  Film film;
  film.cameras = 3;
  std::set<std::pair<std::size_t, std::uint32_t>> gone;
  for (int i = 0; i < 300; ++i) gone.emplace(losses.below(3), losses.below(600));
  film.lost = [&](std::size_t c, std::uint32_t k) { return gone.count({c, k}) > 0; };
  RigSyncOptions options = rig_of(3);
  options.min_frames = 2;
  const Outcome out = grouped(film.samples(&random), options);
  std::size_t sets = 0, lone = 0;
  for (std::uint32_t k = 0; k < film.instants; ++k) {
    const int there = !film.lost(0, k) + !film.lost(1, k) + !film.lost(2, k);
    sets += there >= 2;
    lone += there == 1;
  }
  EXPECT_EQ(out.sets.size(), sets);
  EXPECT_EQ(out.lone, lone);
  EXPECT_EQ(mixed(out), 0u);
}

TEST(FrameSync, ACameraWhoseFramesComeLateIsWaitedFor) {
  Random random(6);
  Film film;
  film.delay_ns = [](std::size_t c, std::uint32_t k) {
    return c == 0 ? 8 * kMs : (k % 100 < 20 ? 300 : 60) * kMs;  // now and then it hangs, within the lag
  };
  const Outcome out = grouped(film.samples(&random), rig_of(2));
  EXPECT_EQ(out.sets.size(), film.instants);
  EXPECT_EQ(out.lone, 0u);
  EXPECT_EQ(mixed(out), 0u);
}

TEST(FrameSync, ACameraThatStopsDoesNotHoldTheOthers) {
  Random random(7);
  Film film;
  film.cameras = 3;
  film.lost = [](std::size_t c, std::uint32_t k) { return c == 2 && k >= 200 && k < 400; };
  RigSyncOptions options = rig_of(3);
  options.min_frames = 2;
  const auto samples = film.samples(&random);
  const Outcome out = grouped(samples, options);
  EXPECT_EQ(out.sets.size(), film.instants);
  EXPECT_EQ(mixed(out), 0u);
  EXPECT_EQ(out.lone, 0u);
  // And live: what is held back stays bounded while the camera is away.
  FrameGrouper grouper(options);
  std::size_t held = 0, most = 0;
  for (const Sample& s : samples) {
    ++held;
    for (const auto& d : grouper.add(std::make_shared<const FrameSample>(std::get<FrameSample>(s))))
      held -= d.tickets.size();
    most = std::max(most, held);
  }
  EXPECT_LE(most, 2 * 32u);  // two cameras for half a second
  // With all three asked for, the others' frames are lone meanwhile, and no set is mixed up.
  const Outcome strict = grouped(samples, rig_of(3));
  EXPECT_EQ(strict.sets.size(), film.instants - 200);
  EXPECT_EQ(strict.lone, 400u);
  EXPECT_EQ(mixed(strict), 0u);
}

TEST(FrameSync, FreeRunningCamerasDriftApartAndTogetherAgain) {
  Random random(8);
  Film film;
  film.jitter_ms = 0.1;
  film.instants = 6000;
  film.drift_ppm = 500;  // 50 ms in 100 s: three periods
  const auto samples = film.samples(&random);
  const Outcome out = grouped(samples, rig_of(2));
  // Pairs lie within the tolerance for 2 · 4 of 16.7 ms of phase.
  EXPECT_NEAR(static_cast<double>(out.sets.size()) / film.instants, 8 / 16.667, 0.05);
  for (const FrameSet& s : out.sets) {
    const std::int64_t apart = s.frames[0]->header.capture.ns - s.frames[1]->header.capture.ns;
    EXPECT_LE(std::abs(apart), 4 * kMs);
    EXPECT_NEAR(static_cast<double>(s.capture.ns - s.frames[0]->header.capture.ns),
                -0.5 * static_cast<double>(apart), 1);
  }
}

TEST(FrameSync, ByDeviceTimeWhereOneClockServesAll) {
  Random random(9);
  Film film;
  film.jitter_ms = 0;
  auto samples = film.samples(&random);
  // Host times of the second camera are off by a period; the common device clock knows better.
  for (Sample& s : samples)
    if (auto& f = std::get<FrameSample>(s); f.header.stream == "camera_1") f.header.capture.ns += kPeriodNs;
  RigSyncOptions options = rig_of(2);
  EXPECT_GT(mixed(grouped(samples, options)), 500u);
  options.time_base = RigSyncOptions::TimeBase::kDeviceTime;
  const Outcome out = grouped(samples, options);
  EXPECT_EQ(out.sets.size(), film.instants);
  EXPECT_EQ(mixed(out), 0u);
}

TEST(FrameSync, OneCameraWithAWrongClockDoesNotPartTheOthers) {
  Random random(10);
  Film film;
  film.cameras = 3;
  film.phase_ns = 3600LL * 1000 * kMs;
  film.delay_ns = [](std::size_t c, std::uint32_t) {
    return c == 2 ? 8 * kMs - 3600LL * 1000 * kMs : 8 * kMs;
  };
  RigSyncOptions options = rig_of(3);
  options.min_frames = 2;
  const Outcome out = grouped(film.samples(&random), options);
  EXPECT_EQ(out.sets.size(), film.instants);
  EXPECT_EQ(out.lone, film.instants);
  EXPECT_EQ(mixed(out), 0u);
}

TEST(FrameSync, FramesThatGoBackInTimeAreLone) {
  Random random(11);
  Film film;
  auto samples = film.samples(&random);
  std::size_t swapped = 0;
  for (std::size_t i = 100; i + 2 < samples.size(); i += 50)
    if (header_of(samples[i]).stream == header_of(samples[i + 2]).stream) {
      std::swap(samples[i], samples[i + 2]);
      ++swapped;
    }
  ASSERT_GT(swapped, 10u);
  const Outcome out = grouped(samples, rig_of(2));
  EXPECT_EQ(mixed(out), 0u);
  EXPECT_GE(out.sets.size() + 2 * swapped, film.instants);
}

TEST(FrameSync, AClockThatStartsAnewPairsAgain) {
  Random random(12);
  Film film;
  auto samples = film.samples(&random), more = film.samples(&random);
  for (Sample& s : more) {
    auto& h = std::get<FrameSample>(s).header;
    h.sequence += 1000;
    samples.push_back(s);
  }
  const Outcome out = grouped(samples, rig_of(2));
  EXPECT_EQ(mixed(out), 0u);
  EXPECT_GE(out.sets.size(), 2 * film.instants - 4);
}

TEST(FrameSync, OtherSamplesPassInOrder) {
  Random random(13);
  Film film;
  film.instants = 50;
  auto samples = film.samples(&random);
  EventSample pedal;
  pedal.header.stream = "pedal";
  pedal.kind = "MI";
  samples.insert(samples.begin() + 41, pedal);
  FrameSample stranger = frame_of(7, 0, 0, 0);
  samples.insert(samples.begin() + 20, stranger);
  ListSource list(samples);
  RigSyncSource source(list, rig_of(2));
  for (const Sample& expected : samples) {
    auto got = source.next();
    ASSERT_TRUE(got && *got);
    EXPECT_EQ(header_of(**got).stream, header_of(expected).stream);
    EXPECT_EQ((*got)->index(), expected.index());
  }
  EXPECT_FALSE(*source.next());
}

}  // namespace
}  // namespace gnathion
