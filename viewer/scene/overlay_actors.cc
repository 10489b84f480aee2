#include "viewer/scene/overlay_actors.h"

#include <vtkActor.h>
#include <vtkArrowSource.h>
#include <vtkBillboardTextActor3D.h>
#include <vtkCellArray.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkSphereSource.h>
#include <vtkTextProperty.h>

namespace gnathion {
namespace {

vtkSmartPointer<vtkActor> plain_actor(vtkPolyDataMapper* mapper, const Color& color) {
  mapper->ScalarVisibilityOff();
  auto actor = vtkSmartPointer<vtkActor>::New();
  actor->SetMapper(mapper);
  actor->GetProperty()->SetColor(color[0], color[1], color[2]);
  actor->PickableOff();
  return actor;
}

vtkSmartPointer<vtkProp> line_actor(const Overlay::Line& line, double scale) {
  vtkNew<vtkPoints> points;
  vtkNew<vtkCellArray> cells;
  const auto n = static_cast<vtkIdType>(line.points_mm.size());
  for (const Vector3& p : line.points_mm) points->InsertNextPoint(p.data());
  if (line.dashed) {
    for (vtkIdType i = 0; i + 1 < n; i += 2) {
      const vtkIdType ids[] = {i, i + 1};
      cells->InsertNextCell(2, ids);
    }
  } else {
    cells->InsertNextCell(static_cast<int>(n));
    for (vtkIdType i = 0; i < n; ++i) cells->InsertCellPoint(i);
  }
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetLines(cells);
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputData(data);
  // Lines that lie on a surface win against it.
  mapper->SetResolveCoincidentTopologyToPolygonOffset();
  mapper->SetRelativeCoincidentTopologyLineOffsetParameters(0, -6);
  auto actor = plain_actor(mapper, line.color);
  actor->GetProperty()->SetLineWidth(static_cast<float>(line.width_px * scale));
  actor->GetProperty()->LightingOff();
  return actor;
}

vtkSmartPointer<vtkProp> ball_actor(const Overlay::Ball& ball) {
  vtkNew<vtkSphereSource> sphere;
  sphere->SetCenter(ball.at_mm.x(), ball.at_mm.y(), ball.at_mm.z());
  sphere->SetRadius(ball.radius_mm);
  sphere->SetThetaResolution(16);
  sphere->SetPhiResolution(12);
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputConnection(sphere->GetOutputPort());
  return plain_actor(mapper, ball.color);
}

vtkSmartPointer<vtkProp> arrow_actor(const Overlay::Arrow& arrow) {
  const Vector3 d = arrow.to_mm - arrow.from_mm;
  const double length = std::max(1e-9, d.norm());
  const Vector3 x = d / length, y = x.unitOrthogonal(), z = x.cross(y);
  vtkNew<vtkArrowSource> source;
  source->SetTipLength(0.28);
  source->SetTipRadius(0.075);
  source->SetShaftRadius(0.026);
  source->SetTipResolution(20);
  source->SetShaftResolution(12);
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputConnection(source->GetOutputPort());
  auto actor = plain_actor(mapper, arrow.color);
  vtkNew<vtkMatrix4x4> m;
  for (int r = 0; r < 3; ++r) {
    m->SetElement(r, 0, length * x[r]);
    m->SetElement(r, 1, length * y[r]);
    m->SetElement(r, 2, length * z[r]);
    m->SetElement(r, 3, arrow.from_mm[r]);
  }
  actor->SetUserMatrix(m);
  actor->GetProperty()->SetAmbient(0.35);
  return actor;
}

vtkSmartPointer<vtkProp> label_actor(const Overlay::Label& label) {
  auto actor = vtkSmartPointer<vtkBillboardTextActor3D>::New();
  actor->SetInput(label.text.c_str());
  actor->SetPosition(label.at_mm.x(), label.at_mm.y(), label.at_mm.z());
  vtkTextProperty* text = actor->GetTextProperty();
  text->SetFontFamilyToArial();
  text->SetBold(true);
  text->SetFontSize(label.size_px);
  text->SetColor(label.color[0], label.color[1], label.color[2]);
  text->SetJustificationToCentered();
  text->SetVerticalJustificationToCentered();
  if (label.plate) {
    text->SetBackgroundColor(1, 1, 1);
    text->SetBackgroundOpacity(0.85);
  }
  actor->PickableOff();
  return actor;
}

}  // namespace

std::vector<vtkSmartPointer<vtkProp>> overlay_actors(const Overlay& overlay, double scale) {
  std::vector<vtkSmartPointer<vtkProp>> out;
  for (const auto& line : overlay.lines)
    if (line.points_mm.size() > 1) out.push_back(line_actor(line, scale));
  for (const auto& ball : overlay.balls) out.push_back(ball_actor(ball));
  for (const auto& arrow : overlay.arrows) out.push_back(arrow_actor(arrow));
  for (const auto& label : overlay.labels) out.push_back(label_actor(label));
  return out;
}

}  // namespace gnathion
