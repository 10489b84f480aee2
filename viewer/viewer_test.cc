// Drives the real window under Xvfb with mouse and keys, through each step of a phantom case, and looks at
// it.
#include <gtest/gtest.h>
#include <unistd.h>
#include <vtkAutoInit.h>

#include <QVTKOpenGLNativeWidget.h>
#include <QApplication>
#include <QCheckBox>
#include <QDoubleSpinBox>
#include <QLabel>
#include <QLineEdit>
#include <QListWidget>
#include <QPushButton>
#include <QSlider>
#include <QSurfaceFormat>
#include <QTabBar>
#include <QTabWidget>
#include <QTableWidget>
#include <QTest>
#include <QToolBar>
#include <QToolButton>
#include <cmath>
#include <filesystem>

#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "calibration/frames_graph_json.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "phantom/cbct.h"
#include "phantom/jaws.h"
#include "rendering/decimate.h"
#include "tracking/motion_file.h"
#include "viewer/main_window.h"
#include "viewer/model/readout.h"
#include "viewer/widgets/film_view.h"
#include "viewer/widgets/timeline.h"

VTK_MODULE_INIT(vtkRenderingOpenGL2)
VTK_MODULE_INIT(vtkRenderingFreeType)
VTK_MODULE_INIT(vtkInteractionStyle)

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr int kPatienceMs = 120000;  // other work may hold the processor; nothing waits longer than it must

/// A case as `gnathion run` leaves it, with a plain bar as its splint: what is looked at is the window, and a
/// bar's place and colour in a picture are known.
class ViewerTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("gnathion_viewer_" + std::to_string(::getpid()));
    fs::create_directories(folder_ / "results");
    fs::create_directories(folder_ / "scans");
    const PhantomJaws jaws = make_phantom_jaws(77);
    // Small jaws: what is looked at is the window, and it opens in every test.
    constexpr std::size_t kTriangles = 50000;
    ASSERT_TRUE(write_mesh(folder_ / "scans" / "maxilla.ply", decimated(jaws.maxilla, kTriangles)));
    ASSERT_TRUE(write_mesh(folder_ / "scans" / "mandible.ply", decimated(jaws.mandible_mi, kTriangles)));
    ASSERT_TRUE(write_file(folder_ / "case.toml", kCase));
    ASSERT_TRUE(write_json(folder_ / "results" / "T_th.json",
                           motion_json(Motion<Dental>(opening(0.06)), std::nullopt, {})));
    ASSERT_TRUE(write_mesh(folder_ / "results" / "splint.stl", bar()));
    ASSERT_TRUE(
        write_file(folder_ / "results" / "design.json",
                   R"({"verdict":"fail","gates":[{"name":"open_edges","value":0,"limit":0,"pass":true},
        {"name":"wall_min_mm","value":0.3,"limit":0.5,"pass":false,"blocks":true}],
        "thickness_mm":{"min":0.3,"where_mm":[20,8,-2]},"mesh":{"volume_mm3":1500.0},"apertures":[]})"));
    ASSERT_TRUE(write_motion_csv(folder_ / "results" / "motion.csv", motion()));
    ASSERT_TRUE(write_poses(folder_ / "results" / "motion.mcap", poses(), {}));
    FramesGraph graph({{0, 0, 0}, {25, 40, 0}, {-25, 40, 0}});
    for (const char* to : {"dental", "camera"}) {
      FrameEdge e;
      e.to = to;
      e.from = "bow";
      e.covariance = Matrix6::Identity() * 1e-6;
      ASSERT_TRUE(graph.add(e));
    }
    ASSERT_TRUE(write_json(folder_ / "results" / "frames.json", frames_json(graph)));
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }
  void SetUp() override { fs::remove(folder_ / "viewer.json"); }

  static constexpr const char* kCase =
      "[scans]\nmaxilla_mi = \"scans/maxilla.ply\"\nmandible_mi = \"scans/mandible.ply\"\n";
  static Rigid3 opening(double rad) { return Rigid3::about_axis({0, 88, 35}, {1, 0, 0}, rad); }
  /// Rest, opening to 0.3 rad at 2 s, back, and a rest at 0.06 rad from 5 to 6 s; a gap from 3.4 to 3.6 s.
  static JawMotion motion() {
    JawMotion m;
    for (int i = 0; i <= 420; ++i) {
      JawMotionRow row;
      row.time_s = i / 60.0;
      const double t = row.time_s;
      const double angle = t < 1     ? 0
                           : t < 3   ? 0.15 * (1 - std::cos((t - 1) * M_PI))
                           : t < 4.5 ? 0
                           : t < 5   ? 0.12 * (t - 4.5)
                                     : 0.06;
      row.valid = t < 3.4 || t > 3.6;
      row.reason = row.valid ? "" : "bow: no tag seen";
      row.motion = opening(angle);
      row.sigma_mm = 0.01;
      m.rows.push_back(row);
    }
    return m;
  }
  /// The same as the cameras would have seen it: the head rests, the bow goes with the jaw.
  static PoseRecording poses() {
    PoseRecording out;
    std::uint32_t sequence = 0;
    for (const JawMotionRow& row : motion().rows)
      for (const bool bow : {true, false}) {
        PoseRecord r;
        r.sequence = bow ? sequence++ : sequence - 1;
        r.capture = HostTime{static_cast<std::int64_t>(row.time_s * 1e9)};
        r.valid = row.valid;
        r.reason = row.reason;
        if (bow) r.camera_from_body = row.motion;
        r.covariance = Matrix6::Identity() * 1e-8;
        out.bodies[bow ? "bow" : "head_frame"].push_back(r);
      }
    return out;
  }
  static TriangleMesh bar() {
    TriangleMesh m;
    for (int i = 0; i < 8; ++i)
      m.vertices_mm.emplace_back(i & 1 ? 30 : -30, i & 2 ? 12 : -6, i & 4 ? -1 : -4);
    m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                   {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
    return m;
  }

  static fs::path folder_;
};
fs::path ViewerTest::folder_;

