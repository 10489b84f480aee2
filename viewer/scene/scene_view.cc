#include "viewer/scene/scene_view.h"

#include <QVTKOpenGLNativeWidget.h>
#include <vtkActor.h>
#include <vtkCallbackCommand.h>
#include <vtkCamera.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkMatrix4x4.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderer.h>

#include <QTimer>

#include "viewer/scene/scene_impl.h"
#include "viewer/scene/scene_look.h"

namespace gnathion {
Scene3d::Scene3d(LayerModel& layers, JobRunner& jobs, QWidget* parent, const char* name)
    : impl_(std::make_unique<Impl>(*this, layers, jobs, name)) {
  Impl& s = *impl_;
  s.widget = new QVTKOpenGLNativeWidget(parent);
  s.widget->setObjectName(name);
  s.widget->setMinimumSize(240, 200);
  s.widget->setMouseTracking(true);
  s.window->SetMultiSamples(0);
  s.widget->setRenderWindow(s.window);
  s.window->SetNumberOfLayers(2);
  s.window->AddRenderer(s.renderer);
  s.window->AddRenderer(s.front);
  set_background(*s.renderer);
  s.renderer->AddViewProp(s.picture_prop);
  s.front->SetLayer(1);
  s.front->InteractiveOff();
  s.front->SetActiveCamera(s.renderer->GetActiveCamera());
  s.renderer->GetActiveCamera()->SetViewAngle(22);
  add_lights(*s.renderer);
  add_lights(*s.front);
  s.start_interaction();
  s.start_plane();
  s.overlay_widget = new SceneOverlayWidget(s.widget);
  layers.changed.add([this](const std::string& id, LayerChange change) { impl_->take(id, change); });
  for (const Layer& l : layers.layers()) s.take(l.id, LayerChange::kAdded);
}

Scene3d::~Scene3d() {
  impl_->painter.reset();
  impl_->stop_interaction();
}

QWidget* Scene3d::widget() const {
  return impl_->widget;
}

// --- layers -----------------------------------------------------------------------------------------------

void Scene3d::Impl::take(const std::string& id, LayerChange change) {
  ++version;
  const Layer* layer = layers.find(id);
  if (!layer) {
    const auto at = drawn.find(id);
    if (at == drawn.end()) return;
    renderer->RemoveActor(at->second.actor);
    drawn.erase(at);
    return self.render();
  }
  Drawn& d = drawn[id];
  if (change == LayerChange::kAdded || change == LayerChange::kSurface) {
    if (d.surface && d.surface->mesh == layer->mesh) return build_actor(id);
    d.wanted = layer->mesh;
    if (layer->visible) prepare(id);
    return;
  }
  if (layer->visible && d.wanted && !d.preparing && (!d.surface || d.surface->mesh != d.wanted))
    return prepare(id);
  apply_look(id);
}

/// Another view may have made the same mesh ready already.
std::map<const TriangleMesh*, std::weak_ptr<PreparedSurface>>& surface_cache() {
  static std::map<const TriangleMesh*, std::weak_ptr<PreparedSurface>> cache;  // GUI thread only
  return cache;
}

void Scene3d::Impl::prepare(const std::string& id) {
  Drawn& d = drawn[id];
  const auto mesh = d.wanted;
  if (!mesh || mesh->empty()) return;
  if (auto ready = surface_cache()[mesh.get()].lock(); ready && ready->mesh == mesh) {
    d.surface = ready;
    return build_actor(id);
  }
  d.preparing = true;
  auto made = std::make_shared<std::shared_ptr<PreparedSurface>>();
  // While one preview follows another nobody picks on them.
  jobs.run_latest(
      name + "/" + id,
      [mesh, made, pickable = !held_coarse](JobContext&) {
        *made = prepare_surface(mesh, kCoarseTriangles);
        if (pickable) (*made)->query = prepare_query(*mesh);
      },
      [this, id, mesh, made] {
        const auto at = drawn.find(id);
        if (at == drawn.end()) return;
        at->second.preparing = false;
        if (at->second.wanted != mesh) return prepare(id);
        at->second.surface = *made;
        surface_cache()[mesh.get()] = *made;
        build_actor(id);
        if (!held_coarse) prepare_queries();
      });
}

void Scene3d::Impl::prepare_queries() {
  for (auto& [id, d] : drawn) {
    if (!d.surface || d.surface->query || d.preparing) continue;
    auto query = std::make_shared<std::shared_ptr<const MeshQuery>>();
    jobs.run_latest(
        name + "/query/" + id,
        [surface = d.surface, query](JobContext&) { *query = prepare_query(*surface->mesh); },
        [surface = d.surface, query] { surface->query = *query; });
  }
}

void Scene3d::Impl::build_actor(const std::string& id) {
  Drawn& d = drawn[id];
  const Layer* layer = layers.find(id);
  if (!layer || !d.surface) return;
  start_painter();
  ++version;
  if (!d.actor) {
    d.actor = vtkSmartPointer<LayerActor>::New();
    d.actor->laid_over = painter != nullptr;
    renderer->AddActor(d.actor);
  }
  const bool colored = layer->colors != nullptr;
  d.coarse = mapper_of(
      colored ? with_colors(d.surface->coarse, *layer->colors, &d.surface->coarse_source) : d.surface->coarse,
      colored);
  d.full = nullptr;
  if (!painter)
    d.full =
        mapper_of(colored ? with_colors(d.surface->full, *layer->colors, nullptr) : d.surface->full, colored);
  d.actor->SetMapper(moving || painter ? d.coarse : d.full);
  apply_look(id);
  if (!placed) {
    placed = true;
    renderer->ResetCamera();
  }
  self.render();
}

void Scene3d::Impl::apply_look(const std::string& id) {
  Drawn& d = drawn[id];
  const Layer* layer = layers.find(id);
  if (!layer || !d.actor) return;
  ++version;
  set_look(*d.actor->GetProperty(), layer->colors != nullptr, layer->color_3d, layer->opacity);
  d.actor->SetVisibility(layer->visible && layer->opacity > 0.01);
  const Matrix4 m = layer->pose.matrix();
  vtkNew<vtkMatrix4x4> pose;
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) pose->SetElement(r, c, m(r, c));
  d.actor->SetUserMatrix(pose);
  self.render();
}

