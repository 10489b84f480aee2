#include "design/profiles.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "design/parallel.h"

namespace gnathion {
namespace {

using Eigen::Vector2d;

constexpr double kTight = 0.8;        // of a limit: from here on the place is looked at
constexpr double kSamePlaceMm = 0.5;  // along the arch
constexpr double kLargeApertureMm2 = 0.3;
constexpr double kSearchMm = 60.0;

/// A place along the arch that deserves a section.
struct Place {
  std::string name, cause;
  double s_mm = 0.0;
};

/// Parts of the lines inside of the window.
std::vector<Polyline2> in_window(const std::vector<Polyline2>& lines) {
  std::vector<Polyline2> out;
  for (const Polyline2& line : lines) {
    bool open = false;
    for (const Vector2d& p : line) {
      const bool inside = std::abs(p.x()) <= kProfileHalfMm && std::abs(p.y()) <= kProfileHalfMm;
      if (inside && !open) out.emplace_back();
      if (inside) out.back().push_back(p);
      open = inside;
    }
  }
  out.erase(std::remove_if(out.begin(), out.end(), [](const Polyline2& l) { return l.size() < 2; }),
            out.end());
  return out;
}

struct Nearest {
  double distance_mm = kSearchMm;
  Vector2d on = Vector2d::Zero();
};

Nearest nearest_on(const std::vector<Polyline2>& lines, const Vector2d& p) {
  Nearest best;
  for (const Polyline2& line : lines)
    for (std::size_t i = 0; i + 1 < line.size(); ++i) {
      const Vector2d along = line[i + 1] - line[i];
      const double t = std::clamp((p - line[i]).dot(along) / std::max(1e-18, along.squaredNorm()), 0.0, 1.0);
      const Vector2d on = line[i] + t * along;
      const double d = (p - on).norm();
      if (d < best.distance_mm) best = {d, on};
    }
  return best;
}

/// Whether p lies inside of the closed lines (crossings of the ray to the right).
bool inside_of(const std::vector<Polyline2>& closed, const Vector2d& p) {
  bool inside = false;
  for (const Polyline2& line : closed)
    for (std::size_t i = 0; i + 1 < line.size(); ++i) {
      const Vector2d &a = line[i], &b = line[i + 1];
      if ((a.y() > p.y()) != (b.y() > p.y()) &&
          p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x()))
        inside = !inside;
    }
  return inside;
}

void measure_walls(SplintProfile& profile) {
  std::vector<double> walls, gaps;
  for (const Polyline2& line : profile.inner)
    for (const Vector2d& p : line) {
      if (!profile.outer.empty()) {
        const Nearest wall = nearest_on(profile.outer, p);
        if (walls.empty() || wall.distance_mm < *std::min_element(walls.begin(), walls.end()))
          profile.thinnest = {p, wall.on};
        walls.push_back(wall.distance_mm);
      }
      if (!profile.support.empty()) gaps.push_back(nearest_on(profile.support, p).distance_mm);
    }
  std::sort(walls.begin(), walls.end());
  std::sort(gaps.begin(), gaps.end());
  if (!walls.empty()) {
    profile.wall_min_mm = walls.front();
    profile.wall_median_mm = walls[walls.size() / 2];
  }
  if (!gaps.empty()) {
    profile.gap_min_mm = gaps.front();
    profile.gap_median_mm = gaps[gaps.size() / 2];
    profile.gap_max_mm = gaps.back();
  }
}

/// `whole` are the splint's closed curves, beyond the window too.
void measure_clearance(const std::vector<Polyline2>& whole, SplintProfile& profile) {
  if (profile.splint.empty()) return;
  for (const Polyline2& line : profile.opposing)
    for (const Vector2d& p : line) {
      const double apart = nearest_on(whole, p).distance_mm;
      const double clearance = inside_of(whole, p) ? -apart : apart;
      profile.clearance_mm = std::min(profile.clearance_mm.value_or(clearance), clearance);
    }
}

SplintProfile profile_at(const Place& place, const ArchRuler& ruler, const SplintInputs& inputs,
                         const SplintDesign& design) {
  SplintProfile out;
  out.name = place.name;
  out.cause = place.cause;
  out.s_mm = place.s_mm;
  out.plane = {ruler.at(place.s_mm), ruler.outward(place.s_mm), design.arch.up};
  const std::vector<Polyline2> whole = cut_mesh(design.splint, out.plane);
  out.splint = in_window(whole);
  out.support = in_window(cut_mesh(inputs.support(), out.plane));
  out.opposing = in_window(cut_mesh(design.opposing_tp, out.plane));
  out.inner = in_window(cut_mesh(design.cavity, out.plane));
  out.outer = in_window(cut_mesh(design.outer, out.plane));
  out.occlusal = in_window(cut_mesh(design.occlusal_surface_tp, out.plane));
  measure_walls(out);
  measure_clearance(whole, out);
  return out;
}

std::vector<Place> tooth_places(const ToothPartition& teeth) {
  std::vector<Place> out;
  for (std::size_t k = 0; k < teeth.fdi.size(); ++k)
    if (teeth.fdi[k] != 0)
      out.push_back({fmt::format("{}", teeth.fdi[k]), fmt::format("tooth {}", teeth.fdi[k]),
                     0.5 * (teeth.boundaries_mm[k] + teeth.boundaries_mm[k + 1])});
  return out;
}

/// Gates that know their place, where less than a fifth of the limit is left.
std::vector<Place> tight_places(const SplintDesign& design, const ArchRuler& ruler) {
  std::vector<Place> out;
  const SplintVerification& v = design.verification;
  const auto look = [&](const char* gate_name, const Vector3& where_mm) {
    for (const Gate& gate : design.gates) {
      if (gate.name != gate_name) continue;
      const bool upper_limit = gate.pass ? gate.value <= gate.limit : gate.value > gate.limit;
      const bool tight =
          !gate.pass || (upper_limit ? gate.value > kTight * gate.limit : kTight * gate.value < gate.limit);
      if (tight)
        out.push_back({gate.name, fmt::format("{} {:.3f}, limit {:.3f}", gate.name, gate.value, gate.limit),
                       ruler.measure(where_mm).s_mm});
    }
  };
  look("wall_min_mm", v.thickness.where_mm);
  look("insertability_mm", v.insertability.where_mm);
  look("imprint_depth_mm", v.imprint.deepest_where_mm);
  look("imprint_undercut_mm", v.imprint.undercut_where_mm);
  for (std::size_t i = 0; i < v.apertures.size(); ++i)
    if (v.apertures[i].area_mm2 >= kLargeApertureMm2)
      out.push_back({fmt::format("aperture_{}", i + 1),
                     fmt::format("aperture of {:.2f} mm2", v.apertures[i].area_mm2),
                     ruler.measure(v.apertures[i].centre_mm).s_mm});
  return out;
}

nlohmann::json number(const std::optional<double>& value) {
  return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
}
nlohmann::json point(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}

}  // namespace

