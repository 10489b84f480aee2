#include "tracking/body_tracker.h"

#include <algorithm>
#include <set>
#include <tuple>
#include <utility>

#include "core/check.h"

namespace gnathion {
namespace {

/// The last two poses of a body, for a prediction at constant velocity.
struct Track {
  struct Stamped {
    HostTime at;
    Rigid3 pose;
  };
  std::optional<Stamped> last, before;

  void lose() { last = before = std::nullopt; }
  void see(HostTime at, const Rigid3& pose) {
    before = last;
    last = Stamped{at, pose};
  }
  std::optional<Rigid3> predicted(HostTime at, double max_age_s) const {
    if (!last) return std::nullopt;
    const double ahead = at.seconds_since(last->at);
    if (!(ahead >= 0 && ahead <= max_age_s)) return std::nullopt;
    if (!before) return last->pose;
    const double step = last->at.seconds_since(before->at);
    if (!(step > 0 && step <= max_age_s)) return last->pose;
    return exp_se3(difference(last->pose, before->pose) * (ahead / step)) * last->pose;
  }
};

bool near_another(const std::vector<TagObservation>& seen, const TagObservation& o) {
  return std::any_of(seen.begin(), seen.end(), [&](const TagObservation& s) {
    return s.id == o.id && (s.corners_px[0] - o.corners_px[0]).norm() < 3 &&
           (s.corners_px[2] - o.corners_px[2]).norm() < 3;
  });
}

}  // namespace

struct BodyTracker::Impl {
  Rig rig;
  BodyTrackerOptions options;
  std::unique_ptr<TagDetector> detector;
  Track bow, head;
  int frames_to_search = 0;

  /// Each tag of the body that should be visible, looked for where the prediction puts it.
  void follow(const TaggedBody& body, const std::optional<Rigid3>& predicted,
              const std::vector<const Image8*>& images, RigTags* tags) {
    if (!predicted) return;
    for (std::size_t c = 0; c < images.size(); ++c) {
      if (images[c] == nullptr) continue;
      const RigCamera& camera = rig.cameras[c];
      for (const BodyTag& tag : body.tags) {
        const auto expected = projected_tag(camera, tag, *predicted);
        if (!expected) continue;
        const auto seen = detector->follow(*images[c], camera.model, tag.id, *expected);
        if (seen) (*tags)[c].push_back(*seen);
      }
    }
  }

  /// Adds what a search of the whole images finds and was not followed.
  void search(const std::vector<const Image8*>& images, RigTags* tags) {
    for (std::size_t c = 0; c < images.size(); ++c) {
      if (images[c] == nullptr) continue;
      for (const TagObservation& o : detector->detect(*images[c], rig.cameras[c].model)) {
        if (!near_another((*tags)[c], o)) (*tags)[c].push_back(o);
      }
    }
  }

  /// Tags that the first pose of a body predicts and the search did not report (libapriltag misses steep
  /// ones).
  void follow_missed(const TaggedBody& body, const BodyPose& pose, const std::vector<const Image8*>& images,
                     RigTags* tags) {
    if (!pose.valid) return;
    RigTags more(tags->size());
    follow(body, pose.camera_from_body, images, &more);
    for (std::size_t c = 0; c < more.size(); ++c) {
      for (const TagObservation& o : more[c]) {
        if (!near_another((*tags)[c], o)) (*tags)[c].push_back(o);
      }
    }
  }
};

Result<std::unique_ptr<BodyTracker>> BodyTracker::create(const Rig& rig, const BodyTrackerOptions& options) {
  if (rig.cameras.empty()) return bad_input("cannot track", "rig", "it has no camera");
  std::set<int> ids;
  for (const TaggedBody* body : {&rig.bow, &rig.head_frame}) {
    if (body->tags.empty()) return bad_input("cannot track", body->name, "the body has no tag");
    if (body->family != rig.bow.family) {
      return bad_input("cannot track", body->name, "its tag family is not the bow's: " + body->family);
    }
    for (const BodyTag& tag : body->tags) {
      if (!ids.insert(tag.id).second) {
        return bad_input("cannot track", body->name, "tag " + std::to_string(tag.id) + " is there twice");
      }
    }
  }
  auto impl = std::make_unique<Impl>();
  impl->rig = rig;
  impl->options = options;
  impl->options.detector.family = rig.bow.family;
  GNATHION_TRY(impl->detector, TagDetector::create(impl->options.detector));
  return std::unique_ptr<BodyTracker>(new BodyTracker(std::move(impl)));
}

BodyTracker::BodyTracker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BodyTracker::~BodyTracker() = default;

void BodyTracker::reset() {
  impl_->bow.lose();
  impl_->head.lose();
  impl_->frames_to_search = 0;
}

BodyPoses BodyTracker::next(HostTime capture, const std::vector<const Image8*>& images) {
  Impl& m = *impl_;
  GNATHION_CHECK(images.size() == m.rig.cameras.size());
  const auto bow_guess = m.bow.predicted(capture, m.options.max_prediction_s);
  const auto head_guess = m.head.predicted(capture, m.options.max_prediction_s);
  RigTags tags(images.size());
  m.follow(m.rig.bow, bow_guess, images, &tags);
  m.follow(m.rig.head_frame, head_guess, images, &tags);

  BodyPoses poses;
  poses.bow = estimate_body_pose(m.rig, m.rig.bow, tags, m.options.pose, bow_guess);
  poses.head = estimate_body_pose(m.rig, m.rig.head_frame, tags, m.options.pose, head_guess);
  const bool lost = !poses.bow.valid || !poses.head.valid;
  if (lost && --m.frames_to_search <= 0) {
    m.frames_to_search = m.options.search_pause_frames;
    m.search(images, &tags);
    poses.searched = true;
    for (auto [body, pose, guess] : {std::tuple(&m.rig.bow, &poses.bow, &bow_guess),
                                     std::tuple(&m.rig.head_frame, &poses.head, &head_guess)}) {
      if (pose->valid) continue;
      *pose = estimate_body_pose(m.rig, *body, tags, m.options.pose, *guess);
      m.follow_missed(*body, *pose, images, &tags);
      *pose = estimate_body_pose(m.rig, *body, tags, m.options.pose,
                                 pose->valid ? std::optional(pose->camera_from_body) : *guess);
    }
  }
  if (poses.bow.valid && poses.head.valid) m.frames_to_search = 0;
  if (poses.bow.valid) m.bow.see(capture, poses.bow.camera_from_body);
  if (poses.head.valid) m.head.see(capture, poses.head.camera_from_body);
  return poses;
}

}  // namespace gnathion