/// The window with a case in it, and hands to use it with.
class Hands {
 public:
  explicit Hands(const fs::path& folder) : window(WindowOptions{}) {
    window.show();
    EXPECT_TRUE(QTest::qWaitForWindowExposed(&window));
    window.activateWindow();  // no window manager does it here, and keys go to the active window
    EXPECT_TRUE(QTest::qWaitForWindowActive(&window));
    if (folder.empty()) return;
    window.open(folder);
    EXPECT_TRUE(wait([&] { return !window.loading() && window.open_s() > 0; }));
  }
  template <class Condition>
  static bool wait(Condition condition) {
    return QTest::qWaitFor(condition, kPatienceMs);
  }
  template <class T>
  T* find(const char* name) {
    T* found = window.findChild<T*>(name);
    EXPECT_NE(found, nullptr) << name;
    return found;
  }
  void click(QWidget* w) { QTest::mouseClick(w, Qt::LeftButton, {}, w->rect().center()); }
  void click(const char* name) { click(find<QWidget>(name)); }
  void step(int i) {
    auto* tabs = find<QTabBar>("steps");
    QTest::mouseClick(tabs, Qt::LeftButton, {}, tabs->tabRect(i).center());
    ASSERT_EQ(tabs->currentIndex(), i);
    settle();
  }
  void tool(const char* action) {
    auto* bar = find<QToolBar>("toolBar");
    QWidget* b = bar->widgetForAction(window.findChild<QAction*>(action));
    ASSERT_NE(b, nullptr) << action;
    b->isVisible() ? click(b) : window.findChild<QAction*>(action)->trigger();
    settle();
  }
  void settle() {
    EXPECT_TRUE(wait([&] { return window.scene().settled(); }));
  }
  QImage picture() {
    settle();
    return window.scene().picture().convertToFormat(QImage::Format_RGB32);
  }
  QImage whole() {
    settle();
    return window.grab().toImage();
  }
  void drag(QWidget* on, const QPoint& from, const QPoint& to, Qt::KeyboardModifiers keys = {}) {
    const auto move = [&](const QPoint& p, Qt::MouseButtons held) {
      QMouseEvent event(QEvent::MouseMove, p, on->mapToGlobal(p), Qt::NoButton, held, keys);
      QApplication::sendEvent(on, &event);
    };
    move(from, Qt::NoButton);
    QTest::mousePress(on, Qt::LeftButton, keys, from);
    for (int i = 1; i <= 12; ++i) move(from + (to - from) * i / 12, Qt::LeftButton);
    QTest::mouseRelease(on, Qt::LeftButton, keys, to);
  }
  void type(QWidget* into, const char* text) {
    into->setFocus();
    QTest::keyClick(into, Qt::Key_A, Qt::ControlModifier);
    QTest::keyClicks(into, text);
    QTest::keyClick(into, Qt::Key_Return);
  }
  MainWindow window;
};

