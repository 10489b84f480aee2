#include "tracking/body_tracker.h"

#include <algorithm>
#include <array>
#include <set>
#include <utility>

#include "core/check.h"

namespace gnathion {
namespace {

/// The last poses of a body, for a prediction at constant velocity.
class Track {
 public:
  void lose() { last_ = before_ = std::nullopt; }
  void see(HostTime at, const Rigid3& pose) {
    before_ = last_;
    last_ = Stamped{at, pose};
  }
  HostTime last_at() const { return last_ ? last_->at : HostTime{}; }
  const Rigid3* last_pose() const { return last_ ? &last_->pose : nullptr; }
  std::optional<Rigid3> predicted(HostTime at, double max_age_s) const {
    if (!last_) return std::nullopt;
    const double ahead_s = at.seconds_since(last_->at);
    if (!(ahead_s >= 0 && ahead_s <= max_age_s)) return std::nullopt;
    const auto v = velocity(max_age_s);
    return v ? exp_se3(*v * ahead_s) * last_->pose : last_->pose;
  }
  /// Per second, left twist, between the last two poses.
  std::optional<Vector6> velocity(double max_step_s) const {
    if (!last_ || !before_) return std::nullopt;
    const double step_s = last_->at.seconds_since(before_->at);
    if (!(step_s > 0 && step_s <= max_step_s)) return std::nullopt;
    return difference(last_->pose, before_->pose) / step_s;
  }
  /// At `at`, where the body is at `pose`: from the last two steps, whose velocities belong to their middles.
  std::optional<Vector6> velocity_at(HostTime at, const Rigid3& pose, double max_step_s) const {
    if (!last_) return std::nullopt;
    const double step_s = at.seconds_since(last_->at);
    if (!(step_s > 0 && step_s <= max_step_s)) return std::nullopt;
    const Vector6 now = difference(pose, last_->pose) / step_s;
    const auto then = velocity(max_step_s);
    if (!then) return now;
    const double apart_s = 0.5 * at.seconds_since(before_->at);
    return now + (now - *then) * (0.5 * step_s / apart_s);
  }

 private:
  struct Stamped {
    HostTime at;
    Rigid3 pose;
  };
  std::optional<Stamped> last_, before_;
};

/// Everything that the tracker keeps of one body.
struct TrackedBody {
  const TaggedBody* body = nullptr;
  Track track;
  std::size_t retried = 0;  ///< the tag that was retried last
  std::optional<Rigid3> predicted;
  std::optional<Vector6> velocity;
  BodyPose pose;
};

const TagObservation* observation_of(const std::vector<TagObservation>& tags, int id) {
  const auto found =
      std::find_if(tags.begin(), tags.end(), [&](const TagObservation& o) { return o.id == id; });
  return found == tags.end() ? nullptr : &*found;
}

struct Tile {
  int x, y, width, height;
};

/// Tiles that overlap by half, so that a tag of up to a tenth of the image lies whole in one of them.
std::vector<Tile> tiles_of(const CameraModel& camera) {
  const int width = std::max(2, camera.width_px / 5), height = std::max(2, camera.height_px / 4);
  std::vector<Tile> tiles;
  for (int y = 0; y + height / 2 < camera.height_px; y += height / 2)
    for (int x = 0; x + width / 2 < camera.width_px; x += width / 2) tiles.push_back({x, y, width, height});
  return tiles;
}

constexpr double kApartPx = 20;  // two tags of one id, and not one found twice

double apart_px(const TagObservation& a, const TagObservation& b) {
  return (a.corners_px[0] - b.corners_px[0]).norm();
}

bool near_another(const std::vector<TagObservation>& seen, const TagObservation& o) {
  return std::any_of(seen.begin(), seen.end(), [&](const TagObservation& s) {
    return s.id == o.id && (s.corners_px[0] - o.corners_px[0]).norm() < 3 &&
           (s.corners_px[2] - o.corners_px[2]).norm() < 3;
  });
}

}  // namespace

struct BodyTracker::Impl {
  using Images = std::vector<const Image8*>;

  Rig rig;
  BodyTrackerOptions options;
  std::unique_ptr<TagDetector> detector, quick_detector;  // quick: quads at half resolution
  std::array<TrackedBody, 2> bodies;                      // bow, head frame
  RigTags last_tags;
  HostTime last_capture;
  bool rolling = false;  ///< a camera's shutter rolls
  int frames_to_search = 0;
  std::size_t tiles_searched = 0;  ///< since a body was lost

  bool lost() const { return !bodies[0].pose.valid || !bodies[1].pose.valid; }

  void predict(HostTime capture) {
    for (TrackedBody& b : bodies) {
      b.predicted = b.track.predicted(capture, options.max_prediction_s);
      b.velocity = b.track.velocity(options.max_prediction_s);
    }
  }

