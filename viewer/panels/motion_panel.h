// Motion: the session on its timeline, the jaw as it moved, its paths and numbers, MI and TP picked by hand.
#pragma once

#include <QTimer>
#include <memory>
#include <optional>

#include "pipeline/motion_analysis.h"
#include "viewer/panels/panel.h"
#include "viewer/widgets/parts.h"
#include "viewer/widgets/timeline.h"

class QPushButton;
class QComboBox;
class QCheckBox;

namespace gnathion {

class MotionPanel : public Panel {
 public:
  explicit MotionPanel(Workbench& bench);
  QWidget* strip() override { return strip_; }
  void enter() override;
  void leave() override;
  std::set<std::string> first_layers() const override {
    return {"maxilla", "mandible_live", "condyle_left", "condyle_right", "fossa_left", "fossa_right"};
  }
  /// T_th of the picked TP, against the picked MI where there is one.
  std::optional<std::pair<Rigid3, QString>> picked_position();

 private:
  QWidget* make_strip();
  void opened();
  void show_state(const std::string& trouble = {});  ///< why there are no numbers
  void show_bands();
  void analyse();
  void find_rests_of_session();
  void show_analysis(const MotionAnalysis& m);
  void go_to(double time_s, bool playing);
  void step_play();
  void pick(bool tp);
  void show_paths();
  void show_posselt();
  void color_contacts();
  const JawMotionRow* row_at(double time_s) const;
  std::optional<Rigid3> mean_over(const std::pair<double, double>& s) const;

  StepStatus* status_;
  QTableWidget* numbers_;
  QWidget* strip_ = nullptr;
  Timeline* timeline_ = nullptr;
  ProfilePlot* posselt_ = nullptr;
  QPushButton* play_ = nullptr;
  QComboBox* plane_ = nullptr;
  QLabel* at_ = nullptr;
  QCheckBox *contacts_ = nullptr, *paths_ = nullptr;
  QTimer timer_;
  std::shared_ptr<const MeshQuery> upper_;
  std::shared_ptr<const MotionAnalysis> analysis_;
  std::optional<std::pair<Vector3, Vector3>> condyles_mm_;
};

}  // namespace gnathion
