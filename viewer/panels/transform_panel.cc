#include "viewer/panels/transform_panel.h"

#include <QCheckBox>
#include <QDoubleSpinBox>
#include <QGridLayout>
#include <QHeaderView>
#include <QLineEdit>
#include <QSlider>

#include <nlohmann/json.hpp>

#include "core/transform_io.h"
#include "viewer/panels/daemon_row.h"

namespace gnathion {
namespace {

struct SixLook {
  const char *name, *unit, *object, *tip;
  double range, step;
  int decimals;
};
constexpr SixLook kSix[] = {
    {"To the left", "mm", "left", "Lower incisal point, to the patient's left", 8, 0.05, 2},
    {"Forward", "mm", "forward", "Lower incisal point, forward: protrusion", 10, 0.05, 2},
    {"Down", "mm", "down", "Lower incisal point, down: vertical opening", 20, 0.05, 2},
    {"Opening", "deg", "opening", "Turn about the transverse axis, chin down", 20, 0.05, 2},
    {"Yaw", "deg", "yaw", "Turn about the occlusal normal, chin to the left", 6, 0.05, 2},
    {"Roll", "deg", "roll", "Turn about the sagittal axis, left side down", 6, 0.05, 2}};
constexpr const char* kNoCbct =
    "joints not checked: no CBCT. Name a volume in case.toml, [scans] cbct, to see both condyles here.";
constexpr int kMergeSix = 100, kMergeHandle = 110;

QString shown(const std::string& constraint) {
  QString text = QString::fromStdString(constraint).replace('_', ' ');
  text[0] = text[0].toUpper();
  return text;
}

QString signed_text(double v, int decimals) {
  return QString::number(v, 'f', decimals).replace('-', QChar(0x2212));
}

}  // namespace

TransformPanel::TransformPanel(Workbench& bench) : Panel(bench, Step::kTransformation) {
  setObjectName("transformPanel");
  films_ = new CondyleFilms(bench.jobs);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(10, 8, 10, 8);
  column->setSpacing(4);
  column->addWidget(status_ = new StepStatus("transformStatus"));
  column->addWidget(new DaemonRow(bench_, Step::kTransformation));
  column->addWidget(heading("Therapeutic position, from MI"));
  column->addWidget(make_six());
  column->addWidget(make_sources());
  column->addWidget(heading("In the mouth"));
  column->addWidget(make_readout());
  column->addWidget(make_constraints(), 1);
  document().opened.add([this] { opened(); });
  document().state_changed.add([this] { show_state(); });
  bench_.scene.dragged.add([this](const Rigid3& motion, bool finished) {
    if (!isVisible() || !document().state().therapeutic) return;
    if (!dragging_handle_) drag_start_ = *document().state().therapeutic;
    dragging_handle_ = !finished;
    set_transform("Move the mandible by hand", motion * drag_start_, "by hand", kMergeHandle);
    if (finished) document().end_merge();
  });
}

QWidget* TransformPanel::make_six() {
  auto* box = new QWidget;
  auto* grid = new QGridLayout(box);
  grid->setContentsMargins(0, 0, 0, 0);
  grid->setVerticalSpacing(3);
  for (int i = 0; i < 6; ++i) {
    const SixLook& look = kSix[i];
    const auto k = static_cast<std::size_t>(i);
    auto* slider = sliders_[k] = new QSlider(Qt::Horizontal);
    slider->setObjectName(QString("slider_") + look.object);
    slider->setRange(static_cast<int>(-look.range / look.step), static_cast<int>(look.range / look.step));
    slider->setToolTip(look.tip);
    auto* spin = boxes_[k] = new QDoubleSpinBox;
    spin->setObjectName(QString("value_") + look.object);
    spin->setDecimals(look.decimals);
    spin->setRange(-180, 180);
    spin->setSingleStep(look.step);
    spin->setSuffix(QString(" ") + (look.unit[0] == 'd' ? "°" : look.unit));
    spin->setKeyboardTracking(false);
    spin->setToolTip(look.tip);
    spin->setFixedWidth(88);
    connect(slider, &QSlider::valueChanged, this, [this, k](int v) {
      if (showing_) return;
      showing_ = true;
      boxes_[k]->setValue(v * kSix[k].step);
      showing_ = false;
      set_six(kSix[k].name, true);
    });
    connect(slider, &QSlider::sliderReleased, this, [this] { document().end_merge(); });
    connect(spin, qOverload<double>(&QDoubleSpinBox::valueChanged), this, [this, k](double) {
      if (!showing_) set_six(kSix[k].name, false);
    });
    grid->addWidget(new QLabel(look.name), i, 0);
    grid->addWidget(slider, i, 1);
    grid->addWidget(spin, i, 2);
  }
  return box;
}

QWidget* TransformPanel::make_sources() {
  auto* box = new QWidget;
  auto* grid = new QGridLayout(box);
  grid->setContentsMargins(0, 2, 0, 2);
  source_ = wrapped("", true);
  source_->setObjectName("transformSource");
  error_ = wrapped("");
  error_->setObjectName("transformError");
  error_->hide();
  typed_ = new QLineEdit;
  typed_->setObjectName("typedTransform");
  typed_->setPlaceholderText("Type or paste 16 numbers, row by row; Enter");
  connect(typed_, &QLineEdit::returnPressed, this, [this] { take_typed(typed_->text()); });
  handle_box_ = new QCheckBox("Handles in 3D");
  handle_box_->setObjectName("handleBox");
  handle_box_->setToolTip("Arrows move the mandible, rings turn it");
  handle_box_->setChecked(true);
  connect(handle_box_, &QCheckBox::toggled, this, [this] { show_manipulator(); });
  grid->addWidget(button("From file…", "transformFile", "T_th as JSON, 16 numbers or ITK .tfm",
                         [this] {
                           choose_file(this, "Therapeutic position", case_folder(),
                                       "Transforms (*.json *.txt *.tfm);;All (*)",
                                       [this](const QString& path) { take_file(path); });
                         }),
                  0, 0);
  grid->addWidget(button("From motion", "transformMotion", "The position chosen in the Motion step",
                         [this] { take_motion(); }),
                  0, 1);
  grid->addWidget(
      button("As measured", "transformMeasured", "Back to results/T_th.json of the case",
             [this] {
               if (const auto& t = document().content().therapeutic)
                 set_transform("Back to the measured T_th", t->motion.rigid, "results/T_th.json");
               else
                 document().report("This case has no measured T_th yet: 'gnathion run' finds one.");
             }),
      0, 2);
  grid->addWidget(typed_, 1, 0, 1, 3);
  grid->addWidget(handle_box_, 2, 0);
  grid->addWidget(source_, 2, 1, 1, 2);
  grid->addWidget(error_, 3, 0, 1, 3);
  return box;
}

QWidget* TransformPanel::make_readout() {
  readout_ = new QLabel;
  readout_->setObjectName("clinicalReadout");
  readout_->setTextFormat(Qt::RichText);
  readout_->setToolTip("Between the incisal edges at the midline; overbite is negative in an open bite");
  return readout_;
}

QWidget* TransformPanel::make_constraints() {
  auto* box = new QWidget;
  auto* column = new QVBoxLayout(box);
  column->setContentsMargins(0, 0, 0, 0);
  verdict_ = heading("Can a splint hold it?");
  verdict_->setObjectName("feasibilityVerdict");
  constraints_ = plain_table({"", "Constraint", "Value", "Limit"}, "constraintTable");
  constraints_->setColumnWidth(0, 22);
  constraints_->setColumnWidth(2, 86);
  constraints_->setColumnWidth(3, 52);
  constraints_->horizontalHeader()->setSectionResizeMode(1, QHeaderView::Stretch);
  constraints_->setMinimumHeight(96);
  constraints_->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Ignored);  // it takes what is left
  connect(constraints_, &QTableWidget::cellClicked, this, [this](int row, int) {
    const Vector3 at = where_mm_.at(static_cast<std::size_t>(row));
    bench_.scene.look_at(at, 40);
    Overlay mark;
    mark.balls.push_back({at, {0.84, 0.37, 0}, 0.8});
    bench_.scene.set_overlay("constraint", std::move(mark));
  });
  column->addWidget(verdict_);
  column->addWidget(constraints_, 1);
  return box;
}

