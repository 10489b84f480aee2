// The electromagnetic route's files: electromagnetic.toml, sensor.json, and calibration from recordings.
#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "acquisition/recording.h"
#include "core/file.h"
#include "core/transform_io.h"
#include "pipeline/motion_steps.h"
#include "pipeline/toml_file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;
constexpr const char* kWhat = "cannot read electromagnetic setup";

Status known_keys(const toml::table& t, const std::set<std::string>& keys, const std::string& where) {
  for (const auto& [key, value] : t)
    if (!keys.count(std::string(key.str())))
      return bad_input(kWhat, where, "unknown key '" + std::string(key.str()) + "'");
  return {};
}

Status take_number(const toml::table& t, const char* key, double* value, const std::string& where) {
  if (!t[key]) return {};
  const auto v = t[key].value<double>();
  if (!v || !std::isfinite(*v) || *v < 0)
    return bad_input(kWhat, where, fmt::format("'{}' is not a number from 0 on", key));
  *value = *v;
  return {};
}

/// bow_from_sensor of a sensor.json, or 16 numbers in the table itself.
Result<Uncertain<Rigid3>> mount_pose(const toml::table& t, const fs::path& folder, const std::string& where,
                                     bool required) {
  Uncertain<Rigid3> pose;
  if (const auto file = t["mount"].value<std::string>()) {
    GNATHION_TRY(const json j, read_json(folder / *file));
    if (j.value("kind", std::string()) != "sensor" || !j.contains("bow_from_sensor"))
      return bad_input(kWhat, (folder / *file).string(),
                       "is not a sensor.json of 'gnathion calibrate sensor'");
    GNATHION_TRY(const Matrix4 m, matrix_from_json(j["bow_from_sensor"]["matrix"], *file));
    GNATHION_TRY(pose.covariance, covariance_from_json(j["bow_from_sensor"]["covariance"], *file));
    if (!rigidity_deviation(m).is_rigid()) return bad_input(kWhat, *file, "'bow_from_sensor' is not rigid");
    pose.value = nearest_rigid(m);
    return pose;
  }
  const auto* array = t["body_from_sensor"].as_array();
  if (array == nullptr) {
    if (required)
      return bad_input(kWhat, where,
                       "[bow] needs 'mount' (a sensor.json) or 'body_from_sensor' (16 numbers)");
    return pose;
  }
  Matrix4 m = Matrix4::Zero();
  for (std::size_t i = 0; i < std::min<std::size_t>(16, array->size()); ++i)
    m(static_cast<int>(i / 4), static_cast<int>(i % 4)) = (*array)[i].value<double>().value_or(NAN);
  if (array->size() != 16 || !rigidity_deviation(m).is_rigid())
    return bad_input(kWhat, where, "'body_from_sensor' is not the 16 numbers of a rigid pose");
  pose.value = nearest_rigid(m);
  return pose;
}

Result<SensorMount> mount(const toml::table& t, const char* body, const fs::path& folder,
                          const std::string& where, bool required) {
  const auto* table = t[body].as_table();
  if (table == nullptr) return bad_input(kWhat, where, fmt::format("[{}] is missing", body));
  GNATHION_CHECK_OK(known_keys(*table, {"stream", "mount", "body_from_sensor"}, where));
  SensorMount m;
  m.stream = (*table)["stream"].value_or<std::string>("");
  if (m.stream.empty()) return bad_input(kWhat, where, fmt::format("[{}] has no 'stream'", body));
  GNATHION_TRY(m.body_from_sensor, mount_pose(*table, folder, where, required));
  return m;
}

/// Pairs of camera and sensor poses at the camera's times, the sensor's interpolated between its readings.
std::vector<SensorPair> pairs_of(const SessionMotion& session, const std::vector<PoseSample>& readings) {
  std::vector<SensorPair> pairs;
  std::size_t k = 0;
  for (const MotionRow& row : session.rows) {
    if (!row.bow.valid) continue;
    while (k + 1 < readings.size() && readings[k + 1].header.capture <= row.capture) ++k;
    if (k + 1 >= readings.size() || readings[k].header.capture > row.capture) continue;
    const double span = readings[k + 1].header.capture.seconds_since(readings[k].header.capture);
    if (span <= 0 || span > 0.05) continue;
    const double f = row.capture.seconds_since(readings[k].header.capture) / span;
    const Rigid3 &a = readings[k].reference_from_body, &b = readings[k + 1].reference_from_body;
    pairs.push_back({row.bow.camera_from_body, exp_se3(f * difference(b, a)) * a, row.bow.covariance});
  }
  return pairs;
}

