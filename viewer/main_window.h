// The viewer's window: layers and gates on the left, the jaws in the middle, the profile on the right.
#pragma once

#include <QMainWindow>
#include <memory>
#include <vector>

#include "viewer/case_scene.h"
#include "viewer/case_view.h"
#include "viewer/profile_plot.h"

class QCheckBox;

namespace gnathion {

class MainWindow : public QMainWindow {
 public:
  explicit MainWindow(CaseScene scene);
  ~MainWindow() override;
  /// First picture, once the window is on the screen: oblique view with the section's plane.
  void start();

  // For tests that look at the window.
  CaseView& view() { return *view_; }
  ProfilePlot& profile() { return *profile_; }
  QCheckBox* layer_box(std::size_t layer) { return boxes_.at(layer); }

 private:
  QWidget* make_layer_panel();
  QWidget* make_gate_panel();
  QWidget* make_missing_panel();
  void make_toolbar();
  void start_section();
  void cut(const SectionPlane& plane);

  CaseScene scene_;
  std::unique_ptr<CaseView> view_;
  ProfilePlot* profile_ = nullptr;
  std::vector<QCheckBox*> boxes_;
};

}  // namespace gnathion
