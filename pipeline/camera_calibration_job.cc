#include "pipeline/camera_calibration_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "acquisition/recording.h"
#include "tracking/board_images.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot calibrate camera";

/// One camera's images, with the names that pair them with the other cameras'.
struct Images {
  std::string camera, where;
  std::vector<std::string> names;
  std::vector<fs::path> files;  ///< or
  std::vector<Image8> frames;   ///< from a recording
};

std::string digits_of(const std::string& stem) {
  std::string digits;
  for (const char c : stem)
    if (c >= '0' && c <= '9') digits += c;
  return digits;
}

Result<std::int64_t> time_of(const fs::path& file) {
  const std::string stem = file.stem().string();
  if (stem.empty() || stem.size() > 19 || stem.find_first_not_of("0123456789") != std::string::npos)
    return bad_input(kWhat, file.string(), "its name is no time in ns");
  return static_cast<std::int64_t>(std::stoull(stem));
}

/// Images of one instant get one name: the first camera's.
Status pair_by_time(double same_instant_s, std::vector<Images>* cameras) {
  std::vector<std::pair<std::int64_t, std::string>> instants;
  for (std::size_t c = 0; c < cameras->size(); ++c) {
    Images& images = (*cameras)[c];
    for (std::size_t i = 0; i < images.files.size(); ++i) {
      GNATHION_TRY(const std::int64_t t, time_of(images.files[i]));
      const auto nearest = std::min_element(
          instants.begin(), instants.end(),
          [&](const auto& a, const auto& b) { return std::abs(a.first - t) < std::abs(b.first - t); });
      const bool known = c > 0 && nearest != instants.end() &&
                         static_cast<double>(std::abs(nearest->first - t)) * 1e-9 <= same_instant_s;
      images.names[i] =
          known ? nearest->second : fmt::format("{}/{}", images.camera, images.files[i].filename().string());
      if (!known && c == 0) instants.emplace_back(t, images.names[i]);
    }
  }
  return {};
}

/// By equal file names without extension; where cameras share none, by the digits in them (left01, right01).
Status pair_by_name(std::vector<Images>* cameras) {
  std::vector<std::set<std::string>> stems(cameras->size());
  bool shared = true;
  for (std::size_t c = 0; c < cameras->size(); ++c) {
    for (const fs::path& f : (*cameras)[c].files) stems[c].insert(f.stem().string());
    if (c > 0)
      shared = shared && std::any_of(stems[c].begin(), stems[c].end(),
                                     [&](const auto& s) { return stems[0].count(s); });
  }
  for (Images& images : *cameras) {
    std::map<std::string, std::string> used;
    for (std::size_t i = 0; i < images.files.size(); ++i) {
      const std::string stem = images.files[i].stem().string();
      images.names[i] = shared ? stem : digits_of(stem);
      const auto [other, added] = used.emplace(images.names[i], images.files[i].filename().string());
      if (!added)
        return bad_input(
            kWhat, images.files[i].string(),
            fmt::format(
                "cannot be told from {} by the digits in its name: give images of one instant one name",
                other->second));
    }
  }
  return {};
}

Result<std::vector<Images>> images_from_folders(const CameraCalibrationJob& job) {
  std::vector<Images> cameras;
  for (const CalibrationCamera& c : job.cameras) {
    Images images;
    images.camera = c.name;
    images.where = c.images.string();
    GNATHION_TRY(images.files, list_images(c.images));
    for (const fs::path& f : images.files) images.names.push_back(f.filename().string());
    cameras.push_back(std::move(images));
  }
  if (cameras.size() > 1)
    GNATHION_CHECK_OK(job.pair_by_time ? pair_by_time(job.same_instant_s, &cameras) : pair_by_name(&cameras));
  return cameras;
}

