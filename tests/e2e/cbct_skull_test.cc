// Condyles of a real mandible, from the label map of a dental CBCT.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "anatomy/joints/joints.h"
#include "anatomy/volume/read_volume.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

TEST(CbctSkull, CondylesOfALabelMap) {
  const char* shared = std::getenv("GNATHION_SHARED");
  const fs::path file =
      fs::path(shared ? shared : "../shared") / "data/skull/cbct_mandible/patient_MAND_Seg_Or.nii.gz";
  if (!fs::exists(file)) GTEST_SKIP() << "skipped: no label map at " << file;
  SilentProgress silent;
  const auto read = read_volume(file, {}, silent);
  ASSERT_TRUE(read.has_value()) << read.error().line();
  const VoxelGrid& grid = read->volume.grid;
  EXPECT_EQ(grid.size, (std::array<int, 3>{768, 768, 576}));
  // Its sform is RAS with both horizontal axes turned: in LPS the first voxel is at −115.2 mm, and rows go to
  // the left.
  EXPECT_LT((grid.origin_mm - Vector3(-115.2, -115.2, -86.4)).norm(), 0.01);
  EXPECT_LT((grid.step_mm - Matrix3(Vector3(0.3, 0.3, 0.3).asDiagonal())).norm(), 1e-4);

  const auto mandible = surface_of_labels(read->volume, {1}, {}, "mandible");
  ASSERT_TRUE(mandible.has_value()) << mandible.error().line();
  const Box box = bounding_box(*mandible);
  const double middle = box.centre_mm().x();
  CondylarPoles poles[2];
  for (const Side side : {Side::kLeft, Side::kRight}) {
    // The back of the upper half: behind the coronoid process.
    Box where = box;
    (side == Side::kLeft ? where.min_mm : where.max_mm).x() = middle;
    where.min_mm.y() = box.max_mm.y() - 25.0;
    const auto condyle = surface_of_labels(read->volume, {1}, where, side_name(side));
    ASSERT_TRUE(condyle.has_value()) << condyle.error().line();
    const CondylarPoles p = condylar_poles(*condyle, side, Vector3::UnitZ(), Vector3::UnitX());
    const double width = (p.lateral_mm - p.medial_mm).norm();
    std::printf("%s: %zu triangles, head %.1f mm wide\n", side_name(side), condyle->triangles.size(), width);
    // Mediolateral width of condyles: 20 mm, 15 to 26 (Christiansen et al. 1987, CT of 18 joints).
    EXPECT_GT(width, 12.0);
    EXPECT_LT(width, 28.0);
    poles[static_cast<int>(side)] = p;
  }
  // The patient's left is at positive x, and the lateral poles lie outside.
  EXPECT_GT(poles[0].lateral_mm.x(), poles[0].medial_mm.x());
  EXPECT_LT(poles[1].lateral_mm.x(), poles[1].medial_mm.x());
  const double across = (poles[0].lateral_mm - poles[1].lateral_mm).norm();
  std::printf("%.1f mm between the lateral poles\n", across);
  EXPECT_GT(across, 95.0);
  EXPECT_LT(across, 140.0);

  EXPECT_FALSE(surface_of_labels(read->volume, {7}, {}, "nothing").has_value());
}

}  // namespace
}  // namespace gnathion
