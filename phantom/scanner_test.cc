#include "phantom/scanner.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "core/mesh_query.h"
#include "phantom/bodies_field.h"
#include "phantom/bodies_mesher.h"

namespace gnathion {
namespace {

/// A body with nothing round about it by accident: an ellipsoid with a bump and a dent.
TriangleMesh lumpy_body() {
  const auto solid = [](const Vector3& p) {
    double d = field::ellipsoid(p, {0, 0, 0}, {24, 18, 13});
    d = field::unite(d, field::sphere(p, {10, 4, 11}, 6), 3);
    return field::subtract(d, field::sphere(p, {-11, -3, 14}, 5), 3);
  };
  Box box;
  box.extend(Vector3::Constant(-30));
  box.extend(Vector3::Constant(30));
  return mesh_of_field(solid, box, 0.8, 1.6);
}

ScannerModel perfect_scanner() {
  ScannerModel model;
  model.edge_mm = 0.6;
  model.white_noise_mm = model.correlated_noise_mm = model.scale_error = 0;
  model.holes = 0;
  for (int axis = 0; axis < 3; ++axis) {
    model.views.push_back(Vector3::Unit(axis));
    model.views.push_back(-Vector3::Unit(axis));
  }
  model.max_incidence_deg = 89;
  return model;
}

double rms(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

/// Signed distances of the scan's vertices, brought back, to the truth.
std::vector<double> errors_mm(const TriangleMesh& scan, const Rigid3& scan_from_surface,
                              const MeshQuery& truth) {
  std::vector<double> out;
  for (const Vector3& p : transformed(scan_from_surface.inverse(), scan).vertices_mm)
    out.push_back(truth.signed_distance(p)->distance_mm);
  return out;
}

const Rigid3 kPose{exp_so3(Vector3(1.1, -2.0, 0.7)), Vector3(120, -40, 33)};

TEST(Scanner, PerfectScanLiesOnTheSurfaceWithVerticesOfItsOwn) {
  const TriangleMesh body = lumpy_body();
  const MeshQuery truth(body);
  Random random(17);
  const TriangleMesh scan = simulate_scan(body, perfect_scanner(), kPose, random);
  const MeshTopology topology = mesh_topology(scan);
  EXPECT_TRUE(topology.manifold());
  EXPECT_EQ(topology.components, 1u);
  EXPECT_EQ(topology.degenerate_triangles, 0u);
  EXPECT_NEAR(surface_area_mm2(scan), surface_area_mm2(body), 0.01 * surface_area_mm2(body));
  for (const double e : errors_mm(scan, kPose, truth)) ASSERT_LT(std::abs(e), 1e-6);
  double nearest = 1e9;
  const TriangleMesh back = transformed(kPose.inverse(), scan);
  std::map<std::array<long, 3>, std::vector<Vector3>> cells;
  const auto cell_of = [](const Vector3& p) {
    return std::array<long, 3>{std::lround(p.x()), std::lround(p.y()), std::lround(p.z())};
  };
  for (const Vector3& p : body.vertices_mm) cells[cell_of(p)].push_back(p);
  for (const Vector3& p : back.vertices_mm)
    for (const Vector3& q : cells[cell_of(p)]) nearest = std::min(nearest, (p - q).norm());
  EXPECT_GT(nearest, 1e-7) << "a vertex of the source came through";
  // Normals still point outwards.
  EXPECT_GT(signed_volume_mm3(scan), 0.98 * signed_volume_mm3(body));
}

TEST(Scanner, NoiseHasTheSizeAndTheReachItIsGiven) {
  const TriangleMesh body = lumpy_body();
  const MeshQuery truth(body);
  ScannerModel model = perfect_scanner();
  model.white_noise_mm = 0.02;
  Random random(5);
  EXPECT_NEAR(rms(errors_mm(simulate_scan(body, model, kPose, random), kPose, truth)), 0.02, 0.001);

  // Of the correlated part one body holds only some ten independent patches: average over several scans.
  model.white_noise_mm = 0;
  model.correlated_noise_mm = 0.03;
  double variance = 0, near = 0, far = 0;
  std::size_t near_count = 0, far_count = 0;
  constexpr int kScans = 12;
  for (int n = 0; n < kScans; ++n) {
    const TriangleMesh scan = simulate_scan(body, model, {}, random);
    const auto e = errors_mm(scan, {}, truth);
    variance += rms(e) * rms(e) / kScans;
    for (std::size_t i = 0; i < e.size(); i += 97)
      for (std::size_t j = i + 1; j < e.size(); j += 89) {
        const double d = (scan.vertices_mm[i] - scan.vertices_mm[j]).norm();
        if (d < 2) near += e[i] * e[j], ++near_count;
        if (d > 30) far += e[i] * e[j], ++far_count;
      }
  }
  EXPECT_NEAR(std::sqrt(variance), 0.03, 0.007);
  EXPECT_GT(near / static_cast<double>(near_count), 0.85 * variance);
  EXPECT_LT(std::abs(far / static_cast<double>(far_count)), 0.35 * variance);
}

TEST(Scanner, ScaleErrorStretchesFromItsCentre) {
  const TriangleMesh body = lumpy_body();
  ScannerModel model = perfect_scanner();
  model.scale_error = 0.0005;
  model.scale_centre_mm = Vector3(24, 0, 0);
  Random random(6);
  const Box truth = bounding_box(body), scan = bounding_box(simulate_scan(body, model, {}, random));
  EXPECT_NEAR(scan.max_mm.x(), truth.max_mm.x(), 0.006);
  EXPECT_NEAR(scan.min_mm.x(), 24 + 1.0005 * (truth.min_mm.x() - 24), 0.006);
  EXPECT_LT(scan.min_mm.x(), truth.min_mm.x() - 0.015);
}

TEST(Scanner, MissesWhatNoViewReachesAndWhatHolesTake) {
  // A plate hovers over the body's top: seen from above, it hides what lies under it.
  const auto plate = [](const Vector3& p) { return field::box(p - Vector3(0, 0, 30), {8, 8, 1.2}, 0.3); };
  Box box;
  box.extend({-12, -12, 26});
  box.extend({12, 12, 34});
  const TriangleMesh body = lumpy_body();
  const TriangleMesh scene = merged(body, mesh_of_field(plate, box, 0.6));
  ScannerModel model = perfect_scanner();
  model.views = {Vector3::UnitZ()};
  model.reach_mm = 100;
  model.max_incidence_deg = 75;
  Random random(9);
  const TriangleMesh scan = simulate_scan(scene, model, {}, random);
  std::size_t under_plate = 0, beside_plate = 0, on_plate = 0, below_body = 0;
  for (const Vector3& p : scan.vertices_mm) {
    const bool within = std::abs(p.x()) < 7.5 && std::abs(p.y()) < 7.5;
    if (p.z() > 25)
      ++on_plate;
    else if (within)
      ++under_plate;
    else
      ++beside_plate;
    if (p.z() < -1) ++below_body;
  }
  EXPECT_EQ(under_plate, 0u);
  EXPECT_EQ(below_body, 0u);
  EXPECT_GT(beside_plate, 600u);
  EXPECT_GT(on_plate, 600u);

  ScannerModel holed = perfect_scanner();
  holed.holes = 5;
  holed.hole_radius_min_mm = 1.0;
  holed.hole_radius_max_mm = 1.6;
  const TriangleMesh with_holes = simulate_scan(body, holed, {}, random);
  const auto loops = boundary_loops(with_holes);
  EXPECT_GE(loops.size(), 3u);  // two holes may run into one
  EXPECT_LE(loops.size(), 6u);
  EXPECT_TRUE(mesh_topology(with_holes).manifold());
}

TEST(Scanner, SameSeedSameScan) {
  const TriangleMesh body = lumpy_body();
  ScannerModel model = perfect_scanner();
  model.white_noise_mm = 0.01;
  model.holes = 3;
  Random a(3), b(3), c(4);
  const TriangleMesh first = simulate_scan(body, model, kPose, a),
                     second = simulate_scan(body, model, kPose, b);
  EXPECT_EQ(first.triangles, second.triangles);
  EXPECT_EQ(first.vertices_mm, second.vertices_mm);
  EXPECT_NE(simulate_scan(body, model, kPose, c).vertices_mm, first.vertices_mm);
}

}  // namespace
}  // namespace gnathion
