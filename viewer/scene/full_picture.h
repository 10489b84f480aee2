// The picture at rest, in full detail: drawn by a thread and a context of its own, so that the window never
// waits for it, and shown in the window's scene as colours with their depth. Internal to the scene.
#pragma once

#include <vtkOpenGLActor.h>
#include <vtkProp.h>

#include <QObject>
#include <QSize>
#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "core/rigid.h"
#include "viewer/scene/prepared_surface.h"

class vtkCamera;
class vtkOpenGLQuadHelper;
class vtkTextureObject;

namespace gnathion {

/// Where the camera stands, as far as it decides what a picture shows.
struct CameraPlace {
  std::array<double, 3> eye = {}, focus = {}, up = {};
  double angle_deg = 30;
  bool operator==(const CameraPlace& o) const {
    return eye == o.eye && focus == o.focus && up == o.up && angle_deg == o.angle_deg;
  }
};
CameraPlace place_of(vtkCamera& camera);

/// All that a picture is made of: copied on the GUI thread, drawn on another.
struct PictureRequest {
  struct Surface {
    std::shared_ptr<const PreparedSurface> surface;
    std::shared_ptr<const VertexColors> colors;  ///< null: `color`
    Color color = {};
    double opacity = 1;
    Matrix4 pose = Matrix4::Identity();
  };
  std::uint64_t version = 0;  ///< of the layers
  std::vector<Surface> surfaces;
  CameraPlace camera;
  std::array<double, 2> clipping_mm = {1, 1000};
  QSize px;
  bool marks_inside = false;  ///< marks are drawn among the surfaces, which must hide them
};

struct FinishedPicture {
  std::uint64_t version = 0;
  CameraPlace camera;
  std::array<double, 2> clipping_mm = {1, 1000};
  QSize px;
  std::vector<std::uint8_t> rgba;  ///< lowest row first
  std::vector<float> depth;        ///< 0 to 1, of the clipping range
};

/// Draws on its own thread the newest request; what was asked before and not begun is dropped. GUI thread.
class PicturePainter {
 public:
  /// Null where graphics hardware draws, which is quick enough in the window itself, or without a context.
  static std::unique_ptr<PicturePainter> make_for_processor(
      std::function<void(std::shared_ptr<const FinishedPicture>)> done);
  ~PicturePainter();
  void draw(PictureRequest request);

  class Thread;

 private:
  PicturePainter() = default;
  std::unique_ptr<QObject> gui_;
  std::unique_ptr<Thread> thread_;
};

/// A layer in the window's own scene: keeps its place there, drawn or not. Beside a painter, what is clear is laid
/// over the rest as it comes: sorting it would cost a moving picture as much again.
class LayerActor : public vtkOpenGLActor {
 public:
  static LayerActor* New();
  vtkTypeMacro(LayerActor, vtkOpenGLActor);
  int RenderOpaqueGeometry(vtkViewport* v) override {
    return held_back ? 0 : Superclass::RenderOpaqueGeometry(v);
  }
  int RenderTranslucentPolygonalGeometry(vtkViewport* v) override {
    return held_back ? 0 : Superclass::RenderTranslucentPolygonalGeometry(v);
  }
  vtkTypeBool HasTranslucentPolygonalGeometry() override {
    return held_back || (laid_over && !laying_) ? 0 : Superclass::HasTranslucentPolygonalGeometry();
  }
  /// VTK calls it after all that is sorted.
  int RenderVolumetricGeometry(vtkViewport* v) override {
    if (held_back || !laid_over) return 0;
    laying_ = true;
    const int drawn = Superclass::RenderTranslucentPolygonalGeometry(v);
    laying_ = false;
    return drawn;
  }
  bool held_back = false, laid_over = false;

 private:
  bool laying_ = false;
};

/// A finished picture laid behind all else, with its depth: marks in the scene are hidden by it as they are by
/// the surfaces.
class PictureProp : public vtkProp {
 public:
  static PictureProp* New();
  vtkTypeMacro(PictureProp, vtkProp);
  void show(std::shared_ptr<const FinishedPicture> picture);
  int RenderOpaqueGeometry(vtkViewport* viewport) override;
  void ReleaseGraphicsResources(vtkWindow* window) override;

 protected:
  PictureProp();
  ~PictureProp() override;

 private:
  std::shared_ptr<const FinishedPicture> picture_, loaded_;
  std::unique_ptr<vtkOpenGLQuadHelper> quad_;
  vtkSmartPointer<vtkTextureObject> colors_, depth_;
};

}  // namespace gnathion
