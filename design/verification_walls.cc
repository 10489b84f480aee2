#include <algorithm>
#include <cmath>
#include <optional>

#include <tbb/parallel_invoke.h>

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

/// Of these vertices, what is nearest on the other side of the wall.
struct Across {
  std::vector<std::size_t> vertices;
  std::vector<ClosestHit> hits;
};

/// Distance of each of these vertices to the other side of the wall.
Across measure_across(const FinishedSplint& splint, std::initializer_list<SurfacePart> parts,
                      const MeshQuery& other_side, std::vector<float>& thickness) {
  Across out;
  std::vector<Vector3> points;
  for (std::size_t v = 0; v < splint.parts.size(); ++v)
    if (std::find(parts.begin(), parts.end(), splint.parts[v]) != parts.end()) {
      out.vertices.push_back(v);
      points.push_back(splint.mesh().vertices_mm[v]);
    }
  out.hits = closest_points(other_side, points);
  for (std::size_t i = 0; i < out.vertices.size(); ++i)
    thickness[out.vertices[i]] = static_cast<float>(std::abs(out.hits[i].distance_mm));
  return out;
}

/// Vertices of triangles whose three corners are of this part: those of a region.
std::vector<char> vertices_of_region(const FinishedSplint& splint, SurfacePart part) {
  std::vector<char> out(splint.parts.size(), 0);
  for (const Triangle& t : splint.mesh().triangles)
    if (std::all_of(t.begin(), t.end(), [&](std::uint32_t v) { return splint.parts[v] == part; }))
      for (const std::uint32_t v : t) out[v] = 1;
  return out;
}

}  // namespace

void verify_walls(const FinishedSplint& splint, const SplintField& field, SplintVerification& out,
                  double* side_wall_p01_mm, std::vector<float>* thickness_mm) {
  const SplintParameters& par = field.parameters();
  TriangleMesh cavity = splint.region({SurfacePart::kCavity});
  TriangleMesh outer =
      splint.region({SurfacePart::kOuter, SurfacePart::kStamp, SurfacePart::kImprint, SurfacePart::kRelief});
  *side_wall_p01_mm = 0.0;
  thickness_mm->assign(splint.parts.size(), -1.0f);
  if (cavity.empty() || outer.empty()) return;
  std::optional<MeshQuery> outer_tree, cavity_tree;
  tbb::parallel_invoke([&] { outer_tree.emplace(std::move(outer)); },
                       [&] { cavity_tree.emplace(std::move(cavity)); });
  const MeshQuery &to_outer = *outer_tree, &to_cavity = *cavity_tree;
  const Across across = measure_across(splint, {SurfacePart::kCavity}, to_outer, *thickness_mm);
  measure_across(splint,
                 {SurfacePart::kOuter, SurfacePart::kStamp, SurfacePart::kImprint, SurfacePart::kRelief},
                 to_cavity, *thickness_mm);

  struct Sample {
    double thickness = -1.0;
    bool side = false;
  };
  std::vector<Sample> samples(across.vertices.size());
  const std::vector<char> of_region = vertices_of_region(splint, SurfacePart::kCavity);
  const auto place = [&](std::size_t i) { return splint.mesh().vertices_mm[across.vertices[i]]; };
  parallel_each(samples.size(), [&](std::size_t i) {
    if (!of_region[across.vertices[i]] || field.estimate(place(i)).rim > -par.wall_mm) return;
    const ClosestHit& hit = across.hits[i];
    samples[i] = {std::abs(hit.distance_mm), field.estimate(hit.point_mm).cut > par.wall_mm};
  });
  std::vector<double> all, side;
  double thinnest = 1e300;
  for (std::size_t v = 0; v < samples.size(); ++v) {
    if (samples[v].thickness < 0.0) continue;
    if (samples[v].thickness < thinnest) {
      thinnest = samples[v].thickness;
      out.thickness.where_mm = place(v);
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