void TransformPanel::opened() {
  edges_.reset();
  checker_.reset();
  where_mm_.clear();
  constraints_->setRowCount(0);
  films_->show_note(kNoCbct);
  bench_.jobs.cancel_latest("joints");  // of the case before: seconds of every core
  const auto content = document().shared_content();
  const bool ready = content->arch.has_value();
  for (std::size_t k = 0; k < 6; ++k) sliders_[k]->setEnabled(ready), boxes_[k]->setEnabled(ready);
  if (!ready) return;
  edges_ = incisal_edges(*content->mesh("maxilla_mi"), *content->mesh("mandible_mi"), *content->arch);
  make_checkers();
}

/// The jaws alone first: seconds before the joints are found in a volume.
void TransformPanel::make_checkers() {
  const auto content = document().shared_content();
  auto made = std::make_shared<std::shared_ptr<const RealizabilityChecker>>();
  verdict_->setText("Can a splint hold it? Measuring the jaws…");
  bench_.jobs.run_latest(
      "checker", [content, made](JobContext& context) { *made = jaws_checker(*content, context); },
      [this, content, made] {
        if (document().shared_content() != content || checker_) return;
        checker_ = *made;
        check();
      });
  if (content->files.cbct.empty()) return;
  films_->show_note("Finding the joints in " +
                    QString::fromStdString(content->files.cbct.filename().string()) + " …");
  auto found = std::make_shared<std::shared_ptr<const PatientJoints>>();
  bench_.jobs.run_latest(
      "joints", [content, found](JobContext& context) { *found = find_patient_joints(*content, context); },
      [this, content, found] {
        if (document().shared_content() == content && *found) take_joints(*found);
      },
      [this, content] {
        if (document().shared_content() == content)
          films_->show_note("Joints not checked: finding them failed. Open the case again to try once more.");
      });
}

