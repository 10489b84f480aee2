// Pictures of meshes, rendered off screen with VTK. All geometry of one scene is told in one frame, mm.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

using Color = std::array<double, 3>;  ///< red, green, blue, 0..1

/// The colours of the method's figures, the same in pictures, plots and the viewer.
namespace palette {
inline constexpr Color kMaxilla = {0.78, 0.16, 0.16};        ///< red in plots
inline constexpr Color kMandible = {0.10, 0.52, 0.22};       ///< green in plots
inline constexpr Color kInner = {0.05, 0.15, 0.55};          ///< dark blue
inline constexpr Color kOuter = {0.35, 0.65, 0.95};          ///< light blue
inline constexpr Color kOcclusalTp = {0.93, 0.35, 0.65};     ///< pink
inline constexpr Color kSplint = {0.05, 0.05, 0.05};         ///< black in plots
inline constexpr Color kToothIvory = {0.93, 0.88, 0.78};     ///< in 3D
inline constexpr Color kSplintClear = {0.45, 0.68, 0.86};    ///< in 3D
inline constexpr Color kMandibleIvory = {0.84, 0.79, 0.68};  ///< in 3D
}  // namespace palette

struct SceneMesh {
  const TriangleMesh* mesh = nullptr;
  Color color = palette::kToothIvory;
  double opacity = 1.0;
  Rigid3 pose;  ///< scene_from_mesh
  bool use_vertex_colors = false;
  bool flat_light = false;  ///< weak shading, no gloss: colours can be read against a colour bar
};

struct SceneLine {
  std::vector<Vector3> points_mm;
  Color color = {0.1, 0.1, 0.1};
  double width_px = 2.0;
};

/// A parallel projection.
struct SceneView {
  Vector3 towards_viewer = Vector3::UnitZ();  ///< direction from the scene to the eye
  Vector3 up = Vector3::UnitY();
  double zoom = 1.0;  ///< 1: everything just fits
};

struct PictureOptions {
  int width_px = 1400, height_px = 1000;
  std::string title;      ///< upper left; empty: none
  bool scale_bar = true;  ///< 10 mm, lower right
};

/// A picture with its scale.
struct RenderedView {
  std::string png, jpeg;  ///< the same picture; JPEG is a third of the size and not exact
  int width_px = 0, height_px = 0;
  double px_per_mm = 0;
};
/// As render_scene, into memory.
Result<RenderedView> render_view(const std::vector<SceneMesh>& meshes, const std::vector<SceneLine>& lines,
                                 const SceneView& view, const PictureOptions& options);
/// Writes a PNG. Smooth shading, depth-peeled transparency, light from the viewer's upper left.
Status render_scene(const std::filesystem::path& png, const std::vector<SceneMesh>& meshes,
                    const std::vector<SceneLine>& lines, const SceneView& view,
                    const PictureOptions& options);

}  // namespace gnathion
