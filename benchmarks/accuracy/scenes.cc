#include "benchmarks/accuracy/scenes.h"

#include <cmath>

#include "core/check.h"
#include "core/random.h"
#include "phantom/film_scene.h"
#include "phantom/renderer.h"

namespace gnathion::accuracy {
namespace {

constexpr int kColumns = 4, kRows = 3;
constexpr int kTags = kColumns * kRows;
constexpr double kSideMm = 20;

BodyTag centred_tag(int id) {
  const double h = 0.5 * kSideMm;
  BodyTag tag;
  tag.id = id;
  tag.corners_in_body_mm = {Vector3(-h, -h, 0), Vector3(h, -h, 0), Vector3(h, h, 0), Vector3(-h, h, 0)};
  return tag;
}

/// Somewhere in cell `i` of the picture; the tag's z looks at the camera, tilted.
Rigid3 random_pose(const CameraModel& camera, int i, Random& random) {
  constexpr double kMarginPx = 75;
  const double w = static_cast<double>(camera.width_px) / kColumns,
               h = static_cast<double>(camera.height_px) / kRows;
  const Eigen::Vector2d pixel((i % kColumns) * w + random.uniform(kMarginPx, w - kMarginPx),
                              (i / kColumns) * h + random.uniform(kMarginPx, h - kMarginPx));
  const Eigen::Vector2d n = camera.undistorted(pixel);
  const Vector3 sight = Vector3(n.x(), n.y(), 1).normalized();
  const Vector3 across = sight.cross(random.unit_vector()).normalized();
  Rigid3 facing;  // z toward the camera
  facing.rotation.col(2) = -sight;
  facing.rotation.col(0) = across;
  facing.rotation.col(1) = (-sight).cross(across);
  const double tilt = random.uniform(0, 55) * M_PI / 180, spin = random.uniform(0, 2 * M_PI);
  facing.rotation = exp_so3(tilt * Vector3(across)) * facing.rotation * exp_so3(Vector3(0, 0, spin));
  facing.translation_mm = random.uniform(300, 500) * sight;
  return facing;
}

}  // namespace

CameraModel table_camera() {
  CameraModel camera;
  camera.k1 = -0.08;
  camera.k2 = 0.05;
  camera.p1 = 0.0005;
  camera.p2 = -0.0005;
  return camera;
}

std::vector<Picture> tag_pictures(const Look& look, std::uint64_t seed, int count) {
  const CameraModel camera = table_camera();
  Random random(seed, 0x74616773);
  std::vector<SceneBody> bodies;
  for (int i = 0; i < kTags; ++i) {
    SceneBody body;
    body.tags.tags = {centred_tag(static_cast<int>(random.below(48)) * kTags + i)};
    bodies.push_back(body);
  }
  RenderOptions options;
  options.seed = seed;
  options.noise_sigma = look.noise_grey;
  options.blur_sigma_px = look.defocus_px;
  auto renderer = CameraRenderer::create(camera, bodies, options);
  GNATHION_CHECK(renderer.has_value());
  std::vector<Picture> pictures;
  for (int p = 0; p < count; ++p) {
    Picture picture;
    std::vector<BodyExposure> exposures;
    for (int i = 0; i < kTags; ++i) {
      BodyExposure e;
      e.camera_from_body = random_pose(camera, i, random);
      const double angle = random.uniform(0, 2 * M_PI);
      const double mm_per_px = e.camera_from_body.translation_mm.z() / camera.fx_px;
      constexpr int kSteps = 16;
      for (int s = 0; look.motion_px > 0 && s < kSteps; ++s) {
        const double along_mm = look.motion_px * mm_per_px * ((s + 0.5) / kSteps - 0.5);
        Rigid3 pose = e.camera_from_body;
        pose.translation_mm += along_mm * Vector3(std::cos(angle), std::sin(angle), 0);
        e.path.push_back(pose);
      }
      const BodyTag& tag = bodies[static_cast<std::size_t>(i)].tags.tags[0];
      TrueTag truth;
      truth.id = tag.id;
      for (std::size_t k = 0; k < 4; ++k)
        truth.corners_px[k] = *camera.project(e.camera_from_body * tag.corners_in_body_mm[k]);
      picture.tags.push_back(truth);
      exposures.push_back(std::move(e));
    }
    picture.image = renderer->render(exposures, static_cast<std::uint32_t>(p));
    pictures.push_back(std::move(picture));
  }
  return pictures;
}

Film patient_film(std::uint64_t seed, int frames, int tags_per_body) {
  const PhantomPatient patient = make_phantom_patient(seed);
  Film film;
  film.scene = film_scene(patient);
  for (TaggedBody* body : {&film.scene.rig.bow, &film.scene.rig.head_frame}) {
    std::vector<BodyTag> spread;
    const auto n = static_cast<std::size_t>(tags_per_body);
    for (std::size_t i = 0; i < n; ++i) spread.push_back(body->tags[i * body->tags.size() / n]);
    body->tags = spread;
  }
  film.incisal_in_bow_mm = film.scene.bow_from_dental * film.scene.incisal_point_mm;
  FilmOptions options;
  options.seed = seed;
  options.border_movements = false;
  options.duration_s = 10;
  PhantomFilm source(film.scene, options);
  while (film.frames.size() < static_cast<std::size_t>(frames)) {
    auto sample = source.next();
    if (!sample || !*sample) break;
    if (auto* frame = std::get_if<FrameSample>(&**sample)) {
      film.truths.push_back(source.truth_at(frame->header.capture));
      film.frames.push_back(std::move(*frame));
    }
  }
  return film;
}

}  // namespace gnathion::accuracy
