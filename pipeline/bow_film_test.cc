// A rendered film of a bow whose tags are glued a little beside their places, from the pixels to the corners.
#include "pipeline/bow_film.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <numbers>

#include "calibration/bow_layout.h"
#include "core/random.h"
#include "phantom/bodies.h"
#include "phantom/renderer.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;

constexpr double kRad = std::numbers::pi / 180;

TaggedBody nominal_body() {
  TaggedBody body;
  body.name = "bow";
  for (int i = 0; i < 8; ++i)
    body.tags.push_back(
        tag_of(tag_plate(i, {(i % 4 - 1.5) * 36, i % 2 == 0 ? -80.0 : -72.0, i < 4 ? -20.0 : 18.0},
                         i % 2 == 0 ? 14 : -14, i < 4 ? 16 : -4, 3.0 * i)));
  return body;
}

TaggedBody glued_body(const TaggedBody& nominal, Random& random) {
  TaggedBody body = nominal;
  for (BodyTag& tag : body.tags) {
    const Vector3 centre = 0.5 * (tag.corners_in_body_mm[0] + tag.corners_in_body_mm[2]);
    const Rigid3 turn = Rigid3::about_axis(centre, random.unit_vector(), random.uniform(0.1, 0.3) * kRad);
    const Vector3 shift = random.uniform(0.1, 0.3) * random.unit_vector();
    for (Vector3& c : tag.corners_in_body_mm) c = turn * c + shift;
  }
  return body;
}

class Frames : public Source {
 public:
  Result<std::optional<Sample>> next() override {
    if (frames.empty()) return std::optional<Sample>();
    Sample s = std::move(frames.front());
    frames.pop_front();
    return std::optional<Sample>(std::move(s));
  }
  std::deque<FrameSample> frames;
};

RigCamera camera() {
  RigCamera c;
  c.name = "camera_0";
  c.model.k1 = -0.08;
  c.model.k2 = 0.03;
  return c;
}

/// The bow turned by hand before the camera, sharp.
Frames film(const TaggedBody& body, int count, double turn_deg, Random& random) {
  Frames out;
  auto renderer =
      CameraRenderer::create(camera().model, {SceneBody{body, {}, 0.55}}, RenderOptions{random.next_u32()});
  EXPECT_TRUE(renderer);
  Matrix3 facing;
  facing << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  for (int f = 0; f < count; ++f) {
    const Vector3 turn(random.uniform(-1, 1) * turn_deg, random.uniform(-0.5, 0.5) * turn_deg,
                       random.uniform(-1, 1) * turn_deg);
    Rigid3 pose{facing * exp_so3(turn * kRad), Vector3::Zero()};
    pose.translation_mm =
        Vector3(random.uniform(-20, 20), random.uniform(-15, 15), random.uniform(330, 430)) -
        pose.rotation * Vector3(0, -76, 0);
    FrameSample sample;
    sample.header.stream = "camera_0";
    sample.header.sequence = static_cast<std::uint32_t>(f);
    sample.header.capture = HostTime{f * 100'000'000LL};
    sample.image = renderer->render({BodyExposure{pose, {}}}, static_cast<std::uint32_t>(f));
    out.frames.push_back(std::move(sample));
  }
  return out;
}

