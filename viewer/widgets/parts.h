// Small parts that panels are built of.
#pragma once

#include <QFrame>
#include <QIcon>
#include <QLabel>
#include <QPushButton>
#include <QTableWidget>
#include <QVBoxLayout>
#include <QWidget>
#include <functional>
#include <vector>

#include "rendering/scene.h"
#include "viewer/model/case_content.h"

namespace gnathion {

QColor qcolor(const Color& color);
QLabel* heading(const QString& text);
QLabel* wrapped(const QString& text, bool faint = false);
QPushButton* button(const QString& text, const QString& object_name, const QString& tip,
                    std::function<void()> clicked);
/// A read-only table without grid noise; rows select as one.
QTableWidget* plain_table(const QStringList& columns, const QString& object_name);
QTableWidgetItem* cell(const QString& text, bool number = false);
/// A row's first cell: ✓, ✗ or – with its meaning as tool tip, readable without colour.
QTableWidgetItem* verdict_cell(bool pass, bool blocks);
QIcon eye_icon(bool open);

/// "What is done" and "what is missing and why" at the head of a step's panel.
class StepStatus : public QFrame {
 public:
  explicit StepStatus(const QString& object_name);
  void show_state(const QStringList& done, const std::vector<Absence>& missing);

 private:
  QLabel* text_;
};

/// One line across the window for what went wrong; stays until closed or replaced. Never a dialog.
class MessageBar : public QFrame {
 public:
  explicit MessageBar(QWidget* parent);
  void show_error(const QString& line);
  void show_notice(const QString& line);
  QString text() const { return label_->text(); }

 private:
  void show_line(const QString& line, const char* style);
  QLabel* label_;
};

/// A vector drawing of rendering/, as large as it fits.
/// A click shows the same chart over the window, as large as it fits; another click, or Esc, puts it away.
class ChartView : public QWidget {
 public:
  explicit ChartView(QWidget* parent = nullptr);
  void set_drawing(std::shared_ptr<const class Drawing> drawing);
  void set_note(const QString& note);
  bool has_drawing() const { return drawing_ != nullptr; }

 protected:
  void paintEvent(QPaintEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;

 private:
  void enlarge();

  ChartView* large_ = nullptr;  ///< the sheet over the window; a child of it
  bool is_large_ = false;
  std::shared_ptr<const class Drawing> drawing_;
  QString note_;
  QImage picture_;
  QSize drawn_for_;
};

/// Asks for an existing file, `folder`'s first; `chosen` gets it, when one is. Does not block: jobs and pictures
/// go on.
void choose_file(QWidget* parent, const QString& title, const QString& folder, const QString& filter,
                 std::function<void(const QString&)> chosen);

}  // namespace gnathion
