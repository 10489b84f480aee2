// Shaded triangles through a z-buffer, in parallel projection.
//
// Pictures of a design are part of its few seconds, and without a graphics card OpenGL compiles its shaders
// anew in each process before it draws the first triangle. This needs no card, no driver and no context, runs
// on all cores, and gives the same bytes on any number of them.
#pragma once

#include <vector>

#include "rendering/pixels.h"
#include "rendering/scene.h"

namespace gnathion {

/// Where a scene stands in its picture.
struct Projection {
  Matrix3 axes = Matrix3::Identity();  ///< columns: to the right, up, towards the viewer
  Vector3 centre_mm = Vector3::Zero();
  double px_per_mm = 1.0;
  int width_px = 0, height_px = 0;

  /// Everything of the scene fits at a zoom of 1.
  Projection(const std::vector<SceneMesh>& meshes, const SceneView& view, int width, int height);
  /// x to the right and y downwards from the upper left corner, px; z towards the viewer, mm.
  Vector3 seen(const Vector3& p_mm) const;
};

/// On white. Translucent meshes are blended in order of depth; edges are smoothed.
Pixels rasterized(const std::vector<SceneMesh>& meshes, const Projection& projection);

}  // namespace gnathion
