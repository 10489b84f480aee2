#include "viewer/model/colour_maps.h"

#include <algorithm>
#include <cmath>

#include "rendering/charts.h"

namespace gnathion {
namespace {

std::array<std::uint8_t, 3> bytes(const Color& c) {
  const auto byte = [](double v) {
    return static_cast<std::uint8_t>(std::lround(255 * std::clamp(v, 0.0, 1.0)));
  };
  return {byte(c[0]), byte(c[1]), byte(c[2])};
}

template <class Map>
std::shared_ptr<const VertexColors> colored(const std::vector<float>& values, const Color& none,
                                            const Map& map) {
  auto out = std::make_shared<VertexColors>();
  out->reserve(values.size());
  for (const float v : values) out->push_back(bytes(std::isfinite(v) ? map(double(v)) : none));
  return out;
}

}  // namespace

Color ramp_color(double value) {
  // Lightness rises evenly; blue to yellow survives red-green blindness.
  constexpr Color kStops[] = {
      {0.05, 0.12, 0.35}, {0.22, 0.33, 0.46}, {0.42, 0.50, 0.47}, {0.68, 0.66, 0.38}, {0.98, 0.88, 0.30}};
  const double s = std::clamp(value, 0.0, 1.0) * 4;
  const int k = std::min(3, static_cast<int>(s));
  const double f = s - k;
  Color c;
  for (std::size_t i = 0; i < 3; ++i) c[i] = (1 - f) * kStops[k][i] + f * kStops[k + 1][i];
  return c;
}

std::shared_ptr<const VertexColors> ramp_colors(const std::vector<float>& values, double low, double high) {
  return colored(values, kNotMeasured, [&](double v) { return ramp_color((v - low) / (high - low)); });
}

std::shared_ptr<const VertexColors> diverging_colors(const std::vector<float>& values, double range,
                                                     const Color& none) {
  return colored(values, none, [&](double v) { return diverging_color(v / range); });
}

}  // namespace gnathion
