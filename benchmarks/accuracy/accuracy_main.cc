// Corners, poses, speed and latency, ours and others' on the same pictures in the same run.
// Usage: accuracy [SEED [SCALE]]   SCALE 1: as docs/accuracy.md; 0.1: a tenth of the pictures
//
// Prints the tables of docs/accuracy.md. All on one thread; times are CPU time of this thread but for the
// latency, which is wall time.
#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <thread>

#include "benchmarks/accuracy/others.h"
#include "benchmarks/accuracy/scenes.h"
#include "core/check.h"
#include "core/random.h"
#include "core/time.h"
#include "tracking/body_tracker.h"

namespace gnathion::accuracy {
namespace {

using Tags = std::vector<TagObservation>;
using Detect = std::function<Tags(const Picture&)>;

double cpu_s() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double at_quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

double rms(const std::vector<double>& values) {
  double squares = 0;
  for (double v : values) squares += v * v;
  return std::sqrt(squares / static_cast<double>(values.size()));
}

std::unique_ptr<TagDetector> detector(bool refine) {
  TagDetectorOptions options;
  options.refine = refine;
  auto created = TagDetector::create(options);
  GNATHION_CHECK(created.has_value());
  return std::move(*created);
}

struct CornerErrors {
  std::vector<Eigen::Vector2d> px;
  void add(const TagCorners& found, const TagCorners& truth, int shift, int direction) {
    for (int k = 0; k < 4; ++k)
      px.push_back(found[static_cast<std::size_t>((shift + direction * k) & 3)] -
                   truth[static_cast<std::size_t>(k)]);
  }
};

/// Errors in the best of the eight orders of corners: others count from another one, or the other way round.
CornerErrors corner_errors(const TagCorners& found, const TagCorners& truth, bool any_order) {
  CornerErrors best;
  double best_sum = 1e300;
  for (const int direction : {1, -1}) {
    for (int shift = 0; shift < (any_order ? 4 : 1); ++shift) {
      CornerErrors errors;
      errors.add(found, truth, shift, direction);
      double sum = 0;
      for (const auto& e : errors.px) sum += e.squaredNorm();
      if (sum < best_sum) {
        best_sum = sum;
        best = errors;
      }
    }
    if (!any_order) break;
  }
  return best;
}

void corner_row(const char* name, const std::vector<Picture>& pictures, bool stated, const Detect& detect) {
  std::vector<Eigen::Vector2d> errors;
  std::vector<double> times_ms;
  double normalised = 0;
  std::size_t truths = 0, found = 0;
  for (const Picture& picture : pictures) {
    const double start = cpu_s();
    const Tags tags = detect(picture);
    times_ms.push_back(1e3 * (cpu_s() - start));
    for (const TrueTag& truth : picture.tags) {
      ++truths;
      for (const TagObservation& o : tags) {
        if (o.id != truth.id) continue;
        const auto e = corner_errors(o.corners_px, truth.corners_px, !stated).px;
        if (std::any_of(e.begin(), e.end(), [](const auto& d) { return d.norm() > 5; })) continue;
        ++found;
        errors.insert(errors.end(), e.begin(), e.end());
        if (!stated) break;
        Eigen::Matrix<double, 8, 1> d;
        for (int k = 0; k < 4; ++k)
          d.segment<2>(2 * k) =
              o.corners_px[static_cast<std::size_t>(k)] - truth.corners_px[static_cast<std::size_t>(k)];
        normalised += d.dot(o.covariance_px2.ldlt().solve(d)) / 8;
        break;
      }
    }
  }
  const std::string covariance =
      stated ? fmt::format("{:.2f}", normalised / static_cast<double>(found)) : "–";
  // A constant offset is a matter of convention (where pixel (0, 0) is): told, and taken out for others.
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();
  for (const auto& e : errors) offset += e / static_cast<double>(errors.size());
  std::vector<double> distances;
  for (const auto& e : errors) distances.push_back((stated ? e : Eigen::Vector2d(e - offset)).norm());
  fmt::print("| {} | {}/{} | {:.4f} | {:.3f} | {:.3f} | ({:.3f}, {:.3f}) | {} | {:.2f} |\n", name, found,
             truths, rms(distances), at_quantile(distances, 0.95), at_quantile(distances, 1), offset.x(),
             offset.y(), covariance, at_quantile(times_ms, 0.5));
  std::fflush(stdout);
}

void corner_table(const Look& look, std::uint64_t seed, int count) {
  const auto pictures = tag_pictures(look, seed, count);
  fmt::print(
      "\n### Corners: {}\n\n| | found | RMS px | 95 % px | worst px | mean error px | NEES/8 | ms a frame |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- |\n",
      look.name);
  const CameraModel camera = table_camera();
  const auto ours = detector(true), library = detector(false);
  Random random(seed, 7);
  std::vector<Tags> before(pictures.size());
  std::vector<std::vector<TagCorners>> predicted(pictures.size());
  for (std::size_t p = 0; p < pictures.size(); ++p) {
    // A prediction is off by about half a pixel, and knows the tag of the last frame.
    for (const TrueTag& t : pictures[p].tags) {
      TagCorners c = t.corners_px;
      const Eigen::Vector2d shift(0.4 * random.normal(), 0.4 * random.normal());
      for (auto& corner : c) corner += shift + Eigen::Vector2d(0.1 * random.normal(), 0.1 * random.normal());
      predicted[p].push_back(c);
      TagObservation last;
      last.refined = true;
      const float blur = static_cast<float>(std::hypot(look.defocus_px, 0.29, 0.2 * look.motion_px));
      last.side_blur_px = {blur, blur, blur, blur};
      before[p].push_back(last);
    }
  }
  corner_row("Gnathion, tags followed", pictures, true, [&](const Picture& picture) {
    const auto p = static_cast<std::size_t>(&picture - pictures.data());
    Tags tags;
    for (std::size_t i = 0; i < picture.tags.size(); ++i) {
      const auto o = ours->follow(picture.image, camera, picture.tags[i].id, predicted[p][i], &before[p][i]);
      if (o) tags.push_back(*o);
    }
    return tags;
  });
  corner_row("Gnathion, whole frame", pictures, true,
             [&](const Picture& p) { return ours->detect(p.image, camera); });
  corner_row("libapriltag", pictures, false,
             [&](const Picture& p) { return library->detect(p.image, camera); });
  const std::pair<const char*, ArucoRefinement> kAruco[] = {
      {"OpenCV ArUco", ArucoRefinement::kNone},
      {"OpenCV ArUco, subpixel", ArucoRefinement::kSubpixel},
      {"OpenCV ArUco, contour", ArucoRefinement::kContour},
      {"OpenCV ArUco, AprilTag", ArucoRefinement::kAprilTag}};
  for (const auto& [name, refinement] : kAruco)
    corner_row(name, pictures, false, [&](const Picture& p) { return aruco_tags(p.image, refinement); });
}

/// Errors of the bow relative to the head frame over a film.
struct PoseErrors {
  std::vector<double> incisal_mm, turn_deg, times_ms, normalised;
  int frames = 0;

