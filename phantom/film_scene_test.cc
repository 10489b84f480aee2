#include "phantom/film_scene.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "core/mesh_query.h"

namespace gnathion {
namespace {

/// How deep any of the lower teeth's vertices is inside the upper ones; negative: clear by that much.
double overlap_mm(const MeshQuery& maxilla, const PhantomJaws& jaws, const Motion<Dental>& motion,
                  std::size_t stride) {
  double deepest = -1e9;
  for (std::size_t i = 0; i < jaws.mandible_mi.vertices_mm.size(); i += stride) {
    if (jaws.mandible_fdi[i] == 0) continue;
    const auto found = maxilla.signed_distance(motion * jaws.mandible_mi.vertices_mm[i], 3.0);
    if (found && !found->closest.on_boundary) deepest = std::max(deepest, -found->distance_mm);
  }
  return deepest;
}

void expect_path_clear_of_upper_teeth(const PhantomFilm& film, const PhantomJaws& jaws) {
  const MeshQuery maxilla(jaws.maxilla);
  std::vector<double> times;
  for (double t = 0; t < film.jaw().duration_s(); t += 0.03) times.push_back(t);
  std::vector<double> overlaps(times.size());
  tbb::parallel_for(std::size_t{0}, times.size(), [&](std::size_t i) {
    overlaps[i] = overlap_mm(maxilla, jaws, film.jaw().mandible_motion(times[i]), 41);
  });
  for (std::size_t i = 0; i < times.size(); ++i)
    EXPECT_LT(overlaps[i], 0.05) << film.jaw().phase_at(times[i]).name << " at " << times[i] << " s";
}

void expect_bodies_in_picture_but_for_opening(const PhantomFilm& film) {
  const FilmScene& scene = film.scene();
  const CameraModel& camera = scene.rig.cameras[0].model;
  const auto in_picture = [&](const TaggedBody& body, const Rigid3& camera_from_body) {
    return std::count_if(body.tags.begin(), body.tags.end(), [&](const BodyTag& tag) {
      return std::all_of(tag.corners_in_body_mm.begin(), tag.corners_in_body_mm.end(),
                         [&](const Vector3& corner) {
                           const auto p = camera.project(camera_from_body * corner);
                           return p && p->x() > 4 && p->y() > 4 && p->x() < camera.width_px - 5 &&
                                  p->y() < camera.height_px - 5;
                         });
    });
  };
  for (double t = 0; t < film.jaw().duration_s(); t += 0.05) {
    const FilmTruth truth = film.truth_at({static_cast<std::int64_t>(t * 1e9)});
    EXPECT_GE(in_picture(scene.rig.head_frame, truth.camera_from_head.rigid), 8) << t;
    if (film.jaw().phase_at(t).kind == JawPhaseKind::kOpening) continue;
    EXPECT_GE(in_picture(scene.rig.bow, truth.camera_from_bow.rigid), 8) << t;
  }
}

void expect_surfaces_under_their_tags(const FilmScene& scene) {
  for (const auto& [body, surface] : {std::pair(&scene.rig.bow, &scene.bow_surface),
                                      std::pair(&scene.rig.head_frame, &scene.head_surface)}) {
    const MeshQuery query(*surface);
    for (const BodyTag& tag : body->tags)
      for (const Vector3& corner : tag.corners_in_body_mm)
        EXPECT_LT(query.closest(corner)->distance_mm, 0.6) << body->name << " tag " << tag.id;
  }
}

// One test: a patient takes seconds to make.
TEST(FilmScene, ThePatientCanBeFilmed) {
  const PhantomPatient patient = make_phantom_patient(4);
  const PhantomFilm film(film_scene(patient), FilmOptions{});
  expect_path_clear_of_upper_teeth(film, patient.jaws);
  expect_bodies_in_picture_but_for_opening(film);
  expect_surfaces_under_their_tags(film.scene());
}

}  // namespace
}  // namespace gnathion
