#include "benchmarks/chain_campaign_film.h"

#include <cmath>

#include "calibration/bow_geometry.h"
#include "calibration/camera_calibration.h"
#include "core/random.h"
#include "tracking/session_motion.h"

namespace gnathion {
namespace {

constexpr double kRad = M_PI / 180;
constexpr double kCorner_px = 0.015;  // of the detector on sharp pictures (docs/accuracy.md)

CameraModel some_camera(Random& random) {
  CameraModel m;
  m.fx_px = 1100 * random.uniform(0.97, 1.03);
  m.fy_px = m.fx_px * random.uniform(0.998, 1.002);
  m.cx_px += random.uniform(-15, 15);
  m.cy_px += random.uniform(-15, 15);
  m.k1 = random.uniform(-0.15, 0);
  m.k2 = random.uniform(0, 0.08);
  m.p1 = random.uniform(-7e-4, 7e-4);
  m.p2 = random.uniform(-7e-4, 7e-4);
  return m;
}

bool inside(const CameraModel& camera, const Eigen::Vector2d& px) {
  return px.x() > 5 && px.y() > 5 && px.x() < camera.width_px - 6 && px.y() < camera.height_px - 6;
}

BoardView board_view(const CalibrationBoard& board, const CameraModel& camera, int index, Random& random) {
  const std::vector<Vector3> points = board.points_mm();
  const Vector3 middle = 0.5 * (points.front() + points.back());
  const double phi = random.uniform(0, 2 * M_PI), z = random.uniform(320, 600);
  const Matrix3 turn = exp_so3(random.uniform(0.3, 0.7) * Vector3(std::cos(phi), std::sin(phi), 0)) *
                       exp_so3(Vector3(0, 0, random.uniform(-0.4, 0.4)));
  const Vector3 at(random.uniform(-0.3, 0.3) * z, random.uniform(-0.16, 0.16) * z, z);
  BoardView view;
  view.name = "view " + std::to_string(index);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto px = camera.project(at + turn * (points[i] - middle));
    if (!px || !inside(camera, *px)) continue;
    view.corners.push_back({static_cast<int>(i),
                            *px + kCorner_px * Eigen::Vector2d(random.normal(), random.normal()),
                            kCorner_px * kCorner_px * Eigen::Matrix2d::Identity()});
  }
  return view;
}

Result<RigCamera> calibrated(const RigCamera& truth, Random& random) {
  const auto board = parse_board("chessboard:9x6:25");
  std::vector<BoardView> views;
  for (int i = 0; i < 24; ++i) views.push_back(board_view(*board, truth.model, i, random));
  SilentProgress silent;
  GNATHION_TRY(const CameraCalibration found, calibrate_camera(*board, truth.name, truth.model.width_px,
                                                               truth.model.height_px, views, {}, silent));
  RigCamera camera = truth;
  camera.model = found.model;
  camera.focal_sigma_px = found.focal_sigma_px();
  return camera;
}

Vector3 outward(const BodyTag& tag) {
  const auto& q = tag.corners_in_body_mm;
  return (q[1] - q[0]).cross(q[3] - q[0]).normalized();
}

/// Glue lifts tags off their plates, never into them.
TaggedBody glued(const TaggedBody& nominal, Random& random) {
  TaggedBody body = nominal;
  for (BodyTag& tag : body.tags) {
    const Vector3 normal = outward(tag), across = normal.unitOrthogonal();
    const Vector3 centre = 0.5 * (tag.corners_in_body_mm[0] + tag.corners_in_body_mm[2]);
    const double way = random.uniform(0, 2 * M_PI);
    const Vector3 side = std::cos(way) * across + std::sin(way) * normal.cross(across);
    const Rigid3 turn = Rigid3::about_axis(centre, normal, random.uniform(-0.3, 0.3) * kRad) *
                        Rigid3::about_axis(centre, side, random.uniform(0, 0.3) * kRad);
    const Vector3 shift = random.uniform(0.1, 0.3) * normal + random.uniform(0.1, 0.2) * side;
    for (Vector3& c : tag.corners_in_body_mm) c = turn * c + shift;
  }
  return body;
}

std::optional<SeenTag> seen(const BodyTag& tag, const CameraModel& camera, const Rigid3& camera_from_body,
                            Random& random) {
  const Vector3 sight = (camera_from_body * tag.corners_in_body_mm[0]).normalized();
  if (-(camera_from_body.rotation * outward(tag)).dot(sight) < std::cos(60 * kRad)) return std::nullopt;
  SeenTag out;
  out.id = tag.id;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto px = camera.project(camera_from_body * tag.corners_in_body_mm[k]);
    if (!px || !inside(camera, *px)) return std::nullopt;
    out.corners_px[k] = *px + kCorner_px * Eigen::Vector2d(random.normal(), random.normal());
  }
  out.covariance_px2 *= kCorner_px * kCorner_px;
  return out;
}

