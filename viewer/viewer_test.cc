// Drives the real window under Xvfb and looks at its screenshot.
#include <gtest/gtest.h>
#include <unistd.h>
#include <vtkAutoInit.h>

#include <QVTKOpenGLNativeWidget.h>
#include <QApplication>
#include <QCheckBox>
#include <QSurfaceFormat>
#include <QTest>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "phantom/jaws.h"
#include "viewer/main_window.h"

VTK_MODULE_INIT(vtkRenderingOpenGL2)
VTK_MODULE_INIT(vtkRenderingFreeType)
VTK_MODULE_INIT(vtkInteractionStyle)

namespace gnathion {
namespace {

namespace fs = std::filesystem;

/// A finished case as `gnathion run` leaves it, with a plain bar as its splint: what is looked at here is the
/// window, and a bar's place in a picture is known.
class ViewerTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("gnathion_viewer_" + std::to_string(::getpid()));
    fs::create_directories(folder_ / "results");
    fs::create_directories(folder_ / "scans");
    const PhantomJaws jaws = make_phantom_jaws(77);
    ASSERT_TRUE(write_mesh(folder_ / "scans" / "maxilla.ply", jaws.maxilla));
    ASSERT_TRUE(write_mesh(folder_ / "scans" / "mandible.ply", jaws.mandible_mi));
    ASSERT_TRUE(
        write_file(folder_ / "case.toml",
                   "[scans]\nmaxilla_mi = \"scans/maxilla.ply\"\nmandible_mi = \"scans/mandible.ply\"\n"));
    const Motion<Dental> opening(Rigid3::about_axis({0, 88, 35}, {1, 0, 0}, 0.06));
    ASSERT_TRUE(write_json(folder_ / "results" / "T_th.json", motion_json(opening, std::nullopt, {})));
    ASSERT_TRUE(write_mesh(folder_ / "results" / "splint.stl", bar()));
    ASSERT_TRUE(
        write_file(folder_ / "results" / "design.json",
                   R"({"verdict":"pass","gates":[{"name":"open_edges","value":0,"limit":0,"pass":true}]})"));
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }

  static TriangleMesh bar() {
    TriangleMesh m;
    for (int i = 0; i < 8; ++i) m.vertices_mm.emplace_back(i & 1 ? 30 : -30, i & 2 ? 12 : 4, i & 4 ? -1 : -4);
    m.triangles = {{0, 1, 2}, {1, 3, 2}, {4, 6, 5}, {5, 6, 7}, {0, 4, 1}, {1, 4, 5},
                   {2, 3, 6}, {3, 7, 6}, {0, 2, 4}, {2, 6, 4}, {1, 5, 3}, {3, 5, 7}};
    return m;
  }
  static QImage picture(MainWindow& window) {
    QTest::qWait(200);
    return window.view().widget()->grab().toImage();
  }
  /// Pixels that are bluer than they are red: the splint and the section's plane.
  static int blue_pixels(const QImage& image) {
    int n = 0;
    for (int y = 0; y < image.height(); ++y)
      for (int x = 0; x < image.width(); ++x) {
        const QColor c(image.pixel(x, y));
        n += c.blue() > c.red() + 25;
      }
    return n;
  }
  static int ivory_pixels(const QImage& image) {
    int n = 0;
    for (int y = 0; y < image.height(); ++y)
      for (int x = 0; x < image.width(); ++x) {
        const QColor c(image.pixel(x, y));
        n += c.red() > c.blue() + 12;
      }
    return n;
  }
  static std::size_t points_of(const ProfilePlot& plot, const char* name) {
    std::size_t n = 0;
    for (const PlotCurve& c : plot.curves())
      if (c.name == name)
        for (const Polyline2& line : c.lines) n += line.size();
    return n;
  }

  static fs::path folder_;
};
fs::path ViewerTest::folder_;

