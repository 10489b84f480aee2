#include "tracking/tag_detector.h"

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>

#include <algorithm>
#include <utility>

#include "tracking/corner_refine.h"
#include "tracking/corner_refine_fit.h"

namespace gnathion {
namespace {

constexpr int kLeastImagePx = 16;           // libapriltag's tiles need some room
constexpr double kUnrefinedCornerPx = 0.3;  // libapriltag's own corners: measured RMS error, rounded up
constexpr int kCoveredBits =
    3;  // that may be wrong beside max_hamming where part of the outline is covered: codes differ in 11

constexpr double kFarthestFromLibraryPx = 1.25;

double farthest_px(const TagCorners& a, const TagCorners& b) {
  double farthest = 0;
  for (std::size_t k = 0; k < 4; ++k) farthest = std::max(farthest, (a[k] - b[k]).norm());
  return farthest;
}

/// libapriltag's detector and family with their life times.
class LibApriltag {
 public:
  LibApriltag(const TagDetectorOptions& options) {
    if (options.family == "tag36h11") {
      family_ = tag36h11_create();
      destroy_family_ = tag36h11_destroy;
    } else if (options.family == "tag25h9") {
      family_ = tag25h9_create();
      destroy_family_ = tag25h9_destroy;
    } else {
      family_ = tag16h5_create();
      destroy_family_ = tag16h5_destroy;
    }
    detector_ = apriltag_detector_create();
    detector_->quad_decimate = static_cast<float>(options.quad_decimate);
    detector_->nthreads = options.threads;
    detector_->refine_edges = true;
    apriltag_detector_add_family_bits(detector_, family_, options.max_hamming);
  }
  ~LibApriltag() {
    apriltag_detector_destroy(detector_);
    destroy_family_(family_);
  }
  LibApriltag(const LibApriltag&) = delete;
  LibApriltag& operator=(const LibApriltag&) = delete;

  /// Corners in our pixels: libapriltag counts from the upper left corner of the upper left pixel, so that
  /// this pixel's centre is (0.5, 0.5) there and (0, 0) here.
  std::vector<TagObservation> detect(const Image8& image, int x0, int y0, int width, int height) {
    // The library only reads the buffer; its type has no const.
    std::uint8_t* first = const_cast<std::uint8_t*>(image.pixels.data()) +
                          static_cast<std::size_t>(y0) * static_cast<std::size_t>(image.width_px) +
                          static_cast<std::size_t>(x0);
    image_u8_t view = {width, height, image.width_px, first};
    zarray_t* found = apriltag_detector_detect(detector_, &view);
    std::vector<TagObservation> observations;
    for (int i = 0; i < zarray_size(found); ++i) {
      apriltag_detection_t* detection = nullptr;
      zarray_get(found, i, &detection);
      TagObservation o;
      o.id = detection->id;
      o.hamming = detection->hamming;
      o.decision_margin = static_cast<double>(detection->decision_margin);
      for (std::size_t k = 0; k < 4; ++k) {
        o.corners_px[k] = {detection->p[k][0] - 0.5 + x0, detection->p[k][1] - 0.5 + y0};
      }
      observations.push_back(o);
    }
    apriltag_detections_destroy(found);
    return observations;
  }

 private:
  apriltag_family_t* family_ = nullptr;
  void (*destroy_family_)(apriltag_family_t*) = nullptr;
  apriltag_detector_t* detector_ = nullptr;
};

}  // namespace

struct TagDetector::Impl {
  TagDetectorOptions options;
  TagFamily family;
  LibApriltag library;
  EdgeStrip strip;

  Impl(const TagDetectorOptions& o, TagFamily f) : options(o), family(std::move(f)), library(o) {}

  bool refine(const Image8& image, const CameraModel& camera, const CornerStart& start, TagObservation* o) {
    const auto refined = refine_corners(image, camera, family, o->id, start, &strip);
    if (!refined) return false;
    const BitCheck bits = check_bits(image, family, o->id, *refined);
    const int allowed = options.max_hamming + (refined->covered > 0 ? kCoveredBits : 0);
    if (bits.wrong > allowed || bits.margin_grey < 0.15 * refined->contrast_grey) return false;
    o->corners_px = refined->corners_px;
    o->covariance_px2 =
        refined->covariance_px2 + options.corner_floor_px * options.corner_floor_px * Matrix8::Identity();
    o->decision_margin = bits.margin_grey;
    o->hamming = bits.wrong;
    o->contrast_grey = refined->contrast_grey;
    o->noise_grey = refined->noise_grey;
    o->blur_px = refined->blur_px();
    o->side_blur_px = refined->side_blur_px;
    o->covered = refined->covered;
    o->refined = true;
    return true;
  }
};

Result<std::unique_ptr<TagDetector>> TagDetector::create(const TagDetectorOptions& options) {
  const std::string what = "cannot set up the tag detector";
  if (!(options.quad_decimate >= 1)) return bad_input(what, "quad_decimate", "must be 1 or more");
  if (options.threads < 1) return bad_input(what, "threads", "must be 1 or more");
  if (options.max_hamming < 0 || options.max_hamming > 2)
    return bad_input(what, "max_hamming", "must be 0, 1 or 2");
  GNATHION_TRY(TagFamily family, TagFamily::load(options.family));
  return std::unique_ptr<TagDetector>(new TagDetector(std::make_unique<Impl>(options, std::move(family))));
}

TagDetector::TagDetector(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TagDetector::~TagDetector() = default;

std::vector<TagObservation> TagDetector::detect(const Image8& image, const CameraModel& camera) {
  return detect_in(image, camera, 0, 0, image.width_px, image.height_px);
}

std::vector<TagObservation> TagDetector::detect_in(const Image8& image, const CameraModel& camera, int x0,
                                                   int y0, int width_px, int height_px) {
  const int x1 = std::min(image.width_px, x0 + width_px), y1 = std::min(image.height_px, y0 + height_px);
  x0 = std::max(0, x0);
  y0 = std::max(0, y0);
  if (x1 - x0 < kLeastImagePx || y1 - y0 < kLeastImagePx) return {};
  std::vector<TagObservation> kept;
  for (TagObservation& o : impl_->library.detect(image, x0, y0, x1 - x0, y1 - y0)) {
    const TagObservation library = o;
    // The library's corners are off by some tenths of a pixel; a fit far from them has found something else.
    const bool refined = impl_->options.refine && impl_->refine(image, camera, {o.corners_px}, &o) &&
                         farthest_px(library.corners_px, o.corners_px) <= kFarthestFromLibraryPx;
    if (!refined) {
      o = library;
      if (impl_->options.refine && !impl_->options.keep_unrefined) continue;
      o.covariance_px2 = kUnrefinedCornerPx * kUnrefinedCornerPx * Matrix8::Identity();
    }
    kept.push_back(o);
  }
  std::sort(kept.begin(), kept.end(), [](const TagObservation& a, const TagObservation& b) {
    return a.id != b.id ? a.id < b.id : a.corners_px[0].x() < b.corners_px[0].x();
  });
  return kept;
}

std::optional<TagObservation> TagDetector::follow(const Image8& image, const CameraModel& camera, int id,
                                                  const TagCorners& expected_px, const TagObservation* last) {
  if (id < 0 || id >= impl_->family.count()) return std::nullopt;
  TagObservation o;
  o.id = id;
  if (last != nullptr && last->refined) {
    if (impl_->refine(image, camera, {expected_px, true, last->side_blur_px}, &o)) return o;
  }
  if (!impl_->refine(image, camera, {expected_px}, &o)) return std::nullopt;
  return o;
}

}  // namespace gnathion
