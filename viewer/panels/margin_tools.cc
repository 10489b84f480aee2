#include "viewer/panels/margin_tools.h"

#include <QHBoxLayout>
#include <QShortcut>
#include <QToolButton>

#include <algorithm>
#include <cmath>

#include "rendering/charts.h"
#include "viewer/widgets/parts.h"

namespace gnathion {
namespace {

constexpr double kNearPx = 9.0;  ///< a point or a segment is under the mouse
constexpr double kDrapeStepMm = 0.4, kDrapeReachMm = 2.0;
constexpr int kMergeDrag = 300;
constexpr const char* kHint =
    "Click along the gum line; drag a point to move it, click the line to put one in between, Delete takes "
    "the "
    "chosen one away, Enter begins another curve.";

double distance_px(const QPointF& p, const QPointF& a, const QPointF& b) {
  const QPointF ab = b - a, ap = p - a;
  const double length2 = QPointF::dotProduct(ab, ab);
  const double t = length2 > 0 ? std::clamp(QPointF::dotProduct(ap, ab) / length2, 0.0, 1.0) : 0.0;
  const QPointF d = ap - t * ab;
  return std::hypot(d.x(), d.y());
}

}  // namespace

MarginTools::MarginTools(Workbench& bench) : bench_(bench) {
  setObjectName("marginTools");
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  auto* row = new QHBoxLayout;
  draw_ = new QToolButton;
  draw_->setObjectName("drawMargin");
  draw_->setText("Draw margin");
  draw_->setCheckable(true);
  draw_->setToolTip(
      "Where the splint ends on the crowns, in place of the cutting plane. Splint and opposing jaw "
      "are hidden while it is drawn");
  draw_->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
  connect(draw_, &QToolButton::clicked, this, [this](bool on) { on ? take_up() : put_down(); });
  next_ = button("Next curve", "nextMargin", "The next click begins another curve (Enter)",
                 [this] { end_curve(); });
  remove_ = button("Remove", "removeMargin", "Takes the chosen curve away, or the last one",
                   [this] { remove_curve(); });
  row->addWidget(draw_, 1);
  row->addWidget(next_);
  row->addWidget(remove_);
  column->addLayout(row);
  facts_ = wrapped("", true);
  facts_->setObjectName("marginFacts");
  column->addWidget(facts_);
  const auto key = [this](const QKeySequence& keys, auto what) {
    auto* shortcut = new QShortcut(keys, this);
    shortcut->setEnabled(false);  // Enter and Delete are others' while no margin is drawn
    connect(shortcut, &QShortcut::activated, this, [this, what] { (this->*what)(); });
    keys_.push_back(shortcut);
  };
  key(QKeySequence(Qt::Key_Delete), &MarginTools::remove_point);
  key(QKeySequence(Qt::Key_Backspace), &MarginTools::remove_point);
  key(QKeySequence(Qt::Key_Return), &MarginTools::end_curve);
  bench_.document.opened.add([this] {
    put_down();
    refresh();
  });
  bench_.document.state_changed.add([this] { refresh(); });
  bench_.document.layers().changed.add([this](const std::string& id, LayerChange change) {
    const bool jaw = id == "maxilla" || id == "mandible_tp" || id == "mandible_mi";
    if (jaw && change == LayerChange::kPose && shown_ && bench_.document.is_open()) refresh();
  });
  bench_.tool_taken.add([this](const void* who) {
    if (who != this) put_down();
  });
}

std::string MarginTools::arch_layer() const {
  return bench_.document.state().arch == Arch::kMaxilla ? "maxilla" : "mandible_mi";
}

void MarginTools::take_up() {
  LayerModel& layers = bench_.document.layers();
  if (!layers.find(arch_layer())) {
    draw_->setChecked(false);
    return bench_.document.report("There is no scan of the arch that wears the splint.");
  }
  bench_.tool_taken(this);
  at_work_ = true;
  for (QShortcut* k : keys_) k->setEnabled(true);
  draw_->setChecked(true);
  chosen_.reset();
  curve_.reset();
  first_mm_.reset();
  for (const char* id : {"splint", "mandible_tp", "mandible_mi", "maxilla"})
    if (id != arch_layer() && layers.shows(id)) {
      hidden_.push_back(id);
      layers.set_visible(id, false);
    }
  layers.set_visible(arch_layer(), true);
  bench_.scene.set_tool([this](const SceneMouse& m) { return mouse(m); });
  bench_.status(kHint);
  refresh();
}

void MarginTools::put_down() {
  if (!at_work_) return;
  at_work_ = dragging_ = false;
  for (QShortcut* k : keys_) k->setEnabled(false);
  draw_->setChecked(false);
  chosen_.reset();
  first_mm_.reset();
  bench_.scene.set_tool({});
  for (const std::string& id : hidden_) bench_.document.layers().set_visible(id, true);
  hidden_.clear();
  refresh();
}

std::optional<Vector3> MarginTools::on_arch(const QPointF& px) const {
  const auto hit = bench_.scene.pick_on(arch_layer(), px);
  if (!hit) return std::nullopt;
  const Layer* layer = bench_.document.layers().find(arch_layer());
  return layer->pose.inverse() * hit->at_mm;
}

std::optional<MarginTools::At> MarginTools::point_at(const QPointF& px) const {
  const auto& margins = bench_.document.state().edits.margins;
  std::optional<At> best;
  double nearest = kNearPx;
  for (std::size_t c = 0; c < margins.size(); ++c)
    for (std::size_t i = 0; i < margins[c].points_mm.size(); ++i) {
      const auto at =
          bench_.scene.project(shown_from_arch(arch_of(margins[c].points_mm)) * margins[c].points_mm[i]);
      if (!at) continue;
      const double d = std::hypot(at->x() - px.x(), at->y() - px.y());
      if (d < nearest) nearest = d, best = At{c, i};
    }
  return best;
}

std::optional<MarginTools::At> MarginTools::segment_at(const QPointF& px) const {
  const auto& margins = bench_.document.state().edits.margins;
  std::optional<At> best;
  double nearest = kNearPx;
  for (std::size_t c = 0; c < margins.size(); ++c)
    for (std::size_t i = 0; i + 1 < margins[c].points_mm.size(); ++i) {
      const std::vector<Vector3> line = draped({margins[c].points_mm[i], margins[c].points_mm[i + 1]});
      for (std::size_t k = 0; k + 1 < line.size(); ++k) {
        const auto a = bench_.scene.project(line[k]), b = bench_.scene.project(line[k + 1]);
        if (!a || !b) continue;
        const double d = distance_px(px, *a, *b);
        if (d < nearest) nearest = d, best = At{c, i};
      }
    }
  return best;
}

bool MarginTools::mouse(const SceneMouse& m) {
  if (m.kind == SceneMouse::Kind::kPress) {
    if (!point_at(m.px) && !on_arch(m.px)) return false;  // beside the arch: the camera's
    press(m);
    return true;
  }
  if (!dragging_) return false;
  if (m.kind == SceneMouse::Kind::kRelease) {
    dragging_ = false;
    bench_.document.end_merge();
    return true;
  }
  const auto to = on_arch(m.px);
  if (to && chosen_) {
    bench_.scene.note_motion();
    bench_.document.change(
        "Move a margin point",
        [&](SessionState& s) { s.edits.margins.at(chosen_->curve).points_mm.at(chosen_->point) = *to; },
        kMergeDrag);
  }
  return true;
}

void MarginTools::press(const SceneMouse& m) {
  dragging_ = true;
  if (const auto hit = point_at(m.px)) {
    chosen_ = hit;
    curve_ = hit->curve;
    return refresh();
  }
  const auto p = on_arch(m.px);
  if (!p) return;
  if (const auto hit = segment_at(m.px)) {
    bench_.document.change("Put a margin point in", [&](SessionState& s) {
      auto& points = s.edits.margins[hit->curve].points_mm;
      points.insert(points.begin() + static_cast<long>(hit->point) + 1, *p);
    });
    chosen_ = At{hit->curve, hit->point + 1};
    curve_ = hit->curve;
    return refresh();
  }
  add(*p);
}

/// At that end of the curve which was chosen last, or as the beginning of a new one.
void MarginTools::add(const Vector3& p) {
  const auto& margins = bench_.document.state().edits.margins;
  if (curve_ && *curve_ < margins.size()) {
    const bool in_front = chosen_ && chosen_->curve == *curve_ && chosen_->point == 0;
    const std::size_t c = *curve_;
    bench_.document.change("Set a margin point", [&](SessionState& s) {
      auto& points = s.edits.margins[c].points_mm;
      points.insert(in_front ? points.begin() : points.end(), p);
    });
    chosen_ = At{c, in_front ? 0 : bench_.document.state().edits.margins[c].points_mm.size() - 1};
  } else if (!first_mm_) {
    first_mm_ = p;
  } else {
    const Vector3 first = *first_mm_;
    first_mm_.reset();
    bench_.document.change("Begin a margin", [&](SessionState& s) {
      s.edits.margins.push_back({{first, p}});
    });
    curve_ = bench_.document.state().edits.margins.size() - 1;
    chosen_ = At{*curve_, 1};
  }
  refresh();
}

void MarginTools::remove_point() {
  if (first_mm_) {
    first_mm_.reset();
    return refresh();
  }
  const auto& margins = bench_.document.state().edits.margins;
  if (!chosen_ || chosen_->curve >= margins.size())
    return bench_.status("Click a point of the margin first.");
  const At at = *chosen_;
  const bool last = margins[at.curve].points_mm.size() <= 2;  // one point is no curve
  chosen_.reset();
  if (last) curve_.reset();
  bench_.document.change(last ? "Remove a margin" : "Remove a margin point", [&](SessionState& s) {
    if (last) return void(s.edits.margins.erase(s.edits.margins.begin() + static_cast<long>(at.curve)));
    auto& points = s.edits.margins[at.curve].points_mm;
    points.erase(points.begin() + static_cast<long>(at.point));
  });
}

void MarginTools::end_curve() {
  curve_.reset();
  chosen_.reset();
  first_mm_.reset();
  refresh();
}

void MarginTools::remove_curve() {
  const auto& margins = bench_.document.state().edits.margins;
  if (margins.empty()) return bench_.status("There is no margin curve to remove.");
  const std::size_t c = chosen_ && chosen_->curve < margins.size() ? chosen_->curve : margins.size() - 1;
  end_curve();
  bench_.document.change("Remove a margin", [&](SessionState& s) {
    s.edits.margins.erase(s.edits.margins.begin() + static_cast<long>(c));
  });
}

std::shared_ptr<const MeshQuery> MarginTools::surface_of(Arch arch) const {
  if (arch == Arch::kMaxilla) return bench_.scene.surface("maxilla");
  for (const char* id : {"mandible_mi", "mandible_tp"})  // the same scan
    if (auto surface = bench_.scene.surface(id)) return surface;
  return nullptr;
}

Arch MarginTools::arch_of(const std::vector<Vector3>& points) const {
  const Arch chosen = bench_.document.state().arch;
  const auto upper = surface_of(Arch::kMaxilla), lower = surface_of(Arch::kMandible);
  if (!upper || !lower) return chosen;
  double to_upper = 0, to_lower = 0;
  for (const Vector3& p : points)
    for (const auto& [surface, sum] : {std::pair{upper.get(), &to_upper}, {lower.get(), &to_lower}}) {
      const auto hit = surface->closest(p, kDrapeReachMm);
      *sum += hit ? (hit->point_mm - p).norm() : kDrapeReachMm;
    }
  if (to_upper == to_lower) return chosen;
  return to_upper < to_lower ? Arch::kMaxilla : Arch::kMandible;
}

Rigid3 MarginTools::shown_from_arch(Arch arch) const {
  const LayerModel& layers = bench_.document.layers();
  const bool in_tp = arch == Arch::kMandible && !layers.shows("mandible_mi") && layers.shows("mandible_tp");
  const Layer* layer = layers.find(arch == Arch::kMaxilla ? "maxilla" : in_tp ? "mandible_tp" : "mandible_mi");
  return layer ? layer->pose : Rigid3::identity();
}

/// The straight way between the points, laid on the surface, where it shows.
std::vector<Vector3> MarginTools::draped(const std::vector<Vector3>& points) const {
  const Arch arch = arch_of(points);
  const auto surface = surface_of(arch);
  const Rigid3 shown = shown_from_arch(arch);
  std::vector<Vector3> line;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const Vector3 &a = points[i], &b = points[i + 1];
    const int n = std::max(1, static_cast<int>(std::ceil((b - a).norm() / kDrapeStepMm)));
    for (int k = i == 0 ? 0 : 1; k <= n; ++k) {
      const Vector3 p = a + (b - a) * (static_cast<double>(k) / n);
      const auto hit = surface ? surface->closest(p, kDrapeReachMm) : std::nullopt;
      line.push_back(shown * (hit ? hit->point_mm : p));
    }
  }
  return line;
}

