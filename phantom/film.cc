#include "phantom/film.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check.h"
#include "core/random.h"
#include "phantom/renderer.h"

namespace gnathion {
namespace {

HostTime host_time(double seconds) {
  return {static_cast<std::int64_t>(std::llround(seconds * 1e9))};
}

JawGeometry geometry_of(const FilmScene& scene) {
  JawGeometry geometry;
  geometry.condyle_left_mm = scene.condyle_left_mm;
  geometry.condyle_right_mm = scene.condyle_right_mm;
  geometry.incisal_point_mm = scene.incisal_point_mm;
  return geometry;
}

JawSequenceOptions sequence_options(const FilmOptions& options) {
  JawSequenceOptions sequence;
  sequence.seed = options.seed;
  sequence.duration_s = options.duration_s;
  sequence.border_movements = options.border_movements;
  return sequence;
}

/// A device's own clock: another zero, and a few parts per million fast or slow; ticks of 1 µs.
DeviceTime device_time(HostTime host, std::uint64_t seed, std::uint64_t device) {
  Random random(seed, 0x636c6f636b00 + device);
  const double offset_ns = random.uniform(1e9, 1e12), drift = random.uniform(-40e-6, 40e-6);
  const double ns = offset_ns + (1 + drift) * static_cast<double>(host.ns);
  return {static_cast<std::int64_t>(std::llround(ns / 1000)) * 1000};
}

constexpr std::uint64_t kPedalDevice = 99;

}  // namespace

struct PhantomFilm::Renderers {
  std::vector<CameraRenderer> cameras;
};

PhantomFilm::PhantomFilm(FilmScene scene, FilmOptions options)
    : scene_(std::move(scene)),
      options_(options),
      jaw_(geometry_of(scene_), scene_.therapeutic, sequence_options(options)),
      head_(options.seed, options.duration_s, options.head_motion),
      marks_(jaw_.marks()),
      frame_count_(static_cast<std::uint32_t>(std::floor(options.duration_s * options.rate_hz))) {
  GNATHION_CHECK(!scene_.rig.cameras.empty());
  GNATHION_CHECK(options.rate_hz > 0 && options.exposure_s >= 0 && options.prefetch_frames > 0);
}

PhantomFilm::~PhantomFilm() = default;

HostTime PhantomFilm::capture_time(std::uint32_t frame) const {
  return host_time(frame / options_.rate_hz);
}

FilmTruth PhantomFilm::truth_at(HostTime time) const {
  FilmTruth truth = truth_at_seconds(static_cast<double>(time.ns) * 1e-9);
  truth.capture = time;
  return truth;
}

FilmTruth PhantomFilm::truth_at_seconds(double time_s) const {
  FilmTruth truth;
  truth.capture = host_time(time_s);
  truth.mandible = jaw_.mandible_motion(time_s);
  truth.camera_from_dental =
      Transform<Camera, Dental>(scene_.camera_from_dental_at_rest.rigid * head_.motion(time_s).rigid);
  const Transform<Camera, Dental> camera_from_mandible(truth.camera_from_dental.rigid * truth.mandible.rigid);
  truth.camera_from_bow = camera_from_mandible * scene_.bow_from_dental.inverse();
  truth.camera_from_head = truth.camera_from_dental * scene_.head_from_dental.inverse();
  return truth;
}

Status PhantomFilm::prepare_renderers() {
  auto renderers = std::make_unique<Renderers>();
  const std::vector<SceneBody> bodies{{scene_.rig.head_frame, scene_.head_surface},
                                      {scene_.rig.bow, scene_.bow_surface}};
  for (std::size_t c = 0; c < scene_.rig.cameras.size(); ++c) {
    RenderOptions render;
    render.seed = options_.seed * 16 + c;  // another view of another wall, noise of its own
    render.noise_sigma = options_.noise_sigma;
    render.blur_sigma_px = options_.blur_sigma_px;
    render.clutter = options_.clutter;
    GNATHION_TRY(CameraRenderer renderer,
                 CameraRenderer::create(scene_.rig.cameras[c].model, bodies, render));
    renderers->cameras.push_back(std::move(renderer));
  }
  renderers_ = std::move(renderers);
  return {};
}

bool PhantomFilm::dropped(std::size_t camera, std::uint32_t frame) const {
  if (options_.drop_fraction <= 0) return false;
  Random random(options_.seed, 0x64726f7000000000ULL + (std::uint64_t(camera) << 32) + frame);
  return random.uniform() < options_.drop_fraction;
}

SampleHeader PhantomFilm::frame_header(std::size_t camera, std::uint32_t frame) const {
  SampleHeader header;
  header.stream = scene_.rig.cameras[camera].name;
  header.sequence = frame;
  header.capture = capture_time(frame);
  header.device = device_time(header.capture, options_.seed, camera);
  // Half the exposure, read-out and transfer, and the host's scheduling.
  Random random(options_.seed, 0x6a69740000000000ULL + (std::uint64_t(camera) << 32) + frame);
  const double latency_s = 0.5 * options_.exposure_s + 0.006 + 0.0004 * std::abs(random.normal()) +
                           (random.uniform() < 0.02 ? random.uniform(0.001, 0.004) : 0.0);
  header.arrival = {header.capture.ns + static_cast<std::int64_t>(latency_s * 1e9)};
  return header;
}

Image8 PhantomFilm::expose(std::size_t camera, std::uint32_t frame) const {
  const Rigid3 camera_from_rig = scene_.rig.cameras[camera].rig_from_camera.inverse();
  const auto poses_at = [&](double time_s) {
    const FilmTruth truth = truth_at_seconds(time_s);
    return std::array<Rigid3, 2>{camera_from_rig * truth.camera_from_head.rigid,
                                 camera_from_rig * truth.camera_from_bow.rigid};
  };
  const double middle = frame / options_.rate_hz;
  const auto opens = poses_at(middle - 0.5 * options_.exposure_s);
  const auto closes = poses_at(middle + 0.5 * options_.exposure_s), halfway = poses_at(middle);
  const CameraRenderer& renderer = renderers_->cameras[camera];
  std::vector<BodyExposure> exposures;
  for (std::size_t body = 0; body < 2; ++body) {
    BodyExposure exposure{halfway[body], {}};
    const int steps = renderer.sub_exposures(body, opens[body], closes[body]);
    for (int k = 0; steps > 1 && k < steps; ++k) {
      const double time_s = middle + options_.exposure_s * ((k + 0.5) / steps - 0.5);
      exposure.path.push_back(poses_at(time_s)[body]);
    }
    exposures.push_back(std::move(exposure));
  }
  return renderer.render(exposures, frame);
}

void PhantomFilm::prefetch() {
  struct Job {
    std::size_t camera;
    std::uint32_t frame;
  };
  std::vector<Job> jobs;
  const std::uint32_t end =
      std::min(frame_count_, next_frame_ + static_cast<std::uint32_t>(options_.prefetch_frames));
  for (; next_frame_ < end; ++next_frame_)
    for (std::size_t c = 0; c < scene_.rig.cameras.size(); ++c)
      if (!dropped(c, next_frame_)) jobs.push_back({c, next_frame_});
  std::vector<FrameSample> frames(jobs.size());
  tbb::parallel_for(std::size_t{0}, jobs.size(), [&](std::size_t i) {
    frames[i] = {frame_header(jobs[i].camera, jobs[i].frame), expose(jobs[i].camera, jobs[i].frame)};
  });
  for (FrameSample& frame : frames) ready_.push_back(std::move(frame));
}

std::optional<EventSample> PhantomFilm::event_due(HostTime before) {
  if (next_mark_ >= marks_.size()) return std::nullopt;
  const JawMark& mark = marks_[next_mark_];
  if (host_time(mark.time_s) > before) return std::nullopt;
  EventSample event;
  event.header.stream = "pedal";
  event.header.sequence = static_cast<std::uint32_t>(next_mark_);
  event.header.capture = host_time(mark.time_s);
  event.header.device = device_time(event.header.capture, options_.seed, kPedalDevice);
  Random random(options_.seed, 0x706564616c00 + next_mark_);
  event.header.arrival = {event.header.capture.ns +
                          static_cast<std::int64_t>(1e6 * random.uniform(1.0, 9.0))};  // HID polling
  event.kind = mark.kind;
  event.pressed = mark.pressed;
  ++next_mark_;
  return event;
}

Result<std::optional<Sample>> PhantomFilm::next() {
  if (!renderers_ && next_frame_ < frame_count_) {
    if (Status ready = prepare_renderers(); !ready) {
      next_frame_ = frame_count_;
      next_mark_ = marks_.size();
      return tl::unexpected<Error>(ready.error());
    }
  }
  while (ready_.empty() && next_frame_ < frame_count_) prefetch();
  const HostTime limit =
      ready_.empty() ? HostTime{std::numeric_limits<std::int64_t>::max()} : ready_.front().header.capture;
  if (auto event = event_due(limit)) return Sample(std::move(*event));
  if (ready_.empty()) return std::optional<Sample>();
  Sample frame(std::move(ready_.front()));
  ready_.pop_front();
  return frame;
}

}  // namespace gnathion