/// Where two pictures differ: how many pixels, and the mean colour that `a` has there.
struct Difference {
  int pixels = 0;
  double red = 0, green = 0, blue = 0;
};
Difference difference(const QImage& a, const QImage& b) {
  Difference d;
  for (int y = 0; y < a.height(); ++y)
    for (int x = 0; x < a.width(); ++x) {
      const QColor p(a.pixel(x, y)), q(b.pixel(x, y));
      if (std::abs(p.red() - q.red()) + std::abs(p.green() - q.green()) + std::abs(p.blue() - q.blue()) < 24)
        continue;
      ++d.pixels;
      d.red += p.red(), d.green += p.green(), d.blue += p.blue();
    }
  if (d.pixels) d.red /= d.pixels, d.green /= d.pixels, d.blue /= d.pixels;
  return d;
}

std::size_t points_of(const ProfilePlot& plot, const std::string& name) {
  std::size_t n = 0;
  for (const PlotCurve& c : plot.curves())
    if (c.name == name)
      for (const Polyline2& line : c.lines) n += line.size();
  return n;
}

TEST_F(ViewerTest, EachLayerShowsInItsColourAndTheEyeHidesIt) {
  Hands h(folder_);
  EXPECT_EQ(h.find<QTabBar>("steps")->currentIndex(), 4) << "a case with a splint opens at Design";
  const QImage all = h.picture();
  const auto without = [&](const char* eye) {
    h.click(eye);
    const QImage image = h.picture();
    h.click(eye);
    return difference(all, image);
  };
  const Difference splint = without("eye_splint");
  EXPECT_GT(splint.pixels, 1500) << "the splint is not to be seen";
  EXPECT_GT(splint.blue, splint.red + 20) << "the splint is not blue";
  const Difference maxilla = without("eye_maxilla");
  EXPECT_GT(maxilla.pixels, 8000) << "the maxilla is not to be seen";
  EXPECT_GT(maxilla.red, maxilla.blue + 12) << "the maxilla is not ivory";
  const Difference mandible = without("eye_mandible_tp");
  EXPECT_GT(mandible.pixels, 4000) << "the mandible is not to be seen";
  EXPECT_GT(mandible.red, mandible.blue + 12) << "the mandible is not ivory";
  EXPECT_LT(difference(all, h.picture()).pixels, 200) << "the same layers give another picture";

  // While the camera turns the picture is coarser, but the same scene; at rest it is what it was.
  QWidget* scene = h.window.scene().widget();
  QTest::mousePress(scene, Qt::LeftButton, {}, QPoint(20, 20));
  QMouseEvent turn(QEvent::MouseMove, QPoint(21, 20), scene->mapToGlobal(QPoint(21, 20)), Qt::NoButton,
                   Qt::LeftButton, {});
  QApplication::sendEvent(scene, &turn);
  EXPECT_FALSE(h.window.scene().settled());
  const QImage moving = h.window.scene().picture().convertToFormat(QImage::Format_RGB32);
  EXPECT_LT(difference(all, moving).pixels, all.width() * all.height() / 5) << "another scene while moving";
  EXPECT_GT(difference(all, moving).pixels, 0) << "nothing turned";
  QTest::mouseRelease(scene, Qt::LeftButton, {}, QPoint(21, 20));
  EXPECT_TRUE(h.window.scene().project(Vector3::Zero()));

  auto* opacity = h.find<QSlider>("opacity_maxilla");
  opacity->setFocus();
  for (int i = 0; i < 8; ++i) QTest::keyClick(opacity, Qt::Key_PageDown);
  EXPECT_LT(opacity->value(), 60);
  h.settle();
  EXPECT_GT(difference(all, h.picture()).pixels, 8000) << "opacity changes nothing";
}

