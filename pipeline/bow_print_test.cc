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

/// As a scanner has it: a little blurred, paper and ink within the range of grey.
Image8 scanned(const Image8& page) {
  Image8 out = page;
  for (int y = 1; y + 1 < page.height_px; ++y)
    for (int x = 1; x + 1 < page.width_px; ++x) {
      int sum = 0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) sum += (2 - dx * dx) * (2 - dy * dy) * page.at(x + dx, y + dy);
      out.at(x, y) = static_cast<std::uint8_t>(30 + sum * 190 / (16 * 255));
    }
  return out;
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
  auto detector = TagDetector::create(options);
  ASSERT_TRUE(detector);
  std::set<int> seen;
  double worst = 0;
  for (const char* page : {"page-1.pgm", "page-2.pgm"}) {
    const Image8 image = scanned(read_pgm(folder_ / page));
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
  EXPECT_LT(worst, 1.05 / (20 * kPxPerMm));  // poppler snaps edges to pixels: one of 315
  EXPECT_EQ(seen.size(), 18u);
  EXPECT_EQ(*seen.begin(), 0);
  EXPECT_EQ(*seen.rbegin(), 27);
}

// At 1600 dpi a pixel is 0.08 % of a side.
TEST_F(TagSheets, AreTrueToATenthOfAPercent) {
  constexpr double kFinePxPerMm = 1600 / 25.4;
  const TaggedBody bow = body("bow", 0, 10);
  ASSERT_TRUE(write_tag_sheets(folder_ / "tags.pdf", {&bow}, 20));
  const std::string command = "pdftoppm -gray -r 1600 -f 1 -l 1 -x 900 -y 2700 -W 4400 -H 2000 " +
                              (folder_ / "tags.pdf").string() + " " + (folder_ / "fine").string();
  ASSERT_EQ(std::system(command.c_str()), 0);
  const Image8 image = scanned(read_pgm(folder_ / "fine-1.pgm"));
  ASSERT_EQ(image.width_px, 4400);
  CameraModel flat;
  flat.width_px = image.width_px;
  flat.height_px = image.height_px;
  flat.fx_px = flat.fy_px = 1e6;
  TagDetectorOptions options;
  options.quad_decimate = 4;
  auto detector = TagDetector::create(options);
  ASSERT_TRUE(detector);
  const auto tags = (*detector)->detect(image, flat);
  ASSERT_GE(tags.size(), 1u);
  double worst = 0;
  for (const TagObservation& tag : tags)
    for (std::size_t k = 0; k < 4; ++k)
      worst = std::max(
          worst, std::abs((tag.corners_px[(k + 1) % 4] - tag.corners_px[k]).norm() / kFinePxPerMm / 20 - 1));
  std::printf("%zu tags, largest error of a side: %.4f %%\n", tags.size(), 100 * worst);
  EXPECT_LT(worst, 0.001);
}

}  // namespace
}  // namespace gnathion
