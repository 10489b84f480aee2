// Spreads the teeth of a partition over the mesh: from the middle of each crown outwards, slowly over
// concave ground (interdental clefts, the gingival margin), against the gingiva spreading from below.
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kCore = 0.22;         // a tooth's seeds keep this fraction of its width from its boundaries
constexpr double kSeedDepth = 0.45;    // of the crown height
constexpr double kSeedBandMm = 5.0;    // from the arch curve
constexpr double kGingivaDepth = 1.6;  // crown heights behind the tooth's top: never crown
constexpr double kGingivaBandMm = 11.0;
constexpr double kConcaveWeightMm2 = 30.0;  // cost of concave curvature κ: 1 + weight·κ²
constexpr std::int16_t kUnreached = -2, kGingiva = -1;

struct Neighbours {
  std::vector<std::uint32_t> start, to;
};

Neighbours vertex_neighbours(const TriangleMesh& mesh) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;
  edges.reserve(6 * mesh.triangles.size());
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      edges.emplace_back(t[k], t[(k + 1) % 3]);
      edges.emplace_back(t[(k + 1) % 3], t[k]);
    }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  Neighbours out;
  out.start.assign(mesh.vertices_mm.size() + 1, 0);
  for (const auto& [a, b] : edges) {
    ++out.start[a + 1];
    out.to.push_back(b);
  }
  for (std::size_t i = 1; i < out.start.size(); ++i) out.start[i] += out.start[i - 1];
  return out;
}

/// Where each vertex lies against its tooth (by arc length) and what it can be a seed of.
struct Placement {
  std::int16_t tooth = kGingiva;   ///< index in the partition, by arc length alone
  std::int16_t seed = kUnreached;  ///< tooth index or kGingiva: certain; kUnreached: contested
  double depth_in_crowns = 0.0;    ///< behind the tooth's top, in crown heights
};

std::int16_t tooth_at(const ToothPartition& partition, double s_mm) {
  const auto& b = partition.boundaries_mm;
  if (s_mm < b.front() || s_mm >= b.back()) return kGingiva;
  return static_cast<std::int16_t>(std::upper_bound(b.begin(), b.end(), s_mm) - b.begin() - 1);
}

std::vector<Placement> place_vertices(const TriangleMesh& mesh, const ArchFrame& own, Arch which,
                                      const ToothPartition& partition) {
  const ArchRuler ruler(own);
  std::vector<ArchCoordinates> at(mesh.vertices_mm.size());
  tbb::parallel_for(std::size_t{0}, at.size(),
                    [&](std::size_t i) { at[i] = ruler.measure(mesh.vertices_mm[i]); });
  auto depth = [&](std::size_t i) { return which == Arch::kMaxilla ? at[i].height_mm : -at[i].height_mm; };

  const std::size_t teeth = partition.fdi.size();
  std::vector<double> top(teeth, std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < at.size(); ++i) {
    const auto tooth = tooth_at(partition, at[i].s_mm);
    if (tooth >= 0 && std::abs(at[i].buccal_mm) < kSeedBandMm)
      top[static_cast<std::size_t>(tooth)] = std::min(top[static_cast<std::size_t>(tooth)], depth(i));
  }

  std::vector<Placement> out(at.size());
  for (std::size_t i = 0; i < at.size(); ++i) {
    Placement& p = out[i];
    p.tooth = tooth_at(partition, at[i].s_mm);
    if (p.tooth < 0 || std::abs(at[i].buccal_mm) > kGingivaBandMm) {
      // Just past the last molar the surface may still be its distal wall.
      const double past =
          std::max(partition.boundaries_mm.front() - at[i].s_mm, at[i].s_mm - partition.boundaries_mm.back());
      if (past > 2.0 || p.tooth >= 0) p.seed = kGingiva;
      continue;
    }
    const auto k = static_cast<std::size_t>(p.tooth);
    const double from = partition.boundaries_mm[k], width = partition.boundaries_mm[k + 1] - from;
    if (partition.fdi[k] == 0) {  // a gap: no crown but what its neighbours spread over
      const double inside = std::min(at[i].s_mm - from, partition.boundaries_mm[k + 1] - at[i].s_mm);
      if (inside > kCore * width) p.seed = kGingiva;
      p.depth_in_crowns = kGingivaDepth;
      continue;
    }
    const double across = (at[i].s_mm - from) / width;
    p.depth_in_crowns = (depth(i) - top[k]) / mean_crown_height_mm(partition.fdi[k]);
    if (p.depth_in_crowns > kGingivaDepth)
      p.seed = kGingiva;
    else if (across > kCore && across < 1.0 - kCore && p.depth_in_crowns < kSeedDepth &&
             std::abs(at[i].buccal_mm) < kSeedBandMm)
      p.seed = p.tooth;
  }
  return out;
}

