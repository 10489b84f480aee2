#include "phantom/film.h"

#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <map>
#include <set>

#include "phantom/film_test_scene.h"

namespace gnathion {
namespace {

std::vector<Sample> all_of(PhantomFilm& film) {
  std::vector<Sample> samples;
  while (true) {
    auto sample = film.next();
    if (!sample) throw std::runtime_error(sample.error().line());
    if (!*sample) return samples;
    samples.push_back(std::move(**sample));
  }
}

FilmOptions short_film(std::uint64_t seed) {
  FilmOptions options;
  options.seed = seed;
  options.duration_s = 8;
  options.border_movements = false;
  options.rate_hz = 5;
  return options;
}

using Corners = std::array<Eigen::Vector2d, 4>;

/// Stock libapriltag; corners in pixel-centre coordinates.
std::map<int, Corners> detected(const Image8& image) {
  apriltag_family_t* family = tag36h11_create();
  apriltag_detector_t* detector = apriltag_detector_create();
  apriltag_detector_add_family(detector, family);
  detector->quad_decimate = 1;
  image_u8_t view{image.width_px, image.height_px, image.width_px,
                  const_cast<std::uint8_t*>(image.pixels.data())};
  zarray_t* found = apriltag_detector_detect(detector, &view);
  std::map<int, Corners> tags;
  for (int i = 0; i < zarray_size(found); ++i) {
    apriltag_detection_t* d = nullptr;
    zarray_get(found, i, &d);
    for (std::size_t k = 0; k < 4; ++k) tags[d->id][k] = Eigen::Vector2d(d->p[k][0] - 0.5, d->p[k][1] - 0.5);
  }
  apriltag_detections_destroy(found);
  apriltag_detector_destroy(detector);
  tag36h11_destroy(family);
  return tags;
}

TEST(PhantomFilm, EveryTagIsFoundWhereItIs) {
  FilmOptions options;
  options.seed = 31;
  options.rate_hz = 4;
  const FilmScene scene = film_test::test_scene();
  PhantomFilm film(scene, options);
  double squares = 0;
  int corners = 0, frames = 0;
  for (const Sample& sample : all_of(film)) {
    const auto* frame = std::get_if<FrameSample>(&sample);
    if (!frame) continue;
    ++frames;
    const FilmTruth truth = film.truth_at(frame->header.capture);
    const JawPhase& phase = film.jaw().phase_at(frame->header.capture.seconds_since({}));
    const auto found = detected(frame->image);
    std::set<int> known;
    const auto compare = [&](const TaggedBody& body, const Rigid3& camera_from_body) {
      int seen = 0;
      for (const BodyTag& tag : body.tags) {
        known.insert(tag.id);
        const auto it = found.find(tag.id);
        if (it == found.end()) continue;
        ++seen;
        for (std::size_t k = 0; k < 4; ++k) {
          const auto expected =
              scene.rig.cameras[0].model.project(camera_from_body * tag.corners_in_body_mm[k]);
          ASSERT_TRUE(expected);
          const double error = (*expected - it->second[k]).norm();
          EXPECT_LT(error, 1.0) << "corner order and place of tag " << tag.id << " in " << phase.name;
          squares += error * error;
          ++corners;
        }
      }
      if (phase.kind != JawPhaseKind::kOpening) {
        EXPECT_GE(seen, 8) << body.name << " in " << phase.name;
      }
    };
    compare(scene.rig.bow, truth.camera_from_bow.rigid);
    compare(scene.rig.head_frame, truth.camera_from_head.rigid);
    for (const auto& [id, where] : found) EXPECT_TRUE(known.count(id)) << "a tag in the clutter: " << id;
  }
  EXPECT_EQ(frames, 64);
  const double rms = std::sqrt(squares / corners);
  RecordProperty("detected_corner_rms_px", std::to_string(rms));
  EXPECT_LT(rms, 0.25) << "stock detection on a plain homography";
}

TEST(PhantomFilm, TruthIsTheChainOfPoses) {
  const FilmScene scene = film_test::test_scene();
  PhantomFilm film(scene, FilmOptions{});
  const Vector3 tooth(10, 20, -3);  // on the mandible, dental frame in MI
  for (const double t : {0.3, 2.6, 8.1, 11.0, 15.0}) {
    const FilmTruth truth = film.truth_at({static_cast<std::int64_t>(t * 1e9)});
    const Vector3 by_bow = truth.camera_from_bow * (scene.bow_from_dental * tooth);
    const Vector3 by_head = truth.camera_from_head * (scene.head_from_dental * (truth.mandible * tooth));
    EXPECT_LT((by_bow - by_head).norm(), 1e-9);
  }
  // In TP the relative motion of bow and head is T_th, whatever the head does (method, camera route).
  const auto poses = [&](double t) {
    const FilmTruth truth = film.truth_at({static_cast<std::int64_t>(t * 1e9)});
    return std::pair(BowAndHead<Camera>{truth.camera_from_bow, truth.camera_from_head}, truth);
  };
  const JawPhase *mi = nullptr, *tp = nullptr;
  for (const JawPhase& phase : film.jaw().phases()) {
    if (phase.kind == JawPhaseKind::kTp && !tp) tp = &phase;
    if (phase.kind == JawPhaseKind::kMi && !tp) mi = &phase;
  }
  const auto [at_mi, truth_mi] = poses(mi->start_s + 0.2);
  const auto [at_tp, truth_tp] = poses(tp->start_s + 0.4);
  EXPECT_GT(difference(truth_mi.camera_from_head.rigid, truth_tp.camera_from_head.rigid).tail<3>().norm(),
            0.3)
      << "the head has moved";
  const Motion<Dental> recovered =
      express_in(dental_from_measurement(scene.bow_from_dental, at_mi), relative_motion(at_mi, at_tp));
  const Vector3 incisal(0, 0, 0);
  EXPECT_LT((recovered * incisal - scene.therapeutic * incisal).norm(), 0.03) << "but for tremor";
  EXPECT_LT((recovered * incisal).z(), -1) << "and opens";
}

TEST(PhantomFilm, SamplesComeInOrderWithHonestHeaders) {
  FilmOptions options = short_film(5);
  options.rate_hz = 60;
  options.duration_s = 6;
  options.noise_sigma = 0;
  PhantomFilm film(film_test::test_scene(), options);
  HostTime last{-1}, last_arrival{-1};
  std::uint32_t expected = 0;
  std::vector<EventSample> events;
  double first_offset_ns = 0, last_offset_ns = 0, latency_low = 1, latency_high = 0;
  for (const Sample& sample : all_of(film)) {
    const SampleHeader& header = header_of(sample);
    EXPECT_GE(header.capture, last);
    last = header.capture;
    EXPECT_GT(header.arrival, header.capture);
    if (const auto* event = std::get_if<EventSample>(&sample)) {
      EXPECT_EQ(header.stream, "pedal");
      EXPECT_EQ(header.sequence, events.size());
      EXPECT_EQ(film.jaw().phase_at(header.capture.seconds_since({})).name, event->kind);
      events.push_back(*event);
      continue;
    }
    EXPECT_EQ(header.stream, "camera_0");
    EXPECT_EQ(header.sequence, expected++);
    EXPECT_EQ(header.capture.ns, std::llround(header.sequence * 1e9 / 60));
    EXPECT_GT(header.arrival, last_arrival);
    last_arrival = header.arrival;
    const double latency = header.arrival.seconds_since(header.capture);
    latency_low = std::min(latency_low, latency), latency_high = std::max(latency_high, latency);
    last_offset_ns = double(header.device.ns - header.capture.ns);
    if (header.sequence == 0) first_offset_ns = last_offset_ns;
  }
  EXPECT_EQ(expected, 360u);
  EXPECT_EQ(events.size(), film.jaw().marks().size());
  EXPECT_GT(latency_low, 0.006);
  EXPECT_LT(latency_high, 0.016);
  EXPECT_GT(latency_high - latency_low, 0.0005) << "jitter";
  const double drift = (last_offset_ns - first_offset_ns) / 6e9;
  EXPECT_LT(std::abs(drift), 50e-6);
  EXPECT_NE(drift, 0);
}

TEST(PhantomFilm, SameSeedSameBytesOnAnyNumberOfThreads) {
  FilmOptions options = short_film(9);
  options.rate_hz = 3;
  PhantomFilm wide(film_test::test_scene(), options);
  const auto expected = all_of(wide);
  options.prefetch_frames = 1;
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  PhantomFilm narrow(film_test::test_scene(), options);
  const auto got = all_of(narrow);
  options.seed = 10;
  PhantomFilm other(film_test::test_scene(), options);
  const auto different = all_of(other);
  ASSERT_EQ(got.size(), expected.size());
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(header_of(got[i]).arrival, header_of(expected[i]).arrival);
    const auto *a = std::get_if<FrameSample>(&got[i]), *b = std::get_if<FrameSample>(&expected[i]);
    ASSERT_EQ(a == nullptr, b == nullptr);
    if (a) {
      EXPECT_EQ(a->image.pixels, b->image.pixels);
    }
  }
  EXPECT_NE(std::get<FrameSample>(different[0]).image.pixels, std::get<FrameSample>(got[0]).image.pixels);
}

TEST(PhantomFilm, DroppedFramesLeaveGapsInTheCounter) {
  FilmOptions options = short_film(12);
  options.rate_hz = 20;
  options.drop_fraction = 0.1;
  PhantomFilm film(film_test::test_scene(), options), again(film_test::test_scene(), options);
  std::vector<std::uint32_t> got, repeated;
  for (auto* run : {&film, &again})
    for (const Sample& sample : all_of(*run))
      if (std::holds_alternative<FrameSample>(sample))
        (run == &film ? got : repeated).push_back(header_of(sample).sequence);
  EXPECT_EQ(got, repeated);
  EXPECT_EQ(film.frames_per_camera(), 160u);
  EXPECT_GT(got.size(), 125u);
  EXPECT_LT(got.size(), 158u);
}

TEST(PhantomFilm, TwoCamerasSeeTheSameMoment) {
  FilmScene scene = film_test::test_scene();
  RigCamera second = scene.rig.cameras[0];
  second.name = "camera_1";
  second.rig_from_camera = Rigid3{exp_so3(Vector3(0, -0.3, 0)), Vector3(130, 0, 20)};
  scene.rig.cameras.push_back(second);
  FilmOptions options = short_film(3);
  options.rate_hz = 1;
  PhantomFilm film(scene, options);
  std::map<std::string, std::vector<FrameSample>> streams;
  for (Sample& sample : all_of(film))
    if (auto* frame = std::get_if<FrameSample>(&sample)) streams[frame->header.stream].push_back(*frame);
  ASSERT_EQ(streams["camera_0"].size(), 8u);
  ASSERT_EQ(streams["camera_1"].size(), 8u);
  for (std::size_t i = 0; i < 8; ++i)
    EXPECT_EQ(streams["camera_0"][i].header.capture, streams["camera_1"][i].header.capture);
  const FilmTruth truth = film.truth_at(streams["camera_1"][4].header.capture);
  const auto found = detected(streams["camera_1"][4].image);
  int compared = 0;
  for (const BodyTag& tag : scene.rig.head_frame.tags) {
    const auto it = found.find(tag.id);
    if (it == found.end()) continue;
    const Vector3 in_second =
        second.rig_from_camera.inverse() * (truth.camera_from_head * tag.corners_in_body_mm[0]);
    EXPECT_LT((*second.model.project(in_second) - it->second[0]).norm(), 1.0);
    ++compared;
  }
  EXPECT_GE(compared, 6);
}

TEST(PhantomFilm, ARigThatCannotBeDrawnIsAnError) {
  FilmScene scene = film_test::test_scene();
  scene.rig.bow.family = "tag99h99";
  PhantomFilm film(scene, short_film(1));
  const auto first = film.next();
  ASSERT_FALSE(first);
  EXPECT_EQ(first.error().code, ErrorCode::kInput);
  const auto second = film.next();
  ASSERT_TRUE(second);
  EXPECT_FALSE(second->has_value());
}

}  // namespace
}  // namespace gnathion
