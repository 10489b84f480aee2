// Tags in one image: found by libapriltag or predicted, then refined by fitting their four edges.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/result.h"

namespace gnathion {

using TagCorners = std::array<Eigen::Vector2d, 4>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;

/// One tag in one image. Corners in the order of BodyTag, in pixels of the image as taken (distorted), with
/// (0, 0) at the centre of the upper left pixel.
struct TagObservation {
  int id = 0;
  TagCorners corners_px;
  /// Of (x0, y0, … x3, y3), from the edge fits: two neighbouring corners share a side and so its error.
  Matrix8 covariance_px2 = Matrix8::Zero();
  double decision_margin = 0;  ///< mean distance of the data bits from the black/white threshold, grey levels
  int hamming = 0;             ///< data bits that differ from the id's code
  double contrast_grey = 0;    ///< white minus black at the edges
  double noise_grey = 0;       ///< RMS of the edge fits' residuals
  double blur_px = 0;          ///< standard deviation of the edge's profile, the largest of the four sides
  std::array<float, 4> side_blur_px = {};  ///< the same for each side
  double covered = 0;                      ///< share of the outline left out: covered, or lost in glare
  bool refined = false;  ///< false: libapriltag's own corners, with a covariance that says so

  Eigen::Matrix2d corner_covariance_px2(int k) const { return covariance_px2.block<2, 2>(2 * k, 2 * k); }
};

struct TagDetectorOptions {
  std::string family = "tag36h11";
  double quad_decimate = 1.0;   ///< libapriltag's; 1 sees the smallest tags
  int threads = 1;              ///< libapriltag's
  int max_hamming = 1;          ///< data bits that may be wrong
  bool refine = true;           ///< edge fits; without them libapriltag's corners stand
  bool keep_unrefined = false;  ///< keep a tag whose edge fit failed, with a covariance that says so
  /// Added to every corner variance: what the fit cannot see (pixel response, print), px.
  double corner_floor_px = 0.0015;
};

/// Not thread-safe: one per thread. Same image, same result.
class TagDetector {
 public:
  static Result<std::unique_ptr<TagDetector>> create(const TagDetectorOptions& options);
  ~TagDetector();

  /// Searches the whole image. Sorted by id, then by x; one id may occur more than once. No copy is made.
  std::vector<TagObservation> detect(const Image8& image, const CameraModel& camera);
  /// The same inside one rectangle (clamped to the image).
  std::vector<TagObservation> detect_in(const Image8& image, const CameraModel& camera, int x0, int y0,
                                        int width_px, int height_px);
  /// Looks for one tag near where it is expected: straight there when `last`, the tag in the frame before, is
  /// given (off by at most 2 px or so), else by search (off by about a cell of the tag, or 6 px). Nothing
  /// when its edges are not there or its bits are not the id's. With `last`, up to two sides may be covered.
  std::optional<TagObservation> follow(const Image8& image, const CameraModel& camera, int id,
                                       const TagCorners& expected_px, const TagObservation* last = nullptr);

 private:
  struct Impl;
  explicit TagDetector(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace gnathion