void MarginTools::show_margins(bool shown) {
  shown_ = shown;
  if (!shown) put_down();
  refresh();
}

void MarginTools::refresh() {
  const auto& margins = bench_.document.state().edits.margins;
  if (curve_ && *curve_ >= margins.size()) curve_.reset();  // undone
  if (chosen_ &&
      (chosen_->curve >= margins.size() || chosen_->point >= margins[chosen_->curve].points_mm.size()))
    chosen_.reset();
  std::size_t points = 0, others = 0;
  double length = 0;
  Overlay o;
  o.on_top = true;
  for (std::size_t c = 0; c < margins.size(); ++c) {
    points += margins[c].points_mm.size();
    others += arch_of(margins[c].points_mm) != bench_.document.state().arch;
    std::vector<Vector3> line = draped(margins[c].points_mm);
    for (std::size_t i = 0; i + 1 < line.size(); ++i) length += (line[i + 1] - line[i]).norm();
    o.lines.push_back({std::move(line), safe_palette::kBlue, 3.5});
    if (at_work_)
      for (std::size_t i = 0; i < margins[c].points_mm.size(); ++i)
        o.balls.push_back({shown_from_arch(arch_of(margins[c].points_mm)) * margins[c].points_mm[i],
                           chosen_ && *chosen_ == At{c, i} ? safe_palette::kVermilion : safe_palette::kBlue,
                           0.55});
  }
  if (first_mm_) o.balls.push_back({shown_from_arch(bench_.document.state().arch) * *first_mm_, safe_palette::kVermilion, 0.55});
  if (shown_ && (!o.lines.empty() || !o.balls.empty()))
    bench_.scene.set_overlay("margins", std::move(o));
  else
    bench_.scene.clear_overlay("margins");
  next_->setEnabled(at_work_ && (curve_ || first_mm_));
  remove_->setEnabled(!margins.empty());
  facts_->setText(at_work_          ? QString(kHint)
                  : margins.empty() ? "No margin drawn: the splint ends at the depth of the parameters."
                  : others > 0 ? QString("%1 drawn on the other jaw's crowns: not for this splint. Remove it, or "
                                         "choose that jaw.")
                                     .arg(others == 1 ? "A margin is" : "Margins are")
                                    : QString("%1 %2, %3 points, %4 mm; the splint ends there.")
                                          .arg(margins.size())
                                          .arg(margins.size() == 1 ? "curve" : "curves")
                                          .arg(points)
                                          .arg(length, 0, 'f', 1));
}

}  // namespace gnathion
