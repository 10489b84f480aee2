#include "tracking/body_checks.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace gnathion {
namespace {

const char* const kCannotTrackBodies = "cannot track the session";
constexpr std::size_t kMostFailures = 4;
// Scales: what a sum over frames must differ by, in its own standard deviations (frames share the errors of
// print and lens, so these are many) and at all.
constexpr double kSigmas = 8, kTellable = 0.004;
constexpr double kFocalRefused = 0.03, kSizeRefused = 0.02;

bool differs(const ScaleEvidence& e, double least) {
  return e.information > 0 && std::abs(e.log_scale()) > least &&
         std::abs(e.log_scale()) * std::sqrt(e.information) > kSigmas;
}

std::string percent(double log_scale) {
  return fmt::format("{:.1f} % {}", 100 * std::abs(std::expm1(log_scale)), log_scale > 0 ? "more" : "less");
}

Image8 mirrored(const Image8& image) {
  Image8 flipped = image;
  for (int y = 0; y < image.height_px; ++y) {
    const auto row = flipped.pixels.begin() + static_cast<std::ptrdiff_t>(y) * image.width_px;
    std::reverse(row, row + image.width_px);
  }
  return flipped;
}

TaggedBody with_tags_scaled(TaggedBody body, double scale) {
  for (BodyTag& tag : body.tags) {
    const auto c = tag.corners_in_body_mm;
    const Vector3 centre = 0.25 * (c[0] + c[1] + c[2] + c[3]);
    for (Vector3& p : tag.corners_in_body_mm) p = centre + scale * (p - centre);
  }
  return body;
}

Rig with_focal_scaled(Rig rig, double scale) {
  for (RigCamera& camera : rig.cameras) {
    camera.model.fx_px *= scale;
    camera.model.fy_px *= scale;
  }
  return rig;
}

double side_mm(const TaggedBody& body) {
  return (body.tags[0].corners_in_body_mm[1] - body.tags[0].corners_in_body_mm[0]).norm();
}

/// Scales from a half to two in steps of 2 %, 1 left out.
std::vector<double> other_scales() {
  std::vector<double> scales;
  for (int i = -35; i <= 35; ++i) {
    if (i != 0) scales.push_back(std::pow(1.02, i));
  }
  return scales;
}

}  // namespace

void SessionEvidence::add(const BodyPoses& poses, const std::vector<const Image8*>& images) {
  for (int id : poses.ids_seen_twice) ++frames_with_twice_[id];
  for (int id : poses.foreign_ids) ++foreign_[id];
  const BodyPose* both[] = {&poses.bow, &poses.head};
  for (std::size_t b = 0; b < 2; ++b) {
    if (!both[b]->valid) continue;
    size_[b].add(both[b]->tag_size);
    for (std::size_t c = 0; c < focal_.size(); ++c) {
      if (focal_[c].empty()) focal_[c].emplace_back();
      focal_[c].back().add(both[b]->focal_length[c]);
    }
  }
  if (poses.bow.valid && poses.head.valid) {
    head_from_bow_sum_ +=
        poses.head.camera_from_body.rotation.transpose() * poses.bow.camera_from_body.rotation;
  } else if (poses.searched && failures_.size() < kMostFailures) {
    Sample sample;
    sample.tags = poses.tags;
    const bool blank =
        std::all_of(poses.tags.begin(), poses.tags.end(), [](const auto& t) { return t.empty(); });
    for (const Image8* image : images) {
      if (blank && keep_pictures_ && image != nullptr) sample.images.push_back(*image);
    }
    failures_.push_back(std::move(sample));
  }
}

void SessionEvidence::merge(const SessionEvidence& later) {
  for (const auto& [id, frames] : later.frames_with_twice_) frames_with_twice_[id] += frames;
  for (const auto& [id, frames] : later.foreign_) foreign_[id] += frames;
  for (std::size_t c = 0; c < focal_.size(); ++c)
    focal_[c].insert(focal_[c].end(), later.focal_[c].begin(), later.focal_[c].end());
  for (std::size_t b = 0; b < 2; ++b) size_[b].add(later.size_[b]);
  head_from_bow_sum_ += later.head_from_bow_sum_;
  for (const Sample& sample : later.failures_) {
    if (failures_.size() < kMostFailures) failures_.push_back(sample);
  }
}

Status SessionEvidence::refuse_strangers() const {
  for (const auto& [id, frames] : frames_with_twice_) {
    if (frames < 2 && frames_with_twice_.size() < 2) continue;
    return bad_input(kCannotTrackBodies, fmt::format("tag {}", id),
                     "is seen at two places of one picture: a second bow or head frame with the same tags is "
                     "in view; remove it and record again");
  }
  return {};
}

Status SessionEvidence::refuse_scales(const Rig& rig) const {
  const TaggedBody* bodies[] = {&rig.bow, &rig.head_frame};
  for (std::size_t b = 0; b < 2; ++b) {
    if (!differs(size_[b], kSizeRefused)) continue;
    return bad_input(
        kCannotTrackBodies, bodies[b]->name,
        fmt::format("its tags measure {:.2f} mm ({} than the {:.2f} mm of its file): print them at "
                    "true scale, or calibrate the body",
                    side_mm(*bodies[b]) * std::exp(size_[b].log_scale()), percent(size_[b].log_scale()),
                    side_mm(*bodies[b])));
  }
  for (std::size_t c = 0; c < focal_.size(); ++c) {
    ScaleEvidence sum;
    for (const ScaleEvidence& e : focal_[c]) sum.add(e);
    if (!differs(sum, kFocalRefused)) continue;
    const double f = rig.cameras[c].model.fx_px;
    return bad_input(
        kCannotTrackBodies, rig.cameras[c].name,
        fmt::format("its pictures fit a focal length of {:.0f} px, the rig says {:.0f} px: the rig "
                    "of other cameras, or the focus was changed; calibrate again",
                    f * std::exp(sum.log_scale()), f));
  }
  return {};
}

