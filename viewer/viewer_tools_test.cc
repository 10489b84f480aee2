// The window's tools, by mouse and keys: measuring, edits, two designs, residuals of a registration, views,
// screenshots, and what holds everywhere: no dialogs for errors, no cut labels.
#include <QAbstractButton>
#include <QComboBox>
#include <QDoubleSpinBox>
#include <QHeaderView>
#include <QLineEdit>
#include <QListWidget>
#include <QPushButton>
#include <QStatusBar>
#include <QTabWidget>
#include <QTableWidget>

#include "calibration/chain_json.h"
#include "viewer/viewer_hands.h"
#include "viewer/widgets/frames_view.h"
#include "viewer/widgets/parts.h"

namespace gnathion {
namespace {

/// The number at the beginning of "20.03 mm", or after "Measured: ".
double number_in(const QString& text) {
  QRegExp number("(-?\\d+\\.?\\d*)");
  return number.indexIn(text) >= 0 ? number.cap(1).toDouble() : NAN;
}

void keep(Hands& h, const char* name) {
  if (const char* folder = std::getenv("GNATHION_PICTURES"))
    h.whole().save(QString("%1/%2.png").arg(folder, name));
}

void click_tab(Hands& h, int i) {
  auto* tabs = h.find<QTabWidget>("designTabs");
  QTest::mouseClick(tabs->tabBar(), Qt::LeftButton, {}, tabs->tabBar()->tabRect(i).center());
}

TEST_F(ViewerTest, DistanceAngleAndWallAreMeasuredIn3dAndInTheSection) {
  Hands h(folder_);
  h.tool("view_upper_occlusal");
  h.click("eye_mandible_tp");
  h.settle();
  QWidget* scene = h.window.scene().widget();
  const auto click_at = [&](const Vector3& p) {
    const auto px = h.window.scene().project(p);
    ASSERT_TRUE(px);
    QTest::mouseClick(scene, Qt::LeftButton, {}, px->toPoint());
  };
  const auto told = [&] { return h.window.statusBar()->currentMessage(); };
  QTest::keyClick(&h.window, Qt::Key_D);
  click_at({-10, 3, -4});
  click_at({10, 3, -4});
  EXPECT_NEAR(number_in(told()), 20.0, 0.4) << told().toStdString();
  QTest::keyClick(&h.window, Qt::Key_A);
  click_at({-15, 0, -4});
  click_at({0, 0, -4});
  click_at({0, 10, -4});
  EXPECT_TRUE(told().endsWith("°"));
  EXPECT_NEAR(number_in(told()), 90.0, 2.5) << told().toStdString();
  QTest::keyClick(&h.window, Qt::Key_W);
  const QImage before = h.picture();
  click_at({5, 3, -4});
  EXPECT_TRUE(told().endsWith("mm thick"));
  EXPECT_NEAR(number_in(told()), 3.0, 0.02) << told().toStdString();
  EXPECT_GT(difference(before, h.picture()).pixels, 100) << "the figure does not stand in the scene";
  keep(h, "measured_3d");

  auto* section = h.find<ProfilePlot>("section");
  // Across the bar, which the plane of the molars does not meet.
  h.window.scene().set_plane({{0, 3, -2.5}, {0, 1, 0}, {0, 0, 1}}, {0, 0, 1});
  h.tool("sectionAction");
  ASSERT_TRUE(h.wait([&] { return points_of(*section, "Splint") > 3; }));
  // The longest edge of the bar's profile: a click on its middle measures across it.
  Eigen::Vector2d middle(0, 0), edge(0, 0);
  for (const PlotCurve& c : section->curves())
    if (c.name == "Splint")
      for (const Polyline2& line : c.lines)
        for (std::size_t i = 0; i + 1 < line.size(); ++i)
          if ((line[i + 1] - line[i]).norm() > edge.norm())
            edge = line[i + 1] - line[i], middle = 0.5 * (line[i] + line[i + 1]);
  ASSERT_GT(edge.norm(), 2.0);
  const auto in_plot = [&](const Eigen::Vector2d& p) {
    QTest::mouseClick(section, Qt::LeftButton, {}, section->to_widget(p).toPoint());
  };
  in_plot(middle);  // the tool of the wall is still in the hand
  EXPECT_TRUE(section->measured().endsWith("mm thick")) << section->measured().toStdString();
  EXPECT_NEAR(number_in(section->measured()), 3.0, 0.02) << section->measured().toStdString();
  QTest::keyClick(&h.window, Qt::Key_D);
  in_plot(middle - 0.3 * edge);
  in_plot(middle + 0.3 * edge);
  EXPECT_NEAR(number_in(section->measured()), 0.6 * edge.norm(), 0.15);
  in_plot(middle);
  EXPECT_TRUE(section->measured().isEmpty()) << "a third click begins anew";
  QTest::keyClick(&h.window, Qt::Key_A);
  const Eigen::Vector2d across(-edge.y(), edge.x());
  in_plot(middle - 0.3 * edge);
  in_plot(middle);
  in_plot(middle + 8.0 * across.normalized());
  EXPECT_NEAR(number_in(section->measured()), 90.0, 6.0) << section->measured().toStdString();
  keep(h, "measured_2d");
  QTest::keyClick(&h.window, Qt::Key_Escape);
  EXPECT_TRUE(section->measured().isEmpty());
}

TEST_F(ViewerTest, EachKindOfEditIsDrawnListedAndUndone) {
  Hands h(folder_);
  h.tool("view_upper_occlusal");
  h.click("eye_mandible_tp");
  h.settle();
  click_tab(h, 2);
  QWidget* scene = h.window.scene().widget();
  const auto px = [&](double x, double y) { return h.window.scene().project({x, y, -4})->toPoint(); };
  const auto& edits = h.window.document().state().edits;
  auto* list = h.find<QListWidget>("editList");
  const QImage before = h.picture();
  for (const char* kind : {"Remove", "Smooth"}) {
    h.click((std::string("edit_") + kind).c_str());
    h.drag(scene, px(-12, 3), px(12, 3));
  }
  ASSERT_EQ(edits.strokes.size(), 2u);
  for (const char* kind : {"Cutout", "Contact"}) {
    h.click((std::string("edit_") + kind).c_str());
    const double x = kind == std::string("Cutout") ? -15 : 8;
    // Once around a field of 8 by 6 mm, the button held.
    QTest::mousePress(scene, Qt::LeftButton, {}, px(x, 0));
    const std::pair<double, double> corners[] = {{x, 0}, {x + 8, 0}, {x + 8, 6}, {x, 6}, {x, 0}};
    for (int k = 0; k < 4; ++k)
      for (int i = 1; i <= 8; ++i) {
        const QPoint to = px(corners[k].first + (corners[k + 1].first - corners[k].first) * i / 8,
                             corners[k].second + (corners[k + 1].second - corners[k].second) * i / 8);
        QMouseEvent move(QEvent::MouseMove, to, scene->mapToGlobal(to), Qt::NoButton, Qt::LeftButton, {});
        QApplication::sendEvent(scene, &move);
      }
    QTest::mouseRelease(scene, Qt::LeftButton, {}, px(x, 0));
  }
  EXPECT_EQ(list->count(), 4) << "not every edit stands in the list";
  keep(h, "edits");
  EXPECT_GT(difference(before, h.picture()).pixels, 600) << "the edits are not to be seen";
  QTest::keyClick(&h.window, Qt::Key_Escape);
  for (int i = 0; i < 4; ++i) QTest::keyClick(&h.window, Qt::Key_Z, Qt::ControlModifier);
  EXPECT_TRUE(edits.empty()) << "four strokes, four steps of undo";
  EXPECT_TRUE(list->item(0)->text().startsWith("No edits")) << "the list still has them";
}

TEST_F(ViewerTest, TwoDesignsSideBySideOverEachOtherAndAsADifference) {
  TriangleMesh larger = bar();
  for (Vector3& v : larger.vertices_mm)
    v += 0.2 * Vector3(v.x() > 0 ? 1 : -1, v.y() > 3 ? 1 : -1, v.z() > -2.5 ? 1 : -1);
  fs::create_directories(folder_ / "designs" / "design_001");
  ASSERT_TRUE(write_mesh(folder_ / "designs" / "design_001" / "splint.stl", larger));
  Hands h(folder_);
  fs::remove(folder_ / "viewer.json");
  click_tab(h, 2);
  auto* other = h.find<QComboBox>("compareWith");
  auto* mode = h.find<QComboBox>("compareMode");
  other->setFocus();
  QTest::keyClick(other, Qt::Key_Down);
  ASSERT_EQ(other->currentText(), "designs/design_001");
  const auto& layers = h.window.document().layers();
  const auto next_mode = [&] {
    mode->setFocus();
    QTest::keyClick(mode, Qt::Key_Down);
  };

  next_mode();
  Scene3d& second = h.window.second_scene();
  ASSERT_TRUE(second.widget()->isVisible());
  const Vector3 corner(30, 12, -1);
  EXPECT_TRUE(h.wait([&] { return second.settled() && second.surface("splint"); }));
  h.settle();
  const auto same_camera = [&] {
    const auto a = h.window.scene().project(corner), b = second.project(corner);
    if (!a || !b) return 1e9;
    // From the middle of each view.
    const QPointF d = *a - QRectF(h.window.scene().widget()->rect()).center() - *b +
                      QRectF(second.widget()->rect()).center();
    return std::hypot(d.x(), d.y());
  };
  EXPECT_LT(same_camera(), 4.0);
  EXPECT_NEAR(second.widget()->width(), h.window.scene().widget()->width(), 4);
  const QImage before = second.picture();
  QWidget* scene = h.window.scene().widget();
  h.drag(scene, scene->rect().center(), scene->rect().center() + QPoint(60, 15));
  h.settle();
  EXPECT_TRUE(h.wait([&] { return second.settled(); }));
  EXPECT_GT(difference(before, second.picture()).pixels, 3000) << "the second view does not turn with it";
  EXPECT_LT(same_camera(), 4.0) << "the cameras are not one";
  keep(h, "side_by_side");

  next_mode();
  EXPECT_FALSE(second.widget()->isVisible());
  ASSERT_TRUE(h.wait([&] { return layers.find("other") != nullptr; }));
  h.settle();
  keep(h, "over_each_other");

  next_mode();
  ASSERT_TRUE(h.wait([&] { return layers.find("difference") != nullptr; }));
  EXPECT_EQ(layers.find("other"), nullptr);
  const QString facts = h.find<QLabel>("compareFacts")->text();
  EXPECT_TRUE(facts.startsWith("mean 0.200 mm, largest 0.20 mm")) << facts.toStdString();
  h.settle();
  const QImage map = h.picture();
  h.click("eye_difference");
  const Difference shown = difference(map, h.picture());
  EXPECT_GT(shown.pixels, 1000);
  int blue = 0;
  for (int y = 0; y < map.height(); ++y)
    for (int x = 0; x < map.width(); ++x) {
      const QColor c(map.pixel(x, y));
      blue += c.blue() > c.red() + 50;
    }
  EXPECT_GT(blue, 1000) << "the shown design is smaller everywhere: blue";
  h.click("eye_difference");
  keep(h, "difference");

  // A choice that is taken back while the other design is still read leaves nothing behind.
  QTest::keyClick(mode, Qt::Key_Up);
  QTest::keyClick(mode, Qt::Key_Home);
  EXPECT_EQ(mode->currentIndex(), 0);
  EXPECT_TRUE(h.wait([&] { return !h.window.jobs().any(); }));
  EXPECT_EQ(layers.find("other"), nullptr);
  EXPECT_EQ(layers.find("difference"), nullptr);
  fs::remove_all(folder_ / "designs");
}

TEST_F(ViewerTest, RegistrationsShowResidualsWeakDirectionAndTheGraph) {
  // The lower jaw stands for bow and clutch: a real registration of two surfaces, whose answer is known.
  const fs::path scans = folder_ / "scans", toml = folder_ / "case.toml";
  const auto lower = read_mesh(scans / "mandible.ply");
  ASSERT_TRUE(lower);
  const Rigid3 bow_from_dental = Rigid3::about_axis({5, 20, 0}, {0.1, 0.2, 1}, 0.3);
  ASSERT_TRUE(write_mesh(scans / "bow.stl", transformed(bow_from_dental, *lower)));
  ASSERT_TRUE(
      write_mesh(scans / "clutch.ply", transformed(Rigid3::about_axis({0, 10, 0}, {1, 0, 0}, 0.2), *lower)));
  ASSERT_TRUE(write_file(
      toml,
      std::string(kCase) + "mandible_clutch = \"scans/clutch.ply\"\n[bodies]\nbow = \"scans/bow.stl\"\n"));
  Chain chain;
  chain.has_faces = false;
  chain.bow_from_dental.value = bow_from_dental;
  chain.bow_from_dental.covariance = Matrix6::Identity() * 1e-6;
  chain.bow_from_dental.rms_mm = 0.012;
  chain.bow_from_dental.weak = {"rotation about the bow's long axis is weak: 0.06 deg"};
  ASSERT_TRUE(write_json(folder_ / "results" / "chain.json", chain_json(chain)));
  {
    Hands h(folder_);
    h.step(2);
    EXPECT_TRUE(h.find<QLabel>("calibrateStatusText")->text().contains("0.012 mm RMS"));
    const QImage before = h.picture();
    auto* rows = h.find<QTableWidget>("registrationTable");
    ASSERT_GE(rows->rowCount(), 2);
    QTest::mouseClick(rows->viewport(), Qt::LeftButton, {}, rows->visualItemRect(rows->item(0, 0)).center());
    const auto& layers = h.window.document().layers();
    ASSERT_TRUE(h.wait([&] { return layers.find("overlay_source") != nullptr; }));
    const Layer* source = layers.find("overlay_source");
    // The registration found the pose, so that the clutch scan lies on the bow.
    double worst = 0;
    for (std::size_t i = 0; i < lower->vertices_mm.size(); i += 97)
      worst = std::max(worst, (source->pose * source->mesh->vertices_mm[i] - lower->vertices_mm[i]).norm());
    EXPECT_LT(worst, 0.05);
    EXPECT_TRUE(h.find<QLabel>("registrationFacts")->text().contains("long axis is weak"));
    EXPECT_GT(difference(before, h.picture()).pixels, 8000) << "the residual map is not to be seen";
    keep(h, "registration");
    // Its histogram is shown large by a click, and put away by Esc.
    auto* chart = h.find<ChartView>("residualHistogram");
    ASSERT_TRUE(h.wait([&] { return chart->has_drawing(); }));
    h.click(chart);
    auto* large = h.find<ChartView>("largeChart");
    EXPECT_TRUE(large->isVisible());
    EXPECT_GT(large->width(), 3 * chart->width());
    keep(h, "large_chart");
    QTest::keyClick(&h.window, Qt::Key_Escape);
    EXPECT_FALSE(large->isVisible());
    // The arrows of the weakest direction are vermilion, and in front of the surfaces.
    int vermilion = 0;
    const QImage image = h.picture();
    for (int y = 0; y < image.height(); ++y)
      for (int x = 0; x < image.width(); ++x) {
        const QColor c(image.pixel(x, y));
        vermilion += c.red() > 150 && c.red() > c.green() + 60 && c.green() > c.blue() + 30;
      }
    EXPECT_GT(vermilion, 150) << "no arrows";
    // An edge of the graph, clicked in its middle: the facts name it.
    auto* graph = h.find<FramesView>("framesView");
    bool named = false;
    for (int x = 10; x < graph->width() && !named; x += 6)
      for (int y = 10; y < graph->height() && !named; y += 12) {
        QTest::mouseClick(graph, Qt::LeftButton, {}, QPoint(x, y));
        named = h.find<QLabel>("registrationFacts")->text().contains("bow") &&
                !h.find<QLabel>("registrationFacts")->text().contains("forecast");
      }
    EXPECT_TRUE(named) << "no edge of the graph answers a click";
  }
  fs::remove(folder_ / "results" / "chain.json");
  ASSERT_TRUE(write_file(toml, kCase));
}

TEST_F(ViewerTest, ScansAreEvaluatedHereAndEachChartIsSeen) {
  // A surface that fits onto itself in one way only, as its plan and as its scan: what is measured is
  // nothing.
  fs::copy_file(folder_ / "results" / "splint.stl", folder_ / "bar.stl");
  ASSERT_TRUE(write_mesh(folder_ / "results" / "splint.stl", *read_mesh(folder_ / "scans" / "mandible.ply")));
  Hands h(folder_);
  h.step(5);
  h.type(h.find<QLineEdit>("scanSplint"), (folder_ / "results" / "splint.stl").c_str());
  h.type(h.find<QLineEdit>("scanMaxilla"), (folder_ / "scans" / "maxilla.ply").c_str());
  h.click("evaluateScans");
  auto* charts = h.find<QComboBox>("chartBox");
  auto* message = h.find<QLabel>("messageText");
  ASSERT_TRUE(h.wait([&] { return charts->count() > 0 || message->isVisible(); }));
  ASSERT_GT(charts->count(), 0) << message->text().toStdString();
  auto* procedures = h.find<QTableWidget>("procedureTable");
  ASSERT_GT(procedures->rowCount(), 0);
  for (int row = 0; row < procedures->rowCount(); ++row) {
    EXPECT_LT(std::abs(number_in(procedures->item(row, 1)->text().replace(QChar(0x2212), '-'))), 0.01);
    QTest::mouseClick(procedures->viewport(), Qt::LeftButton, {},
                      procedures->visualItemRect(procedures->item(row, 0)).center());
    const QString facts = h.find<QLabel>("procedureFacts")->text();
    EXPECT_TRUE(facts.contains(procedures->item(row, 0)->text())) << facts.toStdString();
  }
  // Down the list by the keyboard: every chart is another picture, and none is empty.
  auto* chart = h.find<ChartView>("evaluationChart");
  charts->setFocus();
  QStringList names;
  QImage last;
  for (int i = 0; i < charts->count(); ++i) {
    if (i > 0) QTest::keyClick(charts, Qt::Key_Down);
    ASSERT_EQ(charts->currentIndex(), i);
    names << charts->currentText().toLower();
    EXPECT_TRUE(chart->has_drawing());
    const QImage image = chart->grab().toImage().convertToFormat(QImage::Format_RGB32);
    EXPECT_NE(image, last) << names.back().toStdString();
    last = image;
    keep(h, ("chart_" + std::to_string(i)).c_str());
  }
  for (const char* wanted : {"error", "radar", "histogram", "profile"})
    EXPECT_FALSE(names.filter(wanted).empty()) << wanted << " in " << names.join(", ").toStdString();
  fs::rename(folder_ / "bar.stl", folder_ / "results" / "splint.stl");
}

TEST_F(ViewerTest, NamedViewsScreenshotsAndKeys) {
  Hands h(folder_);
  std::vector<QImage> seen;
  for (int i = 0; i < 7; ++i) {
    QTest::keyClick(&h.window, static_cast<Qt::Key>(Qt::Key_1 + i));
    seen.push_back(h.picture());
    for (std::size_t k = 0; k + 1 < seen.size(); ++k)
      EXPECT_GT(difference(seen[k], seen.back()).pixels, 2000) << "views " << k + 1 << " and " << i + 1;
  }
  for (int i = 0; i < 6; ++i) {
    QTest::keyClick(&h.window, static_cast<Qt::Key>(Qt::Key_1 + i), Qt::ControlModifier);
    EXPECT_EQ(h.find<QTabBar>("steps")->currentIndex(), i);
  }
  QTest::keyClick(&h.window, Qt::Key_S, Qt::ControlModifier);
  const fs::path shot = folder_ / "screenshots" / "screenshot_001.png";
  ASSERT_TRUE(h.wait([&] { return fs::exists(shot); }));
  const QImage saved(QString::fromStdString(shot.string()));
  EXPECT_EQ(saved.size(), h.window.size() * h.window.devicePixelRatioF());
  fs::remove_all(folder_ / "screenshots");
  QTest::keyClick(&h.window, Qt::Key_F1);
  auto* sheet = h.find<QLabel>("shortcutSheet");
  EXPECT_TRUE(sheet->isVisible());
  EXPECT_FALSE(sheet->isModal());
  QTest::keyClick(&h.window, Qt::Key_Escape);
  EXPECT_FALSE(sheet->isVisible());
}

TEST_F(ViewerTest, ClosingWhileASplintIsBuiltLosesNothing) {
  {
    Hands h(folder_);
    click_tab(h, 1);
    h.type(h.find<QDoubleSpinBox>("parameter_wall_mm"), "1.85");
    h.click("buildSplint");
    EXPECT_TRUE(h.window.jobs().busy());
    h.window.close();
    EXPECT_EQ(QApplication::activeModalWidget(), nullptr);
  }
  EXPECT_TRUE(!fs::exists(folder_ / "designs") || fs::is_empty(folder_ / "designs"))
      << "half a design was left";
  Hands again(folder_);
  EXPECT_NEAR(again.window.document().state().parameters.wall_mm, 1.85, 1e-9);
}

TEST_F(ViewerTest, NoLabelIsCut) {
  Hands h(folder_);
  for (int step = 0; step < 6; ++step) {
    h.step(step);
    QStringList cut;
    for (QWidget* w : h.window.findChildren<QWidget*>()) {
      if (!w->isVisibleTo(&h.window) || w->width() == 0) continue;
      int wanted = 0;
      QString text;
      if (const auto* label = qobject_cast<QLabel*>(w)) {
        text = label->text();
        if (text.isEmpty() || label->wordWrap()) {
          // Of wrapped text the height is what may be too little.
          if (!text.isEmpty() && label->heightForWidth(w->width()) > w->height() + 1)
            cut << w->objectName() + ": " + text;
          continue;
        }
        wanted = label->sizeHint().width();
      } else if (const auto* button = qobject_cast<QAbstractButton*>(w)) {
        text = button->text();
        if (text.isEmpty()) continue;
        wanted = w->fontMetrics().horizontalAdvance(text.remove('&'));
      } else if (const auto* box = qobject_cast<QComboBox*>(w)) {
        text = box->currentText();
        wanted = w->fontMetrics().horizontalAdvance(text) + 20;  // and its arrow
      }
      if (wanted > w->width() + 1)
        cut << QString("%1: '%2' needs %3 of %4").arg(w->objectName(), text).arg(wanted).arg(w->width());
    }
    for (auto* table : h.window.findChildren<QTableWidget*>()) {
      if (!table->isVisibleTo(&h.window)) continue;
      for (int c = 0; c < table->columnCount(); ++c) {
        const QString text = table->horizontalHeaderItem(c)->text();
        if (table->fontMetrics().horizontalAdvance(text) + 6 > table->columnWidth(c))
          cut << table->objectName() + ": " + text;
        for (int r = 0; r < table->rowCount(); ++r) {
          const int lines = std::max(1, table->rowHeight(r) / table->fontMetrics().lineSpacing());
          if (const auto* item = table->item(r, c);
              item &&
              table->fontMetrics().horizontalAdvance(item->text()) + 6 > lines * table->columnWidth(c))
            cut << table->objectName() + ": " + item->text();
        }
      }
    }
    EXPECT_TRUE(cut.isEmpty()) << "step " << step + 1 << ": " << cut.join("; ").toStdString();
    keep(h, QString("step_%1_at_%2").arg(step + 1).arg(h.window.devicePixelRatioF()).toUtf8().constData());
  }
}

/// Errors stand in the window's bar. The one modal thing is the choice of a file, which the user asks for.
TEST(ViewerSources, NoDialogForAnError) {
  int read = 0;
  for (const auto& entry : fs::recursive_directory_iterator("viewer")) {
    const std::string name = entry.path().filename().string();
    if (entry.path().extension() != ".cc" || name.find("_test.cc") != std::string::npos) continue;
    const auto text = read_file(entry.path());
    ASSERT_TRUE(text);
    ++read;
    for (const char* word :
         {"QMessageBox", "QErrorMessage", "QDialog ", "QInputDialog", "setModal", "setWindowModality"})
      EXPECT_EQ(text->find(word), std::string::npos) << name << " has " << word;
    if (name.find("_main.cc") == std::string::npos) {
      EXPECT_EQ(text->find("exec()"), std::string::npos) << name << " blocks";
    }
  }
  EXPECT_GT(read, 30);
}

}  // namespace
}  // namespace gnathion
