#include "viewer/scene/scene_look.h"

#include <vtkLight.h>
#include <vtkNew.h>
#include <vtkProperty.h>
#include <vtkRenderer.h>

#include <tuple>

namespace gnathion {

void add_lights(vtkRenderer& renderer) {
  renderer.RemoveAllLights();
  for (const auto& [x, y, intensity] : {std::tuple{-0.8, 1.0, 0.9}, std::tuple{1.0, -0.2, 0.4}}) {
    vtkNew<vtkLight> light;
    light->SetLightTypeToCameraLight();
    light->SetPosition(x, y, 1.0);
    light->SetIntensity(intensity);
    renderer.AddLight(light);
  }
}

void set_background(vtkRenderer& renderer) {
  renderer.SetBackground(0.965, 0.972, 0.98);
  renderer.SetBackground2(0.87, 0.895, 0.925);
  renderer.GradientBackgroundOn();
  renderer.SetMaximumNumberOfPeels(4);
}

void set_look(vtkProperty& look, bool colored, const Color& color, double opacity) {
  look.SetAmbient(colored ? 0.45 : 0.2);
  look.SetDiffuse(colored ? 0.6 : 0.9);
  look.SetSpecular(colored ? 0.0 : 0.2);
  look.SetSpecularPower(25);
  look.SetInterpolationToPhong();
  look.SetColor(color[0], color[1], color[2]);
  look.SetOpacity(opacity);
}

vtkSmartPointer<vtkPolyDataMapper> mapper_of(vtkPolyData* data, bool colored) {
  auto mapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  mapper->SetInputData(data);
  mapper->SetScalarVisibility(colored);
  return mapper;
}

}  // namespace gnathion