TEST_F(ViewerTest, ShowsLayersAndCutsWhereThePlaneIsDragged) {
  auto scene = open_case(folder_);
  ASSERT_TRUE(scene) << scene.error().line();
  EXPECT_TRUE(scene->missing.empty());
  ASSERT_EQ(scene->layers.size(), 4u);
  MainWindow window(std::move(*scene));
  window.show();
  ASSERT_TRUE(QTest::qWaitForWindowExposed(&window));
  window.start();

  const QImage full = picture(window);
  EXPECT_GT(ivory_pixels(full), 20000) << "the jaws are not to be seen";
  EXPECT_GT(blue_pixels(full), 2000) << "the splint is not to be seen";

  // Layers: each box takes its surface out of the picture and out of the profile.
  ASSERT_GT(points_of(window.profile(), "Maxilla"), 20u);
  window.view().show_plane(false);
  const int with_splint = blue_pixels(picture(window));
  QTest::mouseClick(window.layer_box(3), Qt::LeftButton, {}, QPoint(8, window.layer_box(3)->height() / 2));
  EXPECT_FALSE(window.layer_box(3)->isChecked());
  EXPECT_LT(blue_pixels(picture(window)), with_splint / 10);
  QTest::mouseClick(window.layer_box(0), Qt::LeftButton, {}, QPoint(8, window.layer_box(0)->height() / 2));
  EXPECT_EQ(points_of(window.profile(), "Maxilla"), 0u);
  QTest::mouseClick(window.layer_box(0), Qt::LeftButton, {}, QPoint(8, window.layer_box(0)->height() / 2));

  // Drag the plane with the mouse: seen from the side its origin is at a known place.
  window.view().show_plane(true);
  const Vector3 before = window.view().plane().origin_mm;
  QWidget* view = window.view().widget();
  const QImage still = picture(window);
  // The plane is the only strongly blue thing now; grab its middle.
  double sx = 0, sy = 0, n = 0;
  for (int y = 0; y < still.height(); ++y)
    for (int x = 0; x < still.width(); ++x) {
      const QColor c(still.pixel(x, y));
      if (c.blue() > c.red() + 25) sx += x, sy += y, n += 1;
    }
  ASSERT_GT(n, 300) << "the section's plane is not to be seen";
  const QPoint grip(static_cast<int>(sx / n) + 14, static_cast<int>(sy / n) + 14);
  QTest::mouseMove(view, grip);
  QTest::mousePress(view, Qt::LeftButton, {}, grip);
  for (int i = 1; i <= 10; ++i) {
    QMouseEvent move(QEvent::MouseMove, grip + QPoint(4 * i, 0), Qt::NoButton, Qt::LeftButton, {});
    QApplication::sendEvent(view, &move);
  }
  QTest::mouseRelease(view, Qt::LeftButton, {}, grip + QPoint(40, 0));
  const SectionPlane& after = window.view().plane();
  EXPECT_GT((after.origin_mm - before).norm(), 0.2) << "dragging the plane did not move it";
}

TEST_F(ViewerTest, OpensWhatIsThereAndSaysWhatIsNot) {
  const fs::path partial = folder_ / "partial";
  fs::create_directories(partial / "scans");
  fs::copy(folder_ / "scans" / "maxilla.ply", partial / "scans" / "maxilla.ply");
  ASSERT_TRUE(write_file(partial / "scans" / "mandible.ply", "ply\nformat ascii 1.0\nend_header\n"));
  ASSERT_TRUE(
      write_file(partial / "case.toml",
                 "[scans]\nmaxilla_mi = \"scans/maxilla.ply\"\nmandible_mi = \"scans/mandible.ply\"\n"));
  auto scene = open_case(partial);
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->layers.size(), 1u);
  EXPECT_GE(scene->missing.size(), 3u);
  MainWindow window(std::move(*scene));
  window.show();
  ASSERT_TRUE(QTest::qWaitForWindowExposed(&window));
  EXPECT_GT(ivory_pixels(picture(window)), 5000);
  EXPECT_FALSE(open_case(folder_ / "absent"));
}

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  QSurfaceFormat format = QVTKOpenGLNativeWidget::defaultFormat();
  format.setSamples(0);
  QSurfaceFormat::setDefaultFormat(format);
  QApplication app(argc, argv);
  ::testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
