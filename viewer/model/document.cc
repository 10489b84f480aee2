#include "viewer/model/document.h"

#include <QUndoCommand>

#include <nlohmann/json.hpp>

namespace gnathion {
namespace {

constexpr const char* kMeasured = "results/T_th.json";

}  // namespace

class Document::ChangeCommand : public QUndoCommand {
 public:
  ChangeCommand(Document& document, const QString& text, SessionState before, SessionState after, int merge)
      : QUndoCommand(text),
        document_(document),
        before_(std::move(before)),
        after_(std::move(after)),
        merge_(merge),
        generation_(document.merge_generation_) {}
  void undo() override { document_.apply(before_); }
  void redo() override { document_.apply(after_); }
  int id() const override { return merge_; }
  bool mergeWith(const QUndoCommand* next) override {
    const auto* other = static_cast<const ChangeCommand*>(next);
    if (other->generation_ != generation_) return false;
    after_ = other->after_;
    return true;
  }

 private:
  Document& document_;
  SessionState before_, after_;
  int merge_, generation_;
};

Document::Document() {
  autosave_.setSingleShot(true);
  autosave_.setInterval(800);
  QObject::connect(&autosave_, &QTimer::timeout, [this] { save(); });
}

Document::~Document() {
  save();
}

void Document::open(std::shared_ptr<const CaseContent> content) {
  save();
  content_ = std::move(content);
  undo_.clear();
  state_ = {};
  state_.parameters = content_->files.parameters;
  state_.edits = content_->files.edits;
  if (content_->therapeutic) {
    state_.therapeutic = content_->therapeutic->motion.rigid;
    state_.therapeutic_source = kMeasured;
  }
  const std::filesystem::path last = content_->folder / "viewer.json";
  std::error_code ec;
  QString trouble;
  if (std::filesystem::exists(last, ec)) {
    const Result<nlohmann::json> j = read_json(last);
    Result<SessionState> restored =
        j ? session_from_json(*j, state_) : Result<SessionState>(tl::unexpected<Error>(j.error()));
    if (restored) {
      state_ = std::move(*restored);
    } else {
      // The next save would write over it: whoever wrote it may still read it.
      std::filesystem::rename(last, content_->folder / "viewer.json.refused", ec);
      trouble = QString::fromStdString(restored.error().line());
      if (!ec) trouble += " (kept as viewer.json.refused)";
    }
  }
  take_measured();
  layers_.clear();
  opened();
  state_changed();
  if (!trouble.isEmpty()) report(trouble);
}

void Document::refresh(std::shared_ptr<const CaseContent> content) {
  content_ = std::move(content);
  if (!state_.therapeutic) state_.therapeutic_source = kMeasured;
  take_measured();
  layers_.clear();
  opened();
  state_changed();
}

/// A T_th that is the case's own follows its results: a run may have changed them since the state was kept.
void Document::take_measured() {
  if (state_.therapeutic_source != kMeasured || !content_ || !content_->therapeutic) return;
  state_.therapeutic = content_->therapeutic->motion.rigid;
}

void Document::change(const QString& text, const std::function<void(SessionState&)>& mutate, int merge) {
  SessionState after = state_;
  mutate(after);
  undo_.push(new ChangeCommand(*this, text, state_, std::move(after), merge));
}

void Document::apply(const SessionState& state) {
  state_ = state;
  take_measured();
  unsaved_ = true;
  autosave_.start();
  state_changed();
}

void Document::save() {
  autosave_.stop();
  if (!content_ || !unsaved_) return;
  std::error_code ec;
  if (!std::filesystem::is_directory(content_->folder, ec)) return;
  const Status written = write_json(content_->folder / "viewer.json", session_json(state_));
  if (!written) return report(QString::fromStdString(written.error().line()));
  unsaved_ = false;
}

}  // namespace gnathion
