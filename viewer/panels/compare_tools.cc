#include "viewer/panels/compare_tools.h"

#include <QComboBox>
#include <QGridLayout>
#include <QTimer>

#include <algorithm>
#include <cmath>

#include "core/mesh_io.h"
#include "rendering/charts.h"
#include "viewer/model/colour_maps.h"
#include "viewer/model/splint_maps.h"
#include "viewer/widgets/parts.h"

namespace gnathion {
namespace {

constexpr double kRangeMm = 0.5;

}  // namespace

CompareTools::CompareTools(Workbench& bench) : bench_(bench) {
  auto* grid = new QGridLayout(this);
  grid->setContentsMargins(0, 0, 0, 0);
  other_ = new QComboBox;
  other_->setObjectName("compareWith");
  other_->setToolTip("A design of this case: results, or a build kept in designs/");
  mode_ = new QComboBox;
  mode_->setObjectName("compareMode");
  mode_->addItems({"Not compared", "Side by side", "Over each other", "Difference map"});
  facts_ = wrapped("", true);
  facts_->setObjectName("compareFacts");
  grid->addWidget(other_, 0, 0);
  grid->addWidget(mode_, 0, 1);
  grid->addWidget(facts_, 1, 0, 1, 2);
  for (QComboBox* box : {other_, mode_})
    connect(box, qOverload<int>(&QComboBox::currentIndexChanged), this, [this] { show_mode(); });
  bench_.document.opened.add([this] { refresh(); });
}

void CompareTools::refresh() {
  if (!bench_.document.is_open()) return;
  const QString before = other_->currentText();
  const bool blocked = other_->blockSignals(true);
  other_->clear();
  namespace fs = std::filesystem;
  std::error_code ec;
  const CaseContent& c = bench_.document.content();
  if (fs::exists(c.results() / "splint.stl", ec))
    other_->addItem("results", QString::fromStdString((c.results() / "splint.stl").string()));
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(c.folder / "designs", ec))
    for (const char* file : {"splint.stl", "splint.rejected.stl"})
      if (fs::exists(entry.path() / file, ec)) found.push_back(entry.path() / file);
  std::sort(found.begin(), found.end());
  for (const fs::path& p : found)
    other_->addItem(QString::fromStdString("designs/" + p.parent_path().filename().string()),
                    QString::fromStdString(p.string()));
  const int at = other_->findText(before);
  if (at >= 0) other_->setCurrentIndex(at);
  other_->blockSignals(blocked);
  const bool any = other_->count() > 0;
  mode_->setEnabled(any);
  facts_->setText(any ? "" : "No second design yet: a full build keeps each one in designs/.");
}

void CompareTools::with_other(std::function<void(SharedMesh)> use) {
  const std::string path = other_->currentData().toString().toStdString();
  auto read = std::make_shared<Result<TriangleMesh>>(tl::unexpected<Error>(Error{}));
  bench_.jobs.run_latest(
      "compare", [path, read](JobContext&) { *read = read_mesh(path); },
      [this, path, mode = mode_->currentIndex(), read, use = std::move(use)] {
        if (mode != mode_->currentIndex() || path != other_->currentData().toString().toStdString())
          return;  // another choice by now
        if (!*read) return bench_.document.report(QString::fromStdString(read->error().line()));
        use(std::make_shared<const TriangleMesh>(std::move(**read)));
      });
}

void CompareTools::show_mode() {
  LayerModel& layers = bench_.document.layers();
  const auto mode = static_cast<Mode>(mode_->currentIndex());
  layers.remove("other");
  layers.remove("difference");
  bench_.scene.set_colour_scale(std::nullopt);
  bench_.show_second(mode == kSideBySide);
  facts_->clear();
  const Layer* splint = layers.find("splint");
  if (mode == kOff || !splint || other_->count() == 0) return;
  Layer look = *splint;
  look.visible = true;
  look.color_3d = {0.90, 0.62, 0.30};
  look.color_2d = safe_palette::kOrange;
  look.name = other_->currentText().toStdString();
  look.group = "Compared";
  if (mode == kSideBySide) {
    bench_.second_layers.clear();
    for (const char* id : {"maxilla", "mandible_tp", "mandible_mi"})
      if (const Layer* l = layers.find(id)) bench_.second_layers.put(*l);
    bench_.second.set_caption(other_->currentText());
    with_other([this, look](SharedMesh mesh) mutable {
      look.mesh = mesh;
      bench_.second_layers.put(std::move(look));
    });
  } else if (mode == kOver) {
    with_other([this, look](SharedMesh mesh) mutable {
      look.id = "other";
      look.mesh = mesh;
      look.opacity = 0.5;
      bench_.document.layers().put(std::move(look));
    });
  } else {
    with_other([this, look](SharedMesh other) mutable {
      auto values = std::make_shared<std::vector<float>>();
      bench_.jobs.run_latest(
          "difference",
          [mesh = look.mesh, other, values](JobContext&) { *values = difference_mm(*mesh, *other, 3.0); },
          [this, look, values]() mutable {
            if (mode_->currentIndex() != kDifference) return;
            look.id = "difference";
            look.name = "Difference";
            look.opacity = 1;
            look.in_section = false;
            look.colors = diverging_colors(*values, kRangeMm);
            bench_.document.layers().put(std::move(look));
            bench_.document.layers().set_visible("splint", false);
            bench_.scene.set_colour_scale(scale());
            double largest = 0, sum = 0, n = 0;
            for (const float v : *values)
              if (std::isfinite(v))
                largest = std::max(largest, double(std::abs(v))), sum += std::abs(v), n += 1;
            facts_->setText(QString("mean %1 mm, largest %2 mm; positive: the shown design stands out")
                                .arg(n > 0 ? sum / n : 0, 0, 'f', 3)
                                .arg(largest, 0, 'f', 2));
          });
    });
  }
}

ColourScale CompareTools::scale() {
  return {"difference, mm", -kRangeMm, kRangeMm, true};
}

void CompareTools::leave() {
  mode_->setCurrentIndex(kOff);
}

}  // namespace gnathion
