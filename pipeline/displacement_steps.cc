#include "pipeline/displacement_steps.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "anatomy/realizability.h"
#include "core/mesh_io.h"
#include "rendering/scene.h"

namespace gnathion {
namespace {

using nlohmann::json;

json vector_json(const Vector3& v) {
  return {v.x(), v.y(), v.z()};
}

/// Dark blue, teal, green, yellow for 0 … 1: lightness grows evenly, which every eye can read.
std::array<std::uint8_t, 3> heat(double t) {
  constexpr double kStops[][3] = {{68, 1, 84}, {59, 82, 139}, {33, 145, 140}, {94, 201, 98}, {253, 231, 37}};
  const double u = std::clamp(t, 0.0, 1.0) * 4.0;
  const int low = std::min(3, static_cast<int>(u));
  std::array<std::uint8_t, 3> out{};
  for (int k = 0; k < 3; ++k)
    out[static_cast<std::size_t>(k)] = static_cast<std::uint8_t>(
        std::lround(kStops[low][k] + (u - low) * (kStops[low + 1][k] - kStops[low][k])));
  return out;
}

Uncertain<Motion<Dental>> with_covariance(const Motion<Dental>& motion,
                                          const std::optional<Matrix6>& covariance) {
  return {motion, covariance.value_or(Matrix6::Zero())};
}

}  // namespace

Result<MandibleLandmarks> mandible_landmarks(const TriangleMesh& maxilla, const TriangleMesh& mandible) {
  MandibleLandmarks l;
  GNATHION_TRY(l.arch, find_arch(maxilla, mandible));
  const ArchFrame& a = l.arch;
  l.names = {"incisal point", "left end of the arch", "right end of the arch", "left condyle (estimated)",
             "right condyle (estimated)"};
  l.points_mm = {a.incisal_mm, a.curve_mm.back(), a.curve_mm.front(),
                 mean_condyle_mm(a, Side::kLeft), mean_condyle_mm(a, Side::kRight)};
  l.arch_centroid_mm = surface_centroid_mm(mandible);
  return l;
}

json displacement_json(const Motion<Dental>& motion, const std::optional<Matrix6>& covariance,
                       const MandibleLandmarks& landmarks) {
  const Uncertain<Motion<Dental>> therapeutic = with_covariance(motion, covariance);
  const auto known = [&](double value) { return covariance ? json(value) : json(); };
  json points = json::array();
  for (std::size_t i = 0; i < landmarks.points_mm.size(); ++i) {
    const Vector3& p = landmarks.points_mm[i];
    const Vector3 moved = motion * p;
    points.push_back({{"name", landmarks.names[i]},
                      {"at_mm", vector_json(p)},
                      {"displacement_mm", vector_json(moved - p)},
                      {"length_mm", (moved - p).norm()},
                      {"bound95_mm", known(radius95_mm(point_covariance(therapeutic.covariance, moved)))}});
  }
  const ScrewAxis s = screw_axis(therapeutic, landmarks.arch_centroid_mm);
  const Vector3 centroid = motion * landmarks.arch_centroid_mm;
  return {{"landmarks", points},
          {"alpha_deg", s.angle_deg},
          {"t_mm", (centroid - landmarks.arch_centroid_mm).norm()},
          {"screw",
           {{"direction", vector_json(s.direction)},
            {"point_mm", vector_json(s.point_mm)},
            {"angle_deg", s.angle_deg},
            {"shift_mm", s.shift_mm},
            {"angle_sigma_deg", known(s.angle_sigma_deg)},
            {"shift_sigma_mm", known(s.shift_sigma_mm)},
            {"direction_sigma_deg", known(s.direction_sigma_deg)},
            {"point_sigma_mm", known(s.point_sigma_mm)},
            {"determined", covariance ? json(s.determined) : json()}}}};
}

std::string screw_text(const ScrewAxis& s, bool with_sigmas) {
  if (!s.determined && with_sigmas)
    return fmt::format("turns by {:.3f} deg (1 sigma {:.3f}): too little to have an axis", s.angle_deg,
                       s.angle_sigma_deg);
  std::string text = fmt::format(
      "turns by {:.3f} deg about ({:.3f} {:.3f} {:.3f}) through ({:.2f} {:.2f} {:.2f}) mm, shifts by {:.3f} "
      "mm "
      "along it",
      s.angle_deg, s.direction.x(), s.direction.y(), s.direction.z(), s.point_mm.x(), s.point_mm.y(),
      s.point_mm.z(), s.shift_mm);
  if (with_sigmas)
    text +=
        fmt::format("; 1 sigma: {:.3f} deg, {:.3f} mm, the axis' direction {:.2f} deg, its place {:.2f} mm",
                    s.angle_sigma_deg, s.shift_sigma_mm, s.direction_sigma_deg, s.point_sigma_mm);
  return text;
}

std::string displacement_text(const Motion<Dental>& motion, const std::optional<Matrix6>& covariance,
                              const MandibleLandmarks& landmarks) {
  const Uncertain<Motion<Dental>> therapeutic = with_covariance(motion, covariance);
  std::string text;
  for (std::size_t i = 0; i < landmarks.points_mm.size(); ++i) {
    const Vector3& p = landmarks.points_mm[i];
    text += fmt::format("{:<26} moves {:.3f} mm, 95 % bound ", landmarks.names[i], (motion * p - p).norm());
    text += covariance ? fmt::format("{:.3f} mm\n", radius95_mm(point_covariance(*covariance, motion * p)))
                       : std::string("unknown\n");
  }
  return text + screw_text(screw_axis(therapeutic, landmarks.arch_centroid_mm), covariance.has_value()) +
         "\n";
}

Status write_error_map(const Uncertain<Motion<Dental>>& therapeutic, const TriangleMesh& mandible,
                       const ArchFrame& arch, const std::filesystem::path& folder) {
  const std::vector<double> bounds = error_map95_mm(therapeutic, mandible.vertices_mm);
  const auto [least, most] = std::minmax_element(bounds.begin(), bounds.end());
  const double span = std::max(1e-9, *most - *least);
  TriangleMesh map = mandible;
  map.colors_rgb.clear();
  for (const double b : bounds) map.colors_rgb.push_back(heat((b - *least) / span));
  GNATHION_CHECK_OK(write_mesh(folder / "error_map.ply", map));
  std::error_code ec;
  std::filesystem::create_directories(folder / "pictures", ec);
  SceneMesh shown;
  shown.mesh = &map;
  shown.use_vertex_colors = true;
  shown.flat_light = true;
  PictureOptions o;
  o.title = fmt::format("95 % bound of the mandible's place in TP: {:.3f} mm (dark blue) to {:.3f} mm (yellow)",
                        *least, *most);
  return render_scene(folder / "pictures" / "error_map.png", {shown}, {}, {arch.up, arch.anterior, 1.0}, o);
}

std::vector<std::string> oddities_of(const Motion<Dental>& motion, const MandibleLandmarks& landmarks) {
  constexpr double kLargest_mm = 60.0;  // beyond any mouth's opening
  std::vector<std::string> out;
  const ArchFrame& a = landmarks.arch;
  const Vector3 incisal = motion * a.incisal_mm - a.incisal_mm;
  if (incisal.dot(a.up) > 0.1)
    out.push_back(
        fmt::format("the incisal point moves {:.2f} mm up, into the maxilla: is the direction reversed?",
                    incisal.dot(a.up)));
  for (std::size_t i = 0; i < landmarks.points_mm.size(); ++i) {
    const double d = (motion * landmarks.points_mm[i] - landmarks.points_mm[i]).norm();
    if (d > kLargest_mm)
      out.push_back(fmt::format("{} moves {:.0f} mm: is the frame that of these arches, the unit mm?",
                                landmarks.names[i], d));
  }
  return out;
}

}  // namespace gnathion