TEST_F(ViewerTest, StepsSayWhatIsDoneAndWhatIsMissing) {
  Hands h(folder_);
  const std::pair<const char*, const char*> expected[] = {{"captureStatusText", "Recording"},
                                                          {"motionStatusText", "frames tracked"},
                                                          {"calibrateStatusText", "Chain of calibration"},
                                                          {"transformStatusText", "T_th is set"},
                                                          {"designStatusText", "1.50 cm³"},
                                                          {"evaluateStatusText", "evaluation.toml"}};
  for (int i = 0; i < 6; ++i) {
    h.step(i);
    auto* text = h.find<QLabel>(expected[i].first);
    EXPECT_TRUE(text->text().contains(expected[i].second)) << i << ": " << text->text().toStdString();
    EXPECT_TRUE(text->isVisible());
  }
  h.step(3);
  EXPECT_TRUE(h.find<QLabel>("jointsNote")->text().startsWith("joints not checked: no CBCT"));
  h.step(0);
  EXPECT_TRUE(h.find<QLabel>("captureEmpty")->text().contains("gnathiond"));
  EXPECT_FALSE(h.find<QPushButton>("recordButton")->isEnabled());
}

TEST_F(ViewerTest, TransformationBySlidersTypingAndHandIsUndone) {
  Hands h(folder_);
  h.step(3);
  const Rigid3 measured = *h.window.document().state().therapeutic;
  auto* table = h.find<QTableWidget>("constraintTable");
  EXPECT_TRUE(h.wait([&] { return table->rowCount() >= 10; })) << "no constraints";
  const QString before = h.find<QLabel>("clinicalReadout")->text();
  const QImage at_rest = h.picture();

  auto* down = h.find<QDoubleSpinBox>("value_down");
  h.type(down, "9");
  EXPECT_NEAR(six_of(*h.window.document().state().therapeutic, *h.window.document().content().arch).down_mm,
              9.0, 1e-6);
  EXPECT_NE(h.find<QLabel>("clinicalReadout")->text(), before);
  EXPECT_GT(difference(at_rest, h.picture()).pixels, 2000) << "the mandible did not move in the picture";

  auto* slider = h.find<QSlider>("slider_left");
  slider->setFocus();
  for (int i = 0; i < 40; ++i) QTest::keyClick(slider, Qt::Key_Right);
  EXPECT_NEAR(six_of(*h.window.document().state().therapeutic, *h.window.document().content().arch).left_mm,
              2.0, 0.06);

  auto* typed = h.find<QLineEdit>("typedTransform");
  h.type(typed, "1 0 0 0  0 1 0 0  0 0 1 20  0 0 0 1");  // the lower jaw through the upper one
  EXPECT_NEAR(h.window.document().state().therapeutic->translation_mm.z(), 20.0, 1e-9);
  auto* verdict = h.find<QLabel>("feasibilityVerdict");
  EXPECT_TRUE(h.wait([&] { return verdict->text().startsWith("No"); })) << verdict->text().toStdString();
  h.type(typed, "1 2 3");
  EXPECT_FALSE(h.find<QLabel>("transformError")->text().isEmpty());
  EXPECT_EQ(QApplication::activeModalWidget(), nullptr);

  for (int i = 0; i < 200 && h.window.document().undo_stack().canUndo(); ++i)
    QTest::keyClick(&h.window, Qt::Key_Z, Qt::ControlModifier);
  EXPECT_LT((h.window.document().state().therapeutic->matrix() - measured.matrix()).norm(), 1e-12);

  // The arrow that points down and up: dragged upwards on the screen from the front.
  h.tool("view_front");
  const ArchFrame& arch = *h.window.document().content().arch;
  const Vector3 handle = measured * (arch.origin_mm - 14.0 * arch.up) + 12.0 * (measured.rotation * arch.up);
  const auto px = h.window.scene().project(handle);
  ASSERT_TRUE(px);
  QWidget* scene = h.window.scene().widget();
  h.drag(scene, px->toPoint(), px->toPoint() - QPoint(0, 25));
  const Rigid3 moved = *h.window.document().state().therapeutic;
  const Vector3 by = (moved * measured.inverse()).translation_mm;
  EXPECT_GT((measured.rotation * arch.up).dot(by), 0.5) << "dragging the arrow did not move the mandible";
  EXPECT_LT((moved.rotation - measured.rotation).norm(), 1e-9) << "an arrow does not turn";
}

