// A phantom case in a folder of its own, the real window, and hands to use it with.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <QApplication>
#include <QLabel>
#include <QTabBar>
#include <QTest>
#include <QToolBar>
#include <cmath>
#include <filesystem>

#include <nlohmann/json.hpp>

#include "acquisition/pose_recording.h"
#include "calibration/frames_graph_json.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "phantom/jaws.h"
#include "rendering/decimate.h"
#include "tracking/motion_file.h"
#include "viewer/main_window.h"

namespace gnathion {

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

  static inline fs::path folder_;
};

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
inline Difference difference(const QImage& a, const QImage& b) {
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

inline std::size_t points_of(const ProfilePlot& plot, const std::string& name) {
  std::size_t n = 0;
  for (const PlotCurve& c : plot.curves())
    if (c.name == name)
      for (const Polyline2& line : c.lines) n += line.size();
  return n;
}

}  // namespace gnathion
