#include <QVTKOpenGLNativeWidget.h>
#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkProperty.h>
#include <vtkRenderWindowInteractor.h>

#include <QMouseEvent>

#include "viewer/scene/scene_impl.h"

namespace gnathion {
namespace {

class MouseFilter : public QObject {
 public:
  using Handler = std::function<bool(SceneMouse::Kind, const QPointF&, bool, bool)>;
  MouseFilter(Handler handler, std::function<void()> resized)
      : handler_(std::move(handler)), resized_(std::move(resized)) {}

 protected:
  bool eventFilter(QObject*, QEvent* event) override {
    if (event->type() == QEvent::Resize) resized_();
    const bool press = event->type() == QEvent::MouseButtonPress;
    const bool release = event->type() == QEvent::MouseButtonRelease;
    if (!press && !release && event->type() != QEvent::MouseMove) return false;
    const auto* mouse = static_cast<const QMouseEvent*>(event);
    if ((press || release) && mouse->button() != Qt::LeftButton) return false;
    const auto kind = press     ? SceneMouse::Kind::kPress
                      : release ? SceneMouse::Kind::kRelease
                                : SceneMouse::Kind::kMove;
    return handler_(kind, mouse->localPos(), mouse->buttons() & Qt::LeftButton,
                    mouse->modifiers() == Qt::NoModifier);
  }

