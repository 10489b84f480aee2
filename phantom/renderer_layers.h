// The parts of a frame, from back to front: clutter, surfaces, tags. Internal to the renderer.
#pragma once

#include <cstdint>
#include <vector>

#include "core/camera_model.h"
#include "core/mesh.h"
#include "phantom/tag_image.h"

namespace gnathion::render {

/// Pixels that are computed beyond each side of the image, so that the lens blur needs no border rule.
constexpr int kPad = 4;

/// Row-major float image of the padded frame: element (x, y) is pixel (x − kPad, y − kPad).
struct Canvas {
  int width = 0, height = 0;
  std::vector<float> values;

  Canvas() = default;
  Canvas(int w, int h, float value = 0) : width(w), height(h), values(size_t(w) * size_t(h), value) {}
  float* row(int y) { return values.data() + size_t(y) * size_t(width); }
  const float* row(int y) const { return values.data() + size_t(y) * size_t(width); }
};

/// Pixels [x0, x1) × [y0, y1) of a canvas.
struct Window {
  int x0 = 1 << 30, y0 = 1 << 30, x1 = 0, y1 = 0;
  bool empty() const { return x0 >= x1 || y0 >= y1; }
  void extend(const Window& w);
  void clip(int width, int height);
  void grow(int pixels) { x0 -= pixels, y0 -= pixels, x1 += pixels, y1 += pixels; }
};

/// Undistorted rays of all pixels of a canvas, as points on the plane z = 1.
struct RayMap {
  int width = 0;
  std::vector<Eigen::Vector2f> rays;
  explicit RayMap(const CameraModel& camera);
  const Eigen::Vector2f* row(int y) const { return rays.data() + size_t(y) * size_t(width); }
};

/// A room full of edges, print and squares that look like tags, in grey levels.
Canvas clutter(int width, int height, std::uint64_t seed);

/// Direction to the lamp, in the camera's frame: above and to the left of the camera.
Vector3 lamp();

/// A body's surface, ready to be drawn.
struct Surface {
  TriangleMesh mesh;
  std::vector<float> albedo;             ///< per triangle, 0..1
  std::vector<Eigen::Vector3f> normals;  ///< per triangle, unit; zero for degenerate ones
  std::vector<float> offsets_mm;         ///< per triangle, of its plane from the origin along the normal
  Surface(TriangleMesh mesh, double uniform_albedo);
};

/// What has been drawn so far.
struct Scratch {
  Canvas light;          ///< grey levels
  Canvas inverse_depth;  ///< 1/z of surfaces, 1/mm; 0: background
  Window touched;
};

/// Flat shaded, z-buffered, one sample a pixel (the lens blur does the rest).
void draw_surface(const Surface& surface, const Rigid3& camera_from_body, const CameraModel& camera,
                  Scratch& out);

/// One tag in its body's frame: the point at (column, row) modules from the black square's upper left
/// corner is origin + column · right + row · down.
struct TagPlane {
  TagImage image;
  Vector3 origin_mm, right_mm, down_mm;
  TagPlane(TagImage pattern, const BodyTag& tag);
};

/// Print of a tag: grey levels before shading.
struct Ink {
  double white, black;
};

/// Draws a tag averaged over the poses in `path` (at least one), shaded for `path`'s middle. Skipped
/// when it turns its back; hidden where a surface lies more than 1.5 mm in front of it.
void draw_tag(const TagPlane& tag, const std::vector<Rigid3>& path, const CameraModel& camera,
              const RayMap& rays, const Ink& ink, Scratch& out);

/// Share of the unit square where a·x + b·y + d > 0, x and y in [−½, ½] (exact).
double covered_share(double a, double b, double d);

/// Separable Gaussian of `window` of `in`, in grey levels; `in` is read up to kPad around it.
struct Blur {
  std::vector<float> kernel;  ///< kernel[k] is the weight at distance k
  explicit Blur(double sigma_px);
  int radius() const { return static_cast<int>(kernel.size()) - 1; }
  /// Row y of the result over [x0, x1) from rows that pass_horizontally() has blurred.
  void horizontally(const Canvas& in, const Window& window, Canvas& out) const;
  void vertically(const Canvas& in, int y, int x0, int x1, float* out) const;
};

}  // namespace gnathion::render