// --- drawing ----------------------------------------------------------------------------------------------

void Scene3d::render() {
  if (impl_->scheduled) return;
  impl_->scheduled = true;
  QTimer::singleShot(0, impl_->widget, [this] {
    impl_->scheduled = false;
    render_now();
  });
}

void Scene3d::render_now() {
  Impl& s = *impl_;
  if (!s.widget->isVisible()) return;
  s.renderer->ResetCameraClippingRange();
  s.window->Render();
}

/// The framebuffer has `detail` of the view's width and height, and Qt stretches it; everyone else, the mouse
/// above all, goes on to see a window of the view's size.
void Scene3d::Impl::begin_picture() {
  bool clear = false;
  for (const Layer& l : layers.layers()) clear |= l.visible && l.opacity < 1.0;
  const bool full = painter ? show_finished() : !moving;
  renderer->SetUseDepthPeeling(clear && full && !painter);
  renderer->SetUseFXAA(full && !painter);
  set_detail(full ? 1.0 : moving_detail());
  view_px = {window->GetSize()[0], window->GetSize()[1]};
  if (detail < 1.0)
    window->SetSize(std::max(1, static_cast<int>(std::lround(view_px.width() * detail))),
                    std::max(1, static_cast<int>(std::lround(view_px.height() * detail))));
}

void Scene3d::Impl::end_picture() {
  if (detail < 1.0) window->SetSize(view_px.width(), view_px.height());
}

double Scene3d::Impl::moving_detail() {
  if (!painter) return 1.0;  // graphics hardware draws all pixels at once
  const double pixels = 1.0 * window->GetSize()[0] * window->GetSize()[1];
  return std::clamp(std::sqrt(kMovingPixels / std::max(1.0, pixels)), 0.25, 1.0);
}

// --- the picture in full detail, where the processor draws ------------------------------------------------

void Scene3d::Impl::start_painter() {
  if (painter_tried) return;
  painter_tried = true;
  painter = PicturePainter::make_for_processor([this](std::shared_ptr<const FinishedPicture> picture) {
    if (asked && asked->version == picture->version && asked->camera == picture->camera &&
        asked->px == picture->px)
      asked.reset();
    last_full = std::move(picture);
    self.render();
  });
}

PictureRequest Scene3d::Impl::wanted_picture() {
  renderer->ResetCameraClippingRange();  // of this camera, whoever wants the window drawn
  PictureRequest r;
  r.version = version;
  r.camera = place_of(*renderer->GetActiveCamera());
  renderer->GetActiveCamera()->GetClippingRange(r.clipping_mm.data());
  r.px = {window->GetSize()[0], window->GetSize()[1]};
  r.marks_inside = plane_widget->GetEnabled();
  for (const auto& [id, overlay] : overlays) r.marks_inside |= !overlay.first;
  for (const Layer& l : layers.layers()) {
    const auto at = drawn.find(l.id);
    if (!l.visible || l.opacity <= 0.01 || at == drawn.end() || !at->second.actor) continue;
    r.surfaces.push_back({at->second.surface, l.colors, l.color_3d, l.opacity, l.pose.matrix()});
  }
  return r;
}

