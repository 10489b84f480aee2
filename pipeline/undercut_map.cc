#include "pipeline/undercut_map.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "design/write_ply.h"
#include "rendering/scene.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr double kFullMm = 0.5;  // from here on the colour stays the same
constexpr Color kNone = palette::kToothIvory, kLittle = {1.0, 0.80, 0.20}, kMuch = {0.75, 0.05, 0.10};

std::array<std::uint8_t, 3> color_of(double depth_mm) {
  const double t = std::clamp(depth_mm / kFullMm, 0.0, 1.0);
  std::array<std::uint8_t, 3> out{};
  for (std::size_t k = 0; k < 3; ++k) {
    const double value = depth_mm <= 0.0 ? kNone[k] : (1.0 - t) * kLittle[k] + t * kMuch[k];
    out[k] = static_cast<std::uint8_t>(std::lround(255.0 * value));
  }
  return out;
}

}  // namespace

Status draw_undercut_map(const SplintInputs& inputs, const SplintDesign& design, const fs::path& folder) {
  const Retention& retention = design.verification.retention;
  TriangleMesh mesh = inputs.support();
  GNATHION_CHECK_OK(write_value_ply(folder / "undercut.ply", mesh, "undercut_mm", retention.undercut_mm));
  mesh.colors_rgb.clear();
  for (const float depth : retention.undercut_mm) mesh.colors_rgb.push_back(color_of(depth));
  SceneMesh item;
  item.mesh = &mesh;
  item.use_vertex_colors = true;
  item.flat_light = true;
  const ArchFrame& f = design.arch;
  std::error_code ec;
  fs::create_directories(folder / "pictures", ec);
  for (const bool left : {false, true}) {
    PictureOptions o;
    o.title = fmt::format(
        "Undercut above the splint's rim, from the {}: yellow little, red {:.1f} mm or more; largest {:.2f} "
        "mm",
        left ? "left" : "right", kFullMm, retention.undercut_max_mm());
    const Vector3 side = left ? f.left : Vector3(-f.left);
    const SceneView view{(f.anterior + side + 0.25 * f.gingival(inputs.arch)).normalized(), f.up, 1.0};
    GNATHION_CHECK_OK(render_scene(folder / "pictures" / (left ? "undercut_left.png" : "undercut_right.png"),
                                   {item}, {}, view, o));
  }
  return {};
}

}  // namespace gnathion
