#include "acquisition/exchange/plus_collector.h"

#include <fmt/format.h>

#include "acquisition/exchange/plus_names.h"

namespace gnathion {

/// The frame of an instant in which the transform, or the image where `transform` is empty, is not there yet.
PlusFrame& PlusCollector::frame_at(const SampleHeader& header, const std::string& transform) {
  Instant instant{header.capture.ns, 0};
  const auto has_it = [&](const PlusFrame& f) {
    return transform.empty() ? f.has_image : f.transforms.count(transform) > 0;
  };
  for (auto f = frames_.find(instant); f != frames_.end() && has_it(f->second); f = frames_.find(instant))
    ++instant.second;
  const auto [found, is_new] = frames_.try_emplace(instant);
  if (is_new) {
    found->second.has_image = false;
    found->second.number = header.sequence;
    found->second.unfiltered_timestamp_ns = header.arrival.ns;
  }
  return found->second;
}

void PlusCollector::take(const Sample& sample) {
  if (const auto* pose = std::get_if<PoseSample>(&sample)) take_pose(*pose);
  const auto* image = std::get_if<FrameSample>(&sample);
  if (!image || image->header.stream != camera_) return;
  if (width_px_ == 0) {
    width_px_ = image->image.width_px;
    height_px_ = image->image.height_px;
  }
  PlusFrame& frame = frame_at(image->header, "");
  frame.has_image = true;
  frame.number = image->header.sequence;  // the image's, where poses share its instant
  frame.unfiltered_timestamp_ns = image->header.arrival.ns;
}

void PlusCollector::take_pose(const PoseSample& pose) {
  auto& name = names_[pose.header.stream];
  if (name.empty()) {
    const std::string from = plus_name(pose.body), to = plus_name(pose.reference);
    name = from + "To" + to;
    for (int n = 2; !taken_.insert(name).second; ++n) name = fmt::format("{}{}To{}", from, n, to);
  }
  PlusTransform& t = frame_at(pose.header, name).transforms[name];
  t.matrix = pose.reference_from_body.matrix();
  t.valid = pose.valid;
  t.status = pose.valid ? "OK" : pose.reason.empty() ? "INVALID" : pose.reason;
}

PlusSequence PlusCollector::sequence() const {
  PlusSequence s;
  s.width_px = width_px_;
  s.height_px = height_px_;
  if (frames_.empty()) return s;
  const std::int64_t start_ns = frames_.begin()->first.first;
  s.fields[kPlusStartField] = decimal_seconds(start_ns);
  for (const auto& [instant, frame] : frames_) {
    PlusFrame f = frame;
    f.timestamp_ns = instant.first - start_ns;
    f.unfiltered_timestamp_ns = *f.unfiltered_timestamp_ns - start_ns;
    for (const std::string& name : taken_)
      if (!f.transforms.count(name)) f.transforms[name] = {Matrix4::Identity(), false, kPlusNotMeasured};
    s.frames.push_back(std::move(f));
  }
  return s;
}

}  // namespace gnathion