/// True: the finished picture is of what stands in the scene now, and shows. Else the coarse surfaces do, and
/// at rest the picture is asked for.
bool Scene3d::Impl::show_finished() {
  const CameraPlace place = place_of(*renderer->GetActiveCamera());
  const QSize px(window->GetSize()[0], window->GetSize()[1]);
  const auto is_now = [&](const auto& picture) {
    return picture.version == version && picture.camera == place && picture.px == px;
  };
  full_shown = !moving && last_full && is_now(*last_full);
  picture_prop->show(full_shown ? last_full : nullptr);
  for (auto& [id, d] : drawn)
    if (d.actor) d.actor->held_back = full_shown;
  if (moving || full_shown || px.isEmpty() || (asked && is_now(*asked))) return full_shown;
  PictureRequest request = wanted_picture();
  asked = Asked{request.version, request.camera, request.px};
  painter->draw(std::move(request));
  return false;
}

/// Lines and letters keep their size on the screen.
void Scene3d::Impl::set_detail(double wanted) {
  if (wanted == detail) return;
  const double factor = wanted / detail;
  for (const auto& [id, overlay] : overlays)
    for (const auto& prop : overlay.second)
      if (auto* actor = vtkActor::SafeDownCast(prop))
        actor->GetProperty()->SetLineWidth(static_cast<float>(actor->GetProperty()->GetLineWidth() * factor));
  constexpr double kDotsPerInch = 72;  // of VTK's letters on a plain screen
  window->SetDPI(static_cast<int>(std::lround(kDotsPerInch * widget->devicePixelRatioF() * wanted)));
  representation->SetHandleSize(representation->GetHandleSize() * factor);
  detail = wanted;
}

bool Scene3d::settled() const {
  const Impl& s = *impl_;
  if (s.moving || s.scheduled) return false;
  const QSize px = s.widget->size() * s.widget->devicePixelRatioF();
  if (s.painter && s.widget->isVisible() && !(s.full_shown && s.last_full->px == px)) return false;
  for (const Layer& l : s.layers.layers()) {
    if (!l.visible || !l.mesh || l.mesh->empty()) continue;
    const auto at = s.drawn.find(l.id);
    if (at == s.drawn.end() || !at->second.surface || at->second.surface->mesh != l.mesh ||
        !at->second.surface->query)
      return false;
  }
  return true;
}

bool Scene3d::draws(const std::string& layer, const std::shared_ptr<const TriangleMesh>& mesh) const {
  const auto at = impl_->drawn.find(layer);
  return at != impl_->drawn.end() && at->second.actor && at->second.surface &&
         at->second.surface->mesh == mesh;
}

QImage Scene3d::picture() const {
  return impl_->widget->grab().toImage();
}

void Scene3d::Impl::set_moving(bool on) {
  if (on) rest.start();
  if (moving == on) return;
  moving = on;
  for (auto& [id, d] : drawn)
    if (d.actor && !painter) d.actor->SetMapper(on ? d.coarse : d.full);
  if (!on) self.render();
}

void Scene3d::note_motion() {
  impl_->set_moving(true);
}

void Scene3d::offer(const std::shared_ptr<PreparedSurface>& surface) {
  surface_cache()[surface->mesh.get()] = surface;
}

void Scene3d::hold_coarse(bool on) {
  impl_->held_coarse = on;
  if (!on) impl_->prepare_queries();
  if (on || impl_->moving) impl_->set_moving(true);
}

void Scene3d::allow_full_detail(bool allowed) {
  impl_->full_allowed = allowed;
  if (allowed && impl_->moving) impl_->rest.start();
}

// --- camera -----------------------------------------------------------------------------------------------

