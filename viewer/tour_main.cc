// viewer_tour CASE --pictures DIR: opens a case and takes the pictures of the handbook, step by step.
// viewer_tour CASE --steps DIR: each step as it is when it is opened, for looking at.
// viewer_tour CASE --bench: measures opening, frame rate and the longest pause of the window.
#include <QVTKOpenGLNativeWidget.h>
#include <vtkActor.h>
#include <vtkAutoInit.h>
#include <vtkCamera.h>
#include <vtkPolyDataMapper.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <QAction>
#include <QApplication>
#include <QCheckBox>
#include <QElapsedTimer>
#include <QMouseEvent>
#include <QPushButton>
#include <QSurfaceFormat>
#include <QTabBar>
#include <QTabWidget>
#include <QTest>
#include <cstdio>
#include <functional>
#include <string>
#include <thread>

#include "rendering/vtk_mesh.h"
#include "viewer/main_window.h"
#include "viewer/widgets/timeline.h"

VTK_MODULE_INIT(vtkRenderingOpenGL2)
VTK_MODULE_INIT(vtkRenderingFreeType)
VTK_MODULE_INIT(vtkInteractionStyle)

namespace gnathion {
namespace {

bool wait(const std::function<bool()>& condition, int ms = 300000) {
  QElapsedTimer clock;
  clock.start();
  while (!condition()) {
    if (clock.elapsed() > ms) return false;
    QTest::qWait(20);
  }
  return true;
}

void settle(MainWindow& w) {
  wait([&] { return w.scene().settled() && !w.jobs().any(); });
  QTest::qWait(60);
}

void go(MainWindow& w, int step) {
  w.findChild<QTabBar*>("steps")->setCurrentIndex(step);
  settle(w);
}

void act(MainWindow& w, const char* action) {
  w.findChild<QAction*>(action)->trigger();
  settle(w);
}

template <class T>
T* part(MainWindow& w, const char* name) {
  return w.findChild<T*>(name);
}

/// The pictures, each in the state a user would bring about.
void take_pictures(MainWindow& w, const QString& folder) {
  const auto take = [&](const char* name) {
    settle(w);
    w.grab().save(folder + "/" + name + ".png");
    std::printf("%s\n", name);
  };
  go(w, 1);
  auto* timeline = part<Timeline>(w, "timeline");
  act(w, "view_oblique");
  timeline->set_time(0.30 * timeline->end_s());
  timeline->scrubbed(timeline->time_s());
  part<QCheckBox>(w, "contactsBox")->setChecked(true);
  take("viewer_motion");
  part<QCheckBox>(w, "contactsBox")->setChecked(false);
  go(w, 2);
  take("viewer_calibrate");
  go(w, 3);
  act(w, "view_oblique");
  take("viewer_transformation");
  go(w, 4);
  act(w, "view_oblique");
  act(w, "sectionAction");
  take("viewer_design");
  act(w, "sectionAction");
  w.document().layers().set_visible("splint", false);
  w.document().layers().set_visible("thickness", true);
  w.document().layers().set_visible("mandible_tp", false);
  part<QCheckBox>(w, "marginBox")->setChecked(true);
  act(w, "view_upper_occlusal");
  take("viewer_thickness");
  go(w, 5);
  if (w.document().layers().find("splint")) part<QPushButton>(w, "virtualPrint")->click();
  settle(w);
  act(w, "view_upper_occlusal");
  take("viewer_evaluate");
}

/// Every step as it is when it is opened, and the list of keys: of cases with little or nothing in them, too.
void take_steps(MainWindow& w, const QString& folder) {
  constexpr const char* kNames[] = {"1_capture",        "2_motion", "3_calibrate",
                                    "4_transformation", "5_design", "6_evaluate"};
  for (int i = 0; i < 6; ++i) {
    go(w, i);
    w.grab().save(folder + "/" + kNames[i] + ".png");
  }
  act(w, "help");
  w.grab().save(folder + "/7_keys.png");
}

struct Frames {
  double per_second = 0, worst_ms = 0, draw_ms = 0, rest_ms = 0, rest_pause_ms = 0;
};

/// How long the event loop stood still at most while `until` was not yet true.
double longest_pause_ms(const std::function<bool()>& until) {
  QElapsedTimer since;
  since.start();
  double worst = 0;
  QTimer beat;
  QObject::connect(&beat, &QTimer::timeout, [&] {
    worst = std::max(worst, static_cast<double>(since.nsecsElapsed()) / 1e6);
    since.restart();
  });
  beat.start(1);
  while (!until()) QApplication::processEvents(QEventLoop::WaitForMoreEvents);
  return worst;
}

/// Turns the camera by the mouse for about two seconds, every frame drawn before the next move.
Frames turn(MainWindow& w) {
  QWidget* scene = w.scene().widget();
  settle(w);
  const QPoint centre = scene->rect().center();
  const auto send = [&](QEvent::Type type, const QPoint& p, Qt::MouseButton b, Qt::MouseButtons held) {
    QMouseEvent event(type, p, scene->mapToGlobal(p), b, held, {});
    QApplication::sendEvent(scene, &event);
  };
  send(QEvent::MouseButtonPress, centre, Qt::LeftButton, Qt::LeftButton);
  send(QEvent::MouseMove, centre + QPoint(2, 0), Qt::NoButton, Qt::LeftButton);
  QApplication::processEvents();
  QElapsedTimer clock, frame;
  clock.start();
  Frames f;
  int n = 0;
  while (clock.elapsed() < 2500) {
    frame.start();
    send(QEvent::MouseMove, centre + QPoint(static_cast<int>(80 * std::sin(0.05 * n)), n % 7), Qt::NoButton,
         Qt::LeftButton);
    QApplication::processEvents();
    f.worst_ms = std::max(f.worst_ms, static_cast<double>(frame.nsecsElapsed()) / 1e6);
    ++n;
  }
  f.per_second = 1000.0 * n / static_cast<double>(clock.elapsed());
  if (const char* folder = std::getenv("GNATHION_PICTURES"))
    w.grab().save(QString("%1/viewer_turning.png").arg(folder));
  constexpr int kDrawn = 40;
  frame.start();
  for (int i = 0; i < kDrawn; ++i) w.scene().render_now();
  f.draw_ms = static_cast<double>(frame.nsecsElapsed()) / 1e6 / kDrawn;
  send(QEvent::MouseButtonRelease, centre, Qt::LeftButton, Qt::NoButton);
  frame.start();
  f.rest_pause_ms = longest_pause_ms([&] { return w.scene().settled(); });
  f.rest_ms = static_cast<double>(frame.nsecsElapsed()) / 1e6;
  return f;
}

/// The same surfaces in full, drawn by VTK alone into a window of that size: what the machine does at this
/// moment.
double plain_vtk(MainWindow& w, const QSize& size) {
  vtkNew<vtkRenderer> renderer;
  vtkNew<vtkRenderWindow> window;
  window->SetOffScreenRendering(1);
  window->SetMultiSamples(0);
  window->SetSize(size.width(), size.height());
  window->AddRenderer(renderer);
  for (const Layer& l : w.document().layers().layers()) {
    if (!l.visible) continue;
    vtkNew<vtkPolyDataMapper> mapper;
    mapper->SetInputData(to_vtk(*l.mesh, l.pose));
    vtkNew<vtkActor> actor;
    actor->SetMapper(mapper);
    renderer->AddActor(actor);
  }
  renderer->ResetCamera();
  window->Render();
  QElapsedTimer clock;
  clock.start();
  int n = 0;
  for (; clock.elapsed() < 2500; ++n) {
    renderer->GetActiveCamera()->Azimuth(1);
    window->Render();
    window->WaitForCompletion();
  }
  return 1000.0 * n / static_cast<double>(clock.elapsed());
}

double load_now() {
  double load[1] = {0};
  (void)!getloadavg(load, 1);
  return load[0];
}

/// A mesh cut into four until it has about that many triangles: what a finer scanner would give.
std::shared_ptr<const TriangleMesh> refined(const TriangleMesh& mesh, std::size_t triangles) {
  TriangleMesh m;
  m.vertices_mm = mesh.vertices_mm;
  m.triangles = mesh.triangles;
  for (std::size_t t = 0; m.triangles.size() < triangles; ++t) {
    const Triangle v = m.triangles[t];
    const auto c = static_cast<std::uint32_t>(m.vertices_mm.size());
    m.vertices_mm.push_back((m.vertices_mm[v[0]] + m.vertices_mm[v[1]] + m.vertices_mm[v[2]]) / 3);
    m.triangles[t] = {v[0], v[1], c};
    m.triangles.push_back({v[1], v[2], c});
    m.triangles.push_back({v[2], v[0], c});
  }
  return std::make_shared<const TriangleMesh>(std::move(m));
}

void measure_turning(MainWindow& w, std::size_t triangles, const QSize& window) {
  w.resize(window);
  QApplication::processEvents();
  const QSize size = w.scene().widget()->size();
  const double busy = load_now(), plain_before = plain_vtk(w, size);
  const Frames f = turn(w);
  const double plain = 0.5 * (plain_before + plain_vtk(w, size));
  std::printf(
      "| %zu triangles turned, window %d × %d, scene %d × %d | %.1f frames a second, slowest frame %.0f ms "
      "|\n",
      triangles, window.width(), window.height(), size.width(), size.height(), f.per_second, f.worst_ms);
  std::printf("| of a frame: drawing, and all that Qt does to show it | %.0f ms, %.0f ms |\n", f.draw_ms,
              1000.0 / f.per_second - f.draw_ms);
  std::printf(
      "| VTK alone, the same in full, before and after | %.1f frames a second: the viewer %.1f times that "
      "|\n",
      plain, f.per_second / plain);
  std::printf(
      "| from letting go to full detail; longest pause of the window meanwhile | %.0f ms; %.0f ms |\n",
      f.rest_ms, f.rest_pause_ms);
  std::printf("| load of the machine before these | %.1f on %u cores |\n", busy,
              std::thread::hardware_concurrency());
}

/// From a change of a parameter to the coarse splint drawn in the window; the first one finds the teeth.
void measure_preview(MainWindow& w) {
  auto* box = part<QCheckBox>(w, "previewBox");
  const auto shown = [&]() -> std::shared_ptr<const TriangleMesh> {
    const Layer* l = w.document().layers().find("preview");
    return l ? l->mesh : nullptr;
  };
  double first_ms = 0, worst_ms = 0, sum_ms = 0, pause_ms = 0;
  constexpr int kChanges = 6;
  for (int i = 0; i <= kChanges; ++i) {
    const auto before = shown();
    QElapsedTimer clock;
    clock.start();
    if (i == 0)
      box->click();
    else
      w.document().change("Wall", [&](SessionState& s) { s.parameters.wall_mm += i % 2 ? 0.05 : -0.05; });
    pause_ms = std::max(pause_ms, longest_pause_ms([&] {
                          return shown() && shown() != before && w.scene().draws("preview", shown());
                        }));
    w.scene().render_now();
    const auto ms = static_cast<double>(clock.elapsed());
    if (i == 0) {
      first_ms = ms;
      continue;
    }
    worst_ms = std::max(worst_ms, ms);
    sum_ms += ms / kChanges;
  }
  std::printf(
      "| preview after a change, mean and longest of %d; the first of all | %.0f ms, %.0f ms; %.0f ms |\n",
      kChanges, sum_ms, worst_ms, first_ms);
  std::printf("| longest pause of the window during previews | %.0f ms |\n", pause_ms);
  box->click();
}

void measure(MainWindow& w) {
  std::printf("| What | Measured |\n| --- | --- |\n");
  std::printf("| case open, from the call to the full picture | %.2f s (files alone %.2f s) |\n", w.open_s(),
              w.document().content().load_s);
  go(w, 4);
  for (const auto& [id, triangles] :
       {std::pair{"maxilla", 200000}, {"mandible_tp", 200000}, {"splint", 500000}}) {
    const Layer* layer = w.document().layers().find(id);
    if (!layer) continue;
    Layer fine = *layer;
    fine.mesh = refined(*layer->mesh, static_cast<std::size_t>(triangles));
    w.document().layers().put(std::move(fine));
  }
  settle(w);
  std::size_t shown = 0;
  for (const Layer& l : w.document().layers().layers())
    if (l.visible) shown += l.mesh->triangles.size();
  measure_turning(w, shown, {1280, 800});
  measure_turning(w, shown, {1280 + 620, 800 + 120});
  measure_preview(w);
  part<QPushButton>(w, "buildSplint")->click();
  const double pause = longest_pause_ms([&] { return !w.jobs().busy(); });
  std::printf("| longest pause of the window during a full build | %.0f ms |\n", pause);
  std::printf("| load of the machine at the end | %.1f |\n", load_now());
}

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fputs("viewer_tour CASE --pictures DIR | --steps DIR | --bench\n", stderr);
    return 2;
  }
  QSurfaceFormat format = QVTKOpenGLNativeWidget::defaultFormat();
  format.setSamples(0);
  QSurfaceFormat::setDefaultFormat(format);
  QApplication app(argc, argv);
  gnathion::MainWindow window(gnathion::WindowOptions{});
  window.show();
  window.open(argv[1]);
  if (!gnathion::wait([&] { return !window.loading() && window.open_s() > 0; })) return 1;
  if (std::string(argv[2]) == "--bench")
    gnathion::measure(window);
  else if (argc > 3 && std::string(argv[2]) == "--steps")
    gnathion::take_steps(window, argv[3]);
  else if (argc > 3)
    gnathion::take_pictures(window, argv[3]);
  return 0;
}
