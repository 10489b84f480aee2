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
  if (unsaved_) save();
}

void Document::open(std::shared_ptr<const CaseContent> content) {
  if (unsaved_) save();
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
    if (restored)
      state_ = std::move(*restored);
    else
      trouble = QString::fromStdString(restored.error().line());
  }
  layers_.clear();
  opened();
  state_changed();
  if (!trouble.isEmpty()) report(trouble);
}

void Document::refresh(std::shared_ptr<const CaseContent> content) {
  content_ = std::move(content);
  const bool measured = !state_.therapeutic || state_.therapeutic_source == kMeasured;
  if (measured && content_->therapeutic) {
    state_.therapeutic = content_->therapeutic->motion.rigid;
    state_.therapeutic_source = kMeasured;
  }
  layers_.clear();
  opened();
  state_changed();
}

void Document::change(const QString& text, const std::function<void(SessionState&)>& mutate, int merge) {
  SessionState after = state_;
  mutate(after);
  undo_.push(new ChangeCommand(*this, text, state_, std::move(after), merge));
}

void Document::apply(const SessionState& state) {
  state_ = state;
  unsaved_ = true;
  autosave_.start();
  state_changed();
}

void Document::save() {
  autosave_.stop();
  if (!content_) return;
  unsaved_ = false;
  std::error_code ec;
  if (!std::filesystem::is_directory(content_->folder, ec)) return;
  if (const Status written = write_json(content_->folder / "viewer.json", session_json(state_)); !written)
    report(QString::fromStdString(written.error().line()));
}

}  // namespace gnathion
