// Drives the real window under Xvfb with mouse and keys, through each step of a phantom case, and looks at
// it.
#include "viewer/viewer_hands.h"

#include <vtkAutoInit.h>

#include <QVTKOpenGLNativeWidget.h>
#include <QCheckBox>
#include <QComboBox>
#include <QDoubleSpinBox>
#include <QFileDialog>
#include <QLineEdit>
#include <QListWidget>
#include <QPushButton>
#include <QSlider>
#include <QSurfaceFormat>
#include <QTabWidget>
#include <QTableWidget>

#include "phantom/cbct.h"
#include "viewer/model/readout.h"
#include "viewer/widgets/film_view.h"
#include "viewer/widgets/timeline.h"

VTK_MODULE_INIT(vtkRenderingOpenGL2)
VTK_MODULE_INIT(vtkRenderingFreeType)
VTK_MODULE_INIT(vtkInteractionStyle)

namespace gnathion {
namespace {

void keep_picture(QWidget& widget, const char* name) {
  if (const char* folder = std::getenv("GNATHION_PICTURES"))
    widget.grab().save(QString("%1/%2.png").arg(folder, name));
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

/// The window goes on under the dialog that asks for a file.
TEST_F(ViewerTest, TransformationComesFromAFileThatIsChosen) {
  const fs::path good = folder_ / "chosen.txt", bad = folder_ / "broken.json";
  ASSERT_TRUE(write_file(good, "1 0 0 0  0 1 0 0.5  0 0 1 -3  0 0 0 1\n"));
  ASSERT_TRUE(write_file(bad, "{\"kind\":\"motion\""));
  Hands h(folder_);
  h.step(3);
  const auto& state = h.window.document().state();
  const Rigid3 measured = *state.therapeutic;
  const auto dialog = [&] { return h.window.findChild<QFileDialog*>("fileDialog"); };
  const auto choose = [&](const fs::path& file) {
    h.click("transformFile");
    ASSERT_TRUE(h.wait([&] { return dialog() && dialog()->isVisible(); }));
    keep_picture(*dialog(), "file_dialog");
    auto* name = dialog()->findChild<QLineEdit*>("fileNameEdit");
    ASSERT_NE(name, nullptr);
    QTest::keyClicks(name, QString::fromStdString(file.filename().string()));
    QTest::keyClick(name, Qt::Key_Return);
    ASSERT_TRUE(QTest::qWaitFor([&] { return !dialog(); }, 5000)) << "the dialog stays";
  };
  choose(good);
  EXPECT_LT((state.therapeutic->translation_mm - Vector3(0, 0.5, -3)).norm(), 1e-9);
  EXPECT_EQ(state.therapeutic_source, "chosen.txt");
  choose(bad);
  auto* message = h.find<QLabel>("messageText");
  EXPECT_TRUE(message->isVisible() && message->text().contains("broken.json")) << message->text().toStdString();
  EXPECT_LT((state.therapeutic->translation_mm - Vector3(0, 0.5, -3)).norm(), 1e-9) << "a broken file was taken";
  h.click("transformFile");
  ASSERT_TRUE(h.wait([&] { return dialog() && dialog()->isVisible(); }));
  QTest::keyClick(dialog(), Qt::Key_Escape);
  EXPECT_TRUE(h.wait([&] { return !dialog(); }));
  QTest::keyClick(&h.window, Qt::Key_Z, Qt::ControlModifier);
  EXPECT_LT((state.therapeutic->matrix() - measured.matrix()).norm(), 1e-12);
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
  QTest::keyClick(&h.window, Qt::Key_A);
  for (const QPoint& p : {QPoint(60, 60), QPoint(140, 100), QPoint(60, 140)})
    QTest::mouseClick(section, Qt::LeftButton, {}, p);
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

  QTest::keyClick(&h.window, Qt::Key_Escape);
  // For a splint of the lower teeth the upper jaw comes down, and its margin with it.
  const auto facts = [&] { return h.find<QLabel>("marginFacts")->text(); };
  h.window.document().change("Lower", [](SessionState& state) { state.arch = Arch::kMandible; });
  h.click("previewBox");
  h.settle();
  h.tool("view_left");
  keep_picture(h.window, "margin_other_arch");
  const Rigid3 down = layers.find("maxilla")->pose;
  EXPECT_GT((down.matrix() - Matrix4::Identity()).norm(), 0.01);
  const QImage moved = h.picture();
  for (const Vector3& p : margins[0].points_mm) {
    const QPoint there = h.window.scene().project(down * p)->toPoint();
    int blue = 0;
    for (int dy = -3; dy <= 3; ++dy)
      for (int dx = -3; dx <= 3; ++dx) {
        const QColor c(moved.pixel(there + QPoint(dx, dy)));
        blue += c.blue() > c.red() + 60;
      }
    EXPECT_GT(blue, 5) << "the margin is not on the crowns it was drawn on";
  }
  EXPECT_TRUE(facts().contains("other jaw")) << facts().toStdString();
  h.click("previewBox");
  undo();
  EXPECT_FALSE(facts().contains("other jaw"));

  // The preview ends at the curve: what it had beyond goes, or comes.
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
  // On the lower teeth, and with a margin drawn along their left buccal side.
  auto* arch_box = h.find<QComboBox>("archBox");
  arch_box->setFocus();
  QTest::keyClick(arch_box, Qt::Key_Down);
  EXPECT_EQ(h.window.document().state().arch, Arch::kMandible);
  QTest::mouseClick(tabs->tabBar(), Qt::LeftButton, {}, tabs->tabBar()->tabRect(2).center());
  h.tool("view_left");
  h.click("drawMargin");
  h.settle();
  EXPECT_TRUE(h.window.document().layers().shows("mandible_mi"));
  EXPECT_FALSE(h.window.document().layers().shows("maxilla")) << "it would lie over the crowns";
  const ArchFrame& arch = *h.window.document().content().arch;
  const ArchRuler ruler(arch);
  for (int i = 0; i < 4; ++i) {
    const double s_mm = 0.5 * ruler.s_max_mm() + 5.0 * i;
    const auto px = h.window.scene().project(ruler.at(s_mm) + 4.0 * ruler.outward(s_mm) - 3.0 * arch.up);
    ASSERT_TRUE(px);
    QTest::mouseClick(h.window.scene().widget(), Qt::LeftButton, {}, px->toPoint());
  }
  const auto& margins = h.window.document().state().edits.margins;
  ASSERT_EQ(margins.size(), 1u);
  ASSERT_EQ(margins[0].points_mm.size(), 4u);
  const auto lower = h.window.scene().surface("mandible_mi");
  for (const Vector3& p : margins[0].points_mm)
    EXPECT_LT((lower->closest(p, 5.0)->point_mm - p).norm(), 0.01) << "not on the lower crowns";
  QTest::keyClick(&h.window, Qt::Key_Escape);
  h.click("buildSplint");
  EXPECT_TRUE(h.wait([&] { return !h.window.jobs().busy(); }));
  EXPECT_TRUE(fs::exists(folder_ / "designs" / "design_001" / "design.json"));
  EXPECT_TRUE(h.wait([&] { return gates->rowCount() > 5; })) << "the gates of the build do not show";
  // On that side the splint ends at the curve: its lowest points lie there.
  const auto report = read_json(folder_ / "designs" / "design_001" / "design.json");
  ASSERT_TRUE(report);
  const auto& splint = *h.window.document().layers().find("splint")->mesh;
  for (int i = 1; i <= 2; ++i) {
    const Vector3& at = margins[0].points_mm[static_cast<std::size_t>(i)];
    double lowest = 1e9;
    for (const Vector3& p : splint.vertices_mm)
      if ((p - at).cross(arch.up).norm() < 1.5) lowest = std::min(lowest, arch.up.dot(p - at));
    EXPECT_LT(std::abs(lowest), 1.0) << "the built splint does not end at the margin";
  }
  // Seen on the lower teeth, and the upper jaw comes to it as in TP: they do not lie in one another.
  const auto& shown = h.window.document().layers();
  const Rigid3 t = *h.window.document().state().therapeutic;
  EXPECT_LT((shown.find("maxilla")->pose.matrix() - t.inverse().matrix()).norm(), 1e-9);
  EXPECT_TRUE(shown.shows("mandible_mi"));
  EXPECT_FALSE(shown.shows("mandible_tp"));
  if (const char* keep = std::getenv("GNATHION_PICTURES")) h.whole().save(QString(keep) + "/lower.png");
  h.step(5);
  h.click("virtualPrint");
  auto* message = h.find<QLabel>("messageText");
  EXPECT_TRUE(message->isVisible() && message->text().contains("upper teeth")) << message->text().toStdString();
  h.step(3);
  EXPECT_LT((shown.find("maxilla")->pose.matrix() - Matrix4::Identity()).norm(), 1e-9);
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
    // Every result cut short or overwritten: the scans show, and each step says what it cannot read.
    const fs::path cut = folder_ / "cut";
    fs::create_directories(cut / "results");
    fs::copy(folder_ / "scans", cut / "scans");
    ASSERT_TRUE(write_file(cut / "case.toml", kCase));
    for (const char* name : {"T_th.json", "design.json", "frames.json", "motion.mcap", "motion.csv", "splint.stl"})
      ASSERT_TRUE(write_file(cut / "results" / name, "{\"kind\":"));
    Hands h(cut);
    auto* message = h.find<QLabel>("messageText");
    EXPECT_TRUE(message->isVisible() && message->text().contains("Opened with what is there"))
        << message->text().toStdString();
    EXPECT_TRUE(h.window.document().layers().find("maxilla"));
    for (int i = 0; i < 6; ++i) {
      h.step(i);
      keep_picture(h.window, ("cut_" + std::to_string(i)).c_str());
    }
    h.step(3);
    EXPECT_TRUE(h.wait([&] { return h.find<QLabel>("feasibilityVerdict")->text().contains("Set T_th first"); }));
    std::string told;
    for (const Absence& a : h.window.document().content().absences)
      if (a.broken) told += a.what + " (" + a.why + "); ";
    for (const char* name : {"T_th", "splint", "design", "frames", "motion"})
      EXPECT_NE(told.find(name), std::string::npos) << name << " is broken, and not told: " << told;
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
  // A T_th that was kept as the case's own follows the case's results, which may have changed since.
  auto kept = read_json(folder_ / "viewer.json");
  ASSERT_TRUE(kept);
  (*kept)["therapeutic"]["source"]["from"] = "results/T_th.json";
  ASSERT_TRUE(write_json(folder_ / "viewer.json", *kept));
  {
    Hands h(folder_);
    const Document& document = h.window.document();
    ASSERT_TRUE(document.content().therapeutic);
    EXPECT_EQ(document.state().therapeutic->matrix(), document.content().therapeutic->motion.rigid.matrix());
    h.window.close();
  }
  EXPECT_EQ(*read_json(folder_ / "viewer.json"), *kept) << "written though nothing was decided";

  ASSERT_TRUE(write_file(folder_ / "viewer.json", "{\"kind\":"));
  Hands broken(folder_);
  EXPECT_TRUE(broken.find<QLabel>("messageText")->isVisible());
  EXPECT_TRUE(broken.window.document().state().therapeutic.has_value());
  EXPECT_TRUE(std::filesystem::exists(folder_ / "viewer.json.refused"));
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