 private:
  Handler handler_;
  std::function<void()> resized_;
};

}  // namespace

void Scene3d::Impl::start_interaction() {
  window->GetInteractor()->SetInteractorStyle(style);
  // Whoever wants a picture drawn, the camera's style, a widget or this view, it is drawn with these bounds.
  draw_callback->SetClientData(this);
  draw_callback->SetCallback([](vtkObject*, unsigned long event, void* data, void*) {
    Impl& s = *static_cast<Impl*>(data);
    event == vtkCommand::StartEvent ? s.begin_picture() : s.end_picture();
  });
  for (const auto event : {vtkCommand::StartEvent, vtkCommand::EndEvent})
    window->AddObserver(event, draw_callback);
  rest.setSingleShot(true);
  rest.setInterval(kRestMs);
  QObject::connect(&rest, &QTimer::timeout, [this] {
    if (interacting || held_coarse || (!full_allowed && !painter))
      rest.start();
    else
      set_moving(false);
  });
  motion_callback->SetClientData(this);
  motion_callback->SetCallback([](vtkObject*, unsigned long event, void* data, void*) {
    Impl& s = *static_cast<Impl*>(data);
    if (event == vtkCommand::StartInteractionEvent) s.interacting = true, s.fitted = false;
    if (event == vtkCommand::EndInteractionEvent) s.interacting = false;
    s.set_moving(true);
    if (s.linked && s.linked->widget()->isVisible()) {
      s.linked->note_motion();
      s.linked->render();
    }
  });
  for (const auto event :
       {vtkCommand::StartInteractionEvent, vtkCommand::InteractionEvent, vtkCommand::EndInteractionEvent})
    style->AddObserver(event, motion_callback);
  filter = std::make_unique<MouseFilter>([this](SceneMouse::Kind kind, const QPointF& px, bool left,
                                                bool plain) { return mouse(kind, px, left, plain); },
                                         [this] { self.refit(); });
  widget->installEventFilter(filter.get());
}

void Scene3d::Impl::stop_interaction() {
  rest.stop();
  style->RemoveObserver(motion_callback);
  window->RemoveObserver(draw_callback);
  plane_widget->RemoveObserver(plane_callback);
  plane_widget->SetEnabled(false);
  filter.reset();
}

bool Scene3d::Impl::mouse(SceneMouse::Kind kind, const QPointF& px, bool left_down, bool plain) {
  if (handle.held()) {
    const Rigid3 motion = handle.drag(ray(px));
    const bool finished = kind == SceneMouse::Kind::kRelease;
    if (finished) handle.release();
    set_moving(true);
    self.dragged(motion, finished);
    return true;
  }
  const bool dragging_camera = kind == SceneMouse::Kind::kMove && left_down && !tool_held;
  if (dragging_camera) return false;
  if (handle_pose && plain) {
    if (kind == SceneMouse::Kind::kPress && handle.press(px, ray(px), projector())) {
      show_handle();
      return true;
    }
    if (kind == SceneMouse::Kind::kMove && handle.hover(px, projector())) show_handle();
  }
  const SceneMouse event{kind, px, left_down, self.pick(px)};
  if (kind == SceneMouse::Kind::kMove) self.hovered(event.at);
  if (!tool || (!plain && !tool_held)) return false;
  const bool taken = tool(event);
  tool_held = taken && kind != SceneMouse::Kind::kRelease && left_down;
  return taken;
}

// --- picking ----------------------------------------------------------------------------------------------

Manipulator::Ray Scene3d::Impl::ray(const QPointF& px) const {
  const double ratio = widget->devicePixelRatioF();
  const double x = px.x() * ratio, y = (widget->height() - 1 - px.y()) * ratio;
  Vector3 ends[2];
  for (int k = 0; k < 2; ++k) {
    renderer->SetDisplayPoint(x, y, k);
    renderer->DisplayToWorld();
    double w[4];
    renderer->GetWorldPoint(w);
    ends[k] = Vector3(w[0], w[1], w[2]) / w[3];
  }
  return {ends[0], (ends[1] - ends[0]).normalized()};
}

std::optional<QPointF> Scene3d::project(const Vector3& p) const {
  const Impl& s = *impl_;
  s.renderer->SetWorldPoint(p.x(), p.y(), p.z(), 1.0);
  s.renderer->WorldToDisplay();
  double d[3];
  s.renderer->GetDisplayPoint(d);
  const double ratio = s.widget->devicePixelRatioF();
  return QPointF(d[0] / ratio, s.widget->height() - 1 - d[1] / ratio);
}

Manipulator::Project Scene3d::Impl::projector() const {
  return [this](const Vector3& p) { return self.project(p); };
}

std::optional<PickedPoint> Scene3d::pick(const QPointF& px) const {
  return impl_->pick(px, [](const Layer& layer) { return layer.visible && layer.opacity >= 0.05; });
}

std::optional<PickedPoint> Scene3d::pick_on(const std::string& wanted, const QPointF& px) const {
  return impl_->pick(px, [&](const Layer& layer) { return layer.id == wanted; });
}

std::optional<PickedPoint> Scene3d::Impl::pick(const QPointF& px,
                                               const std::function<bool(const Layer&)>& taken) const {
  const Manipulator::Ray r = ray(px);
  std::optional<PickedPoint> best;
  double nearest = 1e300;
  for (const Layer& layer : layers.layers()) {
    if (!taken(layer)) continue;
    const auto query = self.surface(layer.id);
    if (!query) continue;
    const Rigid3 mesh_from_dental = layer.pose.inverse();
    const auto hit = query->ray(mesh_from_dental * r.origin_mm, mesh_from_dental.rotation * r.direction);
    if (!hit || hit->distance_mm >= nearest) continue;
    nearest = hit->distance_mm;
    best = PickedPoint{layer.id, layer.pose * hit->point_mm, layer.pose.rotation * hit->normal, layer.pose};
  }
  return best;
}

void Scene3d::set_tool(std::function<bool(const SceneMouse&)> tool) {
  impl_->tool = std::move(tool);
  impl_->tool_held = false;
  impl_->widget->setCursor(impl_->tool ? Qt::CrossCursor : Qt::ArrowCursor);
}

// --- manipulator ------------------------------------------------------------------------------------------

void Scene3d::show_manipulator(const std::optional<Rigid3>& dental_from_handle) {
  impl_->handle_pose = dental_from_handle;
  if (dental_from_handle) {
    impl_->handle.place(*dental_from_handle);
    impl_->show_handle();
  } else {
    clear_overlay("manipulator");
  }
}

void Scene3d::Impl::show_handle() {
  self.set_overlay("manipulator", handle.look());
}

// --- the section's plane ----------------------------------------------------------------------------------

void Scene3d::Impl::start_plane() {
  plane_callback->SetClientData(this);
  plane_callback->SetCallback([](vtkObject*, unsigned long, void* data, void*) {
    Impl& s = *static_cast<Impl*>(data);
    s.set_moving(true);
    s.take_plane();
  });
  representation->SetPlaceFactor(1.0);
  representation->DrawOutlineOff();
  representation->OutlineTranslationOff();
  representation->ScaleEnabledOff();
  representation->GetPlaneProperty()->SetOpacity(0.22);
  representation->GetPlaneProperty()->SetColor(0.2, 0.45, 0.85);
  representation->GetSelectedPlaneProperty()->SetOpacity(0.35);
  representation->GetEdgesProperty()->SetColor(0.2, 0.45, 0.85);
  plane_widget->SetRepresentation(representation);
  plane_widget->SetInteractor(window->GetInteractor());
  plane_widget->SetDefaultRenderer(renderer);
  plane_widget->SetCurrentRenderer(renderer);
  plane_widget->AddObserver(vtkCommand::InteractionEvent, plane_callback);
}

/// The widget knows origin and normal; the plot's axes follow from them and the patient's up.
void Scene3d::Impl::take_plane() {
  double o[3], n[3];
  representation->GetOrigin(o);
  representation->GetNormal(n);
  const Vector3 normal = Vector3(n[0], n[1], n[2]).normalized();
  plane.origin_mm = {o[0], o[1], o[2]};
  Vector3 y = plane_up - plane_up.dot(normal) * normal;
  if (y.norm() < 1e-3) y = plane.y_axis - plane.y_axis.dot(normal) * normal;
  plane.y_axis = y.normalized();
  plane.x_axis = plane.y_axis.cross(normal);
  self.plane_moved(plane);
}

void Scene3d::set_plane(const SectionPlane& plane, const Vector3& up) {
  Impl& s = *impl_;
  s.plane = plane;
  s.plane_up = up;
  const Vector3 normal = plane.x_axis.cross(plane.y_axis);
  double bounds[6];
  for (int k = 0; k < 3; ++k) {
    bounds[2 * k] = plane.origin_mm[k] - 13;
    bounds[2 * k + 1] = plane.origin_mm[k] + 13;
  }
  s.representation->PlaceWidget(bounds);
  s.representation->SetOrigin(plane.origin_mm.x(), plane.origin_mm.y(), plane.origin_mm.z());
  s.representation->SetNormal(normal.x(), normal.y(), normal.z());
  plane_moved(s.plane);
  render();
}

const SectionPlane& Scene3d::plane() const {
  return impl_->plane;
}

void Scene3d::show_plane(bool visible) {
  impl_->plane_widget->SetEnabled(visible);
  ++impl_->version;  // what hides the plane is drawn with its depth
  render();
}

}  // namespace gnathion