void TransformPanel::take_joints(std::shared_ptr<const PatientJoints> joints) {
  if (!joints->trouble.empty())
    return films_->show_note("Joints not checked: " + QString::fromStdString(joints->trouble));
  films_->show_joints(joints);
  if (joints->checker) checker_ = joints->checker;
  put_joint_layers(document(), *joints->joints, isVisible());
  show_state();
}

void TransformPanel::set_transform(const QString& text, const Rigid3& t, const QString& source, int merge) {
  document().change(
      text,
      [&](SessionState& s) {
        s.therapeutic = t;
        s.therapeutic_source = source.toStdString();
      },
      merge);
}

void TransformPanel::set_six(const QString& text, bool dragging) {
  if (!document().is_open() || !document().content().arch) return;
  SixValues six;
  const auto values = six.all();
  for (std::size_t k = 0; k < 6; ++k) *values[k] = boxes_[k]->value();
  bench_.scene.note_motion();
  const int slot = static_cast<int>(
      std::find_if(std::begin(kSix), std::end(kSix), [&](const SixLook& l) { return text == l.name; }) -
      std::begin(kSix));
  set_transform("T_th: " + text.toLower(), motion_of(six, *document().content().arch), "sliders",
                dragging ? kMergeSix + slot : -1);
}

void TransformPanel::take_file(const QString& path) {
  const Result<MotionFile> motion = read_motion(path.toStdString());
  if (!motion) return document().report(QString::fromStdString(motion.error().line()));
  set_transform("T_th from a file", motion->motion.rigid, path.section('/', -1));
}

void TransformPanel::take_typed(const QString& text) {
  const Result<MotionFile> motion = parse_motion(text.toStdString(), "typed");
  if (!motion) {
    error_->setText(QString::fromStdString(motion.error().why));
    error_->setStyleSheet("color:#a01e14");
    error_->show();
    return;
  }
  error_->clear();
  error_->hide();
  set_transform("T_th typed", motion->motion.rigid, "typed");
}

void TransformPanel::take_motion() {
  const auto taken = from_motion ? from_motion() : std::nullopt;
  if (!taken) return document().report("No position is chosen: pick TP on the timeline of the Motion step.");
  set_transform("T_th from the motion", taken->first, taken->second);
}

void TransformPanel::show_sliders(const Rigid3& t) {
  if (!document().content().arch) return;
  SixValues six = six_of(t, *document().content().arch);
  const auto values = six.all();
  const bool before = showing_;
  showing_ = true;
  for (std::size_t k = 0; k < 6; ++k) {
    boxes_[k]->setValue(*values[k]);
    sliders_[k]->setValue(static_cast<int>(std::lround(*values[k] / kSix[k].step)));
  }
  showing_ = before;
}

