// Plots as PNG: cross-sections with equal axes, and curves over an axis.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/mesh_section.h"
#include "core/result.h"
#include "rendering/scene.h"

namespace gnathion {

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
