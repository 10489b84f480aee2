#include "design/bow/bow_checks.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "design/parallel.h"
#include "design/solid_distance.h"
#include "occlusion/contacts.h"

namespace gnathion {
namespace {

constexpr double kRad = std::numbers::pi / 180;
constexpr double kSample_mm = 0.4;

Vector3 middle_of(const TaggedBody& tags) {
  Vector3 sum = Vector3::Zero();
  for (const BodyTag& t : tags.tags)
    for (const Vector3& c : t.corners_in_body_mm) sum += c / (4.0 * static_cast<double>(tags.tags.size()));
  return sum;
}

Vector3 normal_of(const BodyTag& t) {
  const auto& c = t.corners_in_body_mm;
  return (c[1] - c[0]).cross(c[3] - c[0]).normalized();
}

Vector3 eye_at(const TaggedBody& tags, double yaw, double pitch, double distance) {
  return middle_of(tags) + distance * Vector3(std::sin(yaw) * std::cos(pitch),
                                              -std::cos(yaw) * std::cos(pitch), std::sin(pitch));
}

bool visible(const BodyTag& tag, const MeshQuery& surface, const Vector3& eye) {
  const Vector3 n = normal_of(tag);
  Vector3 centre = Vector3::Zero();
  for (const Vector3& c : tag.corners_in_body_mm) centre += 0.25 * c;
  if (n.dot((eye - centre).normalized()) < std::cos(60 * kRad)) return false;
  for (const Vector3& c : tag.corners_in_body_mm) {
    // With the white cell about the tag, just over the sticker.
    const Vector3 from = centre + 1.2 * (c - centre) + 0.35 * n;
    const Vector3 to = eye - from;
    if (surface.ray(from, to.normalized(), 0.0, to.norm())) return false;
  }
  return true;
}

double least_distance(const MeshQuery& surface, const std::vector<Vector3>& points) {
  double least = 20;
  for (const SolidHit& hit : solid_hits(surface, points, least)) least = std::min(least, hit.distance_mm);
  return least;
}

std::vector<Vector3> points_of(const TriangleMesh& mesh, double step) {
  std::vector<Vector3> out;
  for (const SurfaceSample& s : sample_surface(mesh, step)) out.push_back(s.p_mm);
  out.insert(out.end(), mesh.vertices_mm.begin(), mesh.vertices_mm.end());
  return out;
}

std::vector<Vector3> moved(const Rigid3& motion, std::vector<Vector3> points) {
  for (Vector3& p : points) p = motion * p;
  return points;
}

/// The part of a scan near the bow: distances from it to the bow need no more.
std::vector<Vector3> scan_points(const TriangleMesh& scan, const Box& near) {
  std::vector<Vector3> out;
  for (const SurfaceSample& s : sample_surface(scan, kSample_mm))
    if (((s.p_mm - near.min_mm).array() > -15).all() && ((near.max_mm - s.p_mm).array() > -15).all())
      out.push_back(s.p_mm);
  return out;
}

class Gates {
 public:
  explicit Gates(BowDesign& d) : d_(d) {}
  void at_least(const char* name, double value, double limit) { add(name, value, limit, value >= limit); }
  void at_most(const char* name, double value, double limit) { add(name, value, limit, value <= limit); }

