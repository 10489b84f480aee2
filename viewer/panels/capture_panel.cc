#include "viewer/panels/capture_panel.h"

#include <QHBoxLayout>
#include <QHeaderView>
#include <QListWidget>
#include <QShortcut>

#include <algorithm>

#include "viewer/widgets/camera_view.h"

namespace gnathion {
namespace {

constexpr int kRetryMs = 1500, kMailMs = 33;

QString shown(client::SessionState state) {
  constexpr const char* kNames[] = {"Ready", "Armed", "Recording", "Stopping"};
  return kNames[static_cast<std::size_t>(state)];
}

}  // namespace

struct CapturePanel::Mail {
  std::mutex mutex;
  std::map<std::string, client::Preview> previews;
  std::optional<client::PoseUpdate> poses;
  std::optional<client::LedgerUpdate> ledger;
  std::optional<client::Session> session;
  std::vector<client::EventUpdate> events;
  std::optional<std::string> ended;
};

CapturePanel::CapturePanel(Workbench& bench, Connect reach, std::string socket)
    : Panel(bench, Step::kCapture), connect_(std::move(reach)), socket_(std::move(socket)) {
  setObjectName("capturePanel");
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(10, 8, 10, 8);
  column->addWidget(status_ = new StepStatus("captureStatus"));
  state_ = heading("");
  state_->setObjectName("captureState");
  state_->setWordWrap(true);
  column->addWidget(state_);
  record_ = button("● Record", "recordButton", "Begins a take, ends it (key R)", [this] {
    const bool running = session_ && session_->state == client::SessionState::kRecording;
    const std::string id = document().is_open() ? document().content().title : std::string();
    act(running ? "stop" : "record", [running, id](client::DaemonClient& c) -> Status {
      if (running) {
        if (auto r = c.stop(); !r) return tl::unexpected<Error>(r.error());
        return {};
      }
      if (auto now = c.session(); now && now->state == client::SessionState::kIdle)
        if (auto armed = c.arm(id); !armed) return tl::unexpected<Error>(armed.error());
      if (auto r = c.start(); !r) return tl::unexpected<Error>(r.error());
      return {};
    });
  });
  live_ = button("Live pictures", "liveButton",
                 "Opens the instruments without recording, or closes them (key L)", [this] {
                   const bool open = session_ && session_->state != client::SessionState::kIdle;
                   const std::string id = document().is_open() ? document().content().title : std::string();
                   act(open ? "instruments closed" : "instruments open",
                       [open, id](client::DaemonClient& c) -> Status {
                         auto r = open ? c.disarm() : c.arm(id);
                         if (!r) return tl::unexpected<Error>(r.error());
                         return {};
                       });
                 });
  record_->setProperty("role", "record");
  record_->setMinimumHeight(54);
  column->addWidget(record_);
  column->addWidget(live_);
  auto* marks = new QHBoxLayout;
  const auto mark = [this](const char* text, const char* object, const char* kind, const char* tip) {
    auto* b = button(text, object, tip, [this, kind] {
      act(QString("mark ") + kind, [kind](client::DaemonClient& c) -> Status {
        if (auto r = c.mark(kind); !r) return tl::unexpected<Error>(r.error());
        return {};
      });
    });
    b->setMinimumHeight(42);
    return b;
  };
  marks->addWidget(
      mark_mi_ = mark("Mark MI", "markMi", "MI", "The jaw rests in MI (key M); the pedal does the same"));
  marks->addWidget(mark_tp_ = mark("Mark TP", "markTp", "TP", "The jaw rests in TP (key T)"));
  marks->addWidget(mark_ = mark("Mark", "markAny", "mark", "Something worth finding again (key K)"));
  column->addLayout(marks);
  last_mark_ = wrapped("", true);
  last_mark_->setObjectName("lastMark");
  column->addWidget(last_mark_);
  column->addWidget(heading("Seen now"));
  bow_ = new QLabel, head_ = new QLabel, jaw_ = new QLabel;
  bow_->setObjectName("bowState");
  head_->setObjectName("headState");
  jaw_->setObjectName("jawState");
  for (QLabel* l : {bow_, head_, jaw_}) {
    l->setWordWrap(true);
    column->addWidget(l);
  }
  column->addWidget(heading("Devices"));
  devices_ = plain_table({"Device", "Rate", "Lost", "State"}, "deviceTable");
  devices_->horizontalHeader()->setSectionResizeMode(0, QHeaderView::Stretch);
  for (const int c : {1, 2, 3}) devices_->setColumnWidth(c, c == 3 ? 84 : 60);
  devices_->setMinimumHeight(84);
  devices_->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Ignored);  // it takes what is left
  column->addWidget(devices_, 1);
  column->addWidget(heading("Takes"));
  takes_ = new QListWidget;
  takes_->setObjectName("takeList");
  takes_->setMaximumHeight(96);
  column->addWidget(takes_);
  strip_ = make_strip();
  for (const auto& [key, target] : {std::pair{Qt::Key_R, record_},
                                    {Qt::Key_L, live_},
                                    {Qt::Key_M, mark_mi_},
                                    {Qt::Key_T, mark_tp_},
                                    {Qt::Key_K, mark_}}) {
    auto* shortcut = new QShortcut(QKeySequence(key), this);
    connect(shortcut, &QShortcut::activated, target, &QPushButton::click);
  }
  retry_.setInterval(kRetryMs);
  connect(&retry_, &QTimer::timeout, this, [this] { try_connect(); });
  mail_timer_.setInterval(kMailMs);
  connect(&mail_timer_, &QTimer::timeout, this, [this] { take_mail(); });
  document().opened.add([this] { opened(); });
  lost("");
}