  /// Each tag of the body that should be visible, looked for where the prediction puts it: those of the last
  /// frame straight away, of the others `retries` in turn.
  void follow(TrackedBody& b, const Rigid3& pose, const Images& images, int retries, RigTags* tags) {
    const Vector6 velocity = b.velocity.value_or(Vector6::Zero());
    const std::size_t count = b.body->tags.size(), first = b.retried + 1;
    for (std::size_t c = 0; c < images.size(); ++c) {
      if (images[c] == nullptr) continue;
      const RigCamera& camera = rig.cameras[c];
      int left = retries;
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t which = (first + i) % count;
        const BodyTag& tag = b.body->tags[which];
        const TagObservation* last = observation_of(last_tags[c], tag.id);
        if ((last == nullptr && left == 0) || observation_of((*tags)[c], tag.id) != nullptr) continue;
        const auto expected = projected_tag(camera, tag, pose, 78.0, velocity);
        if (!expected) continue;
        if (last == nullptr) {
          --left;
          b.retried = which;
        }
        const auto seen = detector->follow(*images[c], camera.model, tag.id, *expected, last);
        if (seen) (*tags)[c].push_back(*seen);
      }
    }
  }

  /// Tags of a body whose pose is not known yet, where the last frame showed them: what tiles find one by one
  /// adds up.
  void keep(const TrackedBody& b, const Images& images, RigTags* tags) {
    for (std::size_t c = 0; c < images.size(); ++c) {
      if (images[c] == nullptr) continue;
      for (const BodyTag& tag : b.body->tags) {
        const TagObservation* last = observation_of(last_tags[c], tag.id);
        if (last == nullptr) continue;
        const auto seen = detector->follow(*images[c], rig.cameras[c].model, tag.id, last->corners_px, last);
        if (seen) (*tags)[c].push_back(*seen);
      }
    }
  }

  void estimate(TrackedBody& b, HostTime capture, const RigTags& tags, const std::optional<Rigid3>& guess) {
    b.pose = estimate_body_pose(rig, *b.body, tags, options.pose, guess, b.velocity);
    if (!rolling || !b.pose.valid) return;
    // The pose itself tells the velocity better than the past did; once more with that.
    b.velocity = b.track.velocity_at(capture, b.pose.camera_from_body, options.max_prediction_s);
    if (b.velocity)
      b.pose = estimate_body_pose(rig, *b.body, tags, options.pose, b.pose.camera_from_body, b.velocity);
  }

  /// Adds what a search finds and was not followed.
  void add_found(const std::vector<TagObservation>& found, std::size_t camera, RigTags* tags) {
    for (const TagObservation& o : found) {
      if (!near_another((*tags)[camera], o)) (*tags)[camera].push_back(o);
    }
  }

  void search_whole(TagDetector& with, const Images& images, RigTags* tags) {
    for (std::size_t c = 0; c < images.size(); ++c) {
      if (images[c] != nullptr) add_found(with.detect(*images[c], rig.cameras[c].model), c, tags);
    }
  }

  void search_tiles(const Images& images, RigTags* tags) {
    for (std::size_t c = 0; c < images.size(); ++c) {
      if (images[c] == nullptr) continue;
      const CameraModel& camera = rig.cameras[c].model;
      std::vector<Tile> tiles = tiles_of(camera);
      const Eigen::Vector2d middle(0.5 * camera.width_px, 0.5 * camera.height_px);
      const Eigen::Vector2d near = last_seen(rig.cameras[c]).value_or(middle);
      const auto distance = [&](const Tile& t) {
        return (near - Eigen::Vector2d(t.x + 0.5 * t.width, t.y + 0.5 * t.height)).squaredNorm();
      };
      std::stable_sort(tiles.begin(), tiles.end(),
                       [&](const Tile& a, const Tile& b) { return distance(a) < distance(b); });
      for (int i = 0; i < options.search_tiles; ++i) {
        const Tile& t = tiles[(tiles_searched + static_cast<std::size_t>(i)) % tiles.size()];
        add_found(quick_detector->detect_in(*images[c], camera, t.x, t.y, t.width, t.height), c, tags);
      }
    }
    tiles_searched += static_cast<std::size_t>(options.search_tiles);
  }

  /// Where the camera last saw the body that is lost.
  std::optional<Eigen::Vector2d> last_seen(const RigCamera& camera) const {
    for (const TrackedBody& b : bodies) {
      if (b.pose.valid || b.track.last_pose() == nullptr) continue;
      const Vector3 middle = *b.track.last_pose() * b.body->tags[0].corners_in_body_mm[0];
      return camera.model.project(camera.rig_from_camera.inverse() * middle);
    }
    return std::nullopt;
  }