/// Frames of the first camera, evenly, and of each other camera the nearest to them.
Result<std::vector<Images>> images_from_recording(const CameraCalibrationJob& job) {
  std::vector<std::vector<std::pair<HostTime, std::uint32_t>>> times(job.cameras.size());
  const auto camera_of = [&](const Sample& s) {
    const std::string& stream = header_of(s).stream;
    return static_cast<std::size_t>(
        std::find_if(job.cameras.begin(), job.cameras.end(),
                     [&](const CalibrationCamera& c) { return c.name == stream; }) -
        job.cameras.begin());
  };
  std::set<std::string> streams;
  std::optional<HostTime> start;
  const auto each_frame = [&](const auto& visit) -> Status {
    GNATHION_TRY(const auto source, RecordingSource::open(job.recording));
    for (;;) {
      GNATHION_TRY(auto sample, source->next());
      if (!sample) return {};
      auto* frame = std::get_if<FrameSample>(&*sample);
      if (frame == nullptr) continue;
      streams.insert(frame->header.stream);
      if (const std::size_t c = camera_of(*sample); c < job.cameras.size()) visit(c, *frame);
    }
  };
  GNATHION_CHECK_OK(each_frame([&](std::size_t c, const FrameSample& f) {
    times[c].emplace_back(f.header.capture, f.header.sequence);
    if (!start || f.header.capture < *start) start = f.header.capture;
  }));
  for (std::size_t c = 0; c < times.size(); ++c)
    if (times[c].empty())
      return bad_input(
          kWhat, job.recording.string(),
          fmt::format("has no images of '{}'; it has {}", job.cameras[c].name,
                      streams.empty() ? "none at all" : fmt::format("{}", fmt::join(streams, ", "))));
  std::vector<std::map<std::uint32_t, std::string>> chosen(job.cameras.size());
  const std::size_t stride =
      std::max<std::size_t>(1, (times[0].size() + static_cast<std::size_t>(job.max_frames) - 1) /
                                   static_cast<std::size_t>(job.max_frames));
  for (std::size_t i = 0; i < times[0].size(); i += stride) {
    const std::string name = fmt::format("{:.3f} s", times[0][i].first.seconds_since(*start));
    chosen[0][times[0][i].second] = name;
    for (std::size_t c = 1; c < times.size(); ++c) {
      const auto gap = [&](const auto& t) { return std::abs(t.first.seconds_since(times[0][i].first)); };
      const auto nearest = std::min_element(times[c].begin(), times[c].end(),
                                            [&](const auto& a, const auto& b) { return gap(a) < gap(b); });
      if (gap(*nearest) <= job.same_instant_s) chosen[c][nearest->second] = name;
    }
  }
  std::vector<Images> cameras(job.cameras.size());
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    cameras[c].camera = job.cameras[c].name;
    cameras[c].where = fmt::format("{}, {}", job.recording.string(), job.cameras[c].name);
    if (chosen[c].empty())
      return bad_input(kWhat, cameras[c].where,
                       fmt::format("has no frame within {:.1f} ms of one of {}", 1e3 * job.same_instant_s,
                                   job.cameras[0].name));
  }
  GNATHION_CHECK_OK(each_frame([&](std::size_t c, FrameSample& f) {
    const auto found = chosen[c].find(f.header.sequence);
    if (found == chosen[c].end()) return;
    cameras[c].names.push_back(found->second);
    cameras[c].frames.push_back(std::move(f.image));
  }));
  return cameras;
}

/// What stands in the images instead of the board, from the first few.
Result<std::string> what_else(const CameraCalibrationJob& job, const std::vector<BoardDetection>& found,
                              const ImageLoader& load) {
  GNATHION_TRY(auto detector, BoardDetector::create(job.board));
  int tried = 0;
  for (std::size_t i = 0; i < found.size() && tried < 3; ++i) {
    if (found[i].found()) continue;
    ++tried;
    GNATHION_TRY(const Image8 image, load(i));
    if (std::string other = detector->what_else(image); !other.empty()) return other;
  }
  return std::string();
}