double rms_error(const TaggedBody& found, const TaggedBody& truth, const TaggedBody& nominal) {
  std::vector<Vector3> is, was, cad;
  for (std::size_t t = 0; t < truth.tags.size(); ++t)
    for (std::size_t k = 0; k < 4; ++k) {
      is.push_back(found.tags[t].corners_in_body_mm[k]);
      was.push_back(truth.tags[t].corners_in_body_mm[k]);
      cad.push_back(nominal.tags[t].corners_in_body_mm[k]);
    }
  const Rigid3 gauge = best_rigid_fit(was, cad);
  double sum = 0;
  for (std::size_t i = 0; i < is.size(); ++i) sum += (is[i] - gauge * was[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(is.size()));
}

// 0.010 mm as for synthetic corners (calibration/bow_geometry_test.cc); the printed side is exact here.
TEST(BowFilm, GluedTagsAreFoundFromPixels) {
  Random random(90210);
  const TaggedBody nominal = nominal_body(), truth = glued_body(nominal, random);
  Frames source = film(truth, 50, 32, random);
  SilentProgress progress;
  BowFilmOptions options;
  options.interval_s = 0;
  BowFilmSummary summary;
  const auto found = calibrate_bow_film(source, {camera()}, nominal, options, progress, &summary);
  ASSERT_TRUE(found) << found.error().line();
  ASSERT_EQ(found->body.tags.size(), 8u);
  const double error = rms_error(found->body, truth, nominal), before = rms_error(nominal, truth, nominal);
  std::printf(
      "corners %.4f mm RMS (nominal %.3f), stated %.4f mm, residual %.4f px (scale %.2f), held out %.4f px\n",
      error, before, found->shape_sigma_mm, found->rms_px, found->residual_scale, found->held_out_px);
  EXPECT_LT(error, 0.010);
  EXPECT_GT(before, 0.1);
  EXPECT_LT(found->held_out_px, 0.1);
  EXPECT_EQ(summary.frames, 50u);
}

TEST(BowFilm, RefusesWithTheReason) {
  Random random(4711);
  const TaggedBody nominal = nominal_body();
  SilentProgress progress;
  BowFilmOptions options;
  options.interval_s = 0;
  const auto reason = [&](Frames source) {
    const auto r = calibrate_bow_film(source, {camera()}, nominal, options, progress);
    return r ? std::string("accepted") : r.error().line();
  };
  Frames mirrored = film(nominal, 3, 20, random);
  for (FrameSample& f : mirrored.frames)
    for (int y = 0; y < f.image.height_px; ++y)
      std::reverse(f.image.pixels.begin() + y * f.image.width_px,
                   f.image.pixels.begin() + (y + 1) * f.image.width_px);
  EXPECT_THAT(reason(std::move(mirrored)), HasSubstr("mirrored"));
  EXPECT_THAT(reason(film(nominal, 14, 2, random)), HasSubstr("too little movement"));
  TaggedBody other = nominal;
  for (BodyTag& t : other.tags) t.id += 30;
  EXPECT_THAT(reason(film(other, 12, 20, random)), HasSubstr("30 to 37"));
  Frames renamed = film(nominal, 2, 20, random);
  for (FrameSample& f : renamed.frames) f.header.stream = "camera_7";
  EXPECT_THAT(reason(std::move(renamed)), HasSubstr("camera_7"));
  Frames small = film(nominal, 2, 20, random);
  for (FrameSample& f : small.frames) f.image = Image8(640, 360);
  EXPECT_THAT(reason(std::move(small)), HasSubstr("640x360"));
}

TEST(BowFilm, DistancesAreParsed) {
  const auto d = parse_distance("0.1-7.2=181.35/0.03");
  ASSERT_TRUE(d);
  EXPECT_EQ(d->tag_a, 0);
  EXPECT_EQ(d->corner_a, 1);
  EXPECT_EQ(d->tag_b, 7);
  EXPECT_EQ(d->corner_b, 2);
  EXPECT_DOUBLE_EQ(d->mm, 181.35);
  EXPECT_DOUBLE_EQ(d->sigma_mm, 0.03);
  ASSERT_TRUE(parse_distance("10-11=20"));
  EXPECT_EQ(parse_distance("10-11=20")->corner_b, -1);
  for (const char* bad :
       {"", "0-7", "0-7=", "0-7=x", "0.4-7=20", "a-7=20", "0-7=-3", "0-7=20/0", "3-3=20", "0-7=20mm"})
    EXPECT_FALSE(parse_distance(bad)) << bad;
}

}  // namespace
}  // namespace gnathion
