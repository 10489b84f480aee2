// Strokes of the wax knife, cutouts and contacts, drawn on the surface with the mouse; each one step of undo.
#pragma once

#include <QWidget>
#include <vector>

#include "viewer/panels/panel.h"

class QButtonGroup;
class QDoubleSpinBox;
class QListWidget;

namespace gnathion {

class EditTools : public QWidget {
 public:
  explicit EditTools(Workbench& bench);
  void put_down();  ///< the tool
  void show_edits(bool shown);

 private:
  enum Tool { kAdd, kRemove, kSmooth, kCutout, kContact };
  void take_up(int tool);
  bool mouse(const SceneMouse& mouse);
  void finish();
  void refresh();
  void remove_selected();

  Workbench& bench_;
  QButtonGroup* tools_;
  QDoubleSpinBox *radius_, *depth_;
  QListWidget* list_;
  std::vector<Vector3> drawing_mm_;
  int tool_ = -1;
  bool shown_ = false;
};

}  // namespace gnathion
