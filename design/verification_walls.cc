#include <algorithm>
#include <cmath>

#include "design/parallel.h"
#include "design/verification_steps.h"

namespace gnathion {

FinishedSplint::FinishedSplint(TriangleMesh mesh, const SplintField& field) : query(std::move(mesh)) {
  parts.resize(query.mesh().vertices_mm.size());
  parallel_each(parts.size(),
                [&](std::size_t v) { parts[v] = field.estimate(query.mesh().vertices_mm[v]).part; });
}

TriangleMesh FinishedSplint::region(std::initializer_list<SurfacePart> wanted) const {
  std::vector<bool> keep(mesh().triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t)
    keep[t] = std::all_of(mesh().triangles[t].begin(), mesh().triangles[t].end(), [&](std::uint32_t v) {
      return std::find(wanted.begin(), wanted.end(), parts[v]) != wanted.end();
    });
  return submesh(mesh(), keep);
}

void verify_topology(const FinishedSplint& splint, SplintVerification& out) {
  out.topology = mesh_topology(splint.mesh());
  out.self_intersections = self_intersections(splint.mesh()).size();
  out.volume_mm3 = signed_volume_mm3(splint.mesh());
}

namespace {

/// Distance of each of these vertices to the other side of the wall.
void measure_across(const FinishedSplint& splint, std::initializer_list<SurfacePart> parts,
                    const MeshQuery& other_side, std::vector<float>& thickness) {
  std::vector<std::size_t> which;
  std::vector<Vector3> points;
  for (std::size_t v = 0; v < splint.parts.size(); ++v)
    if (std::find(parts.begin(), parts.end(), splint.parts[v]) != parts.end()) {
      which.push_back(v);
      points.push_back(splint.mesh().vertices_mm[v]);
    }
  const std::vector<ClosestHit> hits = closest_points(other_side, points);
  for (std::size_t i = 0; i < which.size(); ++i)
    thickness[which[i]] = static_cast<float>(std::abs(hits[i].distance_mm));
}

}  // namespace

void verify_walls(const FinishedSplint& splint, const SplintField& field, SplintVerification& out,
                  double* side_wall_p01_mm, std::vector<float>* thickness_mm) {
  const SplintParameters& par = field.parameters();
  const TriangleMesh cavity = splint.region({SurfacePart::kCavity});
  const TriangleMesh outer =
      splint.region({SurfacePart::kOuter, SurfacePart::kStamp, SurfacePart::kImprint, SurfacePart::kRelief});
  *side_wall_p01_mm = 0.0;
  thickness_mm->assign(splint.parts.size(), -1.0f);
  if (cavity.empty() || outer.empty()) return;
  const MeshQuery to_outer(outer), to_cavity(cavity);
  measure_across(splint, {SurfacePart::kCavity}, to_outer, *thickness_mm);
  measure_across(splint,
                 {SurfacePart::kOuter, SurfacePart::kStamp, SurfacePart::kImprint, SurfacePart::kRelief},
                 to_cavity, *thickness_mm);

  struct Sample {
    double thickness = -1.0;
    bool side = false;
  };
  std::vector<Sample> samples(cavity.vertices_mm.size());
  const std::vector<ClosestHit> across = closest_points(to_outer, cavity.vertices_mm);
  parallel_each(samples.size(), [&](std::size_t v) {
    if (field.estimate(cavity.vertices_mm[v]).rim > -par.wall_mm) return;
    samples[v] = {std::abs(across[v].distance_mm), field.estimate(across[v].point_mm).cut > par.wall_mm};
  });
  std::vector<double> all, side;
  double thinnest = 1e300;
  for (std::size_t v = 0; v < samples.size(); ++v) {
    if (samples[v].thickness < 0.0) continue;
    if (samples[v].thickness < thinnest) {
      thinnest = samples[v].thickness;
      out.thickness.where_mm = cavity.vertices_mm[v];
    }
    all.push_back(samples[v].thickness);
    if (samples[v].side) side.push_back(samples[v].thickness);
  }
  if (all.empty()) return;
  std::sort(all.begin(), all.end());
  std::sort(side.begin(), side.end());
  out.thickness.min_mm = all.front();
  out.thickness.p01_mm = all[all.size() / 100];
  out.thickness.median_mm = all[all.size() / 2];
  if (!side.empty()) *side_wall_p01_mm = side[side.size() / 100];

  const TriangleMesh biting =
      splint.region({SurfacePart::kImprint, SurfacePart::kRelief, SurfacePart::kStamp});
  std::vector<Vector3> centres;
  for (std::size_t t = 0; t < biting.triangles.size(); ++t)
    centres.push_back((biting.corner(t, 0) + biting.corner(t, 1) + biting.corner(t, 2)) / 3.0);
  const std::vector<ClosestHit> thin = closest_points(to_cavity, centres, par.wall_mm - 0.02);
  for (std::size_t t = 0; t < thin.size(); ++t)
    if (thin[t].triangle != ClosestHit::kNoTriangle)
      out.thin_under_contact_mm2 += 0.5 * face_normal_scaled(biting, t).norm();
}

}  // namespace gnathion
