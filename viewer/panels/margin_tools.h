// The margin curve: where the splint ends on the crowns, as points on the arch that wears it. Points are set,
// dragged, put in between and taken away with the mouse; each one step of undo.
#pragma once

#include <QWidget>
#include <optional>
#include <string>
#include <vector>

#include "viewer/panels/panel.h"

class QLabel;
class QPushButton;
class QShortcut;
class QToolButton;

namespace gnathion {

class MarginTools : public QWidget {
 public:
  explicit MarginTools(Workbench& bench);
  void put_down();  ///< the tool
  void show_margins(bool shown);
  bool at_work() const { return at_work_; }

 private:
  struct At {
    std::size_t curve = 0, point = 0;
    bool operator==(const At& b) const { return curve == b.curve && point == b.point; }
  };
  void take_up();
  bool mouse(const SceneMouse& mouse);
  void press(const SceneMouse& mouse);
  void add(const Vector3& p_mm);
  void remove_point();
  void end_curve();
  void remove_curve();
  void refresh();
  /// Under the mouse, within a finger's width; the second: the place behind which a point would go in.
  std::optional<At> point_at(const QPointF& px) const;
  std::optional<At> segment_at(const QPointF& px) const;
  std::optional<Vector3> on_arch(const QPointF& px) const;
  std::vector<Vector3> draped(const std::vector<Vector3>& points_mm) const;
  /// On whose crowns the points lie, in the frame that arch was scanned in; the chosen arch where only one shows.
  Arch arch_of(const std::vector<Vector3>& points_mm) const;
  std::shared_ptr<const MeshQuery> surface_of(Arch arch) const;
  Rigid3 shown_from_arch(Arch arch) const;  ///< where that arch stands in the scene now
  std::string arch_layer() const;

  Workbench& bench_;
  QToolButton* draw_;
  QPushButton *next_, *remove_;
  QLabel* facts_;
  std::vector<QShortcut*> keys_;  ///< while a margin is drawn
  bool at_work_ = false, shown_ = false, dragging_ = false;
  std::optional<std::size_t> curve_;  ///< that the next click goes on with
  std::optional<Vector3> first_mm_;   ///< of a curve that has one point yet
  std::optional<At> chosen_;
  std::vector<std::string> hidden_;  ///< layers that would lie over the crowns
};

}  // namespace gnathion
