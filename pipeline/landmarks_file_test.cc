#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "core/file.h"
#include "pipeline/motion_analysis.h"
#include "pipeline/motion_steps.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

const char* const kTeeth =
    "incisal_mm = [0, 0, 0]\nmolar_left_mm = [23, 30, 0]\nmolar_right_mm = [-23, 30, 0]\n";
const char* const kCondyles = "condyle_left_mm = [50, 92, 36]\ncondyle_right_mm = [-50, 92, 36]\n";

Result<JawLandmarks> parsed(const std::string& text) {
  const fs::path path = fs::path(::testing::TempDir()) / "gnathion_landmarks.toml";
  EXPECT_TRUE(write_file(path, text).has_value());
  return read_landmarks(path);
}

std::string why(const std::string& text) {
  const auto read = parsed(text);
  return read ? std::string() : read.error().line();
}

TEST(LandmarksFile, PlanesPointWhereTheirPointsLie) {
  const auto occlusal = parsed(std::string(kTeeth) + kCondyles);
  ASSERT_TRUE(occlusal.has_value()) << occlusal.error().line();
  EXPECT_LE((occlusal->plane.left - Vector3::UnitX()).norm(), 1e-12);
  EXPECT_LE((occlusal->plane.anterior + Vector3::UnitY()).norm(), 1e-12);
  EXPECT_LE((occlusal->plane.up - Vector3::UnitZ()).norm(), 1e-12);
  // The orbit 20 mm over the condyles, 80 mm before them: the axis-orbital plane rises forward by
  // atan(20/80).
  const auto orbital =
      parsed(std::string(kTeeth) + kCondyles + "plane = \"axis-orbital\"\norbitale_mm = [30, 12, 56]\n");
  ASSERT_TRUE(orbital.has_value()) << orbital.error().line();
  EXPECT_EQ(orbital->plane.name, "axis-orbital");
  EXPECT_NEAR(std::atan2(orbital->plane.anterior.z(), -orbital->plane.anterior.y()), std::atan2(20, 80),
              1e-12);
  EXPECT_GT(orbital->plane.up.z(), 0.9);
}

TEST(LandmarksFile, BadOnesAreRefusedByName) {
  const std::string teeth = kTeeth;
  EXPECT_THAT(why("molar_left_mm = [1, 2, 3]\n"), HasSubstr("incisal_mm"));
  EXPECT_THAT(why(teeth + "condyles = 3\n"), HasSubstr("unknown key 'condyles'"));
  EXPECT_THAT(why("incisal_mm = [0, 0]\n"), HasSubstr("three numbers"));
  EXPECT_THAT(why(teeth + "sigma_mm = -1\n"), HasSubstr("sigma_mm"));
  EXPECT_THAT(why(teeth + "plane = \"frankfort\"\n"), HasSubstr("porion_left_mm"));
  EXPECT_THAT(why(teeth + "plane = \"camper\"\n"), HasSubstr("none of"));
  EXPECT_THAT(why("incisal_mm = [0, 0, 0]\nmolar_left_mm = [0, 0, 0]\nmolar_right_mm = [0, 0, 0]\n"),
              HasSubstr("one line"));
  EXPECT_THAT(why(teeth + "incisal_mm = \n"), HasSubstr("line"));
}

TEST(ElectromagneticFile, BadOnesAreRefusedByName) {
  const fs::path path = fs::path(::testing::TempDir()) / "gnathion_em.toml";
  const auto refusal = [&](const std::string& text) {
    EXPECT_TRUE(write_file(path, text).has_value());
    const auto read = read_electromagnetic(path);
    return read ? std::string() : read.error().line();
  };
  const std::string identity = "body_from_sensor = [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n";
  const std::string bow = "[bow]\nstream = \"a\"\n" + identity, head = "[head]\nstream = \"b\"\n";
  EXPECT_EQ(refusal(bow + head), "");
  EXPECT_THAT(refusal(bow), HasSubstr("[head] is missing"));
  EXPECT_THAT(refusal("[bow]\nstream = \"a\"\n" + head), HasSubstr("mount"));
  EXPECT_THAT(refusal("[bow]\nstream = \"a\"\nmount = \"none.json\"\n" + head), HasSubstr("none.json"));
  EXPECT_THAT(refusal("sigma_m = 1\n" + bow + head), HasSubstr("unknown key 'sigma_m'"));
  EXPECT_THAT(
      refusal("[bow]\nstream = \"a\"\nbody_from_sensor = [2,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n" + head),
      HasSubstr("rigid"));
  EXPECT_THAT(refusal(bow + head + "[[rigid_pair]]\nfirst = \"b\"\n"), HasSubstr("rigid_pair"));
}

/// The mount's covariance travels with the motion and comes back.
TEST(ElectromagneticFile, MountCovarianceTravels) {
  SessionMotion session;
  EXPECT_TRUE(mount_covariance(session).isZero(0));
  Matrix6 covariance = Matrix6::Identity() * 1e-4;
  covariance(0, 4) = covariance(4, 0) = 3e-5;
  add_mount_covariance(covariance, &session);
  EXPECT_LE((mount_covariance(session) - covariance).norm(), 1e-12);
}

}  // namespace
}  // namespace gnathion
