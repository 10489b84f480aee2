// Depth frames: decoding byte by byte, and a burst fused against the true face.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <thread>

#include "acquisition/scanner/depth_fusion.h"
#include "acquisition/scanner/depth_protocol.h"
#include "acquisition/scanner/surface_deviation.h"
#include "core/mesh_query.h"
#include "core/random.h"
#include "phantom/face.h"
#include "phantom/scanner.h"
#include "tests/support/uvc_depth.h"

namespace gnathion {
namespace {

TEST(Z16, IsTwoBytesAPixelAndNothingElse) {
  const auto image = decode_z16(std::string("\x01\x02\xff\xff\x00\x00\x10\x00", 8), 2, 2);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->units, (std::vector<std::uint16_t>{0x0201, 0xffff, 0, 16}));
  EXPECT_FALSE(decode_z16("1234567", 2, 2));
  EXPECT_FALSE(decode_z16("123456789", 2, 2));
  EXPECT_FALSE(decode_z16("", 0, 0));
  EXPECT_FALSE(decode_z16("", -2, 2));
  EXPECT_FALSE(decode_z16("", 1 << 30, 1 << 30));
}

TEST(DepthDescriptors, OffersOfZ16AreFound) {
  const auto found = parse_depth_modes(streaming_descriptors(640, 480));
  ASSERT_TRUE(found) << found.error().line();
  ASSERT_EQ(found->modes.size(), 1u);
  EXPECT_EQ(found->endpoint, 0x81);
  EXPECT_EQ(found->modes[0].format, 2);
  EXPECT_EQ(found->modes[0].frame, 3);
  EXPECT_EQ(found->modes[0].width_px, 640);
  EXPECT_EQ(found->modes[0].height_px, 480);
  EXPECT_EQ(found->modes[0].interval_100ns, 333333u);
  // YUY2 of the same size is no depth.
  const auto colour = parse_depth_modes(streaming_descriptors(640, 480, "YUY2" + z16_guid().substr(4)));
  ASSERT_TRUE(colour);
  EXPECT_TRUE(colour->modes.empty());
  // Cut anywhere, it is refused or simply offers less; it never offers nonsense.
  const std::string whole = streaming_descriptors(640, 480);
  for (std::size_t n = 0; n < whole.size(); ++n) {
    const auto cut = parse_depth_modes(whole.substr(0, n));
    EXPECT_TRUE(!cut || cut->modes.empty()) << n;
  }
}

TEST(StreamControl, GoesThereAndBack) {
  const StreamControl control{2, 3, 333333, 614400, 16396};
  const std::string bytes = format_stream_control(control);
  ASSERT_EQ(bytes.size(), 26u);
  const auto back = parse_stream_control(bytes);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->format, 2);
  EXPECT_EQ(back->frame, 3);
  EXPECT_EQ(back->interval_100ns, 333333u);
  EXPECT_EQ(back->frame_bytes, 614400u);
  EXPECT_EQ(back->payload_bytes, 16396u);
  EXPECT_FALSE(parse_stream_control(bytes.substr(0, 25)));
}

class Assembler : public ::testing::Test {
 protected:
  static std::string frame(char fill) { return std::string(1000, fill); }
  /// Feeds payloads; returns how many frames were whole, and remembers what was lost.
  int feed(const std::vector<std::string>& payloads) {
    int whole = 0;
    for (const std::string& p : payloads) {
      const auto outcome = assembler_.add(p);
      if (outcome.frame) ++whole, last_ = *outcome.frame, ticks_ = outcome.device_ticks.value_or(0);
      if (!outcome.lost.empty()) lost_.push_back(outcome.lost);
    }
    return whole;
  }
  PayloadAssembler assembler_{1000};
  std::string last_;
  std::uint32_t ticks_ = 0;
  std::vector<std::string> lost_;
};

TEST_F(Assembler, JoinsPayloads) {
  EXPECT_EQ(feed(payloads_of(frame('a'), false, 7, 300)), 1);
  EXPECT_EQ(last_, frame('a'));
  EXPECT_EQ(feed({""}), 0);  // transfers without data are nothing
  EXPECT_EQ(feed(payloads_of(frame('b'), true, 8, 1000)), 1);
  EXPECT_EQ(last_, frame('b'));
  EXPECT_EQ(ticks_, 8u);
  EXPECT_TRUE(lost_.empty());
}

