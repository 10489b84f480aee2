// Capture: joins the daemon: cameras with their tags, bow and head, rate and losses, the jaw live, recording.
#pragma once

#include <QTimer>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "client/daemon_client.h"
#include "viewer/panels/panel.h"
#include "viewer/widgets/parts.h"

class QLineEdit;
class QListWidget;

namespace gnathion {

class CameraView;

class CapturePanel : public Panel {
 public:
  /// Makes a connection; in a background job, may take seconds.
  using Connect = std::function<Result<std::unique_ptr<client::DaemonClient>>(const std::string& socket)>;
  CapturePanel(Workbench& bench, Connect connect, std::string socket);
  ~CapturePanel() override;
  QWidget* strip() override { return strip_; }
  void enter() override;
  void leave() override;
  std::set<std::string> first_layers() const override { return {"maxilla", "mandible_live"}; }

 private:
  struct Mail;  ///< newest of each kind, from the subscriptions' threads
  QWidget* make_strip();
  void opened();
  void try_connect();
  void connected(std::unique_ptr<client::DaemonClient> client);
  void lost(const std::string& why);
  void take_mail();
  void show_session(const client::Session& s);
  void show_mark(const client::EventUpdate& e);
  void show_devices(const client::LedgerUpdate& l);
  void show_poses(const client::PoseUpdate& u);
  void act(const QString& name, std::function<Status(client::DaemonClient&)> call);
  void list_takes();

  Connect connect_;
  std::string socket_;
  std::shared_ptr<client::DaemonClient> client_;
  std::vector<std::unique_ptr<client::Subscription>> subscriptions_;
  std::shared_ptr<Mail> mail_;
  QTimer retry_, mail_timer_;
  bool connecting_ = false, was_connected_ = false;
  std::optional<client::Session> session_;
  std::map<std::string, std::optional<HostTime>> pressed_;  ///< by stream and kind, while held

  StepStatus* status_;
  QLabel *state_, *bow_, *head_, *jaw_, *empty_, *last_mark_;
  QPushButton *live_, *record_, *mark_mi_, *mark_tp_, *mark_;
  QTableWidget* devices_;
  QListWidget* takes_;
  QWidget *strip_, *camera_row_;
  std::map<std::string, CameraView*> cameras_;
};

}  // namespace gnathion