void Scene3d::look_from(const Vector3& towards_viewer, const Vector3& up) {
  Impl& s = *impl_;
  const Vector3 back = towards_viewer.normalized();
  const Vector3 right = up.cross(back).normalized(), above = back.cross(right);
  vtkCamera* camera = s.renderer->GetActiveCamera();
  const double tan_y = std::tan(0.5 * camera->GetViewAngle() * M_PI / 180.0);
  const double tan_x = tan_y * s.widget->width() / std::max(1, s.widget->height());
  // In perspective, each surface point asks for a distance on its own; the largest of each side make the
  // frame narrowest and put what is seen, not its box, into the middle.
  // A colour scale at the right edge keeps its place: the frame ends before it.
  const double usable =
      s.scale_shown && s.widget->width() > 480 ? 1.0 - 2.0 * 124.0 / s.widget->width() : 1.0;
  double most[4] = {-1e300, -1e300, -1e300, -1e300};
  for (const Layer& layer : s.layers.layers()) {
    if (!layer.visible || !layer.mesh) continue;
    const auto& vertices = layer.mesh->vertices_mm;
    const std::size_t step = std::max<std::size_t>(1, vertices.size() / 4000);
    for (std::size_t i = 0; i < vertices.size(); i += step) {
      const Vector3 p = layer.pose * vertices[i];
      const double x = right.dot(p) / tan_x, y = above.dot(p) / tan_y, z = back.dot(p);
      const double asked[4] = {z + x / usable, z - x, z + y, z - y};
      for (int k = 0; k < 4; ++k) most[k] = std::max(most[k], asked[k]);
    }
  }
  const bool empty = most[0] < -1e299;
  // Where both sides ask for the same distance.
  const double aside = empty ? 0.0 : (most[0] - most[1]) / (1.0 + 1.0 / usable);
  const double reach = empty ? 200.0 : std::max(most[1] + aside, 0.5 * (most[2] + most[3]));
  const Vector3 on_axis =
      empty ? Vector3::Zero() : Vector3(tan_x * aside * right + 0.5 * tan_y * (most[2] - most[3]) * above);
  const double depth = empty ? 0.0 : back.dot(s.middle());
  const Vector3 focus = on_axis + depth * back, eye = focus + 1.08 * (reach - depth) * back;
  camera->SetFocalPoint(focus.data());
  camera->SetPosition(eye.data());
  camera->SetViewUp(up.data());
  camera->OrthogonalizeViewUp();
  s.placed = s.fitted = true;
  render();
}

void Scene3d::fit() {
  double n[3], up[3];
  vtkCamera* camera = impl_->renderer->GetActiveCamera();
  camera->GetDirectionOfProjection(n);
  camera->GetViewUp(up);
  look_from(-Vector3(n[0], n[1], n[2]), Vector3(up[0], up[1], up[2]));
}

void Scene3d::refit() {
  if (impl_->fitted) fit();
}

/// Of the visible layers' boxes.
Vector3 Scene3d::Impl::middle() const {
  Vector3 sum = Vector3::Zero();
  int n = 0;
  for (const Layer& layer : layers.layers())
    if (layer.visible && layer.mesh && !layer.mesh->vertices_mm.empty())
      sum += layer.pose * bounding_box(*layer.mesh).centre_mm(), ++n;
  return n ? Vector3(sum / n) : sum;
}

void Scene3d::look_at(const Vector3& point_mm, double width_mm) {
  vtkCamera* camera = impl_->renderer->GetActiveCamera();
  double n[3];
  camera->GetDirectionOfProjection(n);
  const double distance = 0.5 * width_mm / std::tan(0.5 * camera->GetViewAngle() * 0.017453292519943295);
  impl_->fitted = false;
  const Vector3 eye = point_mm - distance * Vector3(n[0], n[1], n[2]);
  camera->SetFocalPoint(point_mm.data());
  camera->SetPosition(eye.data());
  render();
}

void Scene3d::link_camera(Scene3d& other) {
  vtkCamera* camera = other.impl_->renderer->GetActiveCamera();
  impl_->renderer->SetActiveCamera(camera);
  impl_->front->SetActiveCamera(camera);
  impl_->placed = true;
  impl_->linked = &other;
  other.impl_->linked = this;
  render();
}

void Scene3d::unlink_camera() {
  if (!impl_->linked) return;
  impl_->linked->impl_->linked = nullptr;
  impl_->linked = nullptr;
}

// --- overlays ---------------------------------------------------------------------------------------------

void Scene3d::set_overlay(const std::string& overlay_name, Overlay overlay) {
  // What hides marks among the surfaces is drawn with its depth.
  if (!overlay.on_top && !impl_->overlays.count(overlay_name)) ++impl_->version;
  clear_overlay(overlay_name);
  auto& into = impl_->overlays[overlay_name];
  into.first = overlay.on_top;
  into.second = overlay_actors(overlay, impl_->widget->devicePixelRatioF() * impl_->detail);
  for (const auto& actor : into.second) (overlay.on_top ? impl_->front : impl_->renderer)->AddViewProp(actor);
  render();
}

void Scene3d::clear_overlay(const std::string& overlay_name) {
  const auto at = impl_->overlays.find(overlay_name);
  if (at == impl_->overlays.end()) return;
  for (const auto& actor : at->second.second)
    (at->second.first ? impl_->front : impl_->renderer)->RemoveViewProp(actor);
  impl_->overlays.erase(at);
  render();
}

void Scene3d::set_colour_scale(std::optional<ColourScale> scale) {
  impl_->scale_shown = scale.has_value();
  impl_->overlay_widget->set_scale(std::move(scale));
}

void Scene3d::set_caption(const QString& text) {
  impl_->overlay_widget->set_caption(text);
}

std::shared_ptr<const MeshQuery> Scene3d::surface(const std::string& layer) const {
  const auto at = impl_->drawn.find(layer);
  return at == impl_->drawn.end() || !at->second.surface ? nullptr : at->second.surface->query;
}

}  // namespace gnathion
