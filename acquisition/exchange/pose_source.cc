#include "acquisition/exchange/pose_source.h"

#include <algorithm>

#include "acquisition/mcap_reader.h"
#include "acquisition/recording.h"

namespace gnathion {
namespace {

class PoseSource : public Source {
 public:
  explicit PoseSource(PoseRecording poses) {
    for (const auto& [body, rows] : poses.bodies)
      for (const PoseRecord& r : rows) {
        PoseSample s;
        s.header = {body, r.sequence, r.capture, r.capture, {0}};
        s.reference = r.parent;
        s.body = body;
        s.valid = r.valid;
        s.reason = r.reason;
        s.reference_from_body = r.camera_from_body;
        samples_.emplace_back(std::move(s));
      }
    for (EventSample& event : poses.events) samples_.emplace_back(std::move(event));
    std::stable_sort(samples_.begin(), samples_.end(), [](const Sample& a, const Sample& b) {
      return header_of(a).capture < header_of(b).capture;
    });
  }
  Result<std::optional<Sample>> next() override {
    if (next_ == samples_.size()) return std::optional<Sample>();
    return std::optional<Sample>(samples_[next_++]);
  }

 private:
  std::vector<Sample> samples_;
  std::size_t next_ = 0;
};

}  // namespace

bool is_pose_recording(const std::filesystem::path& path) {
  auto reader = McapReader::open(path, McapReader::Ending::kAsFarAsItGoes);
  if (!reader) return false;
  const auto first = (*reader)->next();
  return first && *first && (*first)->channel->topic == "/session_start";
}

std::unique_ptr<Source> make_pose_source(PoseRecording poses) {
  return std::make_unique<PoseSource>(std::move(poses));
}

Result<std::unique_ptr<Source>> open_any_recording(const std::filesystem::path& path) {
  if (is_pose_recording(path)) {
    GNATHION_TRY(PoseRecording poses, read_poses(path));
    return make_pose_source(std::move(poses));
  }
  GNATHION_TRY(auto source, RecordingSource::open(path));
  return std::unique_ptr<Source>(std::move(source));
}

}  // namespace gnathion
