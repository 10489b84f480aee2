#include "design/printing/build_direction.h"

#include <algorithm>
#include <cmath>

#include "design/parallel.h"
#include "design/splint_field.h"

namespace gnathion {
namespace {

constexpr int kDirections = 2500;       // about 4° apart on the sphere
constexpr std::size_t kRayed = 3;       // of the best by normals, looked at with rays
constexpr double kCavityWeight = 20.0;  // a support in the cavity spoils the fit
constexpr double kSame = 0.02;          // of the surface: as good as the best
constexpr auto kCavity = static_cast<std::uint8_t>(SurfacePart::kCavity);

bool is_cavity(const SplintSurface& splint, std::size_t triangle) {
  const Triangle& t = splint.mesh.triangles[triangle];
  return splint.part[t[0]] == kCavity && splint.part[t[1]] == kCavity && splint.part[t[2]] == kCavity;
}

/// Spiral of evenly spread directions about the axis, the axis first.
std::vector<Vector3> directions_about(const Vector3& axis) {
  Matrix3 frame;
  frame.col(2) = axis;
  frame.col(0) = axis.unitOrthogonal();
  frame.col(1) = axis.cross(frame.col(0));
  std::vector<Vector3> out = {axis};
  const double golden = M_PI * (3.0 - std::sqrt(5.0));
  for (int n = 0; n < kDirections; ++n) {
    const double z = 1.0 - (2.0 * n + 1.0) / kDirections, r = std::sqrt(1.0 - z * z);
    out.push_back(frame * Vector3(r * std::cos(golden * n), r * std::sin(golden * n), z));
  }
  return out;
}

double overhang_share(double cavity, double standing, double elsewhere) {
  return kCavityWeight * (cavity + standing) + elsewhere;
}

}  // namespace

namespace {

BuildDirection measured(const SplintSurface& splint, const Vector3& up, double self_supporting_deg,
                        const PlacedTree* tree) {
  const TriangleMesh& mesh = splint.mesh;
  BuildDirection out;
  out.up = up;
  double low = 1e300, high = -1e300;
  for (const Vector3& v : mesh.vertices_mm) {
    low = std::min(low, up.dot(v));
    high = std::max(high, up.dot(v));
  }
  out.height_mm = high - low;
  // A surface at the angle β against the plate has a normal at 180° - β from the build direction.
  const double limit = -std::cos(self_supporting_deg * M_PI / 180.0);
  std::vector<std::size_t> elsewhere;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vector3 scaled = face_normal_scaled(mesh, t);
    const double length = scaled.norm();
    if (scaled.dot(up) >= limit * length) continue;
    out.overhang_mm2 += 0.5 * length;
    if (is_cavity(splint, t))
      out.cavity_overhang_mm2 += 0.5 * length;
    else
      elsewhere.push_back(t);
  }
  if (!tree) return out;
  const Vector3 down = tree->query_from_mesh.rotation * -up;
  std::vector<double> standing(elsewhere.size(), 0.0);
  parallel_each(elsewhere.size(), [&](std::size_t i) {
    const std::size_t t = elsewhere[i];
    const Vector3 centre = (mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0;
    const auto below = tree->query.ray(tree->query_from_mesh * centre, down, 1e-4);
    if (below && is_cavity(splint, below->triangle)) standing[i] = 0.5 * face_normal_scaled(mesh, t).norm();
  });
  for (const double area : standing) out.standing_in_cavity_mm2 += area;
  return out;
}

/// Of the first in the ranking, the one whose supports cost least.
BuildDirection best_by_rays(const SplintSurface& splint, const std::vector<Vector3>& directions,
                            const std::vector<std::pair<double, std::size_t>>& ranked,
                            double self_supporting_deg, const PlacedTree& tree, double surface) {
  BuildDirection best;
  double least = 1e300;
  for (std::size_t n = 0; n < std::min(kRayed, ranked.size()); ++n) {
    const BuildDirection one = measured(splint, directions[ranked[n].second], self_supporting_deg, &tree);
    const double share = overhang_share(one.cavity_overhang_mm2, one.standing_in_cavity_mm2,
                                        one.overhang_mm2 - one.cavity_overhang_mm2);
    const bool as_good = std::abs(share - least) < kSame * surface;
    if (as_good ? one.height_mm < best.height_mm : share < least) best = one;
    least = std::min(least, share);
  }
  return best;
}

}  // namespace

BuildDirection overhang_along(const SplintSurface& splint, const Vector3& up, double self_supporting_deg,
                              bool with_rays) {
  if (!with_rays) return measured(splint, up, self_supporting_deg, nullptr);
  const MeshQuery query(splint.mesh);
  const PlacedTree tree{query, Rigid3::identity()};
  return measured(splint, up, self_supporting_deg, &tree);
}

BuildDirection find_build_direction(const SplintSurface& splint, const Vector3& cavity_opens,
                                    double self_supporting_deg, const PlacedTree* tree) {
  // By normals first: areas gathered in bins of about 3°, so that thousands of directions cost little.
  const TriangleMesh& mesh = splint.mesh;
  constexpr int kBins = 3000;
  const std::vector<Vector3> directions = directions_about(cavity_opens);
  Matrix3 frame;
  frame.col(2) = cavity_opens;
  frame.col(0) = cavity_opens.unitOrthogonal();
  frame.col(1) = cavity_opens.cross(frame.col(0));
  struct Bin {
    Vector3 cavity = Vector3::Zero(), other = Vector3::Zero();
    double cavity_mm2 = 0.0, other_mm2 = 0.0;  // their lengths
  };
  constexpr int kRows = 38, kColumns = kBins / kRows;
  std::vector<Bin> bins(static_cast<std::size_t>(kRows * kColumns));
  double surface = 0.0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vector3 scaled = 0.5 * face_normal_scaled(mesh, t);
    const double area = scaled.norm();
    if (area <= 0.0) continue;
    surface += area;
    const Vector3 n = frame.transpose() * scaled / area;
    const int row = std::min(kRows - 1, static_cast<int>(0.5 * (n.z() + 1.0) * kRows));
    const int column =
        std::min(kColumns - 1, static_cast<int>((std::atan2(n.y(), n.x()) / (2.0 * M_PI) + 0.5) * kColumns));
    Bin& bin = bins[static_cast<std::size_t>(row * kColumns + column)];
    (is_cavity(splint, t) ? bin.cavity : bin.other) += scaled;
  }
  for (Bin& bin : bins) {
    bin.cavity_mm2 = bin.cavity.norm();
    bin.other_mm2 = bin.other.norm();
  }
  const double limit = -std::cos(self_supporting_deg * M_PI / 180.0);
  std::vector<std::pair<double, std::size_t>> ranked(directions.size());
  parallel_each(directions.size(), [&](std::size_t d) {
    double cavity = 0.0, other = 0.0;
    for (const Bin& bin : bins) {
      const double c = bin.cavity_mm2, o = bin.other_mm2;
      if (bin.cavity.dot(directions[d]) < limit * c) cavity += c;
      if (bin.other.dot(directions[d]) < limit * o) other += o;
    }
    ranked[d] = {overhang_share(cavity, 0.0, other), d};
  });
  std::sort(ranked.begin(), ranked.end());
  if (!tree) {
    const MeshQuery query(mesh);
    const PlacedTree own{query, Rigid3::identity()};
    return best_by_rays(splint, directions, ranked, self_supporting_deg, own, surface);
  }
  return best_by_rays(splint, directions, ranked, self_supporting_deg, *tree, surface);
}
}  // namespace gnathion
