// The main job on a virtual patient that no other test has seen, held against its truth; the splint is judged
// by CGAL, which did not make it.
#include "pipeline/demo.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "pipeline/motion_steps.h"
#include "tests/support/cgal_check.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

class Demo : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("gnathion_demo_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
    SilentProgress silent;
    auto demo = run_demo(90210, {}, folder_, silent);
    ASSERT_TRUE(demo) << demo.error().line();
    demo_ = new DemoResult(std::move(*demo));
  }
  static void TearDownTestSuite() {
    delete demo_;
    demo_ = nullptr;
    fs::remove_all(folder_);
  }
  void SetUp() override { ASSERT_NE(demo_, nullptr) << "the demo did not run"; }

  static fs::path folder_;
  static DemoResult* demo_;
};
fs::path Demo::folder_;
DemoResult* Demo::demo_ = nullptr;

TEST_F(Demo, TransformsAreTrueAtTheTeethByEachRouteAlone) {
  RecordProperty("t_mm", std::to_string(demo_->dental_from_face.largest_tooth_mm));
  printf("%s", demo_text(*demo_, folder_).c_str());
  EXPECT_LE(demo_->dental_from_face.largest_tooth_mm, 0.2);
  EXPECT_LE(demo_->dental_from_face.angle_deg, 0.2);
  for (const MotionError* e : {&demo_->camera, &demo_->faces, &demo_->fused}) {
    EXPECT_LE(e->largest_tooth_mm, 0.10);
    EXPECT_LE(e->angle_deg, 0.10);
  }
  ASSERT_TRUE(demo_->results.comparison);
  EXPECT_TRUE(demo_->results.comparison->consistent) << demo_->results.comparison->mahalanobis;
}

TEST_F(Demo, EveryFrameHasItsRow) {
  const SessionMotion& s = demo_->results.session;
  EXPECT_EQ(s.rows.size(), 960u);
  std::size_t valid = 0;
  for (const MotionRow& row : s.rows) valid += row.valid();
  EXPECT_GE(valid, 950u);
  EXPECT_EQ(demo_->results.camera.positions.mi.size(), 4u);
  EXPECT_EQ(demo_->results.camera.positions.tp.size(), 2u);
  EXPECT_TRUE(demo_->results.camera.positions.closes());
}

TEST_F(Demo, SplintPassesItsGatesAndCgalAgrees) {
  EXPECT_TRUE(demo_->results.design.accepted());
  const auto splint = read_mesh(folder_ / "results" / "splint.stl");
  ASSERT_TRUE(splint) << splint.error().line();
  const testing::CgalVerdict verdict = testing::judge_by_cgal(*splint);
  EXPECT_TRUE(verdict.is_polygon_mesh);
  EXPECT_TRUE(verdict.closed);
  EXPECT_TRUE(verdict.outward);
  EXPECT_EQ(verdict.components, 1u);
  EXPECT_FALSE(verdict.self_intersects);
}

TEST_F(Demo, LeavesEverythingItPromises) {
  for (const char* name : {"motion.mcap", "motion.csv", "chain.json", "T_th.json", "T_th_camera.json",
                           "T_th_faces.json", "feasibility.json", "design.json", "splint.stl", "splint.3mf",
                           "report.html", "accuracy.json", "pictures/splint_on_maxilla.png",
                           "pictures/jaws_in_tp.png", "pictures/section_molar.png", "pictures/jaw_path.png"})
    EXPECT_TRUE(fs::exists(folder_ / "results" / name)) << name;
  const auto html = read_file(folder_ / "results" / "report.html");
  ASSERT_TRUE(html);
  EXPECT_NE(html->find("Research use only"), std::string::npos);
  EXPECT_NE(html->find("data:image/png;base64,"), std::string::npos);
}

TEST_F(Demo, MotionFileGivesTheSameTransformation) {
  const auto poses = read_poses(folder_ / "results" / "motion.mcap");
  ASSERT_TRUE(poses) << poses.error().line();
  const auto session = to_session_motion(*poses, "motion.mcap");
  ASSERT_TRUE(session);
  const auto route = camera_route(*session, demo_->results.chain.bow_from_dental, {});
  ASSERT_TRUE(route) << route.error().line();
  const Rigid3 difference = route->estimate.therapeutic.value.rigid *
                            demo_->results.camera.estimate.therapeutic.value.rigid.inverse();
  EXPECT_LT(difference.angle_rad(), 1e-9);
  EXPECT_LT(difference.translation_mm.norm(), 1e-7);
}

}  // namespace
}  // namespace gnathion