std::vector<SplintProfile> splint_profiles(const SplintInputs& inputs, const SplintDesign& design) {
  const ArchRuler ruler(frame_of_jaw(inputs.support(), design.arch, inputs.arch));
  std::vector<Place> places = tooth_places(design.support_teeth);
  for (Place& place : tight_places(design, ruler)) {
    const auto same = std::find_if(places.begin(), places.end(), [&](const Place& p) {
      return std::abs(p.s_mm - place.s_mm) < kSamePlaceMm;
    });
    if (same == places.end())
      places.push_back(std::move(place));
    else
      same->cause += "; " + place.cause;
  }
  std::vector<SplintProfile> out(places.size());
  parallel_each(places.size(), [&](std::size_t i) { out[i] = profile_at(places[i], ruler, inputs, design); });
  const auto bare = [](const SplintProfile& p) { return p.splint.empty(); };  // not covered
  out.erase(std::remove_if(out.begin(), out.end(), bare), out.end());
  return out;
}

nlohmann::json profiles_json(const std::vector<SplintProfile>& profiles) {
  nlohmann::json out = nlohmann::json::array();
  for (const SplintProfile& p : profiles)
    out.push_back({{"name", p.name},
                   {"cause", p.cause},
                   {"s_mm", p.s_mm},
                   {"origin_mm", point(p.plane.origin_mm)},
                   {"buccal", point(p.plane.x_axis)},
                   {"up", point(p.plane.y_axis)},
                   {"wall_min_mm", number(p.wall_min_mm)},
                   {"wall_median_mm", number(p.wall_median_mm)},
                   {"gap_min_mm", number(p.gap_min_mm)},
                   {"gap_median_mm", number(p.gap_median_mm)},
                   {"gap_max_mm", number(p.gap_max_mm)},
                   {"clearance_mm", number(p.clearance_mm)}});
  return out;
}

}  // namespace gnathion
