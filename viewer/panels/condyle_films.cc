#include "viewer/panels/condyle_films.h"

#include <QHBoxLayout>
#include <QResizeEvent>

#include "viewer/widgets/parts.h"

namespace gnathion {
namespace {

constexpr int kMargin = 4, kFilmsHeight = 212;

QString millimetres(double mm) {
  return QString::number(mm, 'f', 2).replace('-', QChar(0x2212)) + " mm";
}

}  // namespace

CondyleFilms::CondyleFilms(JobRunner& jobs) : jobs_(jobs) {
  setObjectName("condyleFilms");
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(2 * kMargin, kMargin, 2 * kMargin, kMargin);
  column->setSpacing(3);
  column->addWidget(note_ = new QLabel);
  note_->setObjectName("jointsNote");
  note_->setWordWrap(true);
  column->addWidget(spaces_ = new QLabel);
  spaces_->setObjectName("jointSpaces");
  spaces_->setWordWrap(true);
  spaces_->setToolTip(
      "Smallest distance between condyle and fossa, in TP and in MI; the condyle's path from MI");
  column->addWidget(row_ = new QWidget, 1);
  auto* row = new QHBoxLayout(row_);
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(4);
  row_->setToolTip(
      "Virtual X-rays out of the CBCT. Lateral: the face looks right. "
      "Frontal: the patient's left is on the right. The white bar is 10 mm.");
  show_note("joints not checked: no CBCT");
}

void CondyleFilms::show_note(const QString& note) {
  joints_.reset();
  note_->setText(note);
  note_->show();
  spaces_->hide();
  row_->hide();
  fit_height();
}

/// Films have a height of their own; a note alone has what its lines need in this width and font.
void CondyleFilms::fit_height() {
  const int before = height();
  int wanted = kFilmsHeight;
  if (!joints_ || views_.empty()) {
    wanted = kMargin;
    for (const QLabel* label : {note_, spaces_})
      if (!label->isHidden()) wanted += label->heightForWidth(width() - 4 * kMargin) + kMargin;
  }
  setFixedHeight(wanted);
  if (wanted != before && height_changed) height_changed();
}

void CondyleFilms::resizeEvent(QResizeEvent* event) {
  QWidget::resizeEvent(event);
  if (event->size().width() != event->oldSize().width()) fit_height();
}

void CondyleFilms::show_joints(std::shared_ptr<const PatientJoints> joints) {
  joints_ = std::move(joints);
  for (FilmView* view : views_) delete view;
  views_.clear();
  for (const JointFilm& film : joints_->films) {
    auto* view = new FilmView;
    view->setObjectName(QString("film_%1_%2").arg(QString::fromStdString(film.view), side_name(film.side)));
    view->set_caption(
        QString("%1 condyle, %2")
            .arg(film.side == Side::kLeft ? "Left" : "Right", QString::fromStdString(film.view)));
    row_->layout()->addWidget(view);
    views_.push_back(view);
  }
  QStringList notes;
  for (const std::string& note : joints_->notes) notes << QString::fromStdString(note);
  note_->setText(notes.join("; "));
  note_->setVisible(!notes.isEmpty());
  row_->setVisible(!views_.empty());
  spaces_->show();
  fit_height();
}

void CondyleFilms::follow(const Motion<Dental>& from_mi) {
  if (!joints_ || views_.empty()) return;
  auto made = std::make_shared<std::vector<Image8>>();
  jobs_.run_latest(
      "films",
      [joints = joints_, from_mi, made](JobContext& context) {
        for (const JointFilm& film : joints->films) {
          context.throw_if_cancelled();
          made->push_back(windowed(film.xray.film(from_mi), film.window.low, film.window.high));
        }
      },
      [this, joints = joints_, made] {
        if (joints != joints_) return;  // another case meanwhile
        for (std::size_t i = 0; i < made->size(); ++i)
          views_[i]->set_film((*made)[i], XrayOptions{}.field_mm);
      });
}

void CondyleFilms::show_spaces(const std::vector<JointReport>& reports) {
  QStringList parts;
  for (const JointReport& r : reports)
    parts << QString("<b>%1 condyle</b> moved %2, space %3 (MI %4)")
                 .arg(r.side == Side::kLeft ? "Left" : "Right", millimetres(r.condyle_path_mm.norm()),
                      millimetres(r.tp.min_mm), millimetres(r.mi.min_mm));
  spaces_->setText(parts.join("&nbsp;&nbsp;&nbsp;"));
}

}  // namespace gnathion