TEST_F(Assembler, NeverGivesHalfAFrame) {
  auto cut = payloads_of(frame('a'), false, 1, 300);
  cut.erase(cut.begin() + 1);  // a payload is missing
  EXPECT_EQ(feed(cut), 0);
  EXPECT_EQ(lost_.size(), 1u);
  auto no_end = payloads_of(frame('b'), true, 2, 300);
  no_end.pop_back();
  EXPECT_EQ(feed(no_end), 0);
  EXPECT_EQ(feed(payloads_of(frame('c'), false, 3, 300)), 1);  // the toggle says that b is over
  EXPECT_EQ(last_, frame('c'));
  EXPECT_EQ(lost_.size(), 2u);
  EXPECT_EQ(feed(payloads_of(frame('d') + "more", true, 4, 300)), 0);
  auto error = payloads_of(frame('e'), false, 5, 300);
  error[1][1] = static_cast<char>(error[1][1] | 0x40);
  EXPECT_EQ(feed(error), 0);
  EXPECT_EQ(feed({std::string(1, 12), std::string(5, 1)}), 0);  // headers that lie about their length
  EXPECT_EQ(feed(payloads_of(frame('f'), true, 6, 300)), 1);
  EXPECT_EQ(last_, frame('f'));
}

/// The phantom's face as a depth camera sees it: noise, holes, and rims that mix face and wall.
struct Burst {
  CameraModel camera;
  TriangleMesh truth;  ///< in the camera's frame
  std::vector<float> depth_mm;
  std::vector<DepthImage> frames;
};

Burst burst(int count, double noise_mm, double unit_mm, std::uint64_t seed) {
  Burst b;
  b.camera.width_px = 320;
  b.camera.height_px = 240;
  b.camera.fx_px = b.camera.fy_px = 380;
  b.camera.cx_px = 159.5;
  b.camera.cy_px = 119.5;
  const TriangleMesh face = make_face(draw_face_shape(seed));
  const Vector3 middle = bounding_box(face).centre_mm();
  Rigid3 camera_from_dental;  // looking along +Y at the face, which looks along −Y
  camera_from_dental.rotation << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  camera_from_dental.translation_mm = Vector3(0, 0, 400) - camera_from_dental.rotation * middle;
  b.truth = transformed(camera_from_dental, face);
  const MeshQuery query(b.truth);
  constexpr double kWall_mm = 800;
  for (int y = 0; y < 240; ++y)
    for (int x = 0; x < 320; ++x) {
      const Vector3 ray =
          Vector3((x - b.camera.cx_px) / b.camera.fx_px, (y - b.camera.cy_px) / b.camera.fy_px, 1)
              .normalized();
      const auto hit = query.ray(Vector3::Zero(), ray);
      b.depth_mm.push_back(static_cast<float>(hit ? hit->distance_mm * ray.z() : kWall_mm));
    }
  Random random(seed);
  for (int n = 0; n < count; ++n) {
    DepthImage image{320, 240, {}};
    for (std::size_t i = 0; i < b.depth_mm.size(); ++i) {
      double z = static_cast<double>(b.depth_mm[i]) + noise_mm * random.normal();
      // Where a pixel's neighbour stands far behind, light of both mixes.
      const float next = b.depth_mm[std::min(i + 1, b.depth_mm.size() - 1)];
      if (std::abs(next - b.depth_mm[i]) > 30) z = 0.5 * (z + static_cast<double>(next));
      if (random.uniform() < 0.05) z = 0;                         // not measured
      if (random.uniform() < 0.01) z = random.uniform(200, 700);  // measured wrong
      image.units.push_back(static_cast<std::uint16_t>(std::lround(z / unit_mm)));
    }
    b.frames.push_back(std::move(image));
  }
  return b;
}

