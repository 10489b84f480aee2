#include "pipeline/bow_film.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <thread>

#include "tracking/body_pose.h"
#include "tracking/tag_detector.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot calibrate the body's tags";
constexpr double kSameInstant_s = 0.002;

/// One image of every camera of the rig.
struct Instant {
  std::string name;
  std::vector<FrameSample> frames;
};

/// Instants of the rig out of a source, at least interval_s apart.
class InstantReader {
 public:
  InstantReader(Source& source, const std::vector<RigCamera>& cameras, double interval_s)
      : source_(source), cameras_(cameras), interval_s_(interval_s), latest_(cameras.size()) {}

  Result<std::optional<Instant>> next() {
    for (;;) {
      GNATHION_TRY(std::optional<Sample> sample, source_.next());
      if (!sample) return std::optional<Instant>();
      auto* frame = std::get_if<FrameSample>(&*sample);
      if (frame == nullptr) continue;
      const auto camera = index_of(frame->header.stream);
      if (!camera) {
        others_.insert({frame->header.stream, true});
        continue;
      }
      ++frames_;
      const CameraModel& m = cameras_[*camera].model;
      if (frame->image.width_px != m.width_px || frame->image.height_px != m.height_px)
        return bad_input(kWhat, frame->header.stream,
                         fmt::format("images of {}x{} px, the rig's camera has {}x{}", frame->image.width_px,
                                     frame->image.height_px, m.width_px, m.height_px));
      const HostTime at = frame->header.capture;
      latest_[*camera] = std::move(*frame);
      if (last_ && at.seconds_since(*last_) < interval_s_) continue;
      const bool complete = std::all_of(latest_.begin(), latest_.end(), [&](const auto& f) {
        return f && std::abs(at.seconds_since(f->header.capture)) <= kSameInstant_s;
      });
      if (!complete) continue;
      last_ = at;
      Instant instant{fmt::format("frame {}", latest_[0]->header.sequence), {}};
      for (auto& f : latest_) {
        instant.frames.push_back(std::move(*f));
        f.reset();
      }
      return std::optional<Instant>(std::move(instant));
    }
  }
  std::size_t frames() const { return frames_; }
  std::string other_streams() const {
    std::string text;
    for (const auto& [name, unused] : others_) text += (text.empty() ? "" : ", ") + name;
    return text;
  }

 private:
  std::optional<std::size_t> index_of(const std::string& stream) const {
    for (std::size_t c = 0; c < cameras_.size(); ++c)
      if (cameras_[c].name == stream) return c;
    return std::nullopt;
  }
  Source& source_;
  const std::vector<RigCamera>& cameras_;
  double interval_s_;
  std::vector<std::optional<FrameSample>> latest_;
  std::optional<HostTime> last_;
  std::map<std::string, bool> others_;
  std::size_t frames_ = 0;
};

Image8 mirrored(const Image8& image) {
  Image8 out = image;
  for (int y = 0; y < image.height_px; ++y)
    for (int x = 0; x < image.width_px; ++x) out.at(image.width_px - 1 - x, y) = image.at(x, y);
  return out;
}

/// Poses are only starts here: printed tags are tenths of a millimetre, pixels, off their nominal places.
BodyPoseOptions generous() {
  BodyPoseOptions o;
  o.max_rms_px = 12;
  o.outlier_min_px = 8;
  return o;
}

BodyView view_of(const Instant& instant, const RigTags& tags, const Rig& rig) {
  BodyView view;
  view.name = instant.name;
  for (const auto& seen : tags) {
    view.tags.emplace_back();
    for (const TagObservation& o : seen) view.tags.back().push_back({o.id, o.corners_px, o.covariance_px2});
  }
  const BodyPose pose = estimate_body_pose(rig, rig.bow, tags, generous());
  if (pose.valid) view.rig_from_body = pose.camera_from_body;
  return view;
}

/// Threads that find tags, each with a detector of its own; one batch at a time, results in order.
class Finder {
 public:
  static Result<Finder> create(const Rig& rig, int threads) {
    Finder f;
    f.rig_ = rig;
    for (int i = 0; i < std::max(1, threads); ++i) {
      TagDetectorOptions options;
      options.family = rig.bow.family;
      GNATHION_TRY(auto detector, TagDetector::create(options));
      f.detectors_.push_back(std::move(detector));
    }
    return f;
  }
  std::size_t batch() const { return 4 * detectors_.size(); }

  void find(const std::vector<Instant>& instants, std::vector<BodyView>& views) {
    std::vector<BodyView> found(instants.size());
    std::vector<std::thread> threads;
    for (std::size_t t = 0; t < detectors_.size(); ++t)
      threads.emplace_back([&, t] {
        for (std::size_t i = t; i < instants.size(); i += detectors_.size())
          found[i] = view_of(instants[i], tags_in(*detectors_[t], instants[i], false), rig_);
      });
    for (std::thread& thread : threads) thread.join();
    views.insert(views.end(), std::make_move_iterator(found.begin()), std::make_move_iterator(found.end()));
  }
  std::size_t tags_when_mirrored(const Instant& instant) {
    std::size_t count = 0;
    for (const auto& tags : tags_in(*detectors_[0], instant, true)) count += tags.size();
    return count;
  }

 private:
  RigTags tags_in(TagDetector& detector, const Instant& instant, bool mirror) const {
    RigTags tags;
    for (std::size_t c = 0; c < rig_.cameras.size(); ++c) {
      const Image8& image = instant.frames[c].image;
      tags.push_back(detector.detect(mirror ? mirrored(image) : image, rig_.cameras[c].model));
    }
    return tags;
  }
  Rig rig_;
  std::vector<std::unique_ptr<TagDetector>> detectors_;
};