/// Multi-source shortest paths; each vertex takes the label of the seed that reaches it first.
std::vector<std::int16_t> spread(const TriangleMesh& mesh, const std::vector<Placement>& placement) {
  const Neighbours neighbours = vertex_neighbours(mesh);
  const auto normals = vertex_normals(mesh);
  std::vector<std::int16_t> label(placement.size(), kUnreached);
  std::vector<double> reached(placement.size(), std::numeric_limits<double>::infinity());
  using Entry = std::pair<double, std::uint32_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> front;
  for (std::size_t i = 0; i < placement.size(); ++i) {
    if (placement[i].seed == kUnreached) continue;
    label[i] = placement[i].seed;
    reached[i] = 0.0;
    front.emplace(0.0, static_cast<std::uint32_t>(i));
  }
  while (!front.empty()) {
    const auto [cost, a] = front.top();
    front.pop();
    if (cost > reached[a]) continue;
    for (auto k = neighbours.start[a]; k < neighbours.start[a + 1]; ++k) {
      const std::uint32_t b = neighbours.to[k];
      const Vector3 step = mesh.vertices_mm[b] - mesh.vertices_mm[a];
      const double length = std::max(step.norm(), 1e-6);
      // Curvature along the edge: positive where the surface bends towards its normal (a valley).
      const double concave = std::max(0.0, -(normals[b] - normals[a]).dot(step) / (length * length));
      const double next = cost + length * (1.0 + kConcaveWeightMm2 * concave * concave);
      if (next >= reached[b]) continue;
      reached[b] = next;
      label[b] = label[a];
      front.emplace(next, b);
    }
  }
  return label;
}

}  // namespace

ArchTeeth find_teeth(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                     const ToothCorrections& corrections) {
  ArchTeeth teeth{partition_teeth(arch_mesh, frame, which, corrections),
                  std::vector<std::uint8_t>(arch_mesh.vertices_mm.size(), 0)};
  const ToothPartition& partition = teeth.partition;
  if (partition.fdi.empty()) return teeth;
  const auto placement = place_vertices(arch_mesh, frame_of_jaw(arch_mesh, frame, which), which, partition);
  const auto label = spread(arch_mesh, placement);
  for (std::size_t i = 0; i < label.size(); ++i) {
    const std::int16_t tooth = label[i] != kUnreached
                                   ? label[i]
                                   : (placement[i].depth_in_crowns < 1.0 ? placement[i].tooth : kGingiva);
    if (tooth >= 0) teeth.fdi[i] = partition.fdi[static_cast<std::size_t>(tooth)];
  }
  return teeth;
}

std::vector<std::uint8_t> assign_teeth(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                                       const ToothCorrections& corrections) {
  return find_teeth(arch_mesh, frame, which, corrections).fdi;
}

Result<NamedJaws> name_jaws(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                            const ToothCorrections& corrections) {
  NamedJaws jaws;
  GNATHION_TRY(jaws.arch, find_arch(maxilla, mandible_mi));
  tbb::parallel_invoke(
      [&] { jaws.maxilla = find_teeth(maxilla, jaws.arch, Arch::kMaxilla, corrections); },
      [&] { jaws.mandible = find_teeth(mandible_mi, jaws.arch, Arch::kMandible, corrections); });
  return jaws;
}

}  // namespace gnathion