TEST(DepthFusion, ABurstIsTrueToItsStatedDeviation) {
  const Burst b = burst(25, 0.9, 0.5, 7);
  DepthFusionOptions options;
  options.unit_mm = 0.5;
  options.far_mm = 700;
  const auto fused = fuse_depth(b.frames, b.camera, options);
  ASSERT_TRUE(fused) << fused.error().line();
  EXPECT_NEAR(fused->frame_sigma_mm, 0.9, 0.12);
  EXPECT_GT(fused->flying_share, 0.0005);
  const ScanSurface surface = surface_from_grid(fused->grid, {}, {});
  ASSERT_GT(surface.mesh.vertices_mm.size(), 8000u);
  const MeshQuery truth(b.truth);
  std::vector<double> off, normalised;
  for (std::size_t v = 0; v < surface.mesh.vertices_mm.size(); ++v) {
    const Vector3& p = surface.mesh.vertices_mm[v];
    const auto hit = truth.ray(Vector3::Zero(), p.normalized());
    ASSERT_TRUE(hit) << "a vertex where nothing is: " << p.transpose();
    const double error = (p.norm() - hit->distance_mm) * p.normalized().z();
    off.push_back(std::abs(error));
    // The deviation is along the normal; the ray's error is compared with it along the normal too.
    normalised.push_back(std::abs(error * p.normalized().dot(hit->normal) / p.normalized().z()) /
                         surface.deviation_mm[v]);
  }
  std::sort(off.begin(), off.end());
  std::sort(normalised.begin(), normalised.end());
  const auto q = [](const std::vector<double>& s, double p) {
    return s[static_cast<std::size_t>(p * double(s.size() - 1))];
  };
  printf(
      "single frame %.2f mm; fused: median %.3f, p95 %.3f, max %.2f mm; error/stated: core %.2f, p95/1.96 "
      "%.2f\n",
      fused->frame_sigma_mm, q(off, 0.5), q(off, 0.95), q(off, 1), q(normalised, 0.5) / 0.6745,
      q(normalised, 0.95) / 1.96);
  EXPECT_LT(q(off, 0.95), 0.5);
  EXPECT_NEAR(q(normalised, 0.5) / 0.6745, 1, 0.25);
  EXPECT_LT(q(normalised, 0.95) / 1.96, 1.4);
}

TEST(DepthFusion, DoesNotClaimMoreThanItsUnitCarries) {
  // Without noise every frame rounds alike: a hundred frames know no more than one.
  Burst b = burst(10, 0.0, 1.0, 8);
  const auto fused = fuse_depth(b.frames, b.camera, {});
  ASSERT_TRUE(fused);
  double least = 1e9;
  for (std::size_t i = 0; i < fused->grid.depth_mm.size(); ++i)
    if (fused->grid.depth_mm[i] > 0) least = std::min(least, static_cast<double>(fused->grid.sigma_mm[i]));
  EXPECT_GE(least, 1 / std::sqrt(12.0) - 1e-3);
}

TEST(DepthFusion, RefusesInOneLine) {
  const Burst b = burst(3, 0.5, 1.0, 9);
  EXPECT_FALSE(fuse_depth({b.frames[0], b.frames[1]}, b.camera, {}));
  CameraModel other = b.camera;
  other.width_px = 640;
  const auto size = fuse_depth(b.frames, other, {});
  ASSERT_FALSE(size);
  EXPECT_NE(size.error().line().find("640"), std::string::npos);
  other = b.camera;
  other.k1 = 0.1;
  EXPECT_FALSE(fuse_depth(b.frames, other, {}));
  DepthFusionOptions wrong_unit;
  wrong_unit.unit_mm = 0.001;
  const auto unit = fuse_depth(b.frames, b.camera, wrong_unit);
  ASSERT_FALSE(unit);
  EXPECT_NE(unit.error().line().find("unit_mm"), std::string::npos);
}

TEST(SurfaceDeviation, FindsTheNoiseOfAScannerFineAndCoarse) {
  const TriangleMesh face = make_face(draw_face_shape(10));
  for (const double noise_mm : {0.03, 0.1, 0.5}) {
    ScannerModel model = face_scanner(-Vector3::UnitY(), Vector3::UnitZ());
    model.white_noise_mm = noise_mm;
    model.correlated_noise_mm = 0;
    Random random(11);
    const auto measured = measure_surface_deviation(simulate_scan(face, model, {}, random));
    ASSERT_TRUE(measured) << measured.error().line();
    printf("white noise %.2f mm: measured %.3f mm in %zu patches of %.1f mm\n", noise_mm, measured->sigma_mm,
           measured->patches, measured->radius_mm);
    EXPECT_NEAR(measured->sigma_mm, noise_mm, 0.15 * noise_mm + 0.008);
  }
  TriangleMesh few;
  few.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  few.triangles = {{0, 1, 2}};
  EXPECT_FALSE(measure_surface_deviation(few));
}

}  // namespace
}  // namespace gnathion
