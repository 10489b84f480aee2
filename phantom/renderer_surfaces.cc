#include <algorithm>
#include <cmath>

#include "phantom/renderer_layers.h"

namespace gnathion::render {

Vector3 lamp() {
  return Vector3(-0.35, -0.6, -0.72).normalized();
}

Surface::Surface(TriangleMesh surface, double uniform_albedo) : mesh(std::move(surface)) {
  const std::size_t count = mesh.triangles.size();
  albedo.assign(count, static_cast<float>(uniform_albedo));
  const std::vector<Vector3> unit = face_normals(mesh);
  for (std::size_t t = 0; t < count; ++t) {
    normals.push_back(unit[t].cast<float>());
    offsets_mm.push_back(static_cast<float>(unit[t].dot(mesh.corner(t, 0))));
  }
  if (mesh.colors_rgb.size() != mesh.vertices_mm.size()) return;
  for (std::size_t t = 0; t < count; ++t) {
    double grey = 0;  // Rec. 601 luma
    for (const std::uint32_t v : mesh.triangles[t]) {
      const auto& c = mesh.colors_rgb[v];
      grey += (0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2]) / 255.0;
    }
    albedo[t] = static_cast<float>(grey / 3);
  }
}

namespace {

struct ScreenVertex {
  float x = 0, y = 0;        ///< canvas px
  float inverse_depth = -1;  ///< 1/mm; 0: cannot be seen; negative: not yet computed
};

/// Vertices on the screen, computed when first asked for: half of a closed surface is never seen.
class Screen {
 public:
  Screen(const TriangleMesh& mesh, const Rigid3& camera_from_body, const CameraModel& camera)
      : mesh_(mesh),
        camera_from_body_(camera_from_body),
        camera_(camera),
        vertices_(mesh.vertices_mm.size()) {}
  const ScreenVertex& operator[](std::uint32_t i) {
    ScreenVertex& v = vertices_[i];
    if (v.inverse_depth < 0) v = projected(camera_from_body_ * mesh_.vertices_mm[i]);
    return v;
  }

 private:
  ScreenVertex projected(const Vector3& p) const {
    // The distortion's polynomial folds back far outside the image; nothing there can be seen.
    if (p.z() < 1 || std::abs(p.x()) > 1.5 * p.z() || std::abs(p.y()) > 1.5 * p.z()) return {0, 0, 0};
    const Eigen::Vector2d pixel = *camera_.project(p);
    return {static_cast<float>(pixel.x() + kPad), static_cast<float>(pixel.y() + kPad),
            static_cast<float>(1 / p.z())};
  }
  const TriangleMesh& mesh_;
  const Rigid3 camera_from_body_;
  const CameraModel& camera_;
  std::vector<ScreenVertex> vertices_;
};

/// Fills one triangle; 1/z is linear in the image.
void fill(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c, float level, Scratch& out) {
  Window window{static_cast<int>(std::ceil(std::min({a.x, b.x, c.x}))),
                static_cast<int>(std::ceil(std::min({a.y, b.y, c.y}))),
                static_cast<int>(std::floor(std::max({a.x, b.x, c.x}))) + 1,
                static_cast<int>(std::floor(std::max({a.y, b.y, c.y}))) + 1};
  window.clip(out.light.width, out.light.height);
  if (window.empty()) return;
  const float area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
  if (area == 0) return;
  const float inv_area = 1 / area;
  // Barycentric coordinates of b and c, and their steps along a row.
  const float step_b = (c.y - a.y) * inv_area, step_c = -(b.y - a.y) * inv_area;
  for (int y = window.y0; y < window.y1; ++y) {
    const float dx = float(window.x0) - a.x, dy = float(y) - a.y;
    float wb = (dx * (c.y - a.y) - dy * (c.x - a.x)) * inv_area;
    float wc = (dy * (b.x - a.x) - dx * (b.y - a.y)) * inv_area;
    float* light = out.light.row(y);
    float* depth = out.inverse_depth.row(y);
    for (int x = window.x0; x < window.x1; ++x, wb += step_b, wc += step_c) {
      if (wb < 0 || wc < 0 || wb + wc > 1) continue;
      const float z = a.inverse_depth + wb * (b.inverse_depth - a.inverse_depth) +
                      wc * (c.inverse_depth - a.inverse_depth);
      if (z <= depth[x]) continue;
      depth[x] = z;
      light[x] = level;
    }
  }
  out.touched.extend(window);
}

}  // namespace

void draw_surface(const Surface& surface, const Rigid3& camera_from_body, const CameraModel& camera,
                  Scratch& out) {
  const TriangleMesh& mesh = surface.mesh;
  Screen screen(mesh, camera_from_body, camera);
  const Rigid3 body_from_camera = camera_from_body.inverse();
  const Eigen::Vector3f eye = body_from_camera.translation_mm.cast<float>();
  const Eigen::Vector3f to_lamp = (body_from_camera.rotation * lamp()).cast<float>();
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Eigen::Vector3f& normal = surface.normals[t];
    if (normal.dot(eye) <= surface.offsets_mm[t]) continue;  // turned away
    const auto [i, j, k] = mesh.triangles[t];
    const ScreenVertex &a = screen[i], &b = screen[j], &c = screen[k];
    if (a.inverse_depth == 0 || b.inverse_depth == 0 || c.inverse_depth == 0) continue;
    const float lambert = std::max(0.0f, normal.dot(to_lamp));
    fill(a, b, c, 235.0f * surface.albedo[t] * (0.32f + 0.68f * lambert), out);
  }
}

}  // namespace gnathion::render
