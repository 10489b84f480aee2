// The design's parameters with unit, range, default and source; each change is a decision that can be undone.
#pragma once

#include <QScrollArea>
#include <map>
#include <string>

#include "design/parameters.h"
#include "viewer/model/document.h"

class QComboBox;
class QDoubleSpinBox;

namespace gnathion {

class ParameterPage : public QScrollArea {
 public:
  explicit ParameterPage(Document& document);
  /// As the document has them.
  void show_values();

 private:
  QWidget* make_row(const ParameterHelp& help, int merge);
  void take(const std::string& name, double value, int merge);

  Document& document_;
  std::map<std::string, QDoubleSpinBox*> boxes_;
  QComboBox* arch_;
  bool showing_ = false;
};

}  // namespace gnathion