void TransformPanel::show_state() {
  if (!document().is_open()) return;
  const auto& t = document().state().therapeutic;
  pose_patient_layers(document());
  if (isVisible() && t)
    for (const char* id : {"condyle_left", "condyle_right"}) document().layers().set_pose(id, *t);
  QStringList done;
  const auto& measured = document().content().therapeutic;
  if (t)
    done << "T_th is set (" + QString::fromStdString(document().state().therapeutic_source).toHtmlEscaped() +
                ")";
  std::vector<Absence> missing;
  for (const Absence& a : absences())
    if (!(t && a.what == "T_th")) missing.push_back(a);
  if (measured && measured->covariance && document().content().arch) {
    const Vector3 incisal = document().content().arch->incisal_mm;
    const double s =
        std::sqrt(point_covariance(*measured->covariance, measured->motion.rigid * incisal).trace());
    done << QString("measured T_th: ± %1 mm (1σ), incisal point").arg(s, 0, 'f', 3);
  }
  status_->show_state(done, missing);
  const QString source = QString::fromStdString(document().state().therapeutic_source);
  source_->setText(source.isEmpty() ? "" : "From: " + source);
  if (!t) {
    readout_->setText("T_th is not set.");
    return;
  }
  show_sliders(*t);
  if (edges_) {
    const ClinicalReadout r = clinical_readout(*t, *edges_, *document().content().arch);
    readout_->setText(
        QString("<table cellspacing=3><tr><td>Vertical dimension</td><td align=right><b>%1 "
                "mm</b></td><td></td></tr>"
                "<tr><td>Overjet</td><td align=right><b>%2 mm</b></td><td>&nbsp;MI %3</td></tr>"
                "<tr><td>Overbite</td><td align=right><b>%4 mm</b></td><td>&nbsp;MI %5</td></tr>"
                "<tr><td>Midline to the left</td><td align=right><b>%6 mm</b></td><td></td></tr></table>")
            .arg((r.vertical_mm > 0 ? "+" : "") + signed_text(r.vertical_mm, 2), signed_text(r.overjet_mm, 2),
                 signed_text(r.overjet_mi_mm, 2), signed_text(r.overbite_mm, 2),
                 signed_text(r.overbite_mi_mm, 2), signed_text(r.midline_mm, 2)));
  }
  if (isVisible()) show_manipulator();
  check();
}

void TransformPanel::show_manipulator() {
  const auto& t = document().state().therapeutic;
  if (!t || !handle_box_->isChecked() || !document().content().arch) {
    bench_.scene.show_manipulator(std::nullopt);
    return;
  }
  // At the lower arch, axes along left, back and up.
  Rigid3 handle = document().content().arch->dental_from_arch();
  handle.rotation = t->rotation * handle.rotation;
  handle.translation_mm = *t * (document().content().arch->origin_mm - 14.0 * document().content().arch->up);
  bench_.scene.show_manipulator(handle);
}

void TransformPanel::check() {
  if (!document().state().therapeutic) {
    constraints_->setRowCount(0);
    verdict_->setText("Can a splint hold it? Set T_th first.");
    return;
  }
  const Motion<Dental> t(*document().state().therapeutic);
  if (isVisible()) films_->follow(t);
  if (!checker_) return;
  auto found = std::make_shared<Feasibility>();
  bench_.jobs.run_latest(
      "check", [checker = checker_, t, found](JobContext&) { *found = checker->check(t); },
      [this, found, checker = checker_] {
        if (checker == checker_) show_constraints(*found);
      });
}

void TransformPanel::show_constraints(const Feasibility& f) {
  films_->show_spaces(f.joints);
  const char* kVerdicts[] = {"Yes: a splint can hold it", "Yes, with apertures", "No: not realizable"};
  verdict_->setText(kVerdicts[static_cast<std::size_t>(f.verdict)]);
  constraints_->setRowCount(static_cast<int>(f.constraints.size()));
  where_mm_.clear();
  int row = 0;
  std::vector<const Constraint*> order;
  for (const Constraint& c : f.constraints)
    if (!c.pass) order.push_back(&c);
  for (const Constraint& c : f.constraints)
    if (c.pass) order.push_back(&c);
  for (const Constraint* c : order) {
    constraints_->setItem(row, 0, verdict_cell(c->pass, c->severity == Severity::kBlocks));
    constraints_->setItem(row, 1, cell(shown(c->name)));
    constraints_->item(row, 1)->setToolTip(QString::fromStdString(c->consequence));
    const QString unit = c->unit == "deg"  ? "°"
                         : c->unit.empty() ? ""
                                           : " " + QString::fromStdString(c->unit);
    constraints_->setItem(row, 2, cell(c->checked ? signed_text(c->value, 2) + unit : "not checked", true));
    constraints_->setItem(row, 3, cell(c->checked ? signed_text(c->limit, 2) : "", true));
    where_mm_.push_back(c->where_mm);
    ++row;
  }
}

void TransformPanel::enter() {
  show_state();
}

void TransformPanel::leave() {
  bench_.scene.show_manipulator(std::nullopt);
  bench_.scene.clear_overlay("constraint");
}

}  // namespace gnathion
