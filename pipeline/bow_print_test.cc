// The sheets of tags, as a printer's raster has them: read by libapriltag and measured.
#include "pipeline/bow_print.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <set>

#include "core/file.h"
#include "core/image.h"
#include "tracking/tag_detector.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

constexpr double kDpi = 400, kPxPerMm = kDpi / 25.4;

TaggedBody body(const char* name, int first, int count) {
  TaggedBody b;
  b.name = name;
  for (int i = 0; i < count; ++i) {
    const double x = (i % 5) * 30.0, z = (i / 5) * 30.0;
    b.tags.push_back(
        {first + i,
         {Vector3(x, 0, z), Vector3(x + 20, 0, z), Vector3(x + 20, 0, z + 20), Vector3(x, 0, z + 20)}});
  }
  return b;
}

/// A binary PGM as pdftoppm writes it.
Image8 read_pgm(const fs::path& path) {
  const auto bytes = read_file(path);
  int width = 0, height = 0, top = 0, used = 0;
  if (!bytes || std::sscanf(bytes->c_str(), "P5 %d %d %d%n", &width, &height, &top, &used) != 3) return {};
  Image8 image(width, height);
  std::copy_n(bytes->begin() + used + 1, image.pixels.size(), image.pixels.begin());
  return image;
}

class TagSheets : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::system("pdftoppm -v >/dev/null 2>&1") != 0)
      GTEST_SKIP() << "pdftoppm (poppler-utils) is not here";
    folder_ = fs::temp_directory_path() / ("gnathion_tag_sheets_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
};

TEST_F(TagSheets, HaveTheRightSizeOnPaper) {
  const TaggedBody bow = body("bow", 0, 10), head = body("head_frame", 20, 8);
  ASSERT_TRUE(write_tag_sheets(folder_ / "tags.pdf", {&bow, &head}, 20));
  const std::string command =
      "pdftoppm -gray -r 400 " + (folder_ / "tags.pdf").string() + " " + (folder_ / "page").string();
  ASSERT_EQ(std::system(command.c_str()), 0);
  CameraModel flat;  // a scanner has no lens
  flat.width_px = static_cast<int>(std::lround(210 * kPxPerMm));
  flat.height_px = static_cast<int>(std::lround(297 * kPxPerMm));
  flat.fx_px = flat.fy_px = 1e6;
  flat.cx_px = 0.5 * flat.width_px;
  flat.cy_px = 0.5 * flat.height_px;
  TagDetectorOptions options;
  options.quad_decimate = 2;
  auto detector = TagDetector::create(options);
  ASSERT_TRUE(detector);
  std::set<int> seen;
  double worst = 0;
  for (const char* page : {"page-1.pgm", "page-2.pgm"}) {
    const Image8 image = read_pgm(folder_ / page);
    ASSERT_NEAR(image.width_px, flat.width_px, 1);
    ASSERT_NEAR(image.height_px, flat.height_px, 1);
    flat.width_px = image.width_px;
    flat.height_px = image.height_px;
    for (const TagObservation& tag : (*detector)->detect(image, flat)) {
      EXPECT_TRUE(seen.insert(tag.id).second);
      EXPECT_EQ(tag.hamming, 0);
      for (std::size_t k = 0; k < 4; ++k) {
        const double side_mm = (tag.corners_px[(k + 1) % 4] - tag.corners_px[k]).norm() / kPxPerMm;
        worst = std::max(worst, std::abs(side_mm / 20 - 1));
      }
      // Upright on the page: lower left, lower right, …
      EXPECT_GT(tag.corners_px[1].x(), tag.corners_px[0].x() + 100);
      EXPECT_LT(tag.corners_px[3].y(), tag.corners_px[0].y() - 100);
    }
  }
  std::printf("largest error of a side: %.4f %%\n", 100 * worst);
  EXPECT_LT(worst, 0.001);
  EXPECT_EQ(seen.size(), 18u);
  EXPECT_EQ(*seen.begin(), 0);
  EXPECT_EQ(*seen.rbegin(), 27);
}

}  // namespace
}  // namespace gnathion
