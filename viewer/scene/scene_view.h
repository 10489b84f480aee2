// The 3D view: layers, overlays, the section's plane, the manipulator, picking, named views.
#pragma once

#include <QImage>
#include <QPointF>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh_query.h"
#include "core/mesh_section.h"
#include "viewer/jobs/jobs.h"
#include "viewer/model/layer.h"

class QWidget;

namespace gnathion {

struct PreparedSurface;

/// A place on a visible surface under the mouse, in Dental.
struct PickedPoint {
  std::string layer;
  Vector3 at_mm = Vector3::Zero(), normal = Vector3::UnitZ();
  Rigid3 dental_from_mesh = {};  ///< of the layer
};

/// Marks over or in the scene, in Dental.
struct Overlay {
  struct Line {
    std::vector<Vector3> points_mm;
    Color color = {0.1, 0.1, 0.1};
    double width_px = 2.5;
    bool dashed = false;
  };
  struct Ball {
    Vector3 at_mm;
    Color color = {0.1, 0.1, 0.1};
    double radius_mm = 0.5;
  };
  struct Arrow {
    Vector3 from_mm, to_mm;
    Color color = {0.1, 0.1, 0.1};
  };
  struct Label {
    Vector3 at_mm;
    std::string text;
    Color color = {0.1, 0.1, 0.1};
    int size_px = 14;
    bool plate = false;  ///< on a pale ground
  };
  std::vector<Line> lines;
  std::vector<Ball> balls;
  std::vector<Arrow> arrows;
  std::vector<Label> labels;
  bool on_top = true;  ///< in front of all surfaces
};

/// A colour scale beside the scene: values from low to high, as diverging_color shows them or as a ramp.
struct ColourScale {
  QString title;
  double low = 0, high = 1;
  bool diverging = true;
};

struct SceneMouse {
  enum class Kind { kPress, kMove, kRelease } kind = Kind::kMove;
  QPointF px;
  bool left_down = false;
  std::optional<PickedPoint> at;
};

/// Owns the VTK widget. GUI thread only.
class Scene3d {
 public:
  Scene3d(LayerModel& layers, JobRunner& jobs, QWidget* parent, const char* name);
  ~Scene3d();

  QWidget* widget() const;
  /// Draws at the next turn of the event loop; any number of calls make one picture.
  void render();
  void render_now();
  /// Whether pictures from now on show that mesh, if only coarsely.
  bool draws(const std::string& layer, const std::shared_ptr<const TriangleMesh>& mesh) const;
  bool settled() const;  ///< every visible layer is drawn, at full detail
  QImage picture() const;

  void look_from(const Vector3& towards_viewer, const Vector3& up);
  void fit();    ///< from where the camera looks now, all that shows
  void refit();  ///< the same, unless the camera was moved by hand since
  void look_at(const Vector3& point_mm, double width_mm);
  void link_camera(Scene3d& other);  ///< one camera for both, from now on
  void unlink_camera();

  void set_overlay(const std::string& name, Overlay overlay);
  void clear_overlay(const std::string& name);
  void set_colour_scale(std::optional<ColourScale> scale);
  void set_caption(const QString& text);  ///< upper left; empty: none

  /// Something moves by itself (a slider, playback): coarse while it does, full detail when it rests.
  void note_motion();
  /// False: keep coarse while background work needs the processor.
  void allow_full_detail(bool allowed);
  /// A surface that is ready before its layer is put: then it shows at once.
  void offer(const std::shared_ptr<PreparedSurface>& surface);
  /// True: more changes are on their way; coarse until false.
  void hold_coarse(bool on);

  void show_plane(bool visible);
  void set_plane(const SectionPlane& plane, const Vector3& up);
  const SectionPlane& plane() const;
  Listeners<const SectionPlane&> plane_moved;

  /// Arrows and rings about `dental_from_handle`; `dragged` gets the motion since the drag began, in Dental.
  void show_manipulator(const std::optional<Rigid3>& dental_from_handle);
  Listeners<const Rigid3&, bool> dragged;  ///< motion, finished

  std::optional<PickedPoint> pick(const QPointF& px) const;
  /// On that layer alone, through whatever lies before it.
  std::optional<PickedPoint> pick_on(const std::string& layer, const QPointF& px) const;
  std::optional<QPointF> project(const Vector3& p_mm) const;  ///< widget pixels
  /// Sees the mouse before the camera does; true: it was for the tool.
  void set_tool(std::function<bool(const SceneMouse&)> tool);
  Listeners<const std::optional<PickedPoint>&> hovered;
  /// The surface of a layer, for measuring; null until it is made ready. Frame of the mesh.
  std::shared_ptr<const MeshQuery> surface(const std::string& layer) const;

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace gnathion
