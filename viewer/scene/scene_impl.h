// The inside of Scene3d, shared by its two source files: drawing (scene_view.cc) and the mouse
// (scene_interaction.cc).
#pragma once

#include <vtkCallbackCommand.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkImplicitPlaneRepresentation.h>
#include <vtkImplicitPlaneWidget2.h>
#include <vtkInteractorStyleTrackballCamera.h>
#include <vtkNew.h>
#include <vtkPolyDataMapper.h>
#include <vtkRenderer.h>

#include <QTimer>
#include <map>

#include "viewer/scene/full_picture.h"
#include "viewer/scene/manipulator.h"
#include "viewer/scene/overlay_actors.h"
#include "viewer/scene/prepared_surface.h"
#include "viewer/scene/scene_overlay_widget.h"
#include "viewer/scene/scene_view.h"

class QVTKOpenGLNativeWidget;

namespace gnathion {

inline constexpr int kRestMs = 220;                     ///< after the last movement: full detail
/// Pixels of a picture while something moves, where the processor draws them: the rest of the view is
/// stretched.
inline constexpr double kMovingPixels = 200000;

struct Scene3d::Impl {
  Impl(Scene3d& view, LayerModel& l, JobRunner& j, const char* n) : self(view), layers(l), jobs(j), name(n) {}

  /// One layer as VTK has it.
  struct Drawn {
    std::shared_ptr<const TriangleMesh> wanted;
    std::shared_ptr<PreparedSurface> surface;
    bool preparing = false;
    vtkSmartPointer<LayerActor> actor;
    vtkSmartPointer<vtkPolyDataMapper> full, coarse;  ///< `full` is the painter's where there is one
  };
  struct Asked {
    std::uint64_t version = 0;
    CameraPlace camera;
    QSize px;
  };

  void take(const std::string& id, LayerChange change);
  void prepare(const std::string& id);
  void prepare_queries();
  void build_actor(const std::string& id);
  void apply_look(const std::string& id);
  void set_moving(bool on);
  void begin_picture();
  void end_picture();
  double moving_detail();
  void set_detail(double wanted);
  void start_painter();
  PictureRequest wanted_picture();
  bool show_finished();
  void start_interaction();
  void stop_interaction();
  void start_plane();
  void take_plane();
  bool mouse(SceneMouse::Kind kind, const QPointF& px, bool left_down, bool plain);
  Manipulator::Ray ray(const QPointF& px) const;
  std::optional<PickedPoint> pick(const QPointF& px, const std::function<bool(const Layer&)>& taken) const;
  Manipulator::Project projector() const;
  void show_handle();
  Vector3 middle() const;

  Scene3d& self;
  LayerModel& layers;
  JobRunner& jobs;
  std::string name;
  QVTKOpenGLNativeWidget* widget = nullptr;
  SceneOverlayWidget* overlay_widget = nullptr;
  vtkNew<vtkGenericOpenGLRenderWindow> window;
  vtkNew<vtkRenderer> renderer, front;
  vtkNew<vtkInteractorStyleTrackballCamera> style;
  vtkNew<vtkImplicitPlaneRepresentation> representation;
  vtkNew<vtkImplicitPlaneWidget2> plane_widget;
  vtkNew<vtkCallbackCommand> plane_callback, motion_callback, draw_callback;
  std::map<std::string, Drawn> drawn;
  std::map<std::string, std::pair<bool, std::vector<vtkSmartPointer<vtkProp>>>> overlays;
  std::unique_ptr<QObject> filter;
  Scene3d* linked = nullptr;
  QTimer rest;
  double detail = 1.0;  ///< of the picture's width and height that is drawn
  QSize view_px;
  std::unique_ptr<PicturePainter> painter;  ///< null: the window draws in full detail itself
  vtkNew<PictureProp> picture_prop;
  std::shared_ptr<const FinishedPicture> last_full;
  std::optional<Asked> asked;  ///< the newest picture asked for, until one comes
  std::uint64_t version = 0;   ///< of what stands in the scene, marks and camera apart
  bool painter_tried = false, full_shown = false;
  bool scale_shown = false;
  bool fitted = false;  ///< nobody has moved the camera since all that shows was brought into view
  bool held_coarse = false;  ///< more changes are on their way
  bool moving = false, scheduled = false, placed = false, full_allowed = true, interacting = false;
  SectionPlane plane;
  Vector3 plane_up = Vector3::UnitZ();
  std::optional<Rigid3> handle_pose;
  Manipulator handle;
  bool tool_held = false;
  std::function<bool(const SceneMouse&)> tool;
  std::optional<PickedPoint> last_hover;
};

}  // namespace gnathion
