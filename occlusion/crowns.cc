#include "occlusion/crowns.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace gnathion {
namespace {

double depth_of(double height_mm, Arch which) {
  return which == Arch::kMaxilla ? height_mm : -height_mm;
}

constexpr double kArchBandMm = 6.0;  // crowns lie within this of the arch curve

std::vector<ArchCoordinates> measured(const TriangleMesh& mesh, const ArchFrame& frame) {
  const ArchRuler ruler(frame);
  std::vector<ArchCoordinates> out(mesh.vertices_mm.size());
  tbb::parallel_for(std::size_t{0}, out.size(),
                    [&](std::size_t i) { out[i] = ruler.measure(mesh.vertices_mm[i]); });
  return out;
}

}  // namespace

std::vector<double> crown_depths_mm(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which) {
  std::vector<double> out;
  out.reserve(arch_mesh.vertices_mm.size());
  for (const auto& p : arch_mesh.vertices_mm) out.push_back(depth_of(frame.height_mm(p), which));
  return out;
}

OcclusalLevel::OcclusalLevel(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which) {
  const auto at = measured(arch_mesh, frame);
  const ArchRuler ruler(frame);
  s0_mm_ = ruler.s_min_mm();
  const auto bins = static_cast<std::size_t>(std::ceil((ruler.s_max_mm() - s0_mm_) / step_mm_)) + 1;
  std::vector<std::vector<double>> depths(bins);
  for (const auto& c : at) {
    if (std::abs(c.buccal_mm) > kArchBandMm) continue;
    const double bin = std::round((c.s_mm - s0_mm_) / step_mm_);
    if (bin < 0.0 || bin >= static_cast<double>(bins)) continue;
    depths[static_cast<std::size_t>(bin)].push_back(depth_of(c.height_mm, which));
  }
  std::vector<double> level(bins, 0.0);
  for (std::size_t b = 0; b < bins; ++b) {
    if (depths[b].empty()) continue;
    const auto k = static_cast<std::ptrdiff_t>(0.02 * static_cast<double>(depths[b].size() - 1));
    std::nth_element(depths[b].begin(), depths[b].begin() + k, depths[b].end());
    level[b] = depths[b][static_cast<std::size_t>(k)];
  }
  // The minimum within a tooth's width stands for its cusps; then a mean of the same width.
  const std::ptrdiff_t reach = 2, n = static_cast<std::ptrdiff_t>(bins);
  auto filtered = [&](const std::vector<double>& in, auto&& fold) {
    std::vector<double> out(in.size());
    for (std::ptrdiff_t b = 0; b < n; ++b) {
      const auto from = std::max<std::ptrdiff_t>(0, b - reach), to = std::min(n - 1, b + reach);
      out[static_cast<std::size_t>(b)] = fold(in.begin() + from, in.begin() + to + 1);
    }
    return out;
  };
  level = filtered(level, [](auto a, auto b) { return *std::min_element(a, b); });
  depth_mm_ = filtered(level, [](auto a, auto b) {
    double sum = 0.0;
    for (auto it = a; it != b; ++it) sum += *it;
    return sum / static_cast<double>(b - a);
  });
}

double OcclusalLevel::depth_mm(double s_mm) const {
  const double at = std::clamp((s_mm - s0_mm_) / step_mm_, 0.0, static_cast<double>(depth_mm_.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(at), depth_mm_.size() - 2);
  const double f = at - static_cast<double>(i);
  return (1.0 - f) * depth_mm_[i] + f * depth_mm_[i + 1];
}

std::vector<bool> crown_region(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                               double depth_mm, double half_width_mm) {
  const OcclusalLevel level(arch_mesh, frame, which);
  const auto at = measured(arch_mesh, frame);
  const ArchRuler ruler(frame);
  std::vector<bool> out(at.size(), false);
  for (std::size_t i = 0; i < at.size(); ++i) {
    const ArchCoordinates& c = at[i];
    out[i] = std::abs(c.buccal_mm) <= half_width_mm && c.s_mm >= ruler.s_min_mm() - half_width_mm &&
             c.s_mm <= ruler.s_max_mm() + half_width_mm &&
             depth_of(c.height_mm, which) <= level.depth_mm(c.s_mm) + depth_mm;
  }
  return out;
}

TriangleMesh region_mesh(const TriangleMesh& mesh, const std::vector<bool>& vertex_selected) {
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    keep[t] = vertex_selected[v[0]] && vertex_selected[v[1]] && vertex_selected[v[2]];
  }
  return submesh(mesh, keep);
}

std::vector<bool> occlusal_facing(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                                  double max_angle_deg) {
  const double limit = std::cos(max_angle_deg * std::numbers::pi / 180.0);
  const Vector3 towards_opposing = -frame.gingival(which);
  const auto normals = vertex_normals(arch_mesh);
  std::vector<bool> out(normals.size());
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = normals[i].dot(towards_opposing) >= limit;
  return out;
}

}  // namespace gnathion
