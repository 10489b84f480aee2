// The session on a line of time: opening of the jaw, marks, plateaus, gaps, and where we are.
#pragma once

#include <QWidget>
#include <functional>
#include <optional>
#include <vector>

namespace gnathion {

struct TimelineBand {
  double start_s = 0, end_s = 0;
  QString label;
  QColor color;
};

/// A rest of the jaw that was found: a bar at the foot, to be chosen by a click.
struct TimelineRest {
  double start_s = 0, end_s = 0;
  QString tip;
};

/// Click or drag scrubs; dragging with Shift selects an interval; the wheel zooms.
class Timeline : public QWidget {
 public:
  explicit Timeline(QWidget* parent = nullptr);
  struct Sample {
    double time_s, value_mm;
    bool valid;
  };
  void set_samples(std::vector<Sample> samples);
  void set_bands(std::vector<TimelineBand> bands);
  void set_rests(std::vector<TimelineRest> rests);
  const std::vector<TimelineRest>& rests() const { return rests_; }
  double rest_bar_y() const;  ///< widget pixels, middle of the bars
  void set_time(double time_s);
  double time_s() const { return time_s_; }
  double end_s() const { return samples_.empty() ? 0.0 : samples_.back().time_s; }
  std::optional<std::pair<double, double>> selection() const { return selection_; }
  void set_selection(std::optional<std::pair<double, double>> s);
  double x_of(double time_s) const;  ///< widget pixels
  std::function<void(double)> scrubbed;
  std::function<void()> selected;
  QSize sizeHint() const override { return {600, 130}; }

 protected:
  void paintEvent(QPaintEvent* event) override;
  void mousePressEvent(QMouseEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void wheelEvent(QWheelEvent* event) override;
  void mouseDoubleClickEvent(QMouseEvent*) override;
  bool event(QEvent* event) override;

 private:
  double time_at(double x) const;
  void draw_curve(QPainter& painter) const;
  void draw_axis(QPainter& painter) const;
  void draw_bands(QPainter& painter) const;
  const TimelineRest* rest_at(const QPointF& px) const;

  std::vector<Sample> samples_;
  std::vector<TimelineBand> bands_;
  std::vector<TimelineRest> rests_;
  std::optional<std::pair<double, double>> selection_;
  double time_s_ = 0, view_start_s_ = 0, view_end_s_ = 1, anchor_s_ = 0;
  double low_mm_ = 0, high_mm_ = 1;
  bool selecting_ = false;
};

}  // namespace gnathion