CapturePanel::~CapturePanel() {
  subscriptions_.clear();
}

QWidget* CapturePanel::make_strip() {
  auto* strip = new QWidget;
  auto* column = new QVBoxLayout(strip);
  column->setContentsMargins(0, 0, 0, 0);
  empty_ = wrapped("");
  empty_->setObjectName("captureEmpty");
  empty_->setAlignment(Qt::AlignCenter);
  empty_->setTextInteractionFlags(Qt::TextSelectableByMouse);
  camera_row_ = new QWidget;
  auto* row = new QHBoxLayout(camera_row_);
  row->setContentsMargins(0, 0, 0, 0);
  column->addWidget(empty_, 1);
  column->addWidget(camera_row_, 1);
  strip->setMinimumHeight(290);
  return strip;
}

void CapturePanel::opened() {
  list_takes();
  QStringList done;
  const CaseContent& c = document().content();
  int scans = 0;
  for (const char* role : {"maxilla_mi", "mandible_mi", "mandible_clutch", "face_mi", "face_tp"})
    scans += c.mesh(role) != nullptr;
  if (scans) done << QString("%1 %2").arg(scans).arg(scans == 1 ? "scan" : "scans");
  std::error_code ec;
  if (!c.files.recording.empty() && std::filesystem::exists(c.files.recording, ec))
    done << "recording " + QString::fromStdString(c.files.recording.filename().string());
  auto missing = absences();
  if (c.files.recording.empty())
    missing.push_back({Step::kCapture, "Recording", "press Record when the daemon is there", false});
  status_->show_state(done, missing);
}

void CapturePanel::list_takes() {
  takes_->clear();
  if (!document().is_open()) return;
  std::error_code ec;
  namespace fs = std::filesystem;
  std::vector<fs::path> found;
  for (const fs::path& folder : {document().content().folder, document().content().folder / "recordings"})
    for (const auto& e : fs::directory_iterator(folder, ec))
      if (e.path().extension() == ".mcap") found.push_back(e.path());
  std::sort(found.begin(), found.end());
  for (const fs::path& p : found)
    takes_->addItem(QString("%1   %2 MB")
                        .arg(QString::fromStdString(p.filename().string()))
                        .arg(static_cast<double>(fs::file_size(p, ec)) / 1e6, 0, 'f', 1));
  if (found.empty()) takes_->addItem("No takes yet.");
}

void CapturePanel::try_connect() {
  if (client_ || connecting_ || !connect_) return;
  connecting_ = true;
  auto made = std::make_shared<Result<std::unique_ptr<client::DaemonClient>>>(tl::unexpected<Error>(Error{}));
  bench_.jobs.run_latest(
      "daemon", [connect = connect_, socket = socket_, made](JobContext&) { *made = connect(socket); },
      [this, made] {
        connecting_ = false;
        if (*made)
          connected(std::move(**made));
        else if (!was_connected_)
          lost("");
      });
}

