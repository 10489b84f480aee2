#include "viewer/case_view.h"

#include <QVTKOpenGLNativeWidget.h>
#include <vtkActor.h>
#include <vtkCallbackCommand.h>
#include <vtkCamera.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkImplicitPlaneRepresentation.h>
#include <vtkImplicitPlaneWidget2.h>
#include <vtkInteractorStyleTrackballCamera.h>
#include <vtkLight.h>
#include <vtkNew.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindowInteractor.h>
#include <vtkRenderer.h>

#include "rendering/vtk_mesh.h"

namespace gnathion {

struct CaseView::Impl {
  QVTKOpenGLNativeWidget* widget = nullptr;
  vtkNew<vtkGenericOpenGLRenderWindow> window;
  vtkNew<vtkRenderer> renderer;
  vtkNew<vtkImplicitPlaneRepresentation> representation;
  vtkNew<vtkImplicitPlaneWidget2> plane_widget;
  vtkNew<vtkCallbackCommand> moved;
  std::vector<vtkSmartPointer<vtkActor>> actors;
  SectionPlane plane;
  Vector3 up = Vector3::UnitZ();  ///< the plot's vertical, as far as the plane allows
  std::function<void(const SectionPlane&)> callback;

  /// The widget knows origin and normal; the plot's axes follow from them and `up`.
  void take_plane_from_widget() {
    double o[3], n[3];
    representation->GetOrigin(o);
    representation->GetNormal(n);
    const Vector3 normal = Vector3(n[0], n[1], n[2]).normalized();
    plane.origin_mm = {o[0], o[1], o[2]};
    Vector3 y = up - up.dot(normal) * normal;
    if (y.norm() < 1e-3) y = plane.y_axis - plane.y_axis.dot(normal) * normal;
    plane.y_axis = y.normalized();
    plane.x_axis = plane.y_axis.cross(normal);
    if (callback) callback(plane);
  }
};

CaseView::CaseView(QWidget* parent) : impl_(std::make_unique<Impl>()) {
  Impl& s = *impl_;
  s.widget = new QVTKOpenGLNativeWidget(parent);
  s.window->SetMultiSamples(0);
  s.widget->setRenderWindow(s.window);
  s.window->AddRenderer(s.renderer);
  s.renderer->SetBackground(0.97, 0.975, 0.98);
  s.renderer->UseFXAAOn();
  s.renderer->SetUseDepthPeeling(true);
  s.renderer->SetMaximumNumberOfPeels(4);
  vtkNew<vtkInteractorStyleTrackballCamera> style;
  s.window->GetInteractor()->SetInteractorStyle(style);
  s.renderer->RemoveAllLights();
  for (const auto& [x, y, intensity] : {std::tuple{-0.8, 1.0, 0.9}, std::tuple{1.0, -0.2, 0.4}}) {
    vtkNew<vtkLight> light;
    light->SetLightTypeToCameraLight();
    light->SetPosition(x, y, 1.0);
    light->SetIntensity(intensity);
    s.renderer->AddLight(light);
  }
  s.moved->SetClientData(&s);
  s.moved->SetCallback([](vtkObject*, unsigned long, void* data, void*) {
    static_cast<Impl*>(data)->take_plane_from_widget();
  });
  s.representation->SetPlaceFactor(1.0);
  s.representation->DrawOutlineOff();
  s.representation->OutlineTranslationOff();
  s.representation->ScaleEnabledOff();
  s.representation->GetPlaneProperty()->SetOpacity(0.25);
  s.representation->GetPlaneProperty()->SetColor(0.2, 0.45, 0.85);
  s.representation->GetSelectedPlaneProperty()->SetOpacity(0.35);
  s.representation->GetEdgesProperty()->SetColor(0.2, 0.45, 0.85);
  s.plane_widget->SetRepresentation(s.representation);
  s.plane_widget->SetInteractor(s.window->GetInteractor());
  s.plane_widget->SetDefaultRenderer(s.renderer);
  s.plane_widget->AddObserver(vtkCommand::InteractionEvent, s.moved);
}

CaseView::~CaseView() {
  impl_->plane_widget->RemoveObserver(impl_->moved);
}

QWidget* CaseView::widget() const {
  return impl_->widget;
}

void CaseView::show(const CaseScene& scene) {
  Impl& s = *impl_;
  for (auto& actor : s.actors) s.renderer->RemoveActor(actor);
  s.actors.clear();
  for (const Layer& layer : scene.layers) {
    vtkNew<vtkPolyDataMapper> mapper;
    mapper->SetInputData(to_vtk(layer.mesh, Rigid3::identity()));
    mapper->ScalarVisibilityOff();
    auto actor = vtkSmartPointer<vtkActor>::New();
    actor->SetMapper(mapper);
    vtkProperty* look = actor->GetProperty();
    look->SetColor(layer.color_3d[0], layer.color_3d[1], layer.color_3d[2]);
    look->SetOpacity(layer.opacity);
    look->SetAmbient(0.2);
    look->SetSpecular(0.2);
    look->SetSpecularPower(25);
    actor->SetVisibility(layer.visible);
    s.renderer->AddActor(actor);
    s.actors.push_back(actor);
  }
  if (scene.arch) s.up = scene.arch->up;
  s.renderer->ResetCamera();
}

void CaseView::set_visible(std::size_t layer, bool visible) {
  impl_->actors.at(layer)->SetVisibility(visible);
  render();
}

void CaseView::set_opacity(std::size_t layer, double opacity) {
  impl_->actors.at(layer)->GetProperty()->SetOpacity(opacity);
  render();
}

void CaseView::look_from(const Vector3& towards_viewer, const Vector3& up) {
  vtkCamera* camera = impl_->renderer->GetActiveCamera();
  double bounds[6];
  impl_->renderer->ComputeVisiblePropBounds(bounds);
  const Vector3 centre(0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3]),
                       0.5 * (bounds[4] + bounds[5]));
  const Vector3 eye = centre + 300.0 * towards_viewer.normalized();
  camera->SetFocalPoint(centre.data());
  camera->SetPosition(eye.data());
  camera->SetViewUp(up.data());
  impl_->renderer->ResetCamera();
  camera->Zoom(1.1);
  render();
}

void CaseView::on_plane_moved(std::function<void(const SectionPlane&)> callback) {
  impl_->callback = std::move(callback);
}

void CaseView::set_plane(const SectionPlane& plane) {
  Impl& s = *impl_;
  s.plane = plane;
  const Vector3 normal = plane.x_axis.cross(plane.y_axis);
  double bounds[6];
  for (int k = 0; k < 3; ++k) {
    bounds[2 * k] = plane.origin_mm[k] - 13;
    bounds[2 * k + 1] = plane.origin_mm[k] + 13;
  }
  s.representation->PlaceWidget(bounds);
  s.representation->SetOrigin(plane.origin_mm.x(), plane.origin_mm.y(), plane.origin_mm.z());
  s.representation->SetNormal(normal.x(), normal.y(), normal.z());
  if (s.callback) s.callback(s.plane);
}

const SectionPlane& CaseView::plane() const {
  return impl_->plane;
}

void CaseView::show_plane(bool visible) {
  impl_->plane_widget->SetEnabled(visible);
  render();
}

void CaseView::render() {
  impl_->window->Render();
}

}  // namespace gnathion