/// The body turned in the hand before the camera, from how it is worn.
Result<TaggedBody> calibrated(const RigCamera& truth, const RigCamera& camera, const TaggedBody& glued_body,
                              const TaggedBody& nominal, const Rigid3& camera_from_body_worn,
                              Random& random) {
  Vector3 middle = Vector3::Zero();
  for (const BodyTag& tag : nominal.tags)
    middle += 0.5 * (tag.corners_in_body_mm[0] + tag.corners_in_body_mm[2]) / double(nominal.tags.size());
  std::vector<BodyView> views;
  for (int v = 0; v < 75; ++v) {
    const Vector3 turn(random.uniform(-0.6, 0.6), random.uniform(-0.3, 0.3), random.uniform(-0.6, 0.6));
    const Vector3 at(random.uniform(-25, 25), random.uniform(-20, 20), random.uniform(340, 440));
    const Matrix3 rotation = camera_from_body_worn.rotation * exp_so3(turn);
    const Rigid3 pose{rotation, at - rotation * middle};
    BodyView view;
    view.name = "view " + std::to_string(v);
    view.tags.resize(1);
    for (const BodyTag& tag : glued_body.tags)
      if (auto s = seen(tag, truth.model, pose, random)) view.tags[0].push_back(*s);
    Vector6 off;
    off << 0.02 * random.normal3(), 2 * random.normal3();
    view.rig_from_body = pose * exp_se3(off);
    views.push_back(view);
  }
  GNATHION_TRY(BowGeometry found, calibrate_bow_geometry({camera}, nominal, views, {}));
  found.body.name = nominal.name;
  found.body.up = nominal.up;
  return found.body;
}

}  // namespace

Result<JawPositions> filmed_positions(const PhantomPatient& patient, const FilmScene& nominal,
                                      std::uint64_t seed) {
  Random random(seed, 0x63616d);
  FilmScene scene = nominal;
  scene.therapeutic = patient.therapeutic;
  RigCamera& camera = scene.rig.cameras.front();
  camera.model = some_camera(random);
  scene.rig.bow = glued(nominal.rig.bow, random);
  scene.rig.head_frame = glued(nominal.rig.head_frame, random);

  Rig rig = nominal.rig;
  GNATHION_TRY(rig.cameras.front(), calibrated(camera, random));
  const Rigid3 bow_worn = (scene.camera_from_dental_at_rest * scene.bow_from_dental.inverse()).rigid;
  const Rigid3 head_worn = (scene.camera_from_dental_at_rest * scene.head_from_dental.inverse()).rigid;
  GNATHION_TRY(rig.bow,
               calibrated(camera, rig.cameras.front(), scene.rig.bow, nominal.rig.bow, bow_worn, random));
  GNATHION_TRY(rig.head_frame, calibrated(camera, rig.cameras.front(), scene.rig.head_frame,
                                          nominal.rig.head_frame, head_worn, random));

  FilmOptions options;
  options.seed = seed;
  options.duration_s = 5.5;
  options.border_movements = false;
  PhantomFilm film(scene, options);
  SilentProgress silent;
  GNATHION_TRY(const SessionMotion session, track_session(film, rig, {}, silent));
  PlateauOptions plateaus;
  plateaus.point_in_bow_mm = scene.bow_from_dental * scene.incisal_point_mm;
  return find_jaw_positions(session, plateaus);
}

}  // namespace gnathion