void CapturePanel::connected(std::unique_ptr<client::DaemonClient> client) {
  client_ = std::move(client);
  if (was_connected_) document().notice("The daemon is back.");
  was_connected_ = true;
  retry_.stop();
  mail_ = std::make_shared<Mail>();
  const auto mail = mail_;
  const auto ended = [mail](const Status& s) {
    const std::lock_guard lock(mail->mutex);
    mail->ended = s ? "the daemon closed the connection" : s.error().why;
  };
  const auto keep = [mail](auto member) {
    return [mail, member](const auto& update) {
      const std::lock_guard lock(mail->mutex);
      (*mail).*member = update;
    };
  };
  subscriptions_.push_back(client_->watch_session(keep(&Mail::session), false, ended));
  subscriptions_.push_back(client_->poses(keep(&Mail::poses), ended));
  subscriptions_.push_back(client_->ledger(0.5, keep(&Mail::ledger), ended));
  subscriptions_.push_back(client_->previews(
      {},
      [mail](const client::Preview& p) {
        const std::lock_guard lock(mail->mutex);
        mail->previews[p.stream] = p;
      },
      ended));
  subscriptions_.push_back(client_->events(
      [mail](const client::EventUpdate& e) {
        const std::lock_guard lock(mail->mutex);
        mail->events.push_back(e);
      },
      ended));
  bench_.daemon.joined(client_);
  mail_timer_.start();
  empty_->hide();
  camera_row_->show();
  for (QPushButton* b : {record_, live_}) b->setEnabled(true);
  state_->setText("Joined the daemon");
}

/// No daemon, or none any more: said here, looked for again.
void CapturePanel::lost(const std::string& why) {
  subscriptions_.clear();
  client_.reset();
  bench_.daemon.lost();
  mail_timer_.stop();
  session_.reset();
  const QString socket = QString::fromStdString(socket_.empty() ? "/run/gnathion/gnathiond.sock" : socket_);
  state_->setText(was_connected_ ? "The daemon went away" : "No daemon");
  empty_->setText(QString("<b>%1 at %2</b>%3<br>Start it with <tt>gnathiond</tt>. "
                          "It is looked for again by itself; everything else works without it.")
                      .arg(was_connected_ ? "The daemon went away" : "No daemon", socket.toHtmlEscaped(),
                           why.empty() ? "" : "<br>" + QString::fromStdString(why).toHtmlEscaped()));
  empty_->show();
  camera_row_->hide();
  for (QPushButton* b : {record_, live_, mark_mi_, mark_tp_, mark_}) b->setEnabled(false);
  record_->setText("● Record");
  for (QLabel* l : {bow_, head_, jaw_})
    l->setText(l == bow_ ? "Bow, head and jaw appear when the daemon is there." : "");
  devices_->setRowCount(0);
  last_mark_->clear();
  pressed_.clear();
  retry_.start();
}

void CapturePanel::take_mail() {
  if (!mail_) return;
  const auto mail = mail_;
  std::map<std::string, client::Preview> previews;
  std::optional<client::PoseUpdate> poses;
  std::optional<client::LedgerUpdate> ledger;
  std::optional<client::Session> session;
  std::vector<client::EventUpdate> events;
  std::optional<std::string> ended;
  {
    const std::lock_guard lock(mail->mutex);
    previews.swap(mail->previews);
    poses.swap(mail->poses);
    ledger.swap(mail->ledger);
    session.swap(mail->session);
    events.swap(mail->events);
    ended.swap(mail->ended);
  }
  if (ended) {
    document().report("The daemon went away: " + QString::fromStdString(*ended) +
                      ". It is looked for again.");
    return lost(*ended);
  }
  for (const auto& [stream, preview] : previews) {
    CameraView*& view = cameras_[stream];
    if (!view) {
      view = new CameraView;
      view->setObjectName("camera_" + QString::fromStdString(stream));
      camera_row_->layout()->addWidget(view);
    }
    view->show_preview(preview);
  }
  if (session) show_session(*session);
  if (ledger) show_devices(*ledger);
  if (poses) show_poses(*poses);
  for (const client::EventUpdate& e : events) show_mark(e);
}

/// Whose hands are at the patient sees at a glance that the pedal was heard.
void CapturePanel::show_mark(const client::EventUpdate& e) {
  if (e.kind == "device") return;  // one that came or went: the table of devices has it
  const QString name = QString::fromStdString(e.kind);
  const QString from = e.stream == "pedal" ? " by pedal" : "";
  auto& since = pressed_[e.stream + "/" + e.kind];
  if (e.pressed) {
    since = e.capture;
    last_mark_->setText(QString("Last mark: %1%2, held").arg(name, from));
  } else {
    const double held_s = since ? static_cast<double>(e.capture.ns - since->ns) * 1e-9 : 0.0;
    since.reset();
    // A key marks a moment.
    last_mark_->setText(QString("Last mark: %1%2").arg(name, from) +
                        (held_s > 0.05 ? QString(", held for %1 s").arg(held_s, 0, 'f', 1) : QString()));
  }
}

