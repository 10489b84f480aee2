// Room between the jaws, tooth by tooth.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "occlusion/contacts.h"

namespace gnathion {
namespace {

constexpr double kOcclusalFacing = 0.5;  // cosine to the occlusal normal: cusps, fossae, incisal edges
constexpr double kFarMm = 300.0;         // beyond any jaw

struct VertexRoom {
  std::optional<double> gap_mm;  ///< signed
  std::optional<double>
      vertical_mm;  ///< height of the maxilla's lower envelope above the vertex; occlusal vertices
  bool occlusal = false;
  std::uint8_t opposing_fdi = 0;
};

VertexRoom room_at(const MeshQuery& maxilla, const std::vector<std::uint8_t>& maxilla_fdi, const Vector3& p,
                   const Vector3& normal, const Vector3& up, double max_mm) {
  VertexRoom room;
  if (const auto found = maxilla.signed_distance(p, max_mm)) {
    const bool inside =
        found->closest.on_boundary ? inside_surface(maxilla, p, -up) : found->distance_mm < 0.0;
    room.gap_mm = inside ? -std::abs(found->distance_mm) : found->distance_mm;
    const Triangle& t = maxilla.mesh().triangles[found->closest.triangle];
    Eigen::Index corner = 0;
    found->closest.barycentric.maxCoeff(&corner);
    if (!maxilla_fdi.empty()) room.opposing_fdi = maxilla_fdi[t[static_cast<std::size_t>(corner)]];
  }
  room.occlusal = normal.dot(up) > kOcclusalFacing;
  if (room.occlusal)
    if (const auto hit = maxilla.ray(p - kFarMm * up, up, 0.0, 2.0 * kFarMm))
      room.vertical_mm = hit->distance_mm - kFarMm;
  return room;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

std::vector<ToothClearance> tooth_clearances(const MeshQuery& maxilla,
                                             const std::vector<std::uint8_t>& maxilla_fdi,
                                             const TriangleMesh& mandible,
                                             const std::vector<std::uint8_t>& mandible_fdi,
                                             const Rigid3& motion, const ArchFrame& frame, double max_mm) {
  const auto normals = vertex_normals(mandible);
  std::vector<VertexRoom> room(mandible.vertices_mm.size());
  tbb::parallel_for(std::size_t{0}, room.size(), [&](std::size_t i) {
    if (mandible_fdi[i] == 0) return;
    room[i] = room_at(maxilla, maxilla_fdi, motion * mandible.vertices_mm[i], motion.rotation * normals[i],
                      frame.up, max_mm);
  });

  struct Tooth {
    ToothClearance clearance;
    std::vector<double> vertical;
    std::size_t occlusal = 0;
  };
  std::map<std::uint8_t, Tooth> teeth;
  for (std::size_t i = 0; i < room.size(); ++i) {
    if (mandible_fdi[i] == 0) continue;
    auto [entry, fresh] = teeth.try_emplace(mandible_fdi[i]);
    Tooth& tooth = entry->second;
    if (fresh) tooth.clearance.min_mm = max_mm;
    if (room[i].gap_mm && *room[i].gap_mm < tooth.clearance.min_mm) {
      tooth.clearance.min_mm = *room[i].gap_mm;
      tooth.clearance.where_mm = motion * mandible.vertices_mm[i];
      tooth.clearance.opposing_fdi = room[i].opposing_fdi;
    }
    tooth.occlusal += room[i].occlusal;
    if (room[i].vertical_mm) tooth.vertical.push_back(*room[i].vertical_mm);
  }
  std::vector<ToothClearance> out;
  for (auto& [fdi, tooth] : teeth) {
    ToothClearance& c = tooth.clearance;
    c.fdi = fdi;
    if (!tooth.vertical.empty()) {
      c.vertical_median_mm = median(tooth.vertical);
      c.opposed_fraction = static_cast<double>(tooth.vertical.size()) / static_cast<double>(tooth.occlusal);
      if (c.vertical_median_mm < 0.0) c.min_mm = std::min(c.min_mm, c.vertical_median_mm);
    }
    out.push_back(c);
  }
  return out;
}

}  // namespace gnathion
