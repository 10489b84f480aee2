#include "registration/align.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "core/mesh_io.h"
#include "registration/scan_like_testing.h"

namespace gnathion {
namespace {

using namespace testing_surfaces;

TriangleMesh real_jaw(const char* name) {
  const auto path = shared_data() / "jaws" / name;
  if (!std::filesystem::exists(path)) return {};
  return *read_mesh(path);
}

/// A closed box, 12 triangles, under a pose.
TriangleMesh box(const Vector3& size, const Rigid3& pose) {
  TriangleMesh m;
  for (int i = 0; i < 8; ++i) {
    const Vector3 unit((i & 1) != 0 ? 0.5 : -0.5, (i & 2) != 0 ? 0.5 : -0.5, (i & 4) != 0 ? 0.5 : -0.5);
    m.vertices_mm.push_back(pose * unit.cwiseProduct(size));
  }
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

/// Plates on a bar, no two alike in tilt, as a bow carries its tags.
TriangleMesh bow_like(Random& random) {
  TriangleMesh m = box({150, 6, 5}, {});
  for (int i = 0; i < 6; ++i) {
    const Rigid3 pose{
        exp_so3(Vector3(random.uniform(-0.4, 0.4), random.uniform(-0.4, 0.4), random.uniform(-0.2, 0.2))),
        Vector3(-62.0 + 25.0 * i, random.uniform(-9, 9), random.uniform(6, 14))};
    m = merged(m, box({21, 21, 2.5}, pose));
  }
  return m;
}

class RealJaw : public ::testing::TestWithParam<const char*> {};

// Two scans of one arch in arbitrary poses: other tessellations, holes, noise, 60 % of the arch in one of
// them.
TEST_P(RealJaw, FoundWithoutGuess) {
  const TriangleMesh jaw = real_jaw(GetParam());
  if (jaw.empty()) GTEST_SKIP() << "no real jaws here: set GNATHION_SHARED";
  for (std::uint64_t seed = 91; seed < 93; ++seed) {
    Random random(seed);
    const TriangleMesh target =
        noisy(with_holes(retessellated(jaw, 0.6, random), 6, 1.2, random), 0.014, 0, 10, random);
    TriangleMesh part =
        part_of(with_holes(retessellated(jaw, 0.65, random), 6, 1.2, random), 0.6, random.unit_vector());
    const Rigid3 truth = random_pose(random, 60);
    const TriangleMesh source = transformed(truth.inverse(), noisy(part, 0.014, 0, 10, random));
    const auto found = align_surfaces(source, target);
    ASSERT_TRUE(found) << found.error().line();
    const PoseError error = pose_error(found->target_from_source, truth, transformed(truth.inverse(), jaw));
    EXPECT_LE(error.rms_mm, 0.015) << "seed " << seed;
    EXPECT_LE(error.angle_deg, 0.05) << "seed " << seed;
    EXPECT_GT(found->held_out_mm, 0.0);
    EXPECT_LT(found->held_out_mm, 0.05);
    EXPECT_GT(found->condition, 1.0);
    const Eigen::SelfAdjointEigenSolver<Matrix6> solver(found->covariance);
    EXPECT_GT(solver.eigenvalues()[0], 0.0) << "covariance must be positive definite";
  }
}
INSTANTIATE_TEST_SUITE_P(Align, RealJaw,
                         ::testing::Values("cast/maxilla.stl", "cast/mandible_mi.stl", "crowns/maxilla.stl",
                                           "crowns/mandible_mi.stl"));

// Arches of two patients have no pose in common: a refusal, not a number.
TEST(Align, RefusesSurfacesOfDifferentThings) {
  const TriangleMesh a = real_jaw("crowns/mandible_mi.stl"), b = real_jaw("cast/maxilla.stl");
  if (a.empty() || b.empty()) GTEST_SKIP() << "no real jaws here: set GNATHION_SHARED";
  const auto found = align_surfaces(a, b);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, ErrorCode::kInput);
  EXPECT_NE(found.error().why.find("undetermined"), std::string::npos) << found.error().line();
}

// Left and right exchanged: real arches are symmetric enough to find a pose all the same.
TEST(Align, RefusesAMirroredScanByName) {
  int tried = 0;
  for (const char* name : {"cast/maxilla.stl", "cast/mandible_mi.stl", "crowns/maxilla.stl"}) {
    const TriangleMesh jaw = real_jaw(name);
    if (jaw.empty()) GTEST_SKIP() << "no real jaws here: set GNATHION_SHARED";
    Random random(31);
    const TriangleMesh target = noisy(retessellated(jaw, 0.6, random), 0.014, 0, 10, random);
    TriangleMesh source = noisy(retessellated(jaw, 0.65, random), 0.014, 0, 10, random);
    for (Vector3& v : source.vertices_mm) v.y() = 30.0 - v.y();
    for (Triangle& t : source.triangles) std::swap(t[0], t[1]);
    const auto found = align_surfaces(transformed(random_pose(random, 60), source), target);
    ASSERT_FALSE(found) << name << ": rms " << found->rms_mm;
    EXPECT_EQ(found.error().code, ErrorCode::kInput);
    EXPECT_NE(found.error().why.find("mirrored"), std::string::npos) << name << ": " << found.error().line();
    ++tried;
  }
  EXPECT_EQ(tried, 3);
}

// A square plate fits itself in several ways.
TEST(Align, RefusesWhatHasSeveralEqualPoses) {
  TriangleMesh plate = box({60, 60, 8}, {});
  for (int i = 0; i < 4; ++i) plate = subdivided(plate);
  const auto found = align_surfaces(transformed(Rigid3::from_translation({5, 3, 1}), plate), plate);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, ErrorCode::kInput);
}

TEST(Align, RefusesEmptySurfaces) {
  const auto found = align_surfaces({}, box({1, 1, 1}, {}));
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, ErrorCode::kInput);
}

