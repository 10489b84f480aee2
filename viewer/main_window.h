// The window: steps on top, the step's panel on the left, the scene in the middle, layers and section on the
// right.
#pragma once

#include <QMainWindow>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "viewer/panels/capture_panel.h"
#include "viewer/panels/panel.h"
#include "viewer/scene/measure_tool.h"

class QActionGroup;
class QLabel;
class QProgressBar;
class QSplitter;
class QStackedWidget;
class QTabBar;
class QToolButton;

namespace gnathion {

class LayerPanel;
class MessageBar;

struct WindowOptions {
  std::string socket;             ///< of the daemon; empty: its default
  CapturePanel::Connect connect;  ///< how to reach it; empty: no daemon
};

class MainWindow : public QMainWindow {
 public:
  explicit MainWindow(WindowOptions options);
  ~MainWindow() override;
  /// Reads the folder in the background and shows it.
  void open(const std::filesystem::path& folder);

  Scene3d& scene() { return *scene_; }
  Scene3d& second_scene() { return *second_; }
  Document& document() { return document_; }
  JobRunner& jobs() { return jobs_; }
  bool loading() const { return loading_; }
  double open_s() const { return open_s_; }  ///< from open() to the first picture of the case

 protected:
  void closeEvent(QCloseEvent* event) override;

 private:
  void make_steps();
  void make_centre();
  void make_right();
  void make_toolbar();
  void make_measuring(class QToolBar* bar);
  void make_status();
  void show_case(std::shared_ptr<const CaseContent> content);
  void reload();
  void go_to_step(int step);
  void fit_strip();
  void keep_shown();
  void apply_layers(Step step);
  void look(const QString& name);
  void start_section();
  void cut();
  void save_screenshot();
  void show_shortcuts();
  void show_job();

  WindowOptions options_;
  Document document_;
  JobRunner jobs_;
  DaemonJobs daemon_jobs_{document_, jobs_};
  LayerModel second_layers_;
  std::unique_ptr<Scene3d> scene_, second_;
  std::unique_ptr<Workbench> bench_;
  std::unique_ptr<MeasureTool> measure_;
  MessageBar* messages_ = nullptr;
  QTabBar* steps_ = nullptr;
  QStackedWidget *panels_ = nullptr, *strips_ = nullptr;
  QSplitter *centre_ = nullptr, *columns_ = nullptr, *pair_ = nullptr;
  LayerPanel* layer_panel_ = nullptr;
  ProfilePlot* section_ = nullptr;
  QActionGroup* measuring_ = nullptr;
  QLabel *coordinates_ = nullptr, *job_text_ = nullptr, *empty_ = nullptr;
  QProgressBar* job_bar_ = nullptr;
  QToolButton* job_cancel_ = nullptr;
  QTimer job_timer_;
  std::vector<Panel*> panel_of_;
  std::map<Step, std::map<std::string, bool>> shown_;
  int step_ = -1;
  bool loading_ = false, plane_on_ = false, section_fitted_ = false;
  double open_s_ = 0;
  std::filesystem::path waiting_;
  class QWidget* shortcuts_ = nullptr;
};

}  // namespace gnathion
