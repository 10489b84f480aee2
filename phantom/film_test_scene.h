// A small private scene for the film's tests: two bodies of twelve tags on tilted plates each, and a
// face-like dome, so that the film is tested without the patient.
#pragma once

#include <cmath>

#include "phantom/film.h"

namespace gnathion::film_test {

inline BodyTag tag_on(int id, const Rigid3& body_from_tag, double side_mm = 20) {
  const double h = 0.5 * side_mm;  // tag's own axes: x right, y up, z towards the viewer
  BodyTag tag;
  tag.id = id;
  tag.corners_in_body_mm = {body_from_tag * Vector3(-h, -h, 0), body_from_tag * Vector3(h, -h, 0),
                            body_from_tag * Vector3(h, h, 0), body_from_tag * Vector3(-h, h, 0)};
  return tag;
}

inline void add_plate(TriangleMesh& mesh, const Rigid3& body_from_tag, double half_mm, double thick_mm) {
  const auto base = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  for (int k = 0; k < 8; ++k)
    mesh.vertices_mm.push_back(body_from_tag * Vector3(k & 1 ? half_mm : -half_mm, k & 2 ? half_mm : -half_mm,
                                                       k & 4 ? -0.02 : -thick_mm));
  for (const auto& q : {std::array<std::uint32_t, 4>{4, 5, 7, 6},
                        {0, 2, 3, 1},
                        {0, 1, 5, 4},
                        {2, 6, 7, 3},
                        {0, 4, 6, 2},
                        {1, 3, 7, 5}}) {
    mesh.triangles.push_back({base + q[0], base + q[1], base + q[2]});
    mesh.triangles.push_back({base + q[0], base + q[2], base + q[3]});
  }
}

/// Twelve tags in a 4 × 3 array on plates that lean outwards by about 20°.
inline TaggedBody tilted_body(const std::string& name, int first_id, TriangleMesh* plates) {
  TaggedBody body;
  body.name = name;
  for (int i = 0; i < 12; ++i) {
    const double x = (i % 4 - 1.5) * 29, y = (i / 4 - 1) * 29;
    const Rigid3 lean{exp_so3(Vector3(-y * 0.012, x * 0.009, 0.05 * (i % 3))),
                      Vector3(x, y, -0.004 * (x * x + y * y))};
    body.tags.push_back(tag_on(first_id + i, lean));
    if (plates) add_plate(*plates, lean, 14, 3);
  }
  return body;
}

/// A coarse dome where the face would be, in the head frame's body frame.
inline void add_dome(TriangleMesh& mesh, const Vector3& centre_mm, double radius_mm) {
  constexpr int kRings = 40, kSides = 64;
  const auto base = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  for (int r = 0; r <= kRings; ++r)
    for (int s = 0; s < kSides; ++s) {
      const double polar = 0.5 * M_PI * r / kRings, around = 2 * M_PI * s / kSides;
      mesh.vertices_mm.push_back(centre_mm + radius_mm * Vector3(0.8 * std::sin(polar) * std::cos(around),
                                                                 1.1 * std::sin(polar) * std::sin(around),
                                                                 std::cos(polar)));
    }
  for (std::uint32_t r = 0; r < kRings; ++r)
    for (std::uint32_t s = 0; s < kSides; ++s) {
      const std::uint32_t t = (s + 1) % kSides, a = base + r * kSides + s, b = base + r * kSides + t;
      const std::uint32_t c = a + kSides, d = b + kSides;
      mesh.triangles.push_back({a, c, d});
      mesh.triangles.push_back({a, d, b});
    }
}

/// Head frame above, bow below, 400 mm before a camera with lens distortion.
inline FilmScene test_scene() {
  FilmScene scene;
  RigCamera camera;
  camera.name = "camera_0";
  camera.model.k1 = -0.12;
  camera.model.k2 = 0.05;
  camera.model.p1 = 0.0006;
  camera.model.p2 = -0.0004;
  scene.rig.cameras.push_back(camera);
  scene.rig.bow = tilted_body("bow", 0, &scene.bow_surface);
  scene.rig.head_frame = tilted_body("head_frame", 100, &scene.head_surface);
  add_dome(scene.head_surface, Vector3(0, -70, -130), 90);
  // Dental (x left, y back, z up) to a body frame with x to the viewer's right, y up, z to the viewer.
  const Matrix3 facing = (Matrix3() << 1, 0, 0, 0, 0, 1, 0, -1, 0).finished();
  scene.bow_from_dental = Transform<Bow, Dental>(Rigid3{facing, Vector3(0, 48, -60)});
  scene.head_from_dental = Transform<HeadFrame, Dental>(Rigid3{facing, Vector3(0, -62, -70)});
  // The camera looks along +y of the patient, a little from above.
  const Matrix3 looking = (Matrix3() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished();
  scene.camera_from_dental_at_rest =
      Transform<Camera, Dental>(Rigid3{exp_so3(Vector3(0.12, -0.1, 0.03)) * looking, Vector3(4, 8, 460)});
  // Two degrees open about the hinge axis, a millimetre forward, a little to the left.
  scene.therapeutic =
      Motion<Dental>(Rigid3::from_translation(Vector3(0.5, -1.2, -0.4)) *
                     Rigid3::about_axis(Vector3(0, 90, 36), Vector3(1, 0.1, -0.15), 2.2 * M_PI / 180));
  scene.condyle_left_mm = Vector3(52, 90, 37);
  scene.condyle_right_mm = Vector3(-51, 91, 36);
  scene.incisal_point_mm = Vector3::Zero();
  return scene;
}

}  // namespace gnathion::film_test
