// Evaluate: the printed splint against the plan: distance maps, histograms, error bars, radar, profiles.
#pragma once

#include <memory>
#include <vector>

#include "evaluation/evaluation.h"
#include "pipeline/evaluation_pictures.h"
#include "viewer/panels/panel.h"
#include "viewer/widgets/parts.h"

class QComboBox;
class QLineEdit;

namespace gnathion {

class EvaluatePanel : public Panel {
 public:
  explicit EvaluatePanel(Workbench& bench);
  QWidget* strip() override { return strip_; }
  void enter() override;
  void leave() override;
  std::set<std::string> first_layers() const override { return {"maxilla"}; }

 private:
  struct Found;  ///< what a job brings back
  QWidget* make_scans();
  void opened();
  void evaluate();
  void run_scans();
  void run_virtual_print();
  void run(const QString& name, std::function<void(JobContext&, Found&)> work);
  void show_found(std::shared_ptr<const Found> found);
  void show_procedure(int row);
  void show_chart();

  StepStatus* status_;
  QLineEdit *splint_, *maxilla_, *mandible_;
  QTableWidget* table_;
  QLabel* facts_;
  QWidget* strip_;
  QComboBox* charts_;
  ChartView* chart_;
  std::shared_ptr<const Found> found_;
  std::vector<EvaluationFigure> figures_;
  double range_mm_ = 0.2;
};

}  // namespace gnathion
