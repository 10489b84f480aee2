// Calibrate: registrations with their errors, scans laid over each other, residual maps, weak directions, and
// the graph of frames.
#pragma once

#include <memory>

#include "calibration/chain.h"
#include "viewer/panels/panel.h"
#include "viewer/widgets/frames_view.h"
#include "viewer/widgets/parts.h"

namespace gnathion {

class CalibratePanel : public Panel {
 public:
  explicit CalibratePanel(Workbench& bench);
  QWidget* strip() override { return strip_; }
  void enter() override;
  void leave() override;
  std::set<std::string> first_layers() const override { return {"mandible_mi"}; }

 private:
  struct Overlaid;  ///< two surfaces laid over each other, with residuals
  void opened();
  void list_registrations();
  void show_registration(int row);
  void overlay(const QString& name, SharedMesh source, SharedMesh target, const Rigid3& dental_from_target,
               std::optional<Rigid3> target_from_source, const std::string& id);
  void show_weak(const ChainPose& pose, const Rigid3& dental_from_to);
  void show_views();

  StepStatus* status_;
  QTableWidget *registrations_, *views_;
  QLabel *facts_, *views_note_;
  QWidget* strip_;
  FramesView* graph_;
  class ChartView* histogram_;
  std::optional<Chain> chain_;
  std::vector<std::string> rows_;
};

}  // namespace gnathion
