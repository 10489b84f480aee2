// How surfaces look, in the window's own pictures and in those drawn beside it.
#pragma once

#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkSmartPointer.h>

#include "viewer/model/layer.h"

class vtkProperty;
class vtkRenderer;

namespace gnathion {

void add_lights(vtkRenderer& renderer);
void set_background(vtkRenderer& renderer);
void set_look(vtkProperty& look, bool colored, const Color& color, double opacity);
vtkSmartPointer<vtkPolyDataMapper> mapper_of(vtkPolyData* data, bool colored);

}  // namespace gnathion
