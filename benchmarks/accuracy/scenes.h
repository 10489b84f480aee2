// Pictures with known truth for the accuracy tables: tags anywhere before the camera, and the virtual
// patient's film with six tags a body.
#pragma once

#include <cstdint>
#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/sample.h"
#include "phantom/film.h"
#include "tracking/tag_detector.h"

namespace gnathion::accuracy {

/// How the pictures of a condition are taken.
struct Look {
  const char* name;
  double motion_px = 0;     ///< length of the smear during exposure, in a random direction
  double defocus_px = 0.7;  ///< Gaussian
  double noise_grey = 2;
};

struct TrueTag {
  int id = 0;
  TagCorners corners_px;
};

struct Picture {
  Image8 image;
  std::vector<TrueTag> tags;
};

/// 1280×720, f = 1100 px, with the lens distortion of the phantom's camera.
CameraModel table_camera();

/// Twelve 20 mm tags a picture, 300 to 500 mm away, tilted up to 55°, in front of clutter; contrast 120 grey
/// levels and more.
std::vector<Picture> tag_pictures(const Look& look, std::uint64_t seed, int count);

struct Film {
  FilmScene scene;
  std::vector<FrameSample> frames;
  std::vector<FilmTruth> truths;
  Vector3 incisal_in_bow_mm;
};

/// The virtual patient of `seed` from its rest over MI and TP, with `tags_per_body` tags on bow and head
/// frame.
Film patient_film(std::uint64_t seed, int frames, int tags_per_body);

}  // namespace gnathion::accuracy
