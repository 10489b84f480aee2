// Two designs side by side or over each other, with linked cameras and a map of their difference.
#pragma once

#include <QWidget>
#include <filesystem>

#include "viewer/panels/panel.h"

class QComboBox;
class QLabel;

namespace gnathion {

class CompareTools : public QWidget {
 public:
  explicit CompareTools(Workbench& bench);
  /// Looks for CASE/designs/*/splint.stl again.
  void refresh();
  void leave();
  static ColourScale scale();  ///< of the difference map

 private:
  enum Mode { kOff, kSideBySide, kOver, kDifference };
  void show_mode();
  void with_other(std::function<void(SharedMesh)> use);

  Workbench& bench_;
  QComboBox *other_, *mode_;
  QLabel* facts_;
};

}  // namespace gnathion
