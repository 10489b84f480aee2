// The phantom's face under a speckle pattern, as two cameras see it: truth for stereo.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/camera_model.h"
#include "core/mesh.h"
#include "phantom/face.h"
#include "phantom/renderer.h"

namespace gnathion {

/// Every triangle cut into four, `times` times; the surface stays as it is.
inline TriangleMesh subdivided(const TriangleMesh& mesh, int times) {
  if (times == 0) return mesh;
  TriangleMesh fine;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vector3 a = mesh.corner(t, 0), b = mesh.corner(t, 1), c = mesh.corner(t, 2);
    const auto n = static_cast<std::uint32_t>(fine.vertices_mm.size());
    for (const Vector3& p : {a, b, c, Vector3(0.5 * (a + b)), Vector3(0.5 * (b + c)), Vector3(0.5 * (c + a))})
      fine.vertices_mm.push_back(p);
    fine.triangles.push_back({n, n + 3, n + 5});
    fine.triangles.push_back({n + 3, n + 1, n + 4});
    fine.triangles.push_back({n + 5, n + 4, n + 2});
    fine.triangles.push_back({n + 3, n + 4, n + 5});
  }
  return subdivided(fine, times - 1);
}

/// Smooth random brightness in space, 0..1: random values on a lattice, interpolated. As if dots were painted
/// on.
inline double speckle(const Vector3& p_mm, double grain_mm, std::uint64_t seed) {
  const auto lattice = [&](long x, long y, long z) {
    std::uint64_t h =
        seed + 0x9E3779B97F4A7C15ull * static_cast<std::uint64_t>(x * 73856093 ^ y * 19349663 ^ z * 83492791);
    h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9ull;
    h = (h ^ (h >> 27)) * 0x94D049BB133111EBull;
    return static_cast<double>((h ^ (h >> 31)) >> 11) * 0x1p-53;
  };
  const Vector3 q = p_mm / grain_mm;
  const long x = std::lround(std::floor(q.x())), y = std::lround(std::floor(q.y())),
             z = std::lround(std::floor(q.z()));
  double sum = 0;
  for (int k = 0; k < 8; ++k) {
    const int dx = k & 1, dy = (k >> 1) & 1, dz = k >> 2;
    const double wx = dx ? q.x() - double(x) : 1 - (q.x() - double(x)),
                 wy = dy ? q.y() - double(y) : 1 - (q.y() - double(y)),
                 wz = dz ? q.z() - double(z) : 1 - (q.z() - double(z));
    sum += wx * wy * wz * lattice(x + dx, y + dy, z + dz);
  }
  return sum;
}

struct SpeckledFace {
  TriangleMesh face;     ///< truth, Dental
  TriangleMesh painted;  ///< the same surface, finely cut, with the pattern as colours
};

inline SpeckledFace speckled_face(std::uint64_t seed, bool pattern = true) {
  SpeckledFace out;
  out.face = make_face(draw_face_shape(seed));
  out.painted = subdivided(out.face, 2);
  out.painted.colors_rgb.reserve(out.painted.vertices_mm.size());
  for (const Vector3& p : out.painted.vertices_mm) {
    const double light = pattern ? std::clamp(0.5 + 1.3 * (speckle(p, 1.6, seed) - 0.5), 0.05, 1.0) : 0.6;
    const auto grey = static_cast<std::uint8_t>(255 * light);
    out.painted.colors_rgb.push_back({grey, grey, grey});
  }
  return out;
}

/// Two cameras in front of the face, `distance_mm` away, toed in a little; the rig's frame is the first
/// camera's.
struct StereoBench {
  RigCamera first, second;
  Rigid3 first_from_dental;
};

inline StereoBench stereo_bench(const TriangleMesh& face, double distance_mm, double baseline_mm,
                                bool upright = false) {
  StereoBench bench;
  CameraModel model;
  model.k1 = -0.09;
  model.k2 = 0.05;
  model.p1 = 0.0004;
  bench.first.name = "left";
  bench.first.model = model;
  bench.second.name = "right";
  bench.second.model = model;
  bench.second.model.fx_px = bench.second.model.fy_px = 1112;
  bench.second.model.cx_px = 648;
  const Vector3 middle = bounding_box(face).centre_mm();
  // The face looks along -Y, its crown is +Z; cameras look along +Y. Upright: one above the other.
  const Vector3 sideways = upright ? Vector3(0, 0, -1) : Vector3(1, 0, 0);
  const auto camera_at = [&](double offset_mm) {
    const Vector3 eye = middle + Vector3(0, -distance_mm, 0) + offset_mm * sideways;
    // Toed in a little only: the renderer's lamp turns with its camera, and shading that differs between the
    // cameras would be an error of the picture, not of the matching.
    const Vector3 z = (middle + 0.85 * offset_mm * sideways - eye).normalized(),
                  x = Vector3(0, 0, -1).cross(z).normalized();
    Rigid3 camera_from_dental;
    camera_from_dental.rotation.row(0) = x.transpose();
    camera_from_dental.rotation.row(1) = z.cross(x).transpose();
    camera_from_dental.rotation.row(2) = z.transpose();
    camera_from_dental.translation_mm = -(camera_from_dental.rotation * eye);
    return camera_from_dental;
  };
  bench.first_from_dental = camera_at(-baseline_mm / 2);
  bench.second.rig_from_camera = bench.first_from_dental * camera_at(baseline_mm / 2).inverse();
  return bench;
}

/// Each pixel gathers four of a camera with half the pixel pitch, as a sensor's area does; noise as the
/// renderer's.
inline Image8 photograph(const TriangleMesh& painted, const CameraModel& camera,
                         const Rigid3& camera_from_dental, std::uint64_t seed, double noise_sigma = 2) {
  CameraModel fine = camera;
  fine.width_px *= 2;
  fine.height_px *= 2;
  fine.fx_px *= 2;
  fine.fy_px *= 2;
  fine.cx_px = 2 * camera.cx_px + 0.5;
  fine.cy_px = 2 * camera.cy_px + 0.5;
  RenderOptions options;
  options.seed = seed;
  options.clutter = false;
  options.blur_sigma_px *= 2;
  options.noise_sigma = 2 * noise_sigma;
  SceneBody body;
  body.surface = painted;
  auto renderer = CameraRenderer::create(fine, {body}, options);
  if (!renderer) return {};
  const Image8 large = renderer->render({BodyExposure{camera_from_dental, {}}}, 0);
  Image8 image(camera.width_px, camera.height_px);
  for (int y = 0; y < image.height_px; ++y)
    for (int x = 0; x < image.width_px; ++x) {
      const int sum = large.at(2 * x, 2 * y) + large.at(2 * x + 1, 2 * y) + large.at(2 * x, 2 * y + 1) +
                      large.at(2 * x + 1, 2 * y + 1);
      image.at(x, y) = static_cast<std::uint8_t>((sum + 2) / 4);
    }
  return image;
}

}  // namespace gnathion
