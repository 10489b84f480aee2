// What every step's panel is given, and what it offers to the window.
#pragma once

#include <QString>
#include <QWidget>
#include <functional>
#include <set>
#include <string>

#include "anatomy/joints/joints.h"
#include "viewer/jobs/daemon_jobs.h"
#include "viewer/jobs/jobs.h"
#include "viewer/model/document.h"
#include "viewer/scene/scene_view.h"
#include "viewer/widgets/profile_plot.h"

namespace gnathion {

/// The window's parts that panels share. Lives as long as the window.
struct Workbench {
  Document& document;
  JobRunner& jobs;
  DaemonJobs& daemon;
  Scene3d& scene;
  Scene3d& second;            ///< beside the first, for two designs
  LayerModel& second_layers;  ///< of the second view
  std::function<void(bool)> show_second;
  std::function<void(const QString&)> status;  ///< status line
  std::function<void()> reload;                ///< reads the case anew, in place
  /// Someone takes the mouse in the scene; everyone else lets go of it.
  Listeners<const void*> tool_taken = {};
};

class Panel : public QWidget {
 public:
  Panel(Workbench& bench, Step step) : bench_(bench), step_(step) {}
  Step step() const { return step_; }
  /// What lies under the scene in this step; may be null. Owned by the window.
  virtual QWidget* strip() { return nullptr; }
  /// The tab is shown, or left.
  virtual void enter() {}
  virtual void leave() {}
  /// Layers that this step shows when it is opened for the first time.
  virtual std::set<std::string> first_layers() const { return {}; }

 protected:
  Document& document() { return bench_.document; }
  std::vector<Absence> absences() const;
  /// Where files are asked for first; empty while none is open.
  QString case_folder() const;
  Workbench& bench_;

 private:
  Step step_;
};

/// Puts the patient's surfaces into the layer model, and moves what T_th moves.
void put_patient_layers(Document& document);
void pose_patient_layers(Document& document);
/// Condyles and fossae that were found in a volume, where the case has none of its own.
void put_joint_layers(Document& document, const Joints& joints, bool visible);

}  // namespace gnathion
