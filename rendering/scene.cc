#include "rendering/scene.h"

#include <tbb/task_arena.h>
#include <vtkActor.h>
#include <vtkActor2D.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkCoordinate.h>
#include <vtkLight.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkPolyDataMapper2D.h>
#include <vtkProperty.h>
#include <vtkProperty2D.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkTextActor.h>
#include <vtkTextProperty.h>

#include "core/file.h"
#include "rendering/vtk_mesh.h"
#include "rendering/window.h"

namespace gnathion {
namespace {

void add_mesh(vtkRenderer& renderer, const SceneMesh& item) {
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputData(to_vtk(*item.mesh, item.pose, item.use_vertex_colors));
  mapper->SetScalarVisibility(item.use_vertex_colors);
  vtkNew<vtkActor> actor;
  actor->SetMapper(mapper);
  vtkProperty* look = actor->GetProperty();
  look->SetColor(item.color[0], item.color[1], item.color[2]);
  look->SetOpacity(item.opacity);
  look->SetAmbient(item.flat_light ? 0.5 : 0.18);
  look->SetDiffuse(item.flat_light ? 0.52 : 0.9);
  look->SetSpecular(item.flat_light ? 0 : 0.2);
  look->SetSpecularPower(25);
  look->SetInterpolationToPhong();
  renderer.AddActor(actor);
}

void add_line(vtkRenderer& renderer, const SceneLine& line) {
  vtkNew<vtkPoints> points;
  for (const Vector3& p : line.points_mm) points->InsertNextPoint(p.data());
  vtkNew<vtkCellArray> cells;
  cells->InsertNextCell(static_cast<int>(line.points_mm.size()));
  for (std::size_t i = 0; i < line.points_mm.size(); ++i) cells->InsertCellPoint(static_cast<vtkIdType>(i));
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetLines(cells);
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputData(data);
  vtkNew<vtkActor> actor;
  actor->SetMapper(mapper);
  actor->GetProperty()->SetColor(line.color[0], line.color[1], line.color[2]);
  actor->GetProperty()->SetLineWidth(static_cast<float>(line.width_px));
  actor->GetProperty()->LightingOff();
  renderer.AddActor(actor);
}

/// Key light from the viewer's upper left, a weak fill from the right, so that form shows in relief.
void add_lights(vtkRenderer& renderer) {
  renderer.RemoveAllLights();
  const auto add = [&](double x, double y, double z, double intensity) {
    vtkNew<vtkLight> light;
    light->SetLightTypeToCameraLight();
    light->SetPosition(x, y, z);
    light->SetFocalPoint(0, 0, 0);
    light->SetIntensity(intensity);
    renderer.AddLight(light);
  };
  add(-0.8, 1.0, 1.0, 0.9);
  add(1.0, -0.2, 1.0, 0.4);
}

void place_camera(vtkRenderer& renderer, const SceneView& view) {
  vtkCamera* camera = renderer.GetActiveCamera();
  camera->ParallelProjectionOn();
  camera->SetFocalPoint(0, 0, 0);
  camera->SetPosition(view.towards_viewer.x(), view.towards_viewer.y(), view.towards_viewer.z());
  camera->SetViewUp(view.up.x(), view.up.y(), view.up.z());
  renderer.ResetCamera();
  camera->Zoom(1.45 * view.zoom);
  renderer.ResetCameraClippingRange();
}

void add_text(vtkRenderer& renderer, const std::string& text, int size_px, double x_px, double y_px) {
  vtkNew<vtkTextActor> actor;
  actor->SetInput(text.c_str());
  actor->GetTextProperty()->SetFontSize(size_px);
  actor->GetTextProperty()->SetColor(0.12, 0.12, 0.15);
  actor->GetTextProperty()->SetFontFamilyToArial();
  actor->SetPosition(x_px, y_px);
  renderer.AddActor2D(actor);
}

/// Ten millimetres; the projection is parallel, so one bar holds for the whole picture.
void add_scale_bar(vtkRenderer& renderer, const PictureOptions& options) {
  const double px_per_mm = options.height_px / (2.0 * renderer.GetActiveCamera()->GetParallelScale());
  const double length = 10.0 * px_per_mm, x1 = options.width_px - 40.0, x0 = x1 - length, y = 40.0;
  vtkNew<vtkPoints> points;
  const double ends[][2] = {{x0, y + 6}, {x0, y}, {x1, y}, {x1, y + 6}};
  for (const auto& e : ends) points->InsertNextPoint(e[0], e[1], 0);
  vtkNew<vtkCellArray> cells;
  cells->InsertNextCell(4);
  for (int i = 0; i < 4; ++i) cells->InsertCellPoint(i);
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetLines(cells);
  vtkNew<vtkPolyDataMapper2D> mapper;
  mapper->SetInputData(data);
  vtkNew<vtkActor2D> bar;
  bar->SetMapper(mapper);
  bar->GetProperty()->SetColor(0.12, 0.12, 0.15);
  bar->GetProperty()->SetLineWidth(3);
  renderer.AddActor2D(bar);
  add_text(renderer, "10 mm", 20, x0, y + 12);
}

Result<RenderedView> draw(const std::vector<SceneMesh>& meshes, const std::vector<SceneLine>& lines,
                          const SceneView& view, const PictureOptions& options) {
  const DrawingTurn turn;
  GNATHION_TRY(auto window, offscreen_window(options.width_px, options.height_px));
  vtkNew<vtkRenderer> renderer;
  renderer->SetBackground(1, 1, 1);
  bool clear = false;
  for (const SceneMesh& m : meshes) {
    if (m.mesh->empty()) continue;
    add_mesh(*renderer, m);
    clear |= m.opacity < 1;
  }
  for (const SceneLine& l : lines) add_line(*renderer, l);
  add_lights(*renderer);
  if (clear) {
    renderer->SetUseDepthPeeling(true);
    renderer->SetMaximumNumberOfPeels(6);
  }
  window->SetAlphaBitPlanes(true);
  renderer->UseFXAAOn();
  window->AddRenderer(renderer);
  place_camera(*renderer, view);
  if (!options.title.empty()) add_text(*renderer, options.title, 26, 24, options.height_px - 46);
  if (options.scale_bar) add_scale_bar(*renderer, options);
  RenderedView out;
  GNATHION_TRY(out.png, window_png(*window));
  GNATHION_TRY(out.jpeg, window_jpeg(*window));
  out.width_px = options.width_px;
  out.height_px = options.height_px;
  out.px_per_mm = options.height_px / (2.0 * renderer->GetActiveCamera()->GetParallelScale());
  return out;
}

}  // namespace

Result<RenderedView> render_view(const std::vector<SceneMesh>& meshes, const std::vector<SceneLine>& lines,
                                 const SceneView& view, const PictureOptions& options) {
  // VTK works with TBB; a thread that waits there must not take up another picture in the midst of this one.
  return tbb::this_task_arena::isolate([&] { return draw(meshes, lines, view, options); });
}

Status render_scene(const std::filesystem::path& png, const std::vector<SceneMesh>& meshes,
                    const std::vector<SceneLine>& lines, const SceneView& view,
                    const PictureOptions& options) {
  GNATHION_TRY(const RenderedView picture, render_view(meshes, lines, view, options));
  return write_file(png, picture.png);
}

}  // namespace gnathion