  void add(const Film& film, std::size_t i, const Rigid3& bow, const Rigid3& head) {
    const FilmTruth& t = film.truths[i];
    const Rigid3 truth = t.camera_from_head.rigid.inverse() * t.camera_from_bow.rigid;
    const Rigid3 found = head.inverse() * bow;
    incisal_mm.push_back((found * film.incisal_in_bow_mm - truth * film.incisal_in_bow_mm).norm());
    turn_deg.push_back((found.inverse() * truth).angle_rad() * 180 / M_PI);
  }
  void print(const char* name) const {
    double nees = 0;
    for (double n : normalised) nees += n / static_cast<double>(normalised.size());
    fmt::print("| {} | {}/{} | {:.4f} | {:.4f} | {:.4f} | {:.4f} | {} | {:.3f} | {:.3f} |\n", name,
               incisal_mm.size(), frames, rms(incisal_mm), at_quantile(incisal_mm, 0.5),
               at_quantile(incisal_mm, 0.95), rms(turn_deg),
               normalised.empty() ? "–" : fmt::format("{:.2f}", nees), at_quantile(times_ms, 0.5),
               at_quantile(times_ms, 0.99));
    std::fflush(stdout);
  }
};

double normalised_error(const Rigid3& truth, const BodyPose& pose) {
  const Vector6 xi = difference(truth, pose.camera_from_body);
  return xi.dot(pose.covariance.ldlt().solve(xi)) / 6;
}

PoseErrors tracked(const std::vector<Film>& films) {
  PoseErrors errors;
  for (const Film& film : films) {
    auto tracker = BodyTracker::create(film.scene.rig, {});
    GNATHION_CHECK(tracker.has_value());
    for (std::size_t i = 0; i < film.frames.size(); ++i) {
      const double start = cpu_s();
      const BodyPoses poses = (*tracker)->next(film.frames[i].header.capture, {&film.frames[i].image});
      if (!poses.searched) errors.times_ms.push_back(1e3 * (cpu_s() - start));
      ++errors.frames;
      if (!poses.bow.valid || !poses.head.valid) continue;
      errors.add(film, i, poses.bow.camera_from_body, poses.head.camera_from_body);
      errors.normalised.push_back(normalised_error(film.truths[i].camera_from_bow.rigid, poses.bow));
      errors.normalised.push_back(normalised_error(film.truths[i].camera_from_head.rigid, poses.head));
    }
  }
  return errors;
}

PoseErrors by_pnp(const std::vector<Film>& films, std::size_t stride, PnpMethod method,
                  const std::function<Tags(const Image8&)>& detect) {
  PoseErrors errors;
  for (const Film& film : films) {
    const Rig& rig = film.scene.rig;
    for (std::size_t i = 0; i < film.frames.size(); i += stride) {
      const double start = cpu_s();
      const Tags tags = detect(film.frames[i].image);
      const auto bow = pnp_pose(rig.cameras[0].model, rig.bow, tags, method);
      const auto head = pnp_pose(rig.cameras[0].model, rig.head_frame, tags, method);
      errors.times_ms.push_back(1e3 * (cpu_s() - start));
      ++errors.frames;
      if (bow && head) errors.add(film, i, *bow, *head);
    }
  }
  return errors;
}

void pose_table(const std::vector<Film>& films, std::size_t stride) {
  fmt::print(
      "\n### Poses: the patient's film, bow relative to head frame, 6 tags a body\n\n"
      "| | frames | incisal point, RMS mm | median mm | 95 % mm | RMS deg | NEES/6 | ms a frame | 99 % ms |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
  const PoseErrors ours = tracked(films);
  ours.print("Gnathion, tracked");
  const CameraModel camera = films[0].scene.rig.cameras[0].model;
  const auto library = detector(false), refined = detector(true);
  const auto by_library = [&](const Image8& image) { return library->detect(image, camera); };
  const auto by_refined = [&](const Image8& image) { return refined->detect(image, camera); };
  const PoseErrors whole = by_pnp(films, stride, PnpMethod::kIterative, by_library);
  by_pnp(films, stride, PnpMethod::kIterative, by_refined).print("our corners, solvePnP iterative");
  whole.print("libapriltag, solvePnP iterative");
  by_pnp(films, stride, PnpMethod::kIppeLargestTag, by_library)
      .print("libapriltag, solvePnP IPPE, largest tag");
  for (const auto& [name, refinement] :
       {std::pair("ArUco subpixel, solvePnP iterative", ArucoRefinement::kSubpixel),
        std::pair("ArUco AprilTag, solvePnP iterative", ArucoRefinement::kAprilTag)}) {
    by_pnp(films, stride, PnpMethod::kIterative, [r = refinement](const Image8& image) {
      return aruco_tags(image, r);
    }).print(name);
  }
  PoseErrors alone;
  for (const Film& film : films) {
    for (std::size_t i = 0; i < film.frames.size(); i += stride) {
      const double start = cpu_s();
      by_library(film.frames[i].image);
      alone.times_ms.push_back(1e3 * (cpu_s() - start));
    }
  }
  const double own_ms = at_quantile(ours.times_ms, 0.5), full_ms = at_quantile(alone.times_ms, 0.5);
  fmt::print(
      "\nTracked, tags and poses: {:.3f} ms a frame; libapriltag on the whole frame (decimation 1, one "
      "thread): {:.1f} ms, {:.0f} times as long.\n",
      own_ms, full_ms, full_ms / own_ms);
}

/// Frames come in at 60 Hz by the wall's clock; every two seconds the picture is covered for three frames.
void latency(const Film& film, bool interrupted) {
  BodyTrackerOptions options;
  options.search_tiles = 1;
  auto tracker = BodyTracker::create(film.scene.rig, options);
  GNATHION_CHECK(tracker.has_value());
  SystemClock clock;
  const Image8 covered(1280, 720, 90);
  std::vector<double> ms, cpu_ms;
  std::size_t valid = 0;
  const HostTime start = clock.now();
  constexpr std::size_t kFrames = 1200;  // the film forth and back, again and again: 20 s
  const std::size_t last = film.frames.size() - 1;
  for (std::size_t i = 0; i < kFrames; ++i) {
    const std::size_t phase = i % (2 * last), shown = phase <= last ? phase : 2 * last - phase;
    const HostTime due{start.ns + static_cast<std::int64_t>(i) * 16'666'667};
    if (const double wait_s = due.seconds_since(clock.now()); wait_s > 0)
      std::this_thread::sleep_for(std::chrono::duration<double>(wait_s));
    const HostTime in = clock.now();
    const double cpu_in = cpu_s();
    const bool hidden = interrupted && i % 120 >= 117;
    const BodyPoses poses = (*tracker)->next(due, {hidden ? &covered : &film.frames[shown].image});
    ms.push_back(1e3 * clock.now().seconds_since(in));
    cpu_ms.push_back(1e3 * (cpu_s() - cpu_in));
    valid += poses.bow.valid && poses.head.valid;
  }
  fmt::print("| {} | {} | {} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} |\n",
             interrupted ? "covered for 3 frames every 2 s" : "undisturbed", kFrames, valid,
             at_quantile(ms, 0.5), at_quantile(ms, 0.99), at_quantile(ms, 1), at_quantile(cpu_ms, 0.99),
             at_quantile(cpu_ms, 1));
}

int run(std::uint64_t seed, double scale) {
  const auto some = [&](int n) { return std::max(2, static_cast<int>(n * scale)); };
  fmt::print("Seed {}; 1280x720 px, f = 1100 px.\n", seed);
  const Look looks[] = {{"sharp", 0, 0.7, 2},
                        {"3 px motion blur", 3, 0.7, 2},
                        {"defocus 1.6 px", 0, 1.6, 2},
                        {"dark: noise 6 grey levels", 0, 0.7, 6}};
  for (const Look& look : looks) corner_table(look, seed, some(25));
  std::vector<Film> films;
  for (std::uint64_t s = 0; s < 3; ++s) films.push_back(patient_film(seed + s, some(300), 6));
  pose_table(films, 5);
  fmt::print(
      "\n### Latency: replayed at 60 Hz, frame in to pose out\n\n| | frames | valid | median ms | 99 % ms | "
      "worst ms | CPU 99 % ms | CPU worst ms |\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- |\n");
  latency(films[0], false);
  latency(films[0], true);
  return 0;
}

}  // namespace
}  // namespace gnathion::accuracy

int main(int argc, char** argv) {
  const std::uint64_t seed = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 20261122;
  return gnathion::accuracy::run(seed, argc > 2 ? std::atof(argv[2]) : 1.0);
}
