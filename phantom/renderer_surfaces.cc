#include <algorithm>
#include <cmath>

#include "phantom/renderer_layers.h"

namespace gnathion::render {

Vector3 lamp() {
  return Vector3(-0.35, -0.6, -0.72).normalized();
}

Surface::Surface(TriangleMesh surface, double uniform_albedo) : mesh(std::move(surface)) {
  albedo.assign(mesh.triangles.size(), static_cast<float>(uniform_albedo));
  if (mesh.colors_rgb.size() != mesh.vertices_mm.size()) return;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
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
  float x = 0, y = 0;       ///< canvas px
  float inverse_depth = 0;  ///< 1/mm; 0: behind the camera
};

std::vector<ScreenVertex> to_screen(const std::vector<Vector3>& camera_points, const CameraModel& camera) {
  std::vector<ScreenVertex> screen(camera_points.size());
  for (std::size_t i = 0; i < screen.size(); ++i) {
    const Vector3& p = camera_points[i];
    if (p.z() < 1) continue;
    const auto pixel = camera.project(p);
    // A wide lens's polynomial folds back far outside the image; nothing there can be seen.
    if (!pixel || std::abs(p.x()) > 1.5 * p.z() || std::abs(p.y()) > 1.5 * p.z()) continue;
    screen[i] = {static_cast<float>(pixel->x() + kPad), static_cast<float>(pixel->y() + kPad),
                 static_cast<float>(1 / p.z())};
  }
  return screen;
}

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
  std::vector<Vector3> points(mesh.vertices_mm.size());
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = camera_from_body * mesh.vertices_mm[i];
  const std::vector<ScreenVertex> screen = to_screen(points, camera);
  const Vector3 to_lamp = lamp();
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [i, j, k] = mesh.triangles[t];
    if (screen[i].inverse_depth == 0 || screen[j].inverse_depth == 0 || screen[k].inverse_depth == 0)
      continue;
    const Vector3 normal = (points[j] - points[i]).cross(points[k] - points[i]);
    if (normal.dot(points[i]) >= 0) continue;  // turned away
    const double lambert = std::max(0.0, normal.dot(to_lamp) / std::max(normal.norm(), 1e-12));
    const double level = 235.0 * surface.albedo[t] * (0.32 + 0.68 * lambert);
    fill(screen[i], screen[j], screen[k], static_cast<float>(level), out);
  }
}

}  // namespace gnathion::render
