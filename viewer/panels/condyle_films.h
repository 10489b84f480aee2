// Virtual X-rays of both condyles under the scene: they follow T_th, the newest position first.
#pragma once

#include <QLabel>
#include <functional>
#include <memory>
#include <vector>

#include "viewer/model/patient_joints.h"
#include "viewer/panels/panel.h"
#include "viewer/widgets/film_view.h"

namespace gnathion {

class CondyleFilms : public QWidget {
 public:
  explicit CondyleFilms(JobRunner& jobs);
  /// No films: why not, in one line.
  void show_note(const QString& note);
  void show_joints(std::shared_ptr<const PatientJoints> joints);
  void follow(const Motion<Dental>& from_mi);
  /// How far the condyles went and what room they have.
  void show_spaces(const std::vector<JointReport>& reports);
  std::function<void()> height_changed;

 protected:
  void resizeEvent(QResizeEvent* event) override;

 private:
  void fit_height();
  JobRunner& jobs_;
  std::shared_ptr<const PatientJoints> joints_;
  QLabel *note_, *spaces_;
  QWidget* row_;
  std::vector<FilmView*> views_;
};

}  // namespace gnathion
