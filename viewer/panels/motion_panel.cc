#include "viewer/panels/motion_panel.h"

#include <QCheckBox>
#include <QComboBox>
#include <QElapsedTimer>
#include <QHBoxLayout>
#include <QHeaderView>

#include <algorithm>
#include <cmath>
#include <limits>

#include "calibration/chain_json.h"
#include "rendering/charts.h"
#include "tracking/plateaus.h"
#include "tracking/se3_mean.h"
#include "viewer/model/colour_maps.h"
#include "viewer/panels/daemon_row.h"

namespace gnathion {
namespace {

constexpr double kContactRangeMm = 1.0;

double down_mm(const Rigid3& t, const ArchFrame& arch) {
  return -arch.up.dot(t * arch.incisal_mm - arch.incisal_mm);
}

/// One decimal, and no "-0.0".
QString tenths(double mm) {
  return QString::number(std::abs(mm) < 0.05 ? 0.0 : mm, 'f', 1).replace('-', QChar(0x2212));
}

QString number_name(const std::string& name) {
  QString text = QString::fromStdString(name).replace('_', ' ');
  if (!text.isEmpty()) text[0] = text[0].toUpper();
  return text.replace(" mm", " mm");
}

}  // namespace

MotionPanel::MotionPanel(Workbench& bench) : Panel(bench, Step::kMotion) {
  setObjectName("motionPanel");
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(10, 8, 10, 8);
  column->addWidget(status_ = new StepStatus("motionStatus"));
  column->addWidget(new DaemonRow(bench_, Step::kMotion));
  column->addWidget(heading("Pick positions"));
  column->addWidget(
      wrapped("Click a violet bar (a rest that was found) on the timeline, or Shift-drag an interval; then "
              "say what it is.",
              true));
  auto* picks = new QHBoxLayout;
  picks->addWidget(button("This is MI", "pickMi", "The chosen interval is maximal intercuspation",
                          [this] { pick(false); }));
  picks->addWidget(button("This is TP", "pickTp", "The chosen interval is the therapeutic position",
                          [this] { pick(true); }));
  column->addLayout(picks);
  column->addWidget(heading("Numbers of the movement"));
  numbers_ = plain_table({"Figure", "Value", "± 1σ"}, "motionNumbers");
  numbers_->horizontalHeader()->setSectionResizeMode(0, QHeaderView::Stretch);
  numbers_->setColumnWidth(1, 88);
  numbers_->setColumnWidth(2, 48);
  numbers_->setWordWrap(true);
  column->addWidget(numbers_, 1);
  strip_ = make_strip();
  timer_.setInterval(33);
  connect(&timer_, &QTimer::timeout, this, [this] { step_play(); });
  document().opened.add([this] { opened(); });
  document().state_changed.add([this] { show_bands(); });
}

QWidget* MotionPanel::make_strip() {
  auto* strip = new QWidget;
  strip->setObjectName("motionStrip");
  auto* row = new QHBoxLayout(strip);
  row->setContentsMargins(0, 0, 0, 0);
  auto* left = new QVBoxLayout;
  auto* bar = new QHBoxLayout;
  play_ = button("▶ Play", "playButton", "Play the recording (space)", [this] {
    if (timer_.isActive())
      timer_.stop();
    else if (document().is_open() && document().content().motion)
      timer_.start();
    play_->setText(timer_.isActive() ? "❚❚ Pause" : "▶ Play");
  });
  play_->setFixedWidth(92);
  play_->setShortcut(QKeySequence(Qt::Key_Space));
  at_ = new QLabel;
  at_->setObjectName("motionTime");
  at_->setSizePolicy(QSizePolicy::Ignored, QSizePolicy::Fixed);
  contacts_ = new QCheckBox("Contacts by distance");
  contacts_->setObjectName("contactsBox");
  contacts_->setToolTip("Colours the lower teeth by their distance to the upper ones in this frame");
  connect(contacts_, &QCheckBox::toggled, this, [this] { color_contacts(); });
  paths_ = new QCheckBox("Paths in 3D");
  paths_->setObjectName("pathsBox");
  paths_->setChecked(true);
  connect(paths_, &QCheckBox::toggled, this, [this] { show_paths(); });
  bar->addWidget(play_);
  bar->addStretch();
  bar->addWidget(contacts_);
  bar->addWidget(paths_);
  timeline_ = new Timeline;
  timeline_->scrubbed = [this](double t) { go_to(t, false); };
  left->addLayout(bar);
  left->addWidget(at_);
  left->addWidget(timeline_, 1);
  posselt_ = new ProfilePlot;
  posselt_->setObjectName("posselt");
  posselt_->setFixedWidth(230);
  posselt_->set_note("The paths appear when a motion is there.");
  auto* right = new QVBoxLayout;
  plane_ = new QComboBox;
  plane_->setObjectName("posseltPlane");
  plane_->addItems({"Posselt, from the right", "Posselt, from the front", "Posselt, from above"});
  connect(plane_, qOverload<int>(&QComboBox::currentIndexChanged), this, [this] { show_posselt(); });
  right->addWidget(plane_);
  right->addWidget(posselt_, 1);
  row->addLayout(left, 1);
  row->addLayout(right);
  strip->setMinimumHeight(250);
  return strip;
}

void MotionPanel::opened() {
  timer_.stop();
  play_->setText("▶ Play");
  analysis_.reset();
  upper_.reset();
  condyles_mm_.reset();
  numbers_->setRowCount(0);
  const CaseContent& c = document().content();
  const SharedMesh left = c.mesh("condyle_left"), right = c.mesh("condyle_right");
  if (left && right) condyles_mm_ = {surface_centroid_mm(*left), surface_centroid_mm(*right)};
  std::vector<Timeline::Sample> samples;
  if (c.motion && c.arch)
    for (const JawMotionRow& row : c.motion->rows)
      samples.push_back({row.time_s, row.valid ? down_mm(row.motion, *c.arch) : 0.0, row.valid});
  timeline_->set_samples(std::move(samples));
  show_bands();
  show_state();
  show_posselt();
  if (c.motion && c.arch) analyse();
  find_rests_of_session();
}

/// Where the jaw stood still, whoever marked it or not.
void MotionPanel::find_rests_of_session() {
  timeline_->set_rests({});
  const auto content = document().shared_content();
  if (!content->session) return;
  auto rests = std::make_shared<std::vector<TimelineRest>>();
  bench_.jobs.run_latest(
      "rests",
      [content, rests](JobContext&) {
        PlateauOptions options;
        if (content->chain && content->arch)
          if (const auto chain = chain_from_json(*content->chain, "chain.json"))
            options.point_in_bow_mm = chain->bow_from_dental.value * content->arch->incisal_mm;
        for (const Plateau& p : find_rests(*content->session, options))
          rests->push_back({p.start_s, p.end_s,
                            QString("Rest found, %1 s, %2 frames, scatter %3 mm, mean ± %4 mm (1σ)")
                                .arg(p.end_s - p.start_s, 0, 'f', 2)
                                .arg(p.frames)
                                .arg(p.dispersion_mm, 0, 'f', 3)
                                .arg(p.sigma_mm, 0, 'f', 3)});
      },
      [this, content, rests] {
        if (document().shared_content() == content) timeline_->set_rests(std::move(*rests));
      });
}

void MotionPanel::show_state(const std::string& trouble) {
  QStringList done;
  const CaseContent& c = document().content();
  if (c.motion) {
    const auto& rows = c.motion->rows;
    const auto valid = std::count_if(rows.begin(), rows.end(), [](const JawMotionRow& r) { return r.valid; });
    std::vector<double> sigma;
    for (const JawMotionRow& r : rows)
      if (r.valid) sigma.push_back(r.sigma_mm);
    std::sort(sigma.begin(), sigma.end());
    done << QString("%1 of %2 frames tracked, %3 s, ± %4 mm (1σ) a frame")
                .arg(valid)
                .arg(rows.size())
                .arg(rows.empty() ? 0.0 : rows.back().time_s, 0, 'f', 1)
                .arg(sigma.empty() ? 0.0 : sigma[sigma.size() / 2], 0, 'f', 3);
  }
  auto missing = absences();
  if (!trouble.empty()) missing.push_back({Step::kMotion, "Numbers", trouble, false});
  status_->show_state(done, missing);
}

/// Marks of the pedal, and what was picked here.
void MotionPanel::show_bands() {
  if (!document().is_open()) return;
  std::vector<TimelineBand> bands;
  const CaseContent& c = document().content();
  if (c.session) {
    std::map<std::string, double> since;
    for (const EventSample& e : c.session->events) {
      const double t = e.header.capture.seconds_since(c.session->start);
      if (e.pressed)
        since[e.kind] = t;
      else if (since.count(e.kind)) {
        bands.push_back({since[e.kind], t, QString::fromStdString(e.kind),
                         e.kind == "TP" ? QColor(0, 130, 95) : QColor(60, 84, 115)});
        since.erase(e.kind);
      }
    }
  }
  if (const auto& s = document().state().mi_s)
    bands.push_back({s->first, s->second, "MI*", QColor(180, 90, 0)});
  if (const auto& s = document().state().tp_s)
    bands.push_back({s->first, s->second, "TP*", QColor(180, 90, 0)});
  timeline_->set_bands(std::move(bands));
}

const JawMotionRow* MotionPanel::row_at(double t) const {
  const auto& motion = bench_.document.content().motion;
  if (!motion || motion->rows.empty()) return nullptr;
  const auto& rows = motion->rows;
  auto it = std::lower_bound(rows.begin(), rows.end(), t,
                             [](const JawMotionRow& r, double at) { return r.time_s < at; });
  if (it == rows.end()) --it;
  if (it != rows.begin() && t - (it - 1)->time_s < it->time_s - t) --it;
  return &*it;
}

void MotionPanel::go_to(double t, bool playing) {
  const JawMotionRow* row = row_at(t);
  if (!row) return;
  timeline_->set_time(t);
  const QString time = QString("%1 s").arg(row->time_s, 0, 'f', 2);
  if (!row->valid) {
    at_->setText(time + "  " + QString::fromStdString(row->reason));
    return;
  }
  const ArchFrame& arch = *document().content().arch;
  at_->setText(QString("%1   down %2 mm   forward %3 mm   left %4 mm")
                   .arg(time, tenths(down_mm(row->motion, arch)),
                        tenths(arch.anterior.dot(row->motion * arch.incisal_mm - arch.incisal_mm)),
                        tenths(arch.left.dot(row->motion * arch.incisal_mm - arch.incisal_mm))));
  LayerModel& layers = document().layers();
  for (const char* id : {"mandible_live", "condyle_left", "condyle_right"}) layers.set_pose(id, row->motion);
  bench_.scene.note_motion();
  show_posselt();
  if (contacts_->isChecked()) color_contacts();
  if (!playing) document().end_merge();
}

void MotionPanel::step_play() {
  double t = timeline_->time_s() + timer_.interval() / 1000.0;
  if (t > timeline_->end_s()) t = 0;
  go_to(t, true);
}

void MotionPanel::pick(bool tp) {
  const auto s = timeline_->selection();
  if (!s || s->second - s->first < 0.05)
    return document().report("Choose an interval first: hold Shift and drag over the timeline.");
  if (!mean_over(*s)) return document().report("The jaw was not seen in that interval: choose another one.");
  document().change(tp ? "Pick TP" : "Pick MI",
                    [&](SessionState& state) { (tp ? state.tp_s : state.mi_s) = s; });
  if (!tp) return;
  const auto taken = picked_position();
  if (taken)
    document().change("T_th from the motion", [&](SessionState& state) {
      state.therapeutic = taken->first;
      state.therapeutic_source = taken->second.toStdString();
    });
}

std::optional<Rigid3> MotionPanel::mean_over(const std::pair<double, double>& s) const {
  std::vector<Rigid3> poses;
  for (const JawMotionRow& row : bench_.document.content().motion->rows)
    if (row.valid && row.time_s >= s.first && row.time_s <= s.second) poses.push_back(row.motion);
  if (poses.empty()) return std::nullopt;
  return robust_mean(poses).mean;
}

std::optional<std::pair<Rigid3, QString>> MotionPanel::picked_position() {
  if (!document().is_open() || !document().content().motion) return std::nullopt;
  const SessionState& s = document().state();
  const auto tp = s.tp_s ? mean_over(*s.tp_s) : std::nullopt;
  if (!tp) {
    const JawMotionRow* row = row_at(timeline_->time_s());
    if (!row || !row->valid) return std::nullopt;
    return std::pair{row->motion, QString("motion at %1 s").arg(row->time_s, 0, 'f', 2)};
  }
  const auto mi = s.mi_s ? mean_over(*s.mi_s) : std::nullopt;
  return std::pair{
      mi ? *tp * mi->inverse() : *tp,
      QString("motion, %1 to %2 s").arg(s.tp_s->first, 0, 'f', 2).arg(s.tp_s->second, 0, 'f', 2)};
}

void MotionPanel::analyse() {
  const auto content = document().shared_content();
  auto found = std::make_shared<Result<MotionAnalysis>>(tl::unexpected<Error>(Error{}));
  bench_.jobs.run_latest(
      "motion analysis",
      [content, found](JobContext& context) {
        MotionAnalysisJob job;
        job.motion = content->results() / "motion.csv";
        job.maxilla = content->files.maxilla_mi;
        job.mandible = content->files.mandible_mi;
        job.pictures = false;
        *found = analyse_motion(job, context);
      },
      [this, content, found] {
        if (document().shared_content() != content) return;
        if (*found) return show_analysis(**found);
        show_state(found->error().why);
      });
}

void MotionPanel::show_analysis(const MotionAnalysis& m) {
  analysis_ = std::make_shared<const MotionAnalysis>(m);
  if (!condyles_mm_ && m.analysis.landmarks.condyle_left_mm)
    condyles_mm_ = {*m.analysis.landmarks.condyle_left_mm, *m.analysis.landmarks.condyle_right_mm};
  numbers_->setRowCount(static_cast<int>(m.analysis.numbers.size()));
  int row = 0;
  for (const bool determined : {true, false})
    for (const JawNumber& n : m.analysis.numbers) {
      if (n.determined != determined) continue;
      const QString side = n.side.empty() ? "" : ", " + QString::fromStdString(n.side);
      const QString unit = n.unit == "deg"   ? "°"
                           : n.unit == "mm2" ? " mm²"
                           : n.unit == "1"   ? ""
                                             : " " + QString::fromStdString(n.unit);
      numbers_->setItem(row, 0, cell(number_name(n.name) + side));
      numbers_->item(row, 0)->setToolTip(QString::fromStdString(n.determined ? n.definition : n.reason));
      numbers_->setItem(
          row, 1,
          cell(determined
                   ? QString::number(n.value, 'f', n.unit == "1" ? 0 : 2).replace('-', QChar(0x2212)) + unit
                   : "–",
               true));
      numbers_->setItem(row, 2, cell(determined ? QString::number(n.sigma, 'f', 3) : "", true));
      ++row;
    }
  numbers_->resizeRowsToContents();
  if (isVisible()) show_paths();
}

void MotionPanel::show_paths() {
  if (!document().is_open() || !paths_->isChecked() || !isVisible() || !document().content().motion ||
      !document().content().arch)
    return bench_.scene.clear_overlay("paths");
  const CaseContent& c = document().content();
  std::vector<std::pair<Vector3, Color>> points = {{c.arch->incisal_mm, safe_palette::kBlue}};
  if (condyles_mm_) {
    points.emplace_back(condyles_mm_->first, safe_palette::kVermilion);
    points.emplace_back(condyles_mm_->second, safe_palette::kGreen);
  }
  Overlay o;
  o.on_top = false;
  for (const auto& [p, color] : points) {
    Overlay::Line line;
    line.color = color;
    line.width_px = 2;
    for (const JawMotionRow& row : c.motion->rows)
      if (row.valid) line.points_mm.push_back(row.motion * p);
    o.lines.push_back(std::move(line));
  }
  bench_.scene.set_overlay("paths", std::move(o));
}

void MotionPanel::show_posselt() {
  const CaseContent* c = document().is_open() ? &document().content() : nullptr;
  if (!c || !c->motion || !c->arch) return posselt_->set_curves({});
  const ArchFrame& arch = *c->arch;
  const int plane = plane_->currentIndex();
  const auto flat = [&](const Vector3& d) -> Eigen::Vector2d {
    if (plane == 0) return {arch.anterior.dot(d), arch.up.dot(d)};
    if (plane == 1) return {arch.left.dot(d), arch.up.dot(d)};
    return {arch.left.dot(d), arch.anterior.dot(d)};
  };
  PlotCurve path{"Incisal point", safe_palette::kBlue, 1.4, {}};
  Polyline2 line;
  for (const JawMotionRow& row : c->motion->rows) {
    if (row.valid)
      line.push_back(flat(row.motion * arch.incisal_mm - arch.incisal_mm));
    else if (!line.empty())
      path.lines.push_back(std::move(line)), line = {};
  }
  if (!line.empty()) path.lines.push_back(std::move(line));
  const bool first = posselt_->curves().empty() || posselt_->property("plane").toInt() != plane + 1;
  posselt_->set_curves({path});
  constexpr const char* kX[] = {"forward, mm", "to the left, mm", "to the left, mm"};
  constexpr const char* kY[] = {"up, mm", "up, mm", "forward, mm"};
  posselt_->set_axes(kX[plane], kY[plane]);
  if (first) posselt_->fit();
  posselt_->setProperty("plane", plane + 1);
  const JawMotionRow* row = row_at(timeline_->time_s());
  posselt_->set_marker(
      row && row->valid ? flat(row->motion * arch.incisal_mm - arch.incisal_mm) : Eigen::Vector2d::Zero(),
      row && row->valid);
}

/// Distances of the lower teeth to the upper ones, the last asked frame first.
void MotionPanel::color_contacts() {
  const Layer* live = document().layers().find("mandible_live");
  const JawMotionRow* row = document().is_open() ? row_at(timeline_->time_s()) : nullptr;
  if (!contacts_->isChecked() || !isVisible() || !live || !row || !row->valid) {
    if (live && live->colors) document().layers().set_colors("mandible_live", nullptr);
    bench_.scene.set_colour_scale(std::nullopt);
    return;
  }
  const auto upper = bench_.scene.surface("maxilla");
  if (!upper) return;
  bench_.scene.set_colour_scale(
      ColourScale{"to the upper teeth, mm", -kContactRangeMm, kContactRangeMm, true});
  auto colors = std::make_shared<std::shared_ptr<const VertexColors>>();
  bench_.jobs.run_latest(
      "contacts",
      [upper, mesh = live->mesh, t = row->motion, colors](JobContext&) {
        std::vector<Vector3> points = mesh->vertices_mm;
        for (Vector3& p : points) p = t * p;
        std::vector<float> gap(points.size(), std::numeric_limits<float>::quiet_NaN());
        const auto hits = closest_points(*upper, points, 2 * kContactRangeMm);
        for (std::size_t i = 0; i < hits.size(); ++i)
          if (hits[i].triangle != ClosestHit::kNoTriangle) gap[i] = static_cast<float>(hits[i].distance_mm);
        *colors = diverging_colors(gap, kContactRangeMm, palette::kMandibleIvory);
      },
      [this, colors] {
        if (contacts_->isChecked() && isVisible()) document().layers().set_colors("mandible_live", *colors);
      });
}

void MotionPanel::enter() {
  show_paths();
  go_to(timeline_->time_s(), false);
  color_contacts();
  QTimer::singleShot(0, this, [this] { posselt_->fit(); });
}

void MotionPanel::leave() {
  timer_.stop();
  play_->setText("▶ Play");
  bench_.scene.clear_overlay("paths");
  bench_.scene.set_colour_scale(std::nullopt);
  if (const Layer* live = document().layers().find("mandible_live"); live && live->colors)
    document().layers().set_colors("mandible_live", nullptr);
}

}  // namespace gnathion