std::size_t tags_in(const std::vector<BodyView>& views) {
  std::size_t count = 0;
  for (const BodyView& view : views)
    for (const auto& tags : view.tags) count += tags.size();
  return count;
}

}  // namespace

Result<BowGeometry> calibrate_bow_film(Source& source, const std::vector<RigCamera>& cameras,
                                       const TaggedBody& nominal, const BowFilmOptions& options,
                                       Progress& progress, BowFilmSummary* summary) {
  Rig rig;
  rig.cameras = cameras;
  rig.bow = nominal;
  GNATHION_TRY(Finder finder, Finder::create(rig, options.threads));
  InstantReader reader(source, cameras, options.interval_s);
  progress.begin_step("finding tags", 0.9);
  std::vector<BodyView> views;
  std::optional<Instant> first;
  for (bool more = true; more;) {
    std::vector<Instant> batch;
    while (batch.size() < finder.batch()) {
      GNATHION_TRY(std::optional<Instant> instant, reader.next());
      more = instant.has_value();
      if (!more) break;
      batch.push_back(std::move(*instant));
    }
    finder.find(batch, views);
    if (!first && !batch.empty()) first = std::move(batch.front());
    progress.update(1 - std::exp(-static_cast<double>(views.size()) / 100));
  }
  if (views.empty())
    return bad_input(kWhat, "film",
                     reader.frames() == 0 ? fmt::format("no frame of the rig's cameras{}",
                                                        reader.other_streams().empty()
                                                            ? std::string()
                                                            : "; it holds " + reader.other_streams())
                                          : std::string("the cameras have no frames of one instant"));
  if (tags_in(views) == 0 && finder.tags_when_mirrored(*first) > 0)
    return bad_input(
        kWhat, "film",
        "mirrored images: tags are found only after flipping them; switch mirroring off in the camera");
  if (tags_in(views) == 0)
    return bad_input(kWhat, "film", "no tag of family " + nominal.family + " is found");
  if (summary != nullptr) {
    summary->frames = reader.frames();
    summary->instants = views.size();
    summary->with_pose = static_cast<std::size_t>(std::count_if(
        views.begin(), views.end(), [](const BodyView& v) { return v.rig_from_body.has_value(); }));
  }
  progress.begin_step("adjusting", 0.1);
  return calibrate_bow_geometry(cameras, nominal, views, options.geometry);
}

Result<KnownDistance> parse_distance(const std::string& text) {
  const auto refuse = [&] {
    return fail(
        ErrorCode::kUsage, "wrong usage", text,
        "a distance is TAG[.CORNER]-TAG[.CORNER]=MM[/SIGMA_MM], as 0-7=181.35 or 0.1-7.2=181.35/0.03");
  };
  KnownDistance d;
  const char* at = text.c_str();
  int used = 0;
  const auto end_of = [&](int& tag, int& corner) {
    if (std::sscanf(at, "%d%n", &tag, &used) != 1 || tag < 0) return false;
    at += used;
    if (*at != '.') return true;
    if (at[1] < '0' || at[1] > '3') return false;
    corner = at[1] - '0';
    at += 2;
    return true;
  };
  if (!end_of(d.tag_a, d.corner_a) || *at++ != '-' || !end_of(d.tag_b, d.corner_b) || *at++ != '=')
    return refuse();
  if (std::sscanf(at, "%lf%n", &d.mm, &used) != 1) return refuse();
  at += used;
  if (*at == '/') {
    if (std::sscanf(at + 1, "%lf%n", &d.sigma_mm, &used) != 1) return refuse();
    at += 1 + used;
  }
  const bool sane =
      std::isfinite(d.mm) && std::isfinite(d.sigma_mm) && d.mm > 0 && d.mm < 2000 && d.sigma_mm > 0;
  if (*at != 0 || !sane || (d.tag_a == d.tag_b && d.corner_a == d.corner_b)) return refuse();
  return d;
}

std::string bow_geometry_text(const BowGeometry& g) {
  std::string text =
      fmt::format("{}: {} tags, {} views over {:.0f} deg, residual {:.3f} px, held out {:.3f} px\n",
                  g.body.name, g.tags.size(), g.views.size(), g.turn_deg, g.rms_px, g.held_out_px);
  text += " tag  side mm          off CAD mm  deg    known to mm  px     views\n";
  for (const TagGeometry& t : g.tags)
    text +=
        fmt::format(" {:>3}  {:.3f} x {:.3f}  {:>10.3f}  {:.2f}  {:>12.4f}  {:.3f}  {:>5}\n", t.tag.id,
                    t.width_mm, t.height_mm, t.shift_mm.norm(), t.turn_deg, t.sigma_mm, t.rms_px, t.views);
  text += fmt::format("scale {:.5f} of the file's, known to {:.2f} % ({:.2f} mm on 100 mm)\n", g.scale,
                      100 * g.scale_sigma, 100 * g.scale_sigma);
  text += fmt::format("the frame is the CAD's within {:.3f} mm, {:.3f} deg (tags about the layout)\n",
                      g.datum_sigma_mm, g.datum_sigma_deg);
  for (const std::string& w : g.weak) text += "weak: " + w + "\n";
  for (const std::string& w : g.warnings) text += "warning: " + w + "\n";
  return text;
}

}  // namespace gnathion
