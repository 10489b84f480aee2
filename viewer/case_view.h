// The 3D part of the window: layers, lights, named views, and the plane that cuts them.
#pragma once

#include <functional>
#include <memory>

#include "rendering/plot.h"
#include "viewer/case_scene.h"

class QWidget;

namespace gnathion {

/// Owns the VTK widget. Everything on the GUI thread.
class CaseView {
 public:
  explicit CaseView(QWidget* parent);
  ~CaseView();

  QWidget* widget() const;
  /// Layers are referred to by their index in scene.layers from now on; the scene must outlive the view.
  void show(const CaseScene& scene);
  void set_visible(std::size_t layer, bool visible);
  void set_opacity(std::size_t layer, double opacity);
  void look_from(const Vector3& towards_viewer, const Vector3& up);
  /// Called with the new plane whenever it is dragged or set.
  void on_plane_moved(std::function<void(const SectionPlane&)> callback);
  void set_plane(const SectionPlane& plane);
  const SectionPlane& plane() const;
  void show_plane(bool visible);
  void render();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gnathion
