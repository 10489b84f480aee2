// Plots as PNG: cross-sections with equal axes, and curves over an axis.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"
#include "rendering/scene.h"

namespace gnathion {

using Polyline2 = std::vector<Eigen::Vector2d>;

/// A plane with axes: p = origin + x·x_axis + y·y_axis; both unit, orthogonal.
struct SectionPlane {
  Vector3 origin_mm = Vector3::Zero();
  Vector3 x_axis = Vector3::UnitX();
  Vector3 y_axis = Vector3::UnitY();
};

/// Where the plane cuts the mesh, as chains of points in plane coordinates, mm. Closed chains repeat
/// their first point. Chains are joined along shared edges of the mesh.
std::vector<Polyline2> cut_mesh(const TriangleMesh& mesh, const SectionPlane& plane);

struct PlotCurve {
  std::string name;  ///< in the legend; curves of one name and colour share an entry
  Color color = {0, 0, 0};
  double width_px = 2.0;
  std::vector<Polyline2> lines;
};

struct PlotOptions {
  int width_px = 1400, height_px = 1000;
  std::string title, x_label, y_label;  ///< labels carry the unit
  bool equal_axes = false;              ///< 1 mm is the same length both ways
  /// Axis limits; an empty range (min ≥ max) fits the data.
  Eigen::Vector2d x_range{0, 0}, y_range{0, 0};
};

/// Writes a PNG with axes, ticks, grid and legend.
Status plot_curves(const std::filesystem::path& png, const std::vector<PlotCurve>& curves,
                   const PlotOptions& options);

}  // namespace gnathion
