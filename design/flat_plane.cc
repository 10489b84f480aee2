#include "design/flat_plane.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <Eigen/Dense>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "design/preparation.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kOverArchMm = 9.0;  // tips farther from the arch curve meet no splint
constexpr double kSlabMm = 1.2;      // thickness that the sweep towards the gingiva starts from
constexpr double kFreedomMm = 0.5;   // from a tip to the foot of its ramp: long centric
constexpr double kTopMm = 1.0;       // level end of a ramp
constexpr double kNarrowMm = 3.0;    // standard deviation of tips across their line: less leaves a tilt open
constexpr double kMostTiltDeg = 10.0;
constexpr double kCanineHalfMm = 3.0, kIncisorHalfMm = 2.8;

/// The tip of every opposing tooth that stands over the splint's arch.
std::vector<FlatPlane::Tip> tips_of(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi,
                                    const Rigid3& place, const Vector3& towards_support,
                                    const OcclusalMap& level) {
  std::map<std::uint8_t, FlatPlane::Tip> tips;
  for (std::size_t v = 0; v < fdi.size(); ++v) {
    if (fdi[v] == 0) continue;
    const Vector3 p = place * mesh.vertices_mm[v];
    const auto [tip, fresh] = tips.try_emplace(fdi[v], FlatPlane::Tip{fdi[v], p, 0.0});
    if (!fresh && towards_support.dot(p) > towards_support.dot(tip->second.p_mm)) tip->second.p_mm = p;
  }
  std::vector<FlatPlane::Tip> out;
  for (const auto& [number, tip] : tips)
    if (std::abs(level.off_curve_mm(tip.p_mm)) < kOverArchMm && level.behind_teeth_mm(tip.p_mm) < 0.0 &&
        level.beyond_cover_mm(tip.p_mm) < 0.0)
      out.push_back(tip);
  return out;
}

/// Unit normal of the plane through points with least squared distance, on the side of `about`. Refused where
/// the points leave the tilt open.
Result<Vector3> fitted_normal(const std::vector<FlatPlane::Tip>& bearing, const Vector3& about,
                              const char* arch_name) {
  const auto refuse = [&](const std::string& why) {
    return bad_input("cannot design", arch_name, why + ": no fitted plane, take --kind flat");
  };
  bool right = false, left = false;
  std::vector<Vector3> points;
  for (const FlatPlane::Tip& tip : bearing) {
    (fdi_side(tip.fdi) > 0.0 ? left : right) = true;
    points.push_back(tip.p_mm);
  }
  if (!right || !left) return refuse("canines to molars stand over the splint on one side only");
  Vector3 mean = Vector3::Zero();
  for (const Vector3& p : points) mean += p / static_cast<double>(points.size());
  Matrix3 spread = Matrix3::Zero();
  for (const Vector3& p : points) spread += (p - mean) * (p - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3> axes(spread);
  if (axes.eigenvalues()(1) < kNarrowMm * kNarrowMm * static_cast<double>(points.size()))
    return refuse("canines to molars over the splint stand nearly on a line");
  const Vector3 normal = axes.eigenvectors().col(0);
  return normal.dot(about) < 0.0 ? Vector3(-normal) : normal;
}

double angle_deg(const Vector3& a, const Vector3& b) {
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0)) * 180.0 / M_PI;
}

}  // namespace