  /// Poses of the lost bodies from what the search found; then the tags that a pose predicts and the search
  /// did not report (libapriltag misses steep ones).
  void estimate_lost(HostTime capture, const Images& images, RigTags* tags) {
    for (TrackedBody& b : bodies) {
      if (b.pose.valid) continue;
      estimate(b, capture, *tags, b.predicted);
      if (!b.pose.valid) continue;
      const Rigid3 found = b.pose.camera_from_body;
      follow(b, found, images, static_cast<int>(b.body->tags.size()), tags);
      estimate(b, capture, *tags, found);
    }
  }

  void search(HostTime capture, const Images& images, RigTags* tags, BodyPoses* told) {
    if (options.search_tiles > 0) {
      search_tiles(images, tags);
      estimate_lost(capture, images, tags);
    } else {
      if (--frames_to_search > 0) return;
      frames_to_search = options.search_pause_frames;
      search_whole(*quick_detector, images, tags);
      estimate_lost(capture, images, tags);
      if (lost()) {
        search_whole(*detector, images, tags);
        estimate_lost(capture, images, tags);
      }
    }
    told->searched = true;
    tell_strangers(*tags, told);
  }

  /// Ids that are there twice, or on neither body: another bow, or other tags in view.
  void tell_strangers(const RigTags& tags, BodyPoses* told) const {
    for (const auto& camera : tags) {
      for (std::size_t i = 0; i < camera.size(); ++i) {
        if (!camera[i].refined || camera[i].hamming > 0) continue;
        const auto on = [&](const TrackedBody& b) {
          return std::any_of(b.body->tags.begin(), b.body->tags.end(),
                             [&](const BodyTag& t) { return t.id == camera[i].id; });
        };
        const bool known = on(bodies[0]) || on(bodies[1]);
        const bool again = std::any_of(
            camera.begin(), camera.begin() + static_cast<std::ptrdiff_t>(i), [&](const TagObservation& o) {
              return o.id == camera[i].id && o.refined && o.hamming == 0 && apart_px(o, camera[i]) > kApartPx;
            });
        if (known && again) told->ids_seen_twice.push_back(camera[i].id);
        if (!known) told->foreign_ids.push_back(camera[i].id);
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
  impl->bodies[0].body = &impl->rig.bow;
  impl->bodies[1].body = &impl->rig.head_frame;
  GNATHION_TRY(impl->detector, TagDetector::create(impl->options.detector));
  TagDetectorOptions quick = impl->options.detector;
  quick.quad_decimate = std::max(quick.quad_decimate, 2.0);
  GNATHION_TRY(impl->quick_detector, TagDetector::create(quick));
  impl->last_tags.resize(rig.cameras.size());
  for (const RigCamera& camera : rig.cameras) impl->rolling |= camera.line_time_ns.value_or(0) != 0;
  return std::unique_ptr<BodyTracker>(new BodyTracker(std::move(impl)));
}

BodyTracker::BodyTracker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
BodyTracker::~BodyTracker() = default;

void BodyTracker::reset() {
  for (TrackedBody& b : impl_->bodies) {
    b.track.lose();
    b.retried = 0;
  }
  for (auto& tags : impl_->last_tags) tags.clear();
  impl_->frames_to_search = 0;
  impl_->tiles_searched = 0;
}

BodyPoses BodyTracker::next(HostTime capture, const std::vector<const Image8*>& images) {
  Impl& m = *impl_;
  GNATHION_CHECK(images.size() == m.rig.cameras.size());
  BodyPoses poses;
  RigTags tags(images.size());
  m.predict(capture);
  for (TrackedBody& b : m.bodies) {
    if (!b.predicted) {
      m.keep(b, images, &tags);
      continue;
    }
    const bool seen_last = b.track.last_at() == m.last_capture;  // else none of its tags has a last frame
    const int retries = seen_last ? m.options.retries_per_frame : static_cast<int>(b.body->tags.size());
    m.follow(b, *b.predicted, images, retries, &tags);
  }
  for (TrackedBody& b : m.bodies) m.estimate(b, capture, tags, b.predicted);
  if (m.lost()) m.search(capture, images, &tags, &poses);
  if (!m.lost()) {
    m.frames_to_search = 0;
    m.tiles_searched = 0;
  }
  for (TrackedBody& b : m.bodies) {
    if (b.pose.valid) b.track.see(capture, b.pose.camera_from_body);
  }
  if (poses.searched && m.lost()) poses.tags = tags;
  m.last_tags = std::move(tags);
  m.last_capture = capture;
  poses.bow = std::move(m.bodies[0].pose);
  poses.head = std::move(m.bodies[1].pose);
  return poses;
}

}  // namespace gnathion
