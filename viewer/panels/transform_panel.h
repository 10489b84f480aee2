// Transformation: T_th by sliders, by hand in 3D, by typing, from a file, from the motion; and what it means.
#pragma once

#include <QLabel>
#include <array>
#include <memory>
#include <optional>

#include "viewer/model/readout.h"
#include "viewer/panels/condyle_films.h"
#include "viewer/panels/panel.h"
#include "viewer/widgets/parts.h"

class QCheckBox;
class QDoubleSpinBox;
class QLineEdit;
class QSlider;

namespace gnathion {

class TransformPanel : public Panel {
 public:
  explicit TransformPanel(Workbench& bench);
  QWidget* strip() override { return films_; }
  void enter() override;
  void leave() override;
  std::set<std::string> first_layers() const override {
    return {"maxilla", "mandible_tp", "condyle_left", "condyle_right", "fossa_left", "fossa_right"};
  }
  CondyleFilms& films() { return *films_; }
  /// The position on the timeline, given by the Motion step; null where there is none.
  std::function<std::optional<std::pair<Rigid3, QString>>()> from_motion;

 private:
  QWidget* make_six();
  QWidget* make_sources();
  QWidget* make_readout();
  QWidget* make_constraints();
  void opened();
  void show_state();
  void show_sliders(const Rigid3& t);
  void set_six(const QString& text, bool dragging);
  void set_transform(const QString& text, const Rigid3& t, const QString& source, int merge = -1);
  void take_file(const QString& path);
  void take_typed(const QString& text);
  void take_motion();
  void make_checkers();
  void take_joints(std::shared_ptr<const PatientJoints> joints);
  void check();
  void show_constraints(const Feasibility& f);
  void show_manipulator();

  StepStatus* status_;
  std::array<QSlider*, 6> sliders_{};
  std::array<QDoubleSpinBox*, 6> boxes_{};
  QLineEdit* typed_;
  QCheckBox* handle_box_;
  QLabel *source_, *error_, *readout_, *verdict_;
  QTableWidget* constraints_;
  CondyleFilms* films_;
  std::vector<Vector3> where_mm_;
  std::optional<IncisalEdges> edges_;
  std::shared_ptr<const RealizabilityChecker> checker_;
  Rigid3 drag_start_;
  bool dragging_handle_ = false, showing_ = false;
};

}  // namespace gnathion
