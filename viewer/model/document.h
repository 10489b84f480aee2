// The open case: what the folder holds, what the user decided, which layers show, and how to undo.
#pragma once

#include <QString>
#include <QTimer>
#include <QUndoStack>
#include <functional>
#include <memory>

#include "viewer/model/case_content.h"
#include "viewer/model/layer.h"
#include "viewer/model/session_state.h"

namespace gnathion {

/// GUI thread only. Every decision goes through change(), so that it can be undone and is saved.
class Document {
 public:
  Document();
  ~Document();
  Document(const Document&) = delete;
  Document& operator=(const Document&) = delete;

  /// Takes a loaded case; the last session's decisions (CASE/viewer.json) come back.
  void open(std::shared_ptr<const CaseContent> content);
  /// The same folder read anew: decisions, undo and saving go on. A T_th that came from the results follows
  /// them.
  void refresh(std::shared_ptr<const CaseContent> content);
  bool is_open() const { return content_ != nullptr; }
  const CaseContent& content() const { return *content_; }
  std::shared_ptr<const CaseContent> shared_content() const { return content_; }
  const SessionState& state() const { return state_; }
  LayerModel& layers() { return layers_; }
  QUndoStack& undo_stack() { return undo_; }

  /// One step of undo. Changes with the same `merge` that follow one another are one step (a slider's drag),
  /// until end_merge().
  void change(const QString& text, const std::function<void(SessionState&)>& mutate, int merge = -1);
  void end_merge() { ++merge_generation_; }
  /// Writes CASE/viewer.json now, if anything was decided since. Errors go to `error`.
  void save();
  /// Shows an error in the window's bar; never a dialog.
  void report(const QString& line) { error(line); }

  Listeners<> opened, state_changed;
  Listeners<const QString&> error, notice;

 private:
  class ChangeCommand;
  void apply(const SessionState& state);
  void take_measured();

  std::shared_ptr<const CaseContent> content_;
  SessionState state_;
  LayerModel layers_;
  QUndoStack undo_;
  QTimer autosave_;
  int merge_generation_ = 0;
  bool unsaved_ = false;
};

}  // namespace gnathion
