// The window joined to a real daemon: live pictures with tags, a take with marks, the daemon gone and back.
#include <gtest/gtest.h>
#include <vtkAutoInit.h>

#include <QVTKOpenGLNativeWidget.h>
#include <QApplication>
#include <QElapsedTimer>
#include <QLabel>
#include <QLineEdit>
#include <QListWidget>
#include <QProgressBar>
#include <QPushButton>
#include <QRegularExpression>
#include <QSurfaceFormat>
#include <QTabBar>
#include <QTableWidget>
#include <QTest>
#include <QTimer>

#include <nlohmann/json.hpp>

#include "acquisition/recording.h"
#include "core/camera_model.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "core/time.h"
#include "core/transform_io.h"
#include "phantom/case.h"
#include "phantom/film.h"
#include "phantom/film_scene.h"
#include "phantom/patient.h"
#include "rendering/decimate.h"
#include "tests/daemon/daemon_process.h"
#include "viewer/main_window.h"
#include "viewer/widgets/camera_view.h"

VTK_MODULE_INIT(vtkRenderingOpenGL2)
VTK_MODULE_INIT(vtkRenderingFreeType)
VTK_MODULE_INIT(vtkInteractionStyle)

namespace gnathion::testing {
namespace {

namespace fs = std::filesystem;
constexpr int kPatienceMs = 120000;

template <class Condition>
bool wait(Condition condition) {
  return QTest::qWaitFor(condition, kPatienceMs);
}

constexpr std::uint64_t kSeed = 5;
constexpr std::size_t kTriangles = 40000;  ///< of a jaw: what is looked at is the window

/// A case with jaws and rig of the virtual patient that stands before the daemon's cameras.
void write_case(const fs::path& folder) {
  const PhantomPatient patient = make_phantom_patient(kSeed);
  fs::create_directories(folder / "scans");
  ASSERT_TRUE(write_mesh(folder / "scans/maxilla.ply", decimated(patient.jaws.maxilla, kTriangles)));
  ASSERT_TRUE(write_mesh(folder / "scans/mandible.ply", decimated(patient.jaws.mandible_mi, kTriangles)));
  ASSERT_TRUE(write_rig(folder / "rig.toml", phantom_rig(patient)));
  ASSERT_TRUE(write_file(folder / "case.toml",
                         "[case]\nid = \"case-live\"\n[scans]\nmaxilla_mi = \"scans/maxilla.ply\"\n"
                         "mandible_mi = \"scans/mandible.ply\"\n[session]\nrig = \"rig.toml\"\n"));
}

int pixels_like(const QImage& image, const QColor& wanted) {
  int n = 0;
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) {
      const QColor c(image.pixel(x, y));
      n += std::abs(c.red() - wanted.red()) + std::abs(c.green() - wanted.green()) +
               std::abs(c.blue() - wanted.blue()) <
           60;
    }
  return n;
}

/// A design's job: followed, cancelled, lost with its daemon, found again, and opened when it is done.
TEST(ViewerLive, JobsOfTheDaemonAreFollowedCancelledAndOpened) {
  const TemporaryFolder folder;
  DaemonProcess daemon(folder.path());
  const fs::path home = daemon.cases() / "case-live";
  write_case(home);
  ASSERT_TRUE(
      write_json(home / "viewer.json",
                 {{"kind", "viewer"},
                  {"therapeutic", motion_json(Motion<Dental>(Rigid3{Matrix3::Identity(), {0, 0.8, -2}}),
                                              std::nullopt, {{"from", "sliders"}})},
                  {"parameters", {{"voxel_mm", 0.25}}}}));
  ASSERT_TRUE(daemon.start()) << daemon.log();
  WindowOptions options;
  options.socket = daemon.socket();
  options.connect = [](const std::string& socket) { return client::DaemonClient::connect(socket); };
  MainWindow window(options);
  window.show();
  ASSERT_TRUE(QTest::qWaitForWindowExposed(&window));
  window.open(home);
  const auto click = [](QWidget* w) { QTest::mouseClick(w, Qt::LeftButton, {}, w->rect().center()); };
  auto* build = window.findChild<QPushButton*>("buildSplint");
  auto* jobs = window.findChild<QTableWidget*>("jobsTable");
  auto* message = window.findChild<QLabel*>("messageText");
  auto* tabs = window.findChild<QTabBar*>("steps");
  const auto state = [&](int row) {
    return row < jobs->rowCount() ? jobs->item(row, 1)->text() : QString("none");
  };
  ASSERT_TRUE(wait([&] { return build->text().contains("daemon"); }))
      << "the case is not known as the daemon's";
  // A copy under the same name is another case: the daemon's jobs would run in the other folder.
  const fs::path copy = folder.path() / "copies" / "case-live";
  fs::create_directories(copy.parent_path());
  fs::copy(home, copy, fs::copy_options::recursive);
  window.open(copy);
  ASSERT_TRUE(wait([&] { return !window.loading() && window.document().content().folder == copy; }));
  QTest::qWait(1500);
  EXPECT_FALSE(build->text().contains("daemon")) << "a copy is taken for the daemon's case";
  window.open(home);
  ASSERT_TRUE(wait([&] { return !window.loading() && build->text().contains("daemon"); }));
  QTest::mouseClick(tabs, Qt::LeftButton, {}, tabs->tabRect(4).center());

  click(build);
  EXPECT_FALSE(build->isEnabled());
  ASSERT_TRUE(wait([&] {
    const auto* bar = qobject_cast<QProgressBar*>(jobs->cellWidget(0, 2));
    return state(0) == "runs" && bar && bar->value() > 0;
  })) << message->text().toStdString();
  EXPECT_FALSE(window.findChild<QLabel*>("jobMessage")->text().isEmpty()) << "no step is told";
  if (const char* keep = std::getenv("GNATHION_PICTURES"))
    window.grab().save(QString(keep) + "/viewer_jobs.png");
  const Stopwatch since_cancel;
  click(window.findChild<QPushButton*>("cancelBuild"));
  EXPECT_TRUE(wait([&] { return state(0).contains("cancelled"); })) << state(0).toStdString();
  std::printf("cancelled after %.0f ms\n", 1e3 * since_cancel.seconds());
  EXPECT_FALSE(fs::exists(home / "designs" / "design_001"));
  EXPECT_TRUE(build->isEnabled());

  // The daemon goes away under a job, and comes back without it.
  click(build);
  ASSERT_TRUE(wait([&] { return state(0) == "runs"; }));
  daemon.kill_and_wait();
  EXPECT_TRUE(wait([&] { return state(0).contains("daemon away"); })) << state(0).toStdString();
  ASSERT_TRUE(daemon.start()) << daemon.log();
  EXPECT_TRUE(wait([&] { return state(0).contains("failed"); })) << state(0).toStdString();
  EXPECT_TRUE(message->text().contains("start it again")) << message->text().toStdString();
  ASSERT_TRUE(wait([&] { return build->isEnabled() && build->text().contains("daemon"); }));

  // What ends well is shown without asking.
  if (std::getenv("GNATHION_CAMPAIGN")) {
    tabs->setCurrentIndex(3);
    click(window.findChild<QPushButton*>("daemonCheck"));
    EXPECT_TRUE(wait([&] { return message->text().contains("Checked by the daemon"); }))
        << message->text().toStdString();
  }
  tabs->setCurrentIndex(4);
  click(build);
  auto* gates = window.findChild<QTableWidget*>("gateTable");
  EXPECT_TRUE(wait([&] { return gates->rowCount() > 5 && window.document().layers().find("splint"); }))
      << message->text().toStdString();
  EXPECT_TRUE(fs::exists(home / "designs" / "design_001" / "design.json"));
  EXPECT_EQ(QApplication::activeModalWidget(), nullptr);
}

/// The same patient as a whole case: scans, bodies, and a short film of MI and TP.
void write_whole_case(const fs::path& folder, const PhantomPatient& patient) {
  fs::create_directories(folder);
  SilentProgress silent;
  ASSERT_TRUE(write_phantom_case(patient, kSeed, folder, silent));
  FilmOptions options;
  options.seed = kSeed;
  options.rate_hz = 12;
  options.duration_s = 10;
  options.border_movements = false;
  options.clutter = false;
  PhantomFilm film(film_scene(patient), options);
  std::map<std::string, std::string> attachments;
  for (const char* name : {"rig.toml", "bow.toml", "head_frame.toml"})
    attachments[name] = *read_file(folder / name);
  ASSERT_TRUE(record(film, folder / "recording.mcap", attachments, film.frames_per_camera(), silent));
  const auto toml = read_file(folder / "case.toml");
  ASSERT_TRUE(toml);
  ASSERT_TRUE(
      write_file(folder / "case.toml", *toml + "\n[design]\nvoxel_mm = 0.3\naperture_limit_mm = 0.6\n"));
}

/// Track, calibrate, T_th by both routes, the whole run, report and evaluation, each by its button.
TEST(ViewerLive, EveryStepsJobIsComputedByTheDaemonAndItsResultShown) {
  const TemporaryFolder folder;
  DaemonProcess daemon(folder.path());
  const fs::path home = daemon.cases() / "case-whole";
  const PhantomPatient patient = make_phantom_patient(kSeed);
  write_whole_case(home, patient);
  ASSERT_TRUE(daemon.start()) << daemon.log();
  WindowOptions options;
  options.socket = daemon.socket();
  options.connect = [](const std::string& socket) { return client::DaemonClient::connect(socket); };
  MainWindow window(options);
  window.show();
  ASSERT_TRUE(QTest::qWaitForWindowExposed(&window));
  window.activateWindow();  // keys go to the active window
  ASSERT_TRUE(QTest::qWaitForWindowActive(&window));
  window.open(home);
  auto* jobs = window.findChild<QTableWidget*>("jobsTable");
  auto* message = window.findChild<QLabel*>("messageText");
  auto* tabs = window.findChild<QTabBar*>("steps");
  QElapsedTimer since;
  double worst_ms = 0;
  QTimer beat;  // the window's own heart: how long it stood still
  QObject::connect(&beat, &QTimer::timeout, [&] {
    worst_ms = std::max(worst_ms, static_cast<double>(since.nsecsElapsed()) / 1e6);
    since.restart();
  });
  const auto ended = [&](int step, const char* name) {
    QTest::mouseClick(tabs, Qt::LeftButton, {}, tabs->tabRect(step).center());
    auto* b = window.findChild<QPushButton*>(name);
    if (!b || !wait([&] { return b->isVisible() && b->isEnabled() && !window.loading(); })) return false;
    const int before = jobs->rowCount();
    worst_ms = 0;
    since.start();
    beat.start(2);
    QTest::mouseClick(b, Qt::LeftButton, {}, b->rect().center());
    const bool done = wait([&] {
      return jobs->rowCount() > before &&
             (jobs->item(0, 1)->text().contains("done") || jobs->item(0, 1)->text().contains("fail") ||
              jobs->item(0, 1)->text().contains("gate"));
    });
    beat.stop();
    std::printf("%s: %s, longest pause of the window %.0f ms\n", name,
                jobs->rowCount() ? jobs->item(0, 1)->text().toUtf8().constData() : "no job", worst_ms);
    return done && jobs->item(0, 1)->text().contains("done");
  };
  const auto& document = window.document();
  ASSERT_TRUE(wait([&] { return window.open_s() > 0; }));

  EXPECT_TRUE(ended(1, "daemonTrack")) << message->text().toStdString();
  EXPECT_TRUE(wait([&] { return document.content().session != nullptr; })) << "the poses are not shown";
  EXPECT_TRUE(ended(2, "daemonCalibrate")) << message->text().toStdString();
  auto* registrations = window.findChild<QTableWidget*>("registrationTable");
  EXPECT_TRUE(wait([&] { return registrations->rowCount() >= 3; })) << "the chain is not shown";

  const auto error_mm = [&] {
    const Rigid3 d = *document.state().therapeutic * patient.therapeutic.rigid.inverse();
    double worst = 0;
    for (const Vector3& p : {Vector3(0, 0, 0), Vector3(25, 40, 0), Vector3(-25, 40, 0)})
      worst = std::max(worst, (d * p - p).norm());
    return worst;
  };
  EXPECT_TRUE(ended(3, "daemonScans")) << message->text().toStdString();
  ASSERT_TRUE(wait([&] { return document.state().therapeutic_source == "jobs/T_th_scans_001.json"; }));
  EXPECT_LT(error_mm(), 0.3);
  EXPECT_TRUE(ended(3, "daemonMotion")) << message->text().toStdString();
  ASSERT_TRUE(wait([&] { return document.state().therapeutic_source == "jobs/T_th_motion_001.json"; }))
      << message->text().toStdString();
  EXPECT_LT(error_mm(), 0.5);
  QTest::keyClick(&window, Qt::Key_Z, Qt::ControlModifier);
  EXPECT_TRUE(wait([&] { return document.state().therapeutic_source == "jobs/T_th_scans_001.json"; }))
      << "undo does not take it back";

  EXPECT_EQ(QApplication::activeModalWidget(), nullptr);
  if (!std::getenv("GNATHION_CAMPAIGN")) return;  // a whole run with its splint takes half a minute more
  EXPECT_TRUE(ended(1, "daemonRun")) << message->text().toStdString();
  EXPECT_TRUE(wait([&] { return document.content().mesh("splint") && document.content().motion; }))
      << "what the run made is not shown";
  if (const char* keep = std::getenv("GNATHION_PICTURES"))
    window.grab().save(QString(keep) + "/viewer_run.png");
  const fs::path report = home / "results" / "report.html";
  ASSERT_TRUE(fs::exists(report));
  fs::remove(report);
  EXPECT_TRUE(ended(5, "daemonReport")) << message->text().toStdString();
  EXPECT_TRUE(fs::exists(report)) << "no report";

  // The design itself stands for its scan: what is measured is nothing.
  window.findChild<QLineEdit*>("scanSplint")
      ->setText(QString::fromStdString((home / "results" / "splint.stl").string()));
  EXPECT_TRUE(ended(5, "evaluateScans")) << message->text().toStdString();
  EXPECT_TRUE(fs::exists(home / "evaluations" / "evaluation_001"));
  auto* procedures = window.findChild<QTableWidget*>("procedureTable");
  EXPECT_TRUE(wait([&] { return procedures->rowCount() > 0; })) << message->text().toStdString();
  if (procedures->rowCount() > 0) {
    EXPECT_LT(std::abs(procedures->item(0, 1)->text().replace(QChar(0x2212), '-').toDouble()), 0.02);
  }
  if (const char* keep = std::getenv("GNATHION_PICTURES"))
    window.grab().save(QString(keep) + "/viewer_evaluated.png");
  // One virtual print of the same splint, here in the window: it is not without error.
  auto* print = window.findChild<QPushButton*>("virtualPrint");
  QTest::mouseClick(print, Qt::LeftButton, {}, print->rect().center());
  ASSERT_TRUE(wait([&] { return !window.jobs().busy(); }));
  ASSERT_GT(procedures->rowCount(), 0) << message->text().toStdString();
  EXPECT_NE(procedures->item(0, 1)->text().replace(QChar(0x2212), '-').toDouble(), 0.0);
  EXPECT_EQ(QApplication::activeModalWidget(), nullptr);
}

TEST(ViewerLive, CapturesATakeAndFindsTheDaemonAgain) {
  const TemporaryFolder folder;
  DaemonProcess daemon(folder.path());
  write_case(daemon.cases() / "case-live");
  ASSERT_TRUE(daemon.start()) << daemon.log();
  {
    const auto client = daemon.connect();
    ASSERT_TRUE(client);
    const auto set = client->configure_devices("[[device]]\nkind = \"phantom\"\nname = \"phantom\"\nseed = " +
                                               std::to_string(kSeed) + "\nduration_s = 900\nrate_hz = 3\n");
    ASSERT_TRUE(set) << set.error().line();
  }
  WindowOptions options;
  options.socket = daemon.socket();
  options.connect = [](const std::string& socket) { return client::DaemonClient::connect(socket); };
  MainWindow window(options);
  window.show();
  ASSERT_TRUE(QTest::qWaitForWindowExposed(&window));
  window.open(daemon.cases() / "case-live");
  ASSERT_TRUE(wait([&] { return !window.loading() && window.open_s() > 0; }));
  const auto click = [](QWidget* w) { QTest::mouseClick(w, Qt::LeftButton, {}, w->rect().center()); };
  auto* record = window.findChild<QPushButton*>("recordButton");
  auto* live = window.findChild<QPushButton*>("liveButton");
  auto* state = window.findChild<QLabel*>("captureState");
  auto* takes = window.findChild<QListWidget*>("takeList");
  window.findChild<QTabBar*>("steps")->setCurrentIndex(0);
  ASSERT_TRUE(wait([&] { return record->isEnabled(); })) << state->text().toStdString();
  EXPECT_FALSE(window.findChild<QPushButton*>("markMi")->isEnabled()) << "a mark without a recording";

  click(live);
  const auto camera = [&]() -> CameraView* { return window.findChild<CameraView*>("camera_camera_0"); };
  ASSERT_TRUE(wait([&] { return camera() && camera()->tags() >= 4; })) << state->text().toStdString();
  const QImage shown = camera()->grab().toImage();
  EXPECT_GT(pixels_like(shown, QColor(40, 210, 140)) + pixels_like(shown, QColor(255, 170, 40)), 60)
      << "no outlines of tags in the picture";
  EXPECT_TRUE(wait([&] { return window.findChild<QLabel*>("bowState")->text().startsWith("✓"); }));
  EXPECT_TRUE(wait([&] { return window.findChild<QLabel*>("headState")->text().startsWith("✓"); }));
  EXPECT_TRUE(wait([&] { return window.findChild<QTableWidget*>("deviceTable")->rowCount() > 0; }));
  EXPECT_TRUE(wait([&] { return camera()->facts().contains("Hz"); })) << "no rate beside the picture";

  // By keys: hands are at the patient.
  window.activateWindow();
  ASSERT_TRUE(QTest::qWaitForWindowActive(&window));
  QTest::keyClick(&window, Qt::Key_R);
  ASSERT_TRUE(wait([&] { return state->text().startsWith("Recording"); })) << state->text().toStdString();
  for (const auto& [key, marks] : {std::pair{Qt::Key_M, 1}, {Qt::Key_T, 2}, {Qt::Key_K, 3}}) {
    QTest::keyClick(&window, key);
    EXPECT_TRUE(wait([&, n = marks] { return state->text().contains(QString("marks: %1").arg(n)); }))
        << state->text().toStdString();
  }
  click(window.findChild<QPushButton*>("markMi"));
  EXPECT_TRUE(wait([&] { return state->text().contains("marks: 4"); })) << state->text().toStdString();
  window.grab().save(QString::fromStdString((folder.path() / "capture.png").string()));
  if (const char* keep = std::getenv("GNATHION_PICTURES"))
    window.grab().save(QString(keep) + "/viewer_live.png");
  click(record);
  EXPECT_TRUE(wait([&] { return takes->count() && takes->item(0)->text().contains("recording_001"); }));
  EXPECT_TRUE(wait([&] { return state->text().startsWith("Armed"); })) << state->text().toStdString();

  daemon.kill_and_wait();
  EXPECT_TRUE(wait([&] { return state->text().contains("went away"); })) << state->text().toStdString();
  EXPECT_FALSE(record->isEnabled());
  EXPECT_EQ(QApplication::activeModalWidget(), nullptr);
  ASSERT_TRUE(daemon.start()) << daemon.log();
  EXPECT_TRUE(wait([&] { return record->isEnabled(); })) << "the daemon is back, and was not found";
}

/// Feet instead of hands: what the pedal says is counted, shown, and in the take.
TEST(ViewerLive, APedalsMarksAreSeenWithoutAKeyPressed) {
  const TemporaryFolder folder;
  DaemonProcess daemon(folder.path());
  write_case(daemon.cases() / "case-live");
  ASSERT_TRUE(daemon.start()) << daemon.log();
  {
    // Its pedal marks MI and TP: the daemon takes it as it takes any instrument's.
    const auto client = daemon.connect();
    ASSERT_TRUE(client);
    const auto set = client->configure_devices("[[device]]\nkind = \"phantom\"\nname = \"phantom\"\nseed = " +
                                               std::to_string(kSeed) + "\nduration_s = 16\nrate_hz = 2\n");
    ASSERT_TRUE(set) << set.error().line();
  }
  WindowOptions options;
  options.socket = daemon.socket();
  options.connect = [](const std::string& socket) { return client::DaemonClient::connect(socket); };
  MainWindow window(options);
  window.show();
  ASSERT_TRUE(QTest::qWaitForWindowExposed(&window));
  window.open(daemon.cases() / "case-live");
  ASSERT_TRUE(wait([&] { return !window.loading() && window.open_s() > 0; }));
  window.findChild<QTabBar*>("steps")->setCurrentIndex(0);
  auto* record = window.findChild<QPushButton*>("recordButton");
  auto* state = window.findChild<QLabel*>("captureState");
  auto* last = window.findChild<QLabel*>("lastMark");
  ASSERT_TRUE(wait([&] { return record->isEnabled(); })) << state->text().toStdString();
  QTest::mouseClick(record, Qt::LeftButton, {}, record->rect().center());
  EXPECT_TRUE(wait([&] { return last->text().contains("by pedal, held for"); }))
      << last->text().toStdString();
  EXPECT_TRUE(wait([&] { return state->text().contains(QRegularExpression("marks: [1-9]")); }))
      << state->text().toStdString();
  EXPECT_TRUE(wait([&] { return last->text().contains("TP by pedal"); })) << last->text().toStdString();
  if (const char* keep = std::getenv("GNATHION_PICTURES"))
    window.grab().save(QString(keep) + "/viewer_pedal.png");
  if (state->text().startsWith("Recording"))
    QTest::mouseClick(record, Qt::LeftButton, {}, record->rect().center());
  auto* takes = window.findChild<QListWidget*>("takeList");
  ASSERT_TRUE(wait([&] { return takes->count() > 0; }));
  const auto summary = summarise_recording(daemon.cases() / "case-live/recordings/recording_001.mcap");
  ASSERT_TRUE(summary) << summary.error().line();
  ASSERT_TRUE(summary->streams.count("pedal"));
  EXPECT_GE(summary->streams.at("pedal").received, 3u);
}

}  // namespace
}  // namespace gnathion::testing

int main(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  QSurfaceFormat format = QVTKOpenGLNativeWidget::defaultFormat();
  format.setSamples(0);
  QSurfaceFormat::setDefaultFormat(format);
  QApplication app(argc, argv);
  return RUN_ALL_TESTS();
}
