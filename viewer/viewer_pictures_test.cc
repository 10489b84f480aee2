// Pictures of the scene against kept ones (viewer/reference), with a tolerance that is itself tested: what
// hides a layer or changes its colour must not pass. GNATHION_REFERENCES=1 writes them anew, to be looked at.
#include <QCheckBox>
#include <QTabWidget>

#include "viewer/viewer_hands.h"
#include "viewer/widgets/timeline.h"

namespace gnathion {
namespace {

constexpr int kSmaller = 4;        ///< kept pictures are that much smaller: edges of other drivers differ
const QSize kScene(616, 560);
constexpr int kColour = 20;        ///< of 255, the channel that differs most
constexpr double kPixels = 0.004;  ///< of the picture may differ by more

QImage small(const QImage& picture) {
  return picture.scaled(picture.size() / kSmaller, Qt::IgnoreAspectRatio, Qt::SmoothTransformation)
      .convertToFormat(QImage::Format_RGB32);
}

/// How much of the picture differs.
double differing(const QImage& a, const QImage& b) {
  if (a.size() != b.size()) return 1;
  int n = 0;
  for (int y = 0; y < a.height(); ++y)
    for (int x = 0; x < a.width(); ++x) {
      const QColor p(a.pixel(x, y)), q(b.pixel(x, y));
      n += std::max({std::abs(p.red() - q.red()), std::abs(p.green() - q.green()),
                     std::abs(p.blue() - q.blue())}) > kColour;
    }
  return 1.0 * n / (a.width() * a.height());
}

void compare(Hands& h, const char* name) {
  // What the scene shows is compared, not how much room fonts leave it.
  h.window.scene().widget()->setFixedSize(kScene);
  const QString path = QString("viewer/reference/%1.png").arg(name);
  const QImage seen = small(h.picture());
  if (std::getenv("GNATHION_REFERENCES")) {
    ASSERT_TRUE(seen.save(path));
    return;
  }
  const QImage kept = QImage(path).convertToFormat(QImage::Format_RGB32);
  ASSERT_FALSE(kept.isNull()) << path.toStdString();
  EXPECT_LE(differing(kept, seen), kPixels) << name << " is not what it was";

  // The comparison sees each layer go, and each colour change.
  LayerModel& layers = h.window.document().layers();
  const std::vector<Layer> shown = layers.layers();
  for (const Layer& layer : shown) {
    if (!layer.visible) continue;
    layers.set_visible(layer.id, false);
    EXPECT_GT(differing(kept, small(h.picture())), 2 * kPixels)
        << name << ": nobody would see that " << layer.id << " is missing";
    layers.set_visible(layer.id, true);
    Layer other = layer;
    if (layer.colors) {
      auto swapped = std::make_shared<VertexColors>(*layer.colors);
      for (auto& c : *swapped) std::swap(c[0], c[2]);
      layers.set_colors(layer.id, swapped);
    } else {
      std::swap(other.color_3d[0], other.color_3d[2]);
      layers.put(other);
    }
    EXPECT_GT(differing(kept, small(h.picture())), 2 * kPixels)
        << name << ": nobody would see that " << layer.id << " has another colour";
    layers.put(layer);
    if (layer.colors) layers.set_colors(layer.id, layer.colors);
  }
  EXPECT_LE(differing(kept, small(h.picture())), kPixels) << "what was changed is not changed back";
}

TEST_F(ViewerTest, PicturesAreThoseThatWereLookedAt) {
  Hands h(folder_);
  h.tool("view_oblique");
  compare(h, "design");
  h.step(3);
  h.tool("view_left");
  compare(h, "transformation");
  h.step(1);
  h.tool("view_front");
  auto* timeline = h.find<Timeline>("timeline");
  QTest::mouseClick(timeline, Qt::LeftButton, {},
                    QPoint(static_cast<int>(timeline->x_of(2.0)), timeline->height() / 2));
  compare(h, "motion");
}

TEST_F(ViewerTest, MapsAreThoseThatWereLookedAt) {
  Hands h(folder_);
  ASSERT_TRUE(h.wait([&] { return h.window.document().layers().find("thickness") != nullptr; }));
  h.wait([&] { return h.window.findChild<QWidget*>("eye_thickness") != nullptr; });
  h.click("eye_splint");
  h.click("eye_mandible_tp");
  h.click("eye_thickness");
  h.tool("view_upper_occlusal");
  compare(h, "thickness");
}

}  // namespace
}  // namespace gnathion