void CapturePanel::show_session(const client::Session& s) {
  const bool was = session_ && session_->state == client::SessionState::kRecording;
  session_ = s;
  const bool running = s.state == client::SessionState::kRecording;
  const bool idle = s.state == client::SessionState::kIdle;
  record_->setText(running ? "■ Stop" : "● Record");
  record_->setEnabled(s.state != client::SessionState::kStopping);
  live_->setText(idle ? "Live pictures" : "Close the instruments");
  live_->setEnabled(idle || s.state == client::SessionState::kArmed);
  for (QPushButton* b : {mark_mi_, mark_tp_, mark_}) b->setEnabled(running);
  state_->setText(running ? QString("Recording %1, %2 s, %3 MB, marks: %4")
                                .arg(QString::fromStdString(s.recording))
                                .arg(s.elapsed_s, 0, 'f', 1)
                                .arg(static_cast<double>(s.file_bytes) / 1e6, 0, 'f', 1)
                                .arg((s.marks + 1) / 2)  // pressed and released
                          : (shown(s.state) + ". " + QString::fromStdString(s.message)));
  if (was && !running) list_takes();
}

void CapturePanel::show_devices(const client::LedgerUpdate& l) {
  devices_->setRowCount(static_cast<int>(l.devices.size()));
  int row = 0;
  for (const client::DeviceInfo& d : l.devices) {
    devices_->setItem(row, 0, cell(QString::fromStdString(d.stream)));
    devices_->setItem(row, 1, cell(QString("%1 Hz").arg(d.rate_hz, 0, 'f', 1), true));
    devices_->setItem(row, 2, cell(QString::number(d.missing + d.rejected), true));
    devices_->setItem(row, 3, cell(QString::fromStdString(d.state)));
    devices_->item(row, 3)->setToolTip(QString::fromStdString(d.message));
    ++row;
  }
  for (const client::StreamCounts& stream : l.streams) {
    const auto view = cameras_.find(stream.stream);
    if (view == cameras_.end()) continue;
    view->second->set_facts(QString("%1 Hz   lost %2   pose after %3 ms")
                                .arg(stream.rate_hz, 0, 'f', 1)
                                .arg(stream.missing + stream.rejected)
                                .arg(l.pose_latency_ms, 0, 'f', 1));
  }
}

void CapturePanel::show_poses(const client::PoseUpdate& u) {
  for (const client::Pose& p : u.poses) {
    const QString text =
        p.valid ? QString("✓ %1: %2 tags, %3 px")
                      .arg(QString::fromStdString(p.body))
                      .arg(p.tags)
                      .arg(p.rms_px, 0, 'f', 2)
                : QString("✗ %1: %2").arg(QString::fromStdString(p.body), QString::fromStdString(p.reason));
    if (p.body == "bow") bow_->setText(text);
    if (p.body == "head_frame" || p.body == "head") head_->setText(text);
    if (p.body != "jaw") continue;
    if (!p.valid) {
      jaw_->setText(text);
    } else if (p.reference == "dental" && document().is_open() && document().content().arch) {
      const ArchFrame& arch = *document().content().arch;
      const Vector3 d = p.reference_from_body * arch.incisal_mm - arch.incisal_mm;
      jaw_->setText(QString("Jaw: down %1 mm, forward %2 mm, left %3 mm from MI")
                        .arg(-arch.up.dot(d), 0, 'f', 1)
                        .arg(arch.anterior.dot(d), 0, 'f', 1)
                        .arg(arch.left.dot(d), 0, 'f', 1));
      if (isVisible()) {
        document().layers().set_pose("mandible_live", p.reference_from_body);
        bench_.scene.note_motion();
      }
    } else {
      jaw_->setText("Jaw: seen; in the teeth's frame when the case has a calibration");
    }
  }
}

void CapturePanel::act(const QString& name, std::function<Status(client::DaemonClient&)> call) {
  if (!client_) return document().report("There is no daemon: start it with gnathiond.");
  auto trouble = std::make_shared<std::string>();
  bench_.jobs.run_latest(
      "capture " + name.toStdString(),
      [client = client_, call = std::move(call), trouble](JobContext&) {
        if (const Status done = call(*client); !done) *trouble = done.error().line();
      },
      [this, trouble, name] {
        if (!trouble->empty())
          document().report(QString::fromStdString(*trouble));
        else
          bench_.status("Done: " + name);
      });
}

void CapturePanel::enter() {
  document().layers().set_pose("mandible_live", Rigid3::identity());
  if (!client_) {
    try_connect();
    retry_.start();
  }
}

void CapturePanel::leave() {}

}  // namespace gnathion