Result<FlatPlane> FlatPlane::fitted(const SplintInputs& inputs, const std::vector<std::uint8_t>& opposing_fdi,
                                    const ArchFrame& arch, const Rigid3& design_from_dental,
                                    const Rigid3& tp_from_mi, const OcclusalMap& level,
                                    const SplintParameters& p) {
  FlatPlane out;
  out.normal_ = design_from_dental.rotation * arch.gingival(inputs.arch);
  out.tips_ =
      tips_of(inputs.opposing_mi(), opposing_fdi, tp_from_mi * design_from_dental, out.normal_, level);
  const char* const opposing_name = inputs.on_maxilla() ? "mandible" : "maxilla";
  std::vector<Tip> bearing;  // canines to molars
  for (const Tip& tip : out.tips_)
    if (fdi_position(tip.fdi) >= 3) bearing.push_back(tip);
  if (bearing.size() < 3)
    return bad_input("cannot design", opposing_name,
                     "fewer than three canines, premolars and molars stand over the splint: no flat plane");
  if (p.flat_plane > 1.5) {
    GNATHION_TRY(const Vector3 fitted, fitted_normal(bearing, out.normal_, opposing_name));
    // Between the occlusal planes of both arches any tilt is sound: T_th itself has turned one of them.
    const double tilt_deg =
        std::min(angle_deg(fitted, out.normal_), angle_deg(fitted, tp_from_mi.rotation * out.normal_));
    if (tilt_deg > kMostTiltDeg)
      return bad_input(
          "cannot design", opposing_name,
          fmt::format("its tips would tilt the plane {:.0f} degrees from the occlusal plane, more "
                      "than {:.0f}: take --kind flat",
                      tilt_deg, kMostTiltDeg));
    out.normal_ = fitted;
  }
  double highest = -1e300, lowest = 1e300;
  for (const Tip& tip : bearing) {
    highest = std::max(highest, out.normal_.dot(tip.p_mm));
    lowest = std::min(lowest, out.normal_.dot(tip.p_mm));
  }
  out.point_ = out.normal_ * std::max(lowest, highest - p.plane_indent_mm);
  for (Tip& tip : out.tips_) tip.into_mm = out.normal_.dot(tip.p_mm - out.point_);
  // Right to left along the arch.
  const std::vector<std::uint8_t> order = fdi_order(inputs.opposing_arch());
  const auto place = [&](const Tip& tip) { return std::find(order.begin(), order.end(), tip.fdi); };
  std::sort(out.tips_.begin(), out.tips_.end(),
            [&](const Tip& a, const Tip& b) { return place(a) < place(b); });

  // The opposing tooth leaves TP forwards and sidewards over a maxillary splint, the other way over a
  // mandibular one, which itself moves.
  const double sense = inputs.on_maxilla() ? 1.0 : -1.0;
  const auto in_plane = [&](const Vector3& dental) {
    const Vector3 d = design_from_dental.rotation * dental * sense;
    return Vector3((d - d.dot(out.normal_) * out.normal_).normalized());
  };
  for (const Tip& tip : out.tips_) {
    const int position = fdi_position(tip.fdi);
    const bool canine = position == 3;
    const double length = canine ? p.canine_ramp_mm : p.anterior_ramp_mm;
    if (position > 3 || length <= 0.0) continue;
    Ramp ramp;
    ramp.fdi = tip.fdi;
    ramp.along = in_plane(canine ? Vector3(fdi_side(tip.fdi) * arch.left) : arch.anterior);
    ramp.start_mm = tip.p_mm - tip.into_mm * out.normal_ + kFreedomMm * ramp.along;
    ramp.slope = std::tan((canine ? p.canine_ramp_deg : p.anterior_ramp_deg) * M_PI / 180.0);
    ramp.length_mm = length;
    ramp.half_width_mm = canine ? kCanineHalfMm : kIncisorHalfMm;
    out.ramps_.push_back(ramp);
  }
  return out;
}

double FlatPlane::ramp_mm(const Ramp& ramp, const Vector3& p) const {
  const Vector3 from = p - ramp.start_mm;
  const double along = from.dot(ramp.along), aside = std::abs(from.dot(normal_.cross(ramp.along)));
  const double high = height_mm(p), cosine = 1.0 / std::hypot(1.0, ramp.slope);
  return std::max({(high - ramp.slope * along) * cosine, high - ramp.slope * ramp.length_mm,
                   along - (ramp.length_mm + kTopMm), aside - ramp.half_width_mm, -kSlabMm - high});
}

double FlatPlane::slab_mm(const Vector3& p) const {
  const double high = height_mm(p);
  double beside = 1e300;  // from the line through the tips, squared, seen along z
  for (std::size_t i = 0; i + 1 < tips_.size(); ++i) {
    const Eigen::Vector2d a = tips_[i].p_mm.head<2>(), step = tips_[i + 1].p_mm.head<2>() - a;
    const double t = std::clamp((p.head<2>() - a).dot(step) / std::max(1e-12, step.squaredNorm()), 0.0, 1.0);
    beside = std::min(beside, (p.head<2>() - a - t * step).squaredNorm());
  }
  double slab = std::max({high, -kSlabMm - high, std::sqrt(beside) - half_mm_});
  for (const Ramp& ramp : ramps_) slab = std::min(slab, ramp_mm(ramp, p));
  return slab;
}

double FlatPlane::beyond_mm(const Vector3& p) const {
  double beyond = height_mm(p);
  for (const Ramp& ramp : ramps_) beyond = std::min(beyond, ramp_mm(ramp, p));
  return beyond;
}

nlohmann::json flat_plane_json(const FlatPlane& plane, const Rigid3& dental) {
  const auto point = [](const Vector3& p) { return nlohmann::json{p.x(), p.y(), p.z()}; };
  nlohmann::json tips = nlohmann::json::array(), ramps = tips;
  for (const FlatPlane::Tip& t : plane.tips())
    tips.push_back({{"fdi", t.fdi}, {"tip_mm", point(dental * t.p_mm)}, {"into_mm", t.into_mm}});
  for (const FlatPlane::Ramp& r : plane.ramps())
    ramps.push_back({{"fdi", r.fdi},
                     {"start_mm", point(dental * r.start_mm)},
                     {"along", point(dental.rotation * r.along)},
                     {"angle_deg", std::atan(r.slope) * 180.0 / M_PI},
                     {"length_mm", r.length_mm}});
  return {{"point_mm", point(dental * plane.point_mm())},
          {"normal", point(dental.rotation * plane.normal())},
          {"tips", tips},
          {"ramps", ramps}};
}

}  // namespace gnathion
