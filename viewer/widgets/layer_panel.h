// The list of layers: an eye, a colour, a name, and how opaque.
#pragma once

#include <QWidget>

#include "viewer/model/layer.h"

class QVBoxLayout;

namespace gnathion {

class LayerPanel : public QWidget {
 public:
  explicit LayerPanel(LayerModel& layers);
  /// Groups in this order; other groups follow.
  void set_groups(const QStringList& order);

 private:
  void rebuild();
  QWidget* make_row(const Layer& layer);
  LayerModel& layers_;
  QVBoxLayout* column_;
  QStringList order_;
  bool rebuilding_ = false, scheduled_ = false;
};

}  // namespace gnathion
