// The graph of frames as a drawing: frames as boxes, registrations as lines with their error at the teeth.
#pragma once

#include <QWidget>
#include <map>
#include <optional>

#include "calibration/frames_graph.h"

namespace gnathion {

class FramesView : public QWidget {
 public:
  explicit FramesView(QWidget* parent = nullptr);
  void set_graph(std::optional<FramesGraph> graph);
  std::function<void(std::size_t edge)> edge_clicked;

 protected:
  void paintEvent(QPaintEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;

 private:
  std::map<std::string, QPointF> places() const;
  std::optional<FramesGraph> graph_;
  std::vector<std::optional<double>> at_teeth_mm_;
  std::vector<bool> suspect_;
  std::optional<std::size_t> chosen_;
};

}  // namespace gnathion
