// Colours for values on surfaces, that every eye can order.
#pragma once

#include <memory>
#include <vector>

#include "rendering/scene.h"
#include "viewer/model/layer.h"

namespace gnathion {

/// From dark blue over green to yellow with steadily growing lightness (sampled from the CIVIDIS idea); 0..1.
Color ramp_color(double value);
/// Values between low and high as colours; NaN is grey, "not measured".
std::shared_ptr<const VertexColors> ramp_colors(const std::vector<float>& values, double low, double high);
/// Signed values in ±range on the diverging map of the reports.
std::shared_ptr<const VertexColors> diverging_colors(const std::vector<float>& values, double range,
                                                     const Color& none = {0.62, 0.62, 0.62});

}  // namespace gnathion