/// Minutes of one core for the volume: the long form, with GNATHION_CAMPAIGN=1.
TEST_F(ViewerTest, FilmsOfBothCondylesFollowTheSlider) {
  if (!std::getenv("GNATHION_CAMPAIGN")) GTEST_SKIP() << "GNATHION_CAMPAIGN=1 runs it";
  PhantomCbctOptions options;
  options.voxel_mm = 0.5;
  options.blur_mm = 0.25;
  const PhantomCbct cbct = make_phantom_cbct(make_phantom_jaws(77), draw_face_shape(77), options);
  ASSERT_TRUE(write_phantom_nrrd(folder_ / "scans" / "cbct.nrrd", cbct));
  ASSERT_TRUE(write_file(folder_ / "case.toml", std::string(kCase) + "cbct = \"scans/cbct.nrrd\"\n"));
  Hands h(folder_);
  h.step(3);
  const auto film = [&](const char* name) { return h.window.findChild<FilmView*>(name); };
  ASSERT_TRUE(h.wait([&] {
    return film("film_lateral_left") && !film("film_lateral_left")->film().isNull();
  })) << h.find<QLabel>("jointsNote")->text().toStdString();
  const char* const kFilms[] = {"film_lateral_left", "film_lateral_right", "film_frontal_left",
                                "film_frontal_right"};
  std::map<std::string, QImage> before;
  for (const char* name : kFilms) before[name] = film(name)->film();
  h.type(h.find<QDoubleSpinBox>("value_forward"), "6");
  for (const char* name : kFilms)
    EXPECT_TRUE(h.wait([&] { return film(name)->film() != before[name]; })) << name << " does not follow";
  EXPECT_TRUE(h.find<QLabel>("jointSpaces")->text().contains("Right condyle"));
  ASSERT_TRUE(write_file(folder_ / "case.toml", kCase));
}

TEST_F(ViewerTest, MotionIsScrubbedAndPicked) {
  Hands h(folder_);
  h.step(1);
  auto* timeline = h.find<Timeline>("timeline");
  const int y = timeline->height() / 2;
  const QImage closed = h.picture();
  QTest::mouseClick(timeline, Qt::LeftButton, {}, QPoint(static_cast<int>(timeline->x_of(2.0)), y));
  EXPECT_NEAR(timeline->time_s(), 2.0, 0.05);
  EXPECT_GT(difference(closed, h.picture()).pixels, 3000) << "the jaw does not open in the picture";
  QTest::mouseClick(timeline, Qt::LeftButton, {}, QPoint(static_cast<int>(timeline->x_of(3.5)), y));
  EXPECT_TRUE(h.find<QLabel>("motionTime")->text().contains("no tag seen"));
  h.click("playButton");
  const double from = timeline->time_s();
  EXPECT_TRUE(h.wait([&] { return timeline->time_s() > from + 0.2; })) << "it does not play";
  h.click("playButton");
  h.drag(timeline, QPoint(static_cast<int>(timeline->x_of(5.2)), y),
         QPoint(static_cast<int>(timeline->x_of(5.8)), y), Qt::ShiftModifier);
  h.click("pickTp");
  const Rigid3 picked = *h.window.document().state().therapeutic;
  EXPECT_LT((picked.matrix() - opening(0.06).matrix()).norm(), 1e-4) << "T_th is not the picked rest";
  // A rest that was found is chosen by one click on its bar: the same position.
  QTest::keyClick(&h.window, Qt::Key_Z, Qt::ControlModifier);
  EXPECT_TRUE(h.wait([&] { return timeline->rests().size() >= 2; })) << "no rests are found";
  const QPoint bar(static_cast<int>(timeline->x_of(6.3)), static_cast<int>(timeline->rest_bar_y()));
  QTest::mouseClick(timeline, Qt::LeftButton, {}, bar);
  ASSERT_TRUE(timeline->selection());
  EXPECT_NEAR(timeline->selection()->first, 5.0, 0.15);
  EXPECT_NEAR(timeline->selection()->second, 7.0, 0.15);
  EXPECT_NEAR(timeline->time_s(), 6.0, 0.15) << "the jaw does not go there";
  h.click("pickTp");
  EXPECT_LT((h.window.document().state().therapeutic->matrix() - opening(0.06).matrix()).norm(), 1e-4);
  EXPECT_FALSE(h.find<ProfilePlot>("posselt")->curves().empty());
  h.click("contactsBox");
  EXPECT_TRUE(h.wait([&] { return h.window.document().layers().find("mandible_live")->colors != nullptr; }));
}