Status SessionEvidence::refuse_upside_down(const Rig& rig) const {
  if (!rig.bow.up || !rig.head_frame.up || head_from_bow_sum_.isZero()) return {};
  const Vector3 up = (head_from_bow_sum_ * *rig.bow.up).normalized();
  const double tilt = std::acos(std::clamp(up.dot(rig.head_frame.up->normalized()), -1.0, 1.0)) * 180 / M_PI;
  if (tilt < 100) return {};
  return bad_input(kCannotTrackBodies, rig.bow.name,
                   fmt::format("is upside down against the head frame (turned by {:.0f} deg)", tilt));
}

Status SessionEvidence::explain_failure(const Rig& rig) const {
  TagDetectorOptions options;
  options.family = rig.bow.family;
  GNATHION_TRY(const auto detector, TagDetector::create(options));
  for (const Sample& sample : failures_) {
    std::size_t found = 0;
    for (std::size_t i = 0; i < sample.images.size(); ++i)
      found +=
          detector->detect(mirrored(sample.images[i]), rig.cameras[std::min(i, rig.cameras.size() - 1)].model)
              .size();
    if (found >= 2) {
      return bad_input(kCannotTrackBodies, "pictures",
                       fmt::format("they are mirrored: {} tags are found once they are flipped; turn the "
                                   "camera's mirroring off",
                                   found));
    }
    for (const TaggedBody* body : {&rig.bow, &rig.head_frame}) {
      const auto fits = [&](const Rig& r, const TaggedBody& b, double* rms) {
        const BodyPose pose = estimate_body_pose(r, b, sample.tags, {});
        if (!pose.valid || pose.tags_used < 3 || !pose.rejected_ids.empty()) return false;
        *rms = pose.rms_px;
        return true;
      };
      double rms = 0, best_rms = 0.5, size = 1, focal = 1;
      if (fits(rig, *body, &rms)) continue;
      for (const double scale : other_scales()) {
        if (fits(rig, with_tags_scaled(*body, scale), &rms) && rms < best_rms) best_rms = rms, size = scale;
      }
      if (size == 1) {
        for (const double scale : other_scales()) {
          if (fits(with_focal_scaled(rig, scale), *body, &rms) && rms < best_rms)
            best_rms = rms, focal = scale;
        }
      }
      if (size != 1) {
        return bad_input(
            kCannotTrackBodies, body->name,
            fmt::format("its tags are of another size than its file says: about {:.1f} mm instead "
                        "of {:.1f} mm",
                        size * side_mm(*body), side_mm(*body)));
      }
      if (focal != 1) {
        return bad_input(
            kCannotTrackBodies, rig.cameras[0].name,
            fmt::format("its pictures fit a focal length of about {:.0f} px, the rig says {:.0f} "
                        "px: the rig of other cameras?",
                        focal * rig.cameras[0].model.fx_px, rig.cameras[0].model.fx_px));
      }
    }
  }
  return {};
}

Status SessionEvidence::refusal(const Rig& rig, std::size_t valid, const std::string& usual_reason) const {
  GNATHION_CHECK_OK(refuse_strangers());
  GNATHION_CHECK_OK(refuse_scales(rig));
  GNATHION_CHECK_OK(refuse_upside_down(rig));
  if (valid > 0) return {};
  GNATHION_CHECK_OK(explain_failure(rig));
  std::string others;
  for (const auto& [id, frames] : foreign_) others += fmt::format("{}{}", others.empty() ? "" : ", ", id);
  if (!others.empty()) others = "; tags " + others + " are seen, which are on neither body";
  return bad_input(kCannotTrackBodies, "recording",
                   "no frame shows bow and head frame (" + usual_reason + ")" + others);
}

std::vector<std::string> SessionEvidence::warnings(const Rig& rig) const {
  std::vector<std::string> said;
  for (const RigCamera& camera : rig.cameras) {
    if (!camera.line_time_ns)
      said.push_back(
          camera.name +
          ": the rig does not say its line_time_ns; if its shutter rolls, poses in motion are off");
  }
  const TaggedBody* bodies[] = {&rig.bow, &rig.head_frame};
  for (std::size_t b = 0; b < 2; ++b) {
    if (differs(size_[b], kTellable))
      said.push_back(fmt::format("{}: its tags measure {} than its file says", bodies[b]->name,
                                 percent(size_[b].log_scale())));
  }
  for (std::size_t c = 0; c < focal_.size(); ++c) {
    ScaleEvidence sum, least, most;
    for (const ScaleEvidence& e : focal_[c]) {
      if (!(e.information > 0)) continue;
      sum.add(e);
      if (!(least.information > 0) || e.log_scale() < least.log_scale()) least = e;
      if (!(most.information > 0) || e.log_scale() > most.log_scale()) most = e;
    }
    if (differs(sum, kTellable))
      said.push_back(fmt::format("{}: the focal length is {} than the rig says", rig.cameras[c].name,
                                 percent(sum.log_scale())));
    const double drift = most.log_scale() - least.log_scale();
    const double sigma =
        std::sqrt(1 / std::max(most.information, 1e-12) + 1 / std::max(least.information, 1e-12));
    if (sum.information > 0 && drift > kTellable && drift > kSigmas * sigma)
      said.push_back(
          fmt::format("{}: its focal length drifts by {:.1f} % within the session; is autofocus off?",
                      rig.cameras[c].name, 100 * drift));
  }
  return said;
}

}  // namespace gnathion