Result<SensorCalibration> from_recordings(const SensorCalibrationJob& job) {
  GNATHION_TRY(const PoseRecording poses, read_poses(job.motion));
  GNATHION_TRY(const SessionMotion session, to_session_motion(poses, job.motion.string()));
  GNATHION_TRY(auto source, RecordingSource::open(job.recording));
  std::vector<PoseSample> readings;
  while (true) {
    GNATHION_TRY(auto sample, source->next());
    if (!sample) break;
    if (auto* pose = std::get_if<PoseSample>(&*sample);
        pose != nullptr && pose->header.stream == job.stream && pose->valid)
      readings.push_back(std::move(*pose));
  }
  if (readings.empty())
    return bad_input("cannot calibrate the sensor", job.recording.string(), "no valid pose on " + job.stream);
  std::stable_sort(readings.begin(), readings.end(), [](const PoseSample& a, const PoseSample& b) {
    return a.header.capture < b.header.capture;
  });
  std::vector<SensorPair> pairs = pairs_of(session, readings);
  // A few hundred, spread over the recording, say as much as thousands: errors of neighbours are alike.
  constexpr std::size_t kMost = 600;
  if (pairs.size() > kMost) {
    std::vector<SensorPair> fewer;
    for (std::size_t i = 0; i < kMost; ++i) fewer.push_back(pairs[i * pairs.size() / kMost]);
    pairs = std::move(fewer);
  }
  return calibrate_sensor(pairs, job.sigma_mm, job.sigma_deg);
}

Result<SensorCalibration> from_points(const fs::path& path) {
  GNATHION_TRY(const std::string text, read_file(path));
  std::vector<Vector3> in_bow, in_sensor;
  std::istringstream lines(text);
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (line.empty() || line[0] == '#' || line[0] == '\r') continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream fields(line);
    double v[6];
    int n = 0;
    while (n < 6 && fields >> v[n]) ++n;
    if (n != 6)
      return bad_input(
          "cannot calibrate the sensor", path.string(),
          fmt::format("line {} is not six numbers: x,y,z of the bow's file, x,y,z by the sensor", number));
    in_bow.emplace_back(v[0], v[1], v[2]);
    in_sensor.emplace_back(v[3], v[4], v[5]);
  }
  return calibrate_sensor_by_points(in_bow, in_sensor);
}

}  // namespace

Result<ElectromagneticSetup> read_electromagnetic(const fs::path& path) {
  const std::string where = path.string();
  GNATHION_TRY(const toml::table t, read_toml(path, kWhat));
  GNATHION_CHECK_OK(known_keys(t,
                               {"bow", "head", "rigid_pair", "sigma_mm", "sigma_deg", "same_instant_s",
                                "distortion_sigmas", "distortion_mm", "distortion_deg"},
                               where));
  ElectromagneticSetup setup;
  GNATHION_TRY(setup.bow, mount(t, "bow", path.parent_path(), where, true));
  GNATHION_TRY(setup.head, mount(t, "head", path.parent_path(), where, false));
  for (const auto& [key, value] :
       {std::pair("sigma_mm", &setup.sigma_mm), std::pair("sigma_deg", &setup.sigma_deg),
        std::pair("same_instant_s", &setup.same_instant_s),
        std::pair("distortion_sigmas", &setup.distortion_sigmas),
        std::pair("distortion_mm", &setup.distortion_mm), std::pair("distortion_deg", &setup.distortion_deg)})
    GNATHION_CHECK_OK(take_number(t, key, value, where));
  if (const auto* pairs = t["rigid_pair"].as_array())
    for (const auto& entry : *pairs) {
      const auto* table = entry.as_table();
      const auto first = table ? (*table)["first"].value<std::string>() : std::nullopt;
      const auto second = table ? (*table)["second"].value<std::string>() : std::nullopt;
      if (!first || !second || *first == *second)
        return bad_input(kWhat, where, "a [[rigid_pair]] needs 'first' and 'second', two streams");
      setup.pairs.push_back({*first, *second});
    }
  return setup;
}

Result<ElectromagneticMotion> track_electromagnetic(const fs::path& recording,
                                                    const ElectromagneticSetup& setup) {
  GNATHION_TRY(auto source, RecordingSource::open(recording));
  return electromagnetic_motion(*source, setup);
}

void add_mount_covariance(const Matrix6& covariance, SessionMotion* session) {
  if (covariance.isZero(0)) return;
  EventSample event;
  event.header.stream = "pedal";
  event.header.capture = event.header.arrival = session->start;
  event.kind = "mount";
  event.text = covariance_json(covariance).dump();
  session->events.insert(session->events.begin(), event);
}

Matrix6 mount_covariance(const SessionMotion& session) {
  for (const EventSample& e : session.events) {
    if (e.kind != "mount") continue;
    const json j = json::parse(e.text, nullptr, false);
    if (const auto covariance = covariance_from_json(j, "mount")) return *covariance;
  }
  return Matrix6::Zero();
}

Result<SensorCalibration> run_sensor_calibration(const SensorCalibrationJob& job) {
  return job.points.empty() ? from_recordings(job) : from_points(job.points);
}

json sensor_json(const SensorCalibration& c) {
  return {{"kind", "sensor"},
          {"unit", "mm"},
          {"bow_from_sensor",
           {{"matrix", matrix_json(c.bow_from_sensor.value.matrix())},
            {"covariance", covariance_json(c.bow_from_sensor.covariance)}}},
          {"rms_mm", c.rms_mm},
          {"rms_deg", c.rms_deg},
          {"held_out_mm", c.held_out_mm},
          {"used", c.used},
          {"weak", c.weak}};
}

}  // namespace gnathion