TEST_F(ViewerTest, SectionFollowsThePlaneAndIsMeasured) {
  Hands h(folder_);
  auto* section = h.find<ProfilePlot>("section");
  QTest::keyClick(&h.window, Qt::Key_C);
  ASSERT_TRUE(h.wait([&] { return points_of(*section, "Maxilla") > 20; }));
  h.click("eye_maxilla");
  EXPECT_TRUE(h.wait([&] { return points_of(*section, "Maxilla") == 0; }));
  h.click("eye_maxilla");
  ASSERT_TRUE(h.wait([&] { return points_of(*section, "Maxilla") > 20; }));
  for (const PlotCurve& c : section->curves()) {
    if (c.name == "Maxilla") {
      EXPECT_EQ(c.color, palette::kMaxilla);
    }
  }

  const Vector3 before = h.window.scene().plane().origin_mm;
  const auto px = h.window.scene().project(before + 4.0 * h.window.scene().plane().x_axis +
                                           5.0 * h.window.scene().plane().y_axis);
  ASSERT_TRUE(px);
  h.settle();
  h.drag(h.window.scene().widget(), px->toPoint(), px->toPoint() + QPoint(45, 0));
  EXPECT_GT((h.window.scene().plane().origin_mm - before).norm(), 0.2)
      << "dragging the plane did not move it";

  QTest::keyClick(&h.window, Qt::Key_D);
  QTest::mouseClick(section, Qt::LeftButton, {}, QPoint(60, 60));
  QTest::mouseClick(section, Qt::LeftButton, {}, QPoint(140, 100));
  EXPECT_TRUE(section->measured().contains("mm"));
  QTest::mouseClick(section, Qt::LeftButton, {}, QPoint(60, 140));
  EXPECT_TRUE(section->measured().contains("°"));
  QTest::keyClick(&h.window, Qt::Key_Escape);
  EXPECT_TRUE(section->measured().isEmpty());
}

TEST_F(ViewerTest, StrokesAreDrawnOnTheSplintAndUndone) {
  Hands h(folder_);
  h.tool("view_upper_occlusal");
  h.click("eye_mandible_tp");
  h.settle();
  auto* tabs = h.find<QTabWidget>("designTabs");
  QTest::mouseClick(tabs->tabBar(), Qt::LeftButton, {}, tabs->tabBar()->tabRect(2).center());
  h.click("edit_Add");
  const auto a = h.window.scene().project({-12, 3, -4}), b = h.window.scene().project({12, 3, -4});
  ASSERT_TRUE(a && b);
  h.drag(h.window.scene().widget(), a->toPoint(), b->toPoint());
  const auto& strokes = h.window.document().state().edits.strokes;
  ASSERT_EQ(strokes.size(), 1u);
  EXPECT_GE(strokes[0].path_mm.size(), 5u);
  for (const Vector3& p : strokes[0].path_mm) EXPECT_NEAR(p.z(), -4.0, 0.05) << "not on the surface";
  EXPECT_TRUE(h.find<QListWidget>("editList")->item(0)->text().startsWith("Add"));
  QTest::keyClick(&h.window, Qt::Key_Z, Qt::ControlModifier);
  EXPECT_TRUE(h.window.document().state().edits.empty());
  QTest::keyClick(&h.window, Qt::Key_Z, Qt::ControlModifier | Qt::ShiftModifier);
  EXPECT_EQ(h.window.document().state().edits.strokes.size(), 1u);
}

