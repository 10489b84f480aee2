// A small rig and two bodies with tags, for this module's tests.
#pragma once

#include <cmath>

#include "core/camera_model.h"
#include "core/random.h"
#include "tracking/body_pose.h"
#include "tracking/synthetic_tags.h"

namespace gnathion::testing {

inline BodyTag body_tag(int id, const Vector3& centre_mm, double yaw_rad, double pitch_rad,
                        double side_mm = 20) {
  // The bodies' tags look along −z of the body, with y down as in a camera's frame.
  const Matrix3 look = Vector3(1, -1, -1).asDiagonal();
  const Rigid3 body_from_tag{exp_so3(Vector3(0, yaw_rad, 0)) * exp_so3(Vector3(pitch_rad, 0, 0)) * look,
                             centre_mm};
  BodyTag tag;
  tag.id = id;
  const auto local = tag_corners_mm(side_mm);
  for (std::size_t k = 0; k < 4; ++k) tag.corners_in_body_mm[k] = body_from_tag * local[k];
  return tag;
}

/// Eight tags a body on a shallow arc, no two in one plane.
inline TaggedBody arc_body(const char* name, int first_id, int count = 8) {
  TaggedBody body;
  body.name = name;
  for (int i = 0; i < count; ++i) {
    const double x = (i % 4 - 1.5) * 30, y = (i / 4) * 30;
    body.tags.push_back(
        body_tag(first_id + i, Vector3(x, y, 0.006 * x * x), -0.25 * (i % 4 - 1.5), i / 4 == 0 ? 0.2 : -0.2));
  }
  return body;
}

inline CameraModel bench_camera() {
  CameraModel camera;
  camera.k1 = -0.08;
  camera.k2 = 0.03;
  camera.p1 = 0.0003;
  return camera;
}

inline Rig bench_rig(int cameras = 1) {
  Rig rig;
  rig.cameras.push_back({"camera_0", bench_camera(), {}});
  if (cameras > 1) {
    rig.cameras.push_back(
        {"camera_1", bench_camera(), Rigid3{exp_so3(Vector3(0, 0.35, 0)), Vector3(-140, 0, 25)}});
  }
  rig.bow = arc_body("bow", 0);
  rig.head_frame = arc_body("head_frame", 20);
  return rig;
}

/// In front of the rig at about `distance_mm`, turned by up to 0.25 rad.
inline Rigid3 bench_pose(Random& random, double y_mm, double distance_mm = 400) {
  return {
      exp_so3(random.uniform(0, 0.25) * random.unit_vector()),
      Vector3(random.uniform(-15, 15), y_mm + random.uniform(-5, 5), distance_mm + random.uniform(-20, 20))};
}

/// Corners as an ideal detector would tell them, with noise of the covariance that it states.
inline RigTags observe(const Rig& rig, const TaggedBody& body, const Rigid3& rig_from_body, double sigma_px,
                       Random& random) {
  RigTags tags(rig.cameras.size());
  for (std::size_t c = 0; c < rig.cameras.size(); ++c) {
    for (const BodyTag& tag : body.tags) {
      const auto corners = projected_tag(rig.cameras[c], tag, rig_from_body);
      if (!corners) continue;
      TagObservation o;
      o.id = tag.id;
      o.corners_px = *corners;
      for (auto& p : o.corners_px) p += sigma_px * Eigen::Vector2d(random.normal(), random.normal());
      o.covariance_px2 = sigma_px * sigma_px * Matrix8::Identity();
      o.refined = true;
      tags[c].push_back(o);
    }
  }
  return tags;
}

/// What a camera shows of a body.
inline std::vector<SceneTag> scene_tags(const TaggedBody& body, const Rigid3& camera_from_body) {
  std::vector<SceneTag> tags;
  for (const BodyTag& tag : body.tags) {
    const auto& c = tag.corners_in_body_mm;
    SceneTag s;
    s.id = tag.id;
    s.side_mm = (c[1] - c[0]).norm();
    Rigid3 body_from_tag;
    body_from_tag.translation_mm = 0.25 * (c[0] + c[1] + c[2] + c[3]);
    body_from_tag.rotation.col(0) = (c[1] - c[0]).normalized();
    body_from_tag.rotation.col(1) = (c[3] - c[0]).normalized();
    body_from_tag.rotation.col(2) = body_from_tag.rotation.col(0).cross(body_from_tag.rotation.col(1));
    s.camera_from_tag = camera_from_body * body_from_tag;
    tags.push_back(s);
  }
  return tags;
}

}  // namespace gnathion::testing
