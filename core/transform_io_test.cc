#include "core/transform_io.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/camera_model.h"
#include "core/file.h"
#include "core/random.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

std::string text_of(const Matrix4& m) {
  std::string s;
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) s += fmt::format("{:.17g}{}", m(r, c), c == 3 ? "\n" : " ");
  return s;
}

TEST(TransformFile, JsonAndTextRoundTrip) {
  Random random(31);
  const Motion<Dental> motion(Rigid3{random.rotation(), 10 * random.normal3()});
  Matrix6 covariance = Matrix6::Identity() * 1e-4;
  const auto json_text = motion_json(motion, covariance, {{"route", "camera"}}).dump();
  const auto a = parse_motion(json_text, "a.json");
  ASSERT_TRUE(a) << a.error().line();
  EXPECT_LT((a->motion.rigid.matrix() - motion.rigid.matrix()).norm(), 1e-12);
  ASSERT_TRUE(a->covariance);
  EXPECT_EQ(*a->covariance, covariance);
  const auto b = parse_motion(text_of(motion.rigid.matrix()), "b.txt");
  ASSERT_TRUE(b) << b.error().line();
  EXPECT_LT((b->motion.rigid.matrix() - motion.rigid.matrix()).norm(), 1e-12);
  EXPECT_FALSE(b->covariance);
}

TEST(TransformFile, ItkMapsFromParentSoItsInverseIsTaken) {
  // A known case: the file says "subtract (1, 2, 3)"; the motion that Slicer shows adds it.
  const std::string affine =
      "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n"
      "Parameters: 1 0 0 0 1 0 0 0 1 -1 -2 -3\nFixedParameters: 0 0 0\n";
  const auto a = parse_motion(affine, "a.tfm");
  ASSERT_TRUE(a) << a.error().line();
  EXPECT_LT((a->motion * Vector3(0, 0, 0) - Vector3(1, 2, 3)).norm(), 1e-12);
  // A quarter turn about z through the centre (10, 0, 0): p' = R (p − c) + c + t.
  const std::string euler =
      "#Insight Transform File V1.0\nTransform: Euler3DTransform_double_3_3\n"
      "Parameters: 0 0 1.5707963267948966 0 0 0\nFixedParameters: 10 0 0 0\n";
  const auto b = parse_motion(euler, "b.tfm");
  ASSERT_TRUE(b) << b.error().line();
  EXPECT_LT((b->motion.inverse() * Vector3(11, 0, 0) - Vector3(10, 1, 0)).norm(), 1e-9);
}

TEST(TransformFile, RefusesWhatIsNotRigidAndSaysTheDeviation) {
  Matrix4 m = Matrix4::Identity();
  m.topLeftCorner<3, 3>() *= 1.01;
  const auto scaled = parse_motion(text_of(m), "scaled.txt");
  ASSERT_FALSE(scaled);
  EXPECT_EQ(exit_code(scaled.error().code), 4);
  EXPECT_NE(scaled.error().line().find("determinant 1.030301"), std::string::npos) << scaled.error().line();
  EXPECT_NE(scaled.error().line().find("scaled.txt"), std::string::npos);
  for (const char* bad :
       {"", "1 2 3", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 5", "1 0 0 x 0 1 0 0 0 0 1 0 0 0 0 1",
        "nan 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "{\"matrix\":[[1]]}", "{", "{\"kind\":\"pose\"}",
        "{\"unit\":\"m\",\"matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}"}) {
    const auto r = parse_motion(bad, "bad");
    ASSERT_FALSE(r) << bad;
    EXPECT_EQ(exit_code(r.error().code), 4) << bad;
  }
}

TEST(RigFile, RoundTrips) {
  const fs::path folder = fs::temp_directory_path() / ("gnathion_rig_" + std::to_string(std::rand()));
  fs::create_directories(folder);
  Random random(32);
  Rig rig;
  rig.bow.name = "bow";
  rig.head_frame.name = "head_frame";
  for (int i = 0; i < 8; ++i) {
    BodyTag tag;
    tag.id = i;
    for (auto& c : tag.corners_in_body_mm) c = 30 * random.normal3();
    rig.bow.tags.push_back(tag);
    tag.id = 20 + i;
    rig.head_frame.tags.push_back(tag);
  }
  RigCamera camera;
  camera.name = "camera_0";
  camera.model.k1 = -0.08;
  camera.rig_from_camera = Rigid3{random.rotation(), random.normal3()};
  rig.cameras.push_back(camera);
  ASSERT_TRUE(write_rig(folder / "rig.toml", rig));
  const auto read = read_rig(folder / "rig.toml");
  ASSERT_TRUE(read) << read.error().line();
  EXPECT_EQ(read->cameras[0].model.k1, -0.08);
  EXPECT_LT((read->cameras[0].rig_from_camera.matrix() - camera.rig_from_camera.matrix()).norm(), 1e-12);
  ASSERT_EQ(read->bow.tags.size(), 8u);
  EXPECT_EQ(read->bow.tags[3].corners_in_body_mm[2], rig.bow.tags[3].corners_in_body_mm[2]);
  ASSERT_TRUE(write_file(folder / "bad.toml", "bow = 1\n[[camera]]\nname = \"x\"\n"));
  const auto bad = read_rig(folder / "bad.toml");
  ASSERT_FALSE(bad);
  EXPECT_EQ(exit_code(bad.error().code), 4);
  fs::remove_all(folder);
}

TEST(CameraModel, UndistortInvertsProjectOverTheWholeImage) {
  CameraModel c;
  c.k1 = -0.21;
  c.k2 = 0.07;
  c.p1 = 0.0011;
  c.p2 = -0.0007;
  c.k3 = 0.01;
  Random random(33);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector2d pixel(random.uniform(0, 1279), random.uniform(0, 719));
    const Eigen::Vector2d n = c.undistorted(pixel);
    const auto back = c.project(Vector3(n.x(), n.y(), 1) * random.uniform(100, 900));
    ASSERT_TRUE(back);
    EXPECT_LT((*back - pixel).norm(), 1e-9);
  }
  EXPECT_FALSE(c.project({0, 0, -1}));
}

TEST(File, StagedDirectoryAppearsWholeOrNotAtAll) {
  const fs::path folder = fs::temp_directory_path() / ("gnathion_staged_" + std::to_string(std::rand()));
  {
    auto staged = StagedDirectory::create(folder, false);
    ASSERT_TRUE(staged);
    ASSERT_TRUE(write_file(staged->path() / "a", "1"));
  }
  EXPECT_FALSE(fs::exists(folder));
  {
    auto staged = StagedDirectory::create(folder, false);
    ASSERT_TRUE(write_file(staged->path() / "a", "1"));
    ASSERT_TRUE(staged->commit());
  }
  EXPECT_EQ(*read_file(folder / "a"), "1");
  const auto refused = StagedDirectory::create(folder, false);
  ASSERT_FALSE(refused);
  EXPECT_EQ(exit_code(refused.error().code), 2);
  {
    auto staged = StagedDirectory::create(folder, true);
    ASSERT_TRUE(write_file(staged->path() / "b", "2"));
    ASSERT_TRUE(staged->commit());
  }
  EXPECT_FALSE(fs::exists(folder / "a"));
  fs::remove_all(folder);
}

TEST(File, Sha256OfTheStandardsExample) {
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

}  // namespace
}  // namespace gnathion