TEST_F(ViewerTest, MarginIsDrawnOnTheCrownsAndUndone) {
  Hands h(folder_);
  const ArchFrame& arch = *h.window.document().content().arch;
  h.tool("view_left");
  auto* tabs = h.find<QTabWidget>("designTabs");
  QTest::mouseClick(tabs->tabBar(), Qt::LeftButton, {}, tabs->tabBar()->tabRect(2).center());
  h.click("drawMargin");
  h.settle();
  const auto& layers = h.window.document().layers();
  EXPECT_TRUE(layers.shows("maxilla"));
  EXPECT_FALSE(layers.shows("splint") || layers.shows("mandible_tp")) << "they would lie over the crowns";
  const QImage before = h.picture();
  QWidget* scene = h.window.scene().widget();
  const auto& margins = h.window.document().state().edits.margins;
  // Along the left buccal side, some millimetres above the cusps.
  const ArchRuler ruler(arch);
  const auto click_at = [&](double s_mm) {
    const auto px = h.window.scene().project(ruler.at(s_mm) + 4.0 * ruler.outward(s_mm) + 3.5 * arch.up);
    ASSERT_TRUE(px);
    QTest::mouseClick(scene, Qt::LeftButton, {}, px->toPoint());
  };
  const double s = 0.5 * ruler.s_max_mm();
  for (int i = 0; i < 4; ++i) click_at(s + 6.0 * i);
  ASSERT_EQ(margins.size(), 1u);
  ASSERT_EQ(margins[0].points_mm.size(), 4u);
  const auto surface = h.window.scene().surface("maxilla");
  for (const Vector3& p : margins[0].points_mm)
    EXPECT_LT((surface->closest(p, 5.0)->point_mm - p).norm(), 0.01) << "not on the crowns";
  const QImage drawn = h.picture();
  const Difference line = difference(drawn, before);
  EXPECT_GT(line.pixels, 250) << "the margin is not to be seen";
  EXPECT_GT(line.blue, line.red + 40) << "the margin is not blue";
  if (const char* keep = std::getenv("GNATHION_PICTURES")) h.whole().save(QString(keep) + "/margin.png");

  // A point between two others, by a click on the line; then it is dragged, and taken away.
  const auto first = *h.window.scene().project(margins[0].points_mm[0]);
  const auto second = *h.window.scene().project(margins[0].points_mm[1]);
  QTest::mouseClick(scene, Qt::LeftButton, {}, (0.5 * (first + second)).toPoint());
  ASSERT_EQ(margins[0].points_mm.size(), 5u) << "a click on the line puts no point in";
  const Vector3 placed = margins[0].points_mm[1];
  const auto at = h.window.scene().project(placed)->toPoint();
  h.drag(scene, at, at + QPoint(0, -12));
  ASSERT_EQ(margins[0].points_mm.size(), 5u);
  EXPECT_GT(arch.up.dot(margins[0].points_mm[1] - placed), 0.3) << "dragging a point up does not move it up";
  const auto undo = [&] { QTest::keyClick(&h.window, Qt::Key_Z, Qt::ControlModifier); };
  undo();
  EXPECT_LT((margins[0].points_mm[1] - placed).norm(), 1e-9) << "a drag is not one step of undo";
  QTest::keyClick(&h.window, Qt::Key_Z, Qt::ControlModifier | Qt::ShiftModifier);
  QTest::keyClick(&h.window, Qt::Key_Delete);
  EXPECT_EQ(margins[0].points_mm.size(), 4u) << "Delete leaves the chosen point";
  // Another curve, and all of it undone.
  QTest::keyClick(&h.window, Qt::Key_Return);
  click_at(s + 20.0);
  click_at(s + 24.0);
  EXPECT_EQ(margins.size(), 2u) << "Enter does not begin another curve";
  undo();
  ASSERT_EQ(margins.size(), 1u);

  // The preview ends at the curve: what it had beyond goes, or comes.
  QTest::keyClick(&h.window, Qt::Key_Escape);
  EXPECT_TRUE(layers.shows("splint") && layers.shows("mandible_tp")) << "what was hidden does not come back";
  const auto preview = [&] { return layers.find("preview"); };
  h.click("previewBox");
  ASSERT_TRUE(h.wait([&] { return preview() != nullptr; }))
      << h.find<QLabel>("previewNote")->text().toStdString();
  const auto with_margin = preview()->mesh;
  h.click("removeMargin");
  ASSERT_TRUE(h.wait([&] { return preview()->mesh != with_margin; }));
  const auto highest = [&](const TriangleMesh& m) {
    double top = -1e9;
    for (const Vector3& p : m.vertices_mm)
      if ((p - ruler.at(s + 9.0)).cross(arch.up).norm() < 6.0) top = std::max(top, arch.up.dot(p));
    return top;
  };
  EXPECT_GT(std::abs(highest(*with_margin) - highest(*preview()->mesh)), 0.3)
      << "the preview knows no margin";
  undo();
  h.window.document().save();
  const auto saved = read_json(folder_ / "viewer.json");
  ASSERT_TRUE(saved);
  const auto edits = parse_edits((*saved)["edits_toml"].get<std::string>(), "viewer.json");
  ASSERT_TRUE(edits) << edits.error().line();
  ASSERT_EQ(edits->margins.size(), 1u) << "the margin is not kept";
  EXPECT_LT((edits->margins[0].points_mm[0] - margins[0].points_mm[0]).norm(), 1e-3);
}