Result<RigCameraViews> views_of(const CameraCalibrationJob& job, const Images& images,
                                const CameraModel& lens, std::vector<NotFound>* not_found, bool* from_edges,
                                Progress& progress) {
  const std::size_t count = images.names.size();
  const auto load = [&](std::size_t i) -> Result<Image8> {
    if (images.frames.empty()) return read_grey_image(images.files[i]);
    return images.frames[i];
  };
  const auto name = [&](std::size_t i) { return images.names[i]; };
  progress.begin_step("finding the board, " + images.camera, 0.4 / static_cast<double>(job.cameras.size()));
  GNATHION_TRY(BoardDetections found, detect_boards(job.board, count, load, name, lens, progress));
  RigCameraViews out;
  out.name = images.camera;
  out.width_px = found.width_px, out.height_px = found.height_px;
  std::map<std::string, int> reasons;
  for (const BoardDetection& d : found.images) {
    if (d.found()) {
      out.views.push_back(d.view);
      *from_edges = *from_edges || d.from_edges;
    } else {
      ++reasons[d.reason];
      not_found->push_back({images.camera, d.view.name, d.reason});
    }
  }
  if (2 * out.views.size() >= count || out.views.size() >= 8) return out;
  GNATHION_TRY(const std::string other, what_else(job, found.images, load));
  const auto most = std::max_element(reasons.begin(), reasons.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  if (!other.empty())
    return bad_input(kWhat, images.where,
                     fmt::format("{} is not what most images show: they show {}", job.board.text(), other));
  if (out.views.empty())
    return bad_input(kWhat, images.where,
                     fmt::format("{} is in none of {} images: {}", job.board.text(), count, most->first));
  return out;
}

/// Boards found and cameras solved, once; `lenses` as far as they are known.
Result<CameraCalibrationOutput> solve_once(const CameraCalibrationJob& job, const std::vector<Images>& images,
                                           const std::vector<CameraModel>& lenses, bool* from_edges,
                                           Progress& progress) {
  CameraCalibrationOutput out;
  std::vector<RigCameraViews> views;
  for (std::size_t c = 0; c < images.size(); ++c) {
    GNATHION_TRY(RigCameraViews v, views_of(job, images[c], lenses[c], &out.not_found, from_edges, progress));
    views.push_back(std::move(v));
  }
  if (views.size() > 1) {
    GNATHION_TRY(out.rig, calibrate_rig(job.board, views, job.options, progress));
    return out;
  }
  const RigCameraViews& only = views[0];
  GNATHION_TRY(CameraCalibration camera, calibrate_camera(job.board, only.name, only.width_px, only.height_px,
                                                          only.views, job.options, progress));
  out.rig.warnings = camera.warnings;
  out.rig.rms_px = camera.rms_px;
  out.rig.held_out_px = camera.held_out_px;
  out.rig.noise_scale = camera.noise_scale;
  out.rig.covariance = camera.covariance;
  out.rig.cameras.push_back({only.name, std::move(camera), {}, Matrix6::Zero(), 0});
  return out;
}

}  // namespace

Result<CameraCalibrationOutput> run_camera_calibration(const CameraCalibrationJob& job, Progress& progress) {
  progress.begin_step("reading images", 0.1);
  GNATHION_TRY(const std::vector<Images> images,
               job.recording.empty() ? images_from_folders(job) : images_from_recording(job));
  bool from_edges = false;
  std::vector<CameraModel> lenses(images.size());
  GNATHION_TRY(CameraCalibrationOutput out, solve_once(job, images, lenses, &from_edges, progress));
  if (!from_edges) return out;
  // The lens bends the edges of tags; now it is known how.
  for (std::size_t c = 0; c < lenses.size(); ++c) lenses[c] = out.rig.cameras[c].camera.model;
  return solve_once(job, images, lenses, &from_edges, progress);
}

}  // namespace gnathion