 private:
  void add(const char* name, double value, double limit, bool pass) {
    d_.gates.push_back({name, value, limit, pass, true});
    if (!pass) d_.violated.emplace_back(name);
  }
  BowDesign& d_;
};

void printable(Gates& gates, const PrintedBody& body, const MeshQuery& surface, const std::string& name,
               double wall_mm) {
  const MeshTopology t = mesh_topology(body.surface);
  const auto gate = [&](const char* what) { return name + "_" + what; };
  gates.at_most(gate("boundary_edges").c_str(), static_cast<double>(t.boundary_edges), 0);
  gates.at_most(gate("non_manifold").c_str(),
                static_cast<double>(t.non_manifold_edges + t.non_manifold_vertices + t.degenerate_triangles),
                0);
  gates.at_most(gate("components").c_str(), static_cast<double>(t.components), 1);
  gates.at_most(gate("self_intersections").c_str(),
                static_cast<double>(self_intersections(body.surface, 100).size()), 0);
  gates.at_least(gate("wall_mm").c_str(), thinnest_wall_mm(surface, nullptr), wall_mm);
  int least = 99;
  for (int yaw = -40; yaw <= 40; yaw += 10)
    for (int pitch = -10; pitch <= 10; pitch += 10)
      least = std::min(least, visible_tags(body, surface, yaw * kRad, pitch * kRad, 400));
  gates.at_least(gate("visible_tags").c_str(), least, 6);
  double widest = 1;
  for (const BodyTag& a : body.tags.tags)
    for (const BodyTag& b : body.tags.tags) widest = std::min(widest, normal_of(a).dot(normal_of(b)));
  gates.at_least(gate("tag_planes_deg").c_str(), std::acos(std::clamp(widest, -1.0, 1.0)) / kRad, 20);
}

/// Too narrow for its normal to mean anything.
bool is_sliver(const TriangleMesh& mesh, std::size_t t) {
  double longest = 0;
  for (int k = 0; k < 3; ++k)
    longest = std::max(longest, (mesh.corner(t, k) - mesh.corner(t, (k + 1) % 3)).norm());
  return face_normal_scaled(mesh, t).norm() < 0.03 * longest;  // height under 0.03 mm
}

/// Deepest that the clutch passes into the teeth on its way off.
double insertion_interference(const ClutchScene& scene, const Clutch& clutch,
                              const std::vector<Vector3>& inner) {
  double deepest = 0;
  for (double way = 0.1; way < 8; way += way < 1 ? 0.1 : 0.25) {
    std::vector<Vector3> points = inner;
    for (Vector3& p : points) p += way * clutch.withdrawal();
    deepest = std::max(deepest, -least_distance(scene.mandible, points));
  }
  return deepest;
}

}  // namespace

int visible_tags(const PrintedBody& body, const MeshQuery& surface, double yaw_rad, double pitch_rad,
                 double distance_mm) {
  const Vector3 eye = eye_at(body.tags, yaw_rad, pitch_rad, distance_mm);
  int count = 0;
  for (const BodyTag& t : body.tags.tags) count += visible(t, surface, eye);
  return count;
}

double predicted_sigma_mm(const PrintedBody& body, const MeshQuery& surface, const Vector3& at_mm) {
  constexpr double kFocal_px = 1100, kSigma_px = 0.05, kDistance_mm = 400;
  const Vector3 eye = eye_at(body.tags, 0, 0, kDistance_mm);
  Matrix3 camera_from_body;
  camera_from_body << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  Matrix6 information = Matrix6::Zero();
  for (const BodyTag& t : body.tags.tags) {
    if (!visible(t, surface, eye)) continue;
    for (const Vector3& c : t.corners_in_body_mm) {
      const Vector3 q = camera_from_body * (c - eye);
      Eigen::Matrix<double, 2, 3> by_point;
      by_point << kFocal_px / q.z(), 0, -kFocal_px * q.x() / (q.z() * q.z()), 0, kFocal_px / q.z(),
          -kFocal_px * q.y() / (q.z() * q.z());
      Eigen::Matrix<double, 2, 6> j;  // by a turn and shift of the body about the point asked for
      j << by_point * camera_from_body * -skew(c - at_mm), by_point * camera_from_body;
      information += j.transpose() * j / (kSigma_px * kSigma_px);
    }
  }
  const Matrix6 covariance = information.inverse();
  if (!covariance.allFinite()) return 1e3;
  const Eigen::SelfAdjointEigenSolver<Matrix3> own(Matrix3(covariance.bottomRightCorner<3, 3>()));
  return std::sqrt(std::max(0.0, own.eigenvalues()(2)));
}

double thinnest_wall_mm(const MeshQuery& surface, Vector3* where_mm) {
  const auto samples = sample_surface(surface.mesh(), 0.6);
  std::vector<double> wall(samples.size(), 1e3);
  parallel_each(samples.size(), [&](std::size_t i) {
    if (is_sliver(surface.mesh(), samples[i].triangle)) return;
    const Vector3 n = face_normal_scaled(surface.mesh(), samples[i].triangle).normalized();
    // Folds of a few hundredths, which simplification leaves beside an edge, are no walls.
    const auto hit = surface.ray(samples[i].p_mm, -n, 0.06, 30);
    // Towards an edge the way through is short without the solid being thin: only faces that face away count.
    if (hit && !is_sliver(surface.mesh(), hit->triangle) && hit->normal.dot(n) < -std::cos(45 * kRad))
      wall[i] = hit->distance_mm;
  });
  const auto least = std::min_element(wall.begin(), wall.end());
  if (where_mm != nullptr) *where_mm = samples[static_cast<std::size_t>(least - wall.begin())].p_mm;
  return *least;
}

void verify_bow(const ClutchScene& scene, const Clutch& clutch, const BowParameters& p, BowDesign& d) {
  Gates gates(d);
  const MeshQuery bow(d.bow.surface), head(d.head_frame.surface);
  printable(gates, d.bow, bow, "bow", 1.0);
  printable(gates, d.head_frame, head, "head_frame", 1.0);
  gates.at_most("incisal_sigma_mm", predicted_sigma_mm(d.bow, bow, Vector3::Zero()), 0.05);

  const Box at_teeth = bounding_box(d.clutch);
  const std::vector<Vector3> bow_points = points_of(d.clutch, kSample_mm);
  const std::vector<Vector3> maxilla_points = scan_points(scene.maxilla_scan, at_teeth);
  double in_mi = 20, on_paths = 20;
  for (std::size_t i = 0; i < scene.jaw_positions.size(); ++i) {
    const Rigid3& motion = scene.jaw_positions[i];
    const double apart = std::min(least_distance(scene.maxilla, moved(motion, bow_points)),
                                  least_distance(bow, moved(motion.inverse(), maxilla_points)));
    (i == 0 ? in_mi : on_paths) = std::min(i == 0 ? in_mi : on_paths, apart);
  }
  gates.at_least("maxilla_clearance_mi_mm", in_mi, 0.5);
  if (scene.jaw_positions.size() > 1) gates.at_least("maxilla_clearance_paths_mm", on_paths, 0.5);
  std::vector<Vector3> contacts;
  for (const SurfaceSample& s : find_contacts(scene.mandible_scan, scene.fdi, Rigid3::identity(),
                                              scene.maxilla, -Vector3::UnitZ(), scene.lower, 0.1)
                                    .samples)
    contacts.push_back(s.p_mm);
  if (!contacts.empty()) gates.at_least("occlusal_contact_distance_mm", least_distance(bow, contacts), 0.5);

  // The seat: what of the bow lies on the teeth, and how near.
  std::vector<Vector3> inner;
  std::vector<double> seat;
  double nearest = 20;
  const auto samples = sample_surface(d.clutch, kSample_mm);
  std::vector<Vector3> all;
  for (const SurfaceSample& s : samples) all.push_back(s.p_mm);
  const auto hits = solid_hits(scene.mandible, all, 20);
  for (std::size_t i = 0; i < hits.size(); ++i) {
    nearest = std::min(nearest, hits[i].distance_mm);
    if (hits[i].distance_mm > 2.5) continue;
    inner.push_back(all[i]);
    if (hits[i].distance_mm > p.bonding_gap_mm + 0.2) continue;
    seat.push_back(hits[i].distance_mm);
    d.bonding_area_mm2 += samples[i].area_mm2;
  }
  std::sort(seat.begin(), seat.end());
  const double median = seat.empty() ? 20 : seat[seat.size() / 2];
  gates.at_least("seat_gap_min_mm", nearest, p.bonding_gap_mm - 0.08);
  gates.at_most("seat_gap_median_mm", median, p.bonding_gap_mm + 0.05);
  gates.at_least("bonding_area_mm2", d.bonding_area_mm2, 60);
  gates.at_least("clutch_height_mm", clutch.height_mm(), 2.0);
  gates.at_most("insertion_interference_mm", insertion_interference(scene, clutch, inner),
                p.engagement_mm + 0.02);

  d.volume_mm3 = signed_volume_mm3(d.bow.surface);
  d.mass_g = d.volume_mm3 * 1e-3 * p.density_g_per_cm3;
  gates.at_most("mass_g", d.mass_g, 40);
  d.verdict = d.violated.empty() ? "pass" : "fail";
}

}  // namespace gnathion