TEST_F(ViewerTest, BuildsInTheBackgroundOrIsCancelled) {
  Hands h(folder_);
  auto* gates = h.find<QTableWidget>("gateTable");
  ASSERT_EQ(gates->rowCount(), 2);
  EXPECT_TRUE(gates->item(0, 1)->text().startsWith("Wall min")) << "what failed stands first";
  const QImage before = h.picture();
  QTest::mouseClick(gates->viewport(), Qt::LeftButton, {}, gates->visualItemRect(gates->item(0, 1)).center());
  EXPECT_GT(difference(before, h.picture()).pixels, 5000) << "a gate's click goes nowhere";

  h.click("buildSplint");
  EXPECT_TRUE(h.window.jobs().busy());
  h.click("cancelBuild");
  EXPECT_TRUE(h.wait([&] { return !h.window.jobs().busy(); }));
  EXPECT_TRUE(!fs::exists(folder_ / "designs") || fs::is_empty(folder_ / "designs")) << "something was left";

  auto* tabs = h.find<QTabWidget>("designTabs");
  QTest::mouseClick(tabs->tabBar(), Qt::LeftButton, {}, tabs->tabBar()->tabRect(1).center());
  h.type(h.find<QDoubleSpinBox>("parameter_voxel_mm"), "0.25");
  EXPECT_NEAR(h.window.document().state().parameters.voxel_mm, 0.25, 1e-9);
  h.click("buildSplint");
  EXPECT_TRUE(h.wait([&] { return !h.window.jobs().busy(); }));
  EXPECT_TRUE(fs::exists(folder_ / "designs" / "design_001" / "design.json"));
  EXPECT_TRUE(h.wait([&] { return gates->rowCount() > 5; })) << "the gates of the build do not show";
  fs::remove_all(folder_ / "designs");
}

TEST_F(ViewerTest, OpensWhatIsThereSaysWhatIsNotAndForgetsNothing) {
  const fs::path partial = folder_ / "partial";
  fs::create_directories(partial / "scans");
  fs::copy(folder_ / "scans" / "maxilla.ply", partial / "scans" / "maxilla.ply");
  ASSERT_TRUE(write_file(partial / "scans" / "mandible.ply", "ply\nformat ascii 1.0\nend_header\n"));
  ASSERT_TRUE(write_file(partial / "case.toml", kCase));
  {
    Hands h(partial);
    auto* message = h.find<QLabel>("messageText");
    EXPECT_TRUE(message->isVisible());
    EXPECT_TRUE(message->text().contains("mandible.ply")) << message->text().toStdString();
    h.click("eye_maxilla");
    const QImage one = h.picture();
    h.click("eye_maxilla");
    EXPECT_GT(difference(one, h.picture()).pixels, 5000) << "the upper jaw is not to be seen";
    for (int i = 0; i < 6; ++i) h.step(i);
    EXPECT_EQ(QApplication::activeModalWidget(), nullptr);
  }
  {
    Hands h(folder_ / "absent");
    EXPECT_TRUE(h.find<QLabel>("messageText")->text().contains("is not a folder"));
  }
  Rigid3 left;
  {
    Hands h(folder_);
    h.step(3);
    h.type(h.find<QDoubleSpinBox>("value_forward"), "1.5");
    left = *h.window.document().state().therapeutic;
    h.window.close();
  }
  Hands again(folder_);
  EXPECT_LT((again.window.document().state().therapeutic->matrix() - left.matrix()).norm(), 1e-9);
  ASSERT_TRUE(write_file(folder_ / "viewer.json", "{\"kind\":"));
  Hands broken(folder_);
  EXPECT_TRUE(broken.find<QLabel>("messageText")->isVisible());
  EXPECT_TRUE(broken.window.document().state().therapeutic.has_value());
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
