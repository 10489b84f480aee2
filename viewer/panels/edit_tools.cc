#include "viewer/panels/edit_tools.h"

#include <QButtonGroup>
#include <QDoubleSpinBox>
#include <QHBoxLayout>
#include <QListWidget>
#include <QShortcut>
#include <QToolButton>

#include "rendering/charts.h"
#include "viewer/widgets/parts.h"

namespace gnathion {
namespace {

constexpr double kStepMm = 0.4;  ///< between points of a stroke
constexpr Color kColors[] = {safe_palette::kGreen, safe_palette::kVermilion, safe_palette::kSky,
                             safe_palette::kPurple, safe_palette::kOrange};
constexpr const char* kNames[] = {"Add", "Remove", "Smooth", "Cutout", "Contact"};
constexpr const char* kTips[] = {
    "Wax on: drag over the splint to raise its outer surface", "Wax off: drag over the splint to lower it",
    "Smooth the outer surface along the stroke", "Drag around a region that the splint leaves free",
    "Drag around a region where contacts are kept; elsewhere the clearance holds"};

bool is_region(int tool) {
  return tool >= 3;
}

Overlay::Line line_of(std::vector<Vector3> points, int kind, bool closed) {
  if (closed && points.size() > 2) points.push_back(points.front());
  return {std::move(points), kColors[kind], 4.0};
}

}  // namespace

EditTools::EditTools(Workbench& bench) : bench_(bench), tools_(new QButtonGroup(this)) {
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  auto* row = new QHBoxLayout;
  row->setSpacing(2);
  tools_->setExclusive(false);
  for (int i = 0; i < 5; ++i) {
    auto* b = new QToolButton;
    b->setObjectName(QString("edit_") + kNames[i]);
    b->setText(kNames[i]);
    b->setToolTip(kTips[i]);
    b->setCheckable(true);
    b->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
    tools_->addButton(b, i);
    row->addWidget(b);
    connect(b, &QToolButton::clicked, this, [this, i](bool on) { on ? take_up(i) : put_down(); });
  }
  column->addLayout(row);
  auto* sizes = new QHBoxLayout;
  const auto spin = [&](const char* name, const char* object, double low, double high, double value) {
    auto* s = new QDoubleSpinBox;
    s->setObjectName(object);
    s->setRange(low, high);
    s->setDecimals(2);
    s->setSingleStep(0.1);
    s->setValue(value);
    s->setSuffix(" mm");
    sizes->addWidget(new QLabel(name));
    sizes->addWidget(s, 1);
    return s;
  };
  radius_ = spin("Radius", "strokeRadius", 0.5, 10, 2.0);
  depth_ = spin("Depth", "strokeDepth", 0.05, 1.0, 0.3);
  column->addLayout(sizes);
  list_ = new QListWidget;
  list_->setObjectName("editList");
  list_->setMaximumHeight(76);
  list_->setToolTip("Delete removes the chosen edit; undo brings it back");
  auto* remove = new QShortcut(QKeySequence(Qt::Key_Delete), list_);
  remove->setContext(Qt::WidgetShortcut);
  connect(remove, &QShortcut::activated, this, [this] { remove_selected(); });
  column->addWidget(list_);
  column->addWidget(
      button("Remove edit", "removeEdit", "Takes the chosen edit away", [this] { remove_selected(); }));
  bench_.document.opened.add([this] { refresh(); });
  bench_.document.state_changed.add([this] { refresh(); });
  bench_.tool_taken.add([this](const void* who) {
    if (who != this && tool_ >= 0) put_down();
  });
}

void EditTools::take_up(int tool) {
  bench_.tool_taken(this);
  tool_ = tool;
  for (QAbstractButton* b : tools_->buttons()) b->setChecked(tools_->id(b) == tool);
  drawing_mm_.clear();
  bench_.scene.set_tool([this](const SceneMouse& m) { return mouse(m); });
  bench_.status(kTips[tool]);
}

void EditTools::put_down() {
  if (tool_ < 0) return;
  tool_ = -1;
  for (QAbstractButton* b : tools_->buttons()) b->setChecked(false);
  bench_.scene.set_tool({});
  bench_.scene.clear_overlay("drawing");
}

bool EditTools::mouse(const SceneMouse& m) {
  if (m.kind == SceneMouse::Kind::kPress) {
    if (!m.at) return false;  // beside the surface: the camera's
    drawing_mm_ = {m.at->at_mm};
    return true;
  }
  if (drawing_mm_.empty()) return false;
  if (m.kind == SceneMouse::Kind::kRelease) {
    finish();
    return true;
  }
  if (!m.left_down) return false;
  if (m.at && (m.at->at_mm - drawing_mm_.back()).norm() > kStepMm) {
    drawing_mm_.push_back(m.at->at_mm);
    Overlay o;
    o.lines.push_back(line_of(drawing_mm_, tool_, false));
    bench_.scene.note_motion();
    bench_.scene.set_overlay("drawing", std::move(o));
  }
  return true;
}

void EditTools::finish() {
  std::vector<Vector3> path = std::move(drawing_mm_);
  drawing_mm_.clear();
  bench_.scene.clear_overlay("drawing");
  if (is_region(tool_) && path.size() < 3)
    return bench_.document.report("Draw around a region: press, drag along its outline, let go.");
  const double radius = radius_->value(), depth = std::min(depth_->value(), 0.5 * radius);
  bench_.document.change(QString(kNames[tool_]) + (is_region(tool_) ? "" : " stroke"), [&](SessionState& s) {
    if (tool_ == kCutout)
      s.edits.cutouts.push_back({path});
    else if (tool_ == kContact)
      s.edits.contacts.push_back({path});
    else
      s.edits.strokes.push_back({static_cast<Stroke::Kind>(tool_), path, radius, depth});
  });
}

void EditTools::show_edits(bool shown) {
  shown_ = shown;
  if (!shown) put_down();
  refresh();
}

void EditTools::refresh() {
  const SplintEdits& edits = bench_.document.state().edits;
  list_->clear();
  Overlay o;
  const auto add = [&](int kind, const std::vector<Vector3>& points, const QString& text) {
    list_->addItem(text);
    o.lines.push_back(line_of(points, kind, is_region(kind)));
    if (points.size() == 1) o.balls.push_back({points[0], kColors[kind], 0.5});
  };
  for (const Stroke& s : edits.strokes) {
    double length = 0;
    for (std::size_t i = 1; i < s.path_mm.size(); ++i) length += (s.path_mm[i] - s.path_mm[i - 1]).norm();
    const int kind = static_cast<int>(s.kind);
    add(kind, s.path_mm,
        QString("%1 %2 mm deep, %3 mm wide, %4 mm long")
            .arg(kNames[kind])
            .arg(s.depth_mm, 0, 'f', 2)
            .arg(2 * s.radius_mm, 0, 'f', 1)
            .arg(length, 0, 'f', 1));
  }
  for (const Region& r : edits.cutouts) add(kCutout, r.outline_mm, "Cutout");
  for (const Region& r : edits.contacts) add(kContact, r.outline_mm, "Contact region");
  const bool none = list_->count() == 0;
  if (none) list_->addItem("No edits yet: choose a tool and drag over the splint.");
  if (shown_ && !none)
    bench_.scene.set_overlay("edits", std::move(o));
  else
    bench_.scene.clear_overlay("edits");
}

void EditTools::remove_selected() {
  const int row = list_->currentRow();
  const SplintEdits& edits = bench_.document.state().edits;
  const std::size_t count = edits.strokes.size() + edits.cutouts.size() + edits.contacts.size();
  if (row < 0 || static_cast<std::size_t>(row) >= count)
    return bench_.document.report("Choose an edit in the list first.");
  bench_.document.change("Remove edit", [&](SessionState& s) {
    std::size_t i = static_cast<std::size_t>(row);
    const auto take = [&](auto& list) {
      if (i < list.size()) {
        list.erase(list.begin() + static_cast<long>(i));
        return true;
      }
      i -= list.size();
      return false;
    };
    (void)(take(s.edits.strokes) || take(s.edits.cutouts) || take(s.edits.contacts));
  });
}

}  // namespace gnathion
