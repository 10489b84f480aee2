// Overlays as VTK actors; internal to the scene.
#pragma once

#include <vtkProp.h>
#include <vtkSmartPointer.h>

#include <vector>

#include "viewer/scene/scene_view.h"

namespace gnathion {

std::vector<vtkSmartPointer<vtkProp>> overlay_actors(const Overlay& overlay, double scale);

}  // namespace gnathion