// A CAD body among other surfaces, seen from one side only, with a rival that has the same plates elsewhere.
TEST(Align, FindsBodyInClutter) {
  for (std::uint64_t seed = 5; seed < 8; ++seed) {
    Random random(seed);
    const TriangleMesh body = bow_like(random), rival = bow_like(random);
    const Rigid3 scene_from_body = random_pose(random, 100);
    TriangleMesh scene = transformed(scene_from_body, body);
    scene = merged(scene, transformed(scene_from_body * Rigid3::from_translation({10, 90, -20}), rival));
    scene = merged(scene,
                   transformed(scene_from_body, box({160, 200, 60}, Rigid3::from_translation({0, 60, -70}))));
    for (int i = 0; i < 4; ++i) scene = subdivided(scene);
    // Only what faces the scanner is there.
    const Vector3 towards = scene_from_body.rotation * Vector3(0.1, 0.2, 1.0).normalized();
    std::vector<bool> seen(scene.triangles.size());
    for (std::size_t t = 0; t < seen.size(); ++t)
      seen[t] = face_normal_scaled(scene, t).normalized().dot(towards) > 0.2;
    scene = noisy(submesh(scene, seen), 0.03, 0.0, 10, random);
    AlignOptions options;
    options.overlap = 0.4;
    const auto found = align_surfaces(body, scene, options);
    ASSERT_TRUE(found) << found.error().line();
    EXPECT_LE(pose_error(found->target_from_source, scene_from_body, body).max_mm, 0.1) << "seed " << seed;
  }
}

// With noise that is correlated over 10 mm the stated covariance must hold, where counting points as
// independent would promise far too much.
TEST(Align, CovarianceHoldsUnderCorrelatedNoise) {
  const TriangleMesh jaw = real_jaw("crowns/mandible_mi.stl");
  if (jaw.empty()) GTEST_SKIP() << "no real jaws here: set GNATHION_SHARED";
  Random base(17);
  const TriangleMesh target = retessellated(jaw, 0.6, base), other = retessellated(jaw, 0.6, base);
  constexpr int kRuns = 16;
  double nees = 0.0, correlated_mm = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    Random random(static_cast<std::uint64_t>(500 + run));
    const TriangleMesh source = noisy(other, 0.01, 0.02, 10, random);
    AlignOptions options;
    options.initial_target_from_source = Rigid3::identity();
    options.points = 3000;
    options.seed = static_cast<std::uint64_t>(run);
    const auto found = align_surfaces(source, target, options);
    ASSERT_TRUE(found) << found.error().line();
    const Vector6 xi = log_se3(found->target_from_source);
    nees += xi.dot(found->covariance.inverse() * xi) / 6.0 / kRuns;
    correlated_mm += found->correlated_sigma_mm / kRuns;
  }
  // 16 runs of χ²/6 have a standard deviation of 0.14.
  EXPECT_GT(nees, 0.4);
  EXPECT_LT(nees, 1.6);
  EXPECT_NEAR(correlated_mm, 0.02, 0.008) << "the correlated part of the noise is recognised";
}

TEST(Align, IsDeterministic) {
  Random random(3);
  TriangleMesh body = bow_like(random);
  for (int i = 0; i < 3; ++i) body = subdivided(body);
  const Rigid3 truth = random_pose(random, 50);
  const TriangleMesh other = noisy(transformed(truth, body), 0.02, 0, 10, random);
  const auto a = align_surfaces(body, other), b = align_surfaces(body, other);
  ASSERT_TRUE(a) << a.error().line();
  ASSERT_TRUE(b);
  EXPECT_EQ(a->target_from_source.matrix(), b->target_from_source.matrix());
  EXPECT_EQ(a->covariance, b->covariance);
}

}  // namespace
}  // namespace gnathion
