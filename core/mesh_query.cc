#include "core/mesh_query.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/mesh_edges.h"
#include "core/triangle_distance.h"
#include "core/triangle_ray.h"

namespace gnathion {
namespace {

constexpr std::uint32_t kBoundary = 0xffffffffu;  ///< the side has no neighbour
constexpr std::uint32_t kSeveral = 0xfffffffeu;   ///< the side has more than one
constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// Of the mesh's radius, by which boxes and search radii are widened: sixteen times what rounding of
/// coordinates and directions to single precision can move a point inside the mesh's sphere.
constexpr double kSlack = 1e-6;
/// Embree takes coordinates below 2^60 or so; farther points are measured without its help anyway.
constexpr double kFarAway = 1e15;
constexpr double kPi = 3.14159265358979323846;

/// One device for the whole process; Embree's devices are thread-safe.
RTCDevice device() {
  static const RTCDevice instance = rtcNewDevice(nullptr);
  GNATHION_CHECK(instance != nullptr);
  return instance;
}

struct PointSearch {
  const TriangleMesh* mesh;
  Vector3 p_mm;
  double slack_mm;
  TrianglePoint best;
  std::uint32_t triangle = kBoundary;

  bool consider(std::uint32_t candidate) {
    return consider(candidate, mesh->corner(candidate, 0), mesh->corner(candidate, 1),
                    mesh->corner(candidate, 2));
  }
  bool consider(std::uint32_t candidate, const Vector3& a, const Vector3& b, const Vector3& c) {
    const TrianglePoint found = closest_on_triangle(p_mm, a, b, c);
    // Of equally close triangles the first counts, so that the order of the search does not matter.
    if (found.squared_distance > best.squared_distance) return false;
    if (found.squared_distance == best.squared_distance && candidate > triangle) return false;
    best = found;
    triangle = candidate;
    return true;
  }
};

/// Every triangle whose box comes within the query's radius.
struct BallSearch {
  std::vector<std::uint32_t>* found;
};

struct RaySearch {
  RTCIntersectContext context;  // first, so that Embree's pointer to it is one to this
  const TriangleMesh* mesh;
  const RayInDouble* ray;
  double near_mm, far_mm;  // beyond the start of `ray`
  bool count_all = false;
  int crossings = 0;
  bool uncertain = false;  // an edge or a vertex was hit, or a triangle edge-on
  double best_mm = kInfinity;
  std::uint32_t triangle = kBoundary;
};

}  // namespace

struct MeshQuery::Impl {
  TriangleMesh mesh;
  Vector3 centre_mm = Vector3::Zero();
  double radius_mm = 0.0;
  RTCScene scene = nullptr;
  /// Per side (3·triangle + k) the triangle across it, or kBoundary or kSeveral.
  std::vector<std::uint32_t> across;
  std::vector<Vector3> normal_at;  ///< angle-weighted pseudonormal per vertex, not normalised
  std::vector<bool> boundary_at;   ///< per vertex
  std::vector<std::pair<std::uint32_t, Vector3>> several;  ///< sum of normals by side, sorted

  explicit Impl(TriangleMesh m) : mesh(std::move(m)) {
    measure_features();
    build_scene();
  }
  ~Impl() {
    if (scene != nullptr) rtcReleaseScene(scene);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void measure_features();
  void build_scene();
  std::optional<ClosestPoint> closest(const Vector3& p_mm, double max_distance_mm, std::uint32_t near) const;
  Vector3 edge_normal(std::uint32_t side) const;
  ClosestPoint finished(const PointSearch& search) const;
  void trace(RaySearch& search) const;
  RayInDouble ray_from_near(const Vector3& origin_mm, const Vector3& direction, double* skipped_mm) const;

  static void bounds(const RTCBoundsFunctionArguments* args);
  static bool visit_point(RTCPointQueryFunctionArguments* args);
  static bool visit_ball(RTCPointQueryFunctionArguments* args) {
    static_cast<BallSearch*>(args->userPtr)->found->push_back(args->primID);
    return false;
  }
  void triangles_near(const Vector3& p_mm, double reach_mm, std::vector<std::uint32_t>& found) const;
  static void visit_ray(const RTCIntersectFunctionNArguments* args);
  static void occlusion_not_used(const RTCOccludedFunctionNArguments*) {}
};

/// What the sign test needs of each edge and vertex. Vertices at one place count as one, so that a mesh
/// whose triangles merely lie side by side has no boundary there.
void MeshQuery::Impl::measure_features() {
  const std::vector<std::uint32_t> same = first_equal_vertices(mesh.vertices_mm);
  TriangleMesh welded;
  welded.vertices_mm = mesh.vertices_mm;
  welded.triangles = mesh.triangles;
  for (Triangle& t : welded.triangles) t = {same[t[0]], same[t[1]], same[t[2]]};

  const std::vector<Vector3> normals = face_normals(mesh);
  across.assign(3 * mesh.triangles.size(), kBoundary);
  boundary_at.assign(mesh.vertices_mm.size(), false);
  MeshEdges(welded).for_each([&](std::uint32_t low, const EdgeUse* uses, std::size_t n) {
    const auto side = [&](std::size_t i) { return 3 * uses[i].triangle + uses[i].side; };
    if (n == 1) boundary_at[low] = boundary_at[uses->high] = true;
    if (n == 2) {
      across[side(0)] = uses[1].triangle;
      across[side(1)] = uses[0].triangle;
    }
    if (n < 3) return;
    Vector3 sum = Vector3::Zero();
    for (std::size_t i = 0; i < n; ++i) sum += normals[uses[i].triangle];
    for (std::size_t i = 0; i < n; ++i) {
      across[side(i)] = kSeveral;
      several.emplace_back(side(i), sum);
    }
  });
  std::sort(several.begin(), several.end(), [](const auto& a, const auto& b) { return a.first < b.first; });

  normal_at = vertex_normals(welded);
  for (std::size_t v = 0; v < same.size(); ++v) {
    if (same[v] == v) continue;
    normal_at[v] = normal_at[same[v]];
    boundary_at[v] = boundary_at[same[v]];
  }
}

void MeshQuery::Impl::build_scene() {
  const Box box = bounding_box(mesh);
  if (mesh.empty()) return;
  centre_mm = box.centre_mm();
  radius_mm = 0.5 * box.size_mm().norm();
  scene = rtcNewScene(device());
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(device(), RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(mesh.triangles.size()));
  rtcSetGeometryUserData(geometry, this);
  rtcSetGeometryBoundsFunction(geometry, &Impl::bounds, nullptr);
  rtcSetGeometryIntersectFunction(geometry, &Impl::visit_ray);
  rtcSetGeometryOccludedFunction(geometry, &Impl::occlusion_not_used);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  GNATHION_CHECK(rtcGetDeviceError(device()) == RTC_ERROR_NONE);
}

/// Boxes about the mesh's centre, widened so that rounding to single precision loses no candidate.
void MeshQuery::Impl::bounds(const RTCBoundsFunctionArguments* args) {
  const Impl& self = *static_cast<const Impl*>(args->geometryUserPtr);
  Box box;
  for (int k = 0; k < 3; ++k) box.extend(self.mesh.corner(args->primID, k) - self.centre_mm);
  const Vector3 slack = Vector3::Constant(kSlack * self.radius_mm);
  const Eigen::Vector3f low = (box.min_mm - slack).cast<float>(), high = (box.max_mm + slack).cast<float>();
  *args->bounds_o = {low.x(), low.y(), low.z(), 0.0f, high.x(), high.y(), high.z(), 0.0f};
}

bool MeshQuery::Impl::visit_point(RTCPointQueryFunctionArguments* args) {
  PointSearch& search = *static_cast<PointSearch*>(args->userPtr);
  if (!search.consider(args->primID)) return false;
  const double radius = std::sqrt(search.best.squared_distance);
  args->query->radius = static_cast<float>(radius * (1.0 + kSlack) + search.slack_mm);
  return true;
}

void MeshQuery::Impl::triangles_near(const Vector3& p_mm, double reach_mm,
                                     std::vector<std::uint32_t>& found) const {
  const double slack = kSlack * ((p_mm - centre_mm).norm() + reach_mm);
  const Eigen::Vector3f q = (p_mm - centre_mm).cast<float>();
  RTCPointQuery query{q.x(), q.y(), q.z(), 0.0f, static_cast<float>(reach_mm * (1.0 + kSlack) + slack)};
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  BallSearch search{&found};
  rtcPointQuery(scene, &query, &context, &Impl::visit_ball, &search);
}

Vector3 MeshQuery::Impl::edge_normal(std::uint32_t side) const {
  const auto unit_normal = [this](std::uint32_t triangle) -> Vector3 {
    const Vector3 n = face_normal_scaled(mesh, triangle);
    const double length = n.norm();
    return length > 0.0 ? Vector3(n / length) : Vector3(Vector3::Zero());
  };
  if (across[side] == kBoundary) return unit_normal(side / 3);
  if (across[side] != kSeveral) return unit_normal(side / 3) + unit_normal(across[side]);
  const auto found = std::lower_bound(several.begin(), several.end(), side,
                                      [](const auto& entry, std::uint32_t s) { return entry.first < s; });
  return found->second;
}

ClosestPoint MeshQuery::Impl::finished(const PointSearch& search) const {
  ClosestPoint result;
  result.point_mm = search.best.point_mm;
  result.triangle = search.triangle;
  result.distance_mm = std::sqrt(search.best.squared_distance);
  result.barycentric = search.best.barycentric;
  const auto feature = static_cast<std::uint32_t>(search.best.feature);
  Vector3 normal;
  if (search.best.feature == TriangleFeature::kFace) {
    normal = face_normal_scaled(mesh, search.triangle);
  } else if (search.best.feature < TriangleFeature::kVertex0) {
    const std::uint32_t side =
        3 * search.triangle + feature - static_cast<std::uint32_t>(TriangleFeature::kEdge0);
    normal = edge_normal(side);
    result.on_boundary = across[side] == kBoundary;
  } else {
    const std::uint32_t k = feature - static_cast<std::uint32_t>(TriangleFeature::kVertex0);
    const std::uint32_t vertex = mesh.triangles[search.triangle][k];
    normal = normal_at[vertex];
    result.on_boundary = boundary_at[vertex];
  }
  const double length = normal.norm();
  if (length > 0.0) result.normal = normal / length;
  return result;
}

MeshQuery::MeshQuery(TriangleMesh mesh) : impl_(std::make_unique<Impl>(std::move(mesh))) {}
MeshQuery::~MeshQuery() = default;
MeshQuery::MeshQuery(MeshQuery&&) noexcept = default;
MeshQuery& MeshQuery::operator=(MeshQuery&&) noexcept = default;

const TriangleMesh& MeshQuery::mesh() const {
  return impl_->mesh;
}

/// `near`: a triangle that may be close, where one is known; the search has less to look at then.
std::optional<ClosestPoint> MeshQuery::Impl::closest(const Vector3& p_mm, double max_distance_mm,
                                                     std::uint32_t near) const {
  if (scene == nullptr || !p_mm.allFinite() || !(max_distance_mm >= 0.0)) return std::nullopt;
  const double slack = kSlack * ((p_mm - centre_mm).norm() + radius_mm);
  PointSearch search{&mesh, p_mm, slack, {}};
  search.best.squared_distance = max_distance_mm * max_distance_mm;
  double reach_mm = max_distance_mm;
  if (near != kBoundary && search.consider(near)) reach_mm = std::sqrt(search.best.squared_distance);
  const Eigen::Vector3f q = (p_mm - centre_mm).cwiseMax(-kFarAway).cwiseMin(kFarAway).cast<float>();
  RTCPointQuery query{q.x(), q.y(), q.z(), 0.0f, std::numeric_limits<float>::infinity()};
  if (reach_mm < kFarAway) query.radius = static_cast<float>(reach_mm * (1.0 + kSlack) + slack);
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(scene, &query, &context, &Impl::visit_point, &search);
  if (search.triangle == kBoundary) return std::nullopt;
  return finished(search);
}

std::optional<ClosestPoint> MeshQuery::closest(const Vector3& p_mm, double max_distance_mm) const {
  return impl_->closest(p_mm, max_distance_mm, kBoundary);
}

namespace {

SignedDistance with_side(const Vector3& p_mm, const ClosestPoint& found) {
  const bool inside = !found.on_boundary && (p_mm - found.point_mm).dot(found.normal) < 0.0;
  return {inside ? -found.distance_mm : found.distance_mm, found};
}

}  // namespace

std::optional<SignedDistance> MeshQuery::signed_distance(const Vector3& p_mm, double max_distance_mm) const {
  const std::optional<ClosestPoint> found = closest(p_mm, max_distance_mm);
  if (!found) return std::nullopt;
  return with_side(p_mm, *found);
}

namespace {

/// A bound, by a hair larger against rounding; the comparison itself is PointSearch's.
double loosened(double mm) {
  return mm * (1.0 + 1e-12) + 1e-9;
}

}  // namespace

bool LocalQuery::gather(const Vector3& centre_mm, double radius_mm, double max_distance_mm) {
  constexpr std::size_t kMost = 256;
  candidates_.clear();
  found_.clear();
  direct_ = false;
  centre_mm_ = centre_mm;
  const double reach_mm = max_distance_mm + radius_mm;
  const std::optional<ClosestPoint> nearest = query_->impl_->closest(centre_mm, reach_mm, last_);
  if (!nearest) return false;
  last_ = nearest->triangle;
  // A point of the ball has nearest's triangle within its distance + radius, so its own is within + 2 radii.
  const double ball_mm = std::min(reach_mm, nearest->distance_mm + 2.0 * radius_mm);
  query_->impl_->triangles_near(centre_mm, ball_mm, found_);
  direct_ = found_.size() > kMost;
  if (direct_) return true;
  const TriangleMesh& mesh = query_->mesh();
  for (const std::uint32_t t : found_) {
    const Vector3 centre = (mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0;
    double radius2 = 0.0;
    for (int k = 0; k < 3; ++k) radius2 = std::max(radius2, (mesh.corner(t, k) - centre).squaredNorm());
    const double nearest_mm = (centre - centre_mm).norm() - std::sqrt(radius2);
    if (nearest_mm <= loosened(ball_mm)) candidates_.emplace_back(nearest_mm, t);
  }
  std::sort(candidates_.begin(), candidates_.end());
  bundles_.assign((candidates_.size() + TriangleBundle::kLanes - 1) / TriangleBundle::kLanes, {});
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    const std::uint32_t t = candidates_[i].second;
    bundles_[i / TriangleBundle::kLanes].set(static_cast<int>(i % TriangleBundle::kLanes),
                                             mesh.corner(t, 0) - centre_mm, mesh.corner(t, 1) - centre_mm,
                                             mesh.corner(t, 2) - centre_mm, radius_mm);
  }
  return true;
}

std::optional<ClosestPoint> LocalQuery::closest(const Vector3& p_mm, double max_distance_mm) const {
  if (direct_) {
    const auto found = query_->impl_->closest(p_mm, max_distance_mm, last_);
    if (found) last_ = found->triangle;
    return found;
  }
  if (candidates_.empty()) return std::nullopt;
  PointSearch search{&query_->mesh(), p_mm, 0.0, {}};
  search.best.squared_distance = max_distance_mm * max_distance_mm;
  search.consider(last_);
  double best_mm = std::sqrt(search.best.squared_distance);
  const Vector3 off = p_mm - centre_mm_;
  const double off_mm = off.norm();
  const Eigen::Vector3f p = off.cast<float>();
  for (std::size_t i = 0; i < candidates_.size(); i += TriangleBundle::kLanes) {
    if (candidates_[i].first - off_mm > loosened(best_mm)) break;
    const unsigned near = bundles_[i / TriangleBundle::kLanes].near(p, static_cast<float>(loosened(best_mm)));
    if (near == 0) continue;
    for (unsigned lane = 0; lane < TriangleBundle::kLanes; ++lane)
      if ((near >> lane & 1u) != 0 && candidates_[i + lane].second != last_)
        search.consider(candidates_[i + lane].second);
    best_mm = std::sqrt(search.best.squared_distance);
  }
  if (search.triangle == kBoundary) return std::nullopt;
  last_ = search.triangle;
  return query_->impl_->finished(search);
}

std::optional<SignedDistance> LocalQuery::signed_distance(const Vector3& p_mm, double max_distance_mm) const {
  const std::optional<ClosestPoint> found = closest(p_mm, max_distance_mm);
  if (!found) return std::nullopt;
  return with_side(p_mm, *found);
}

/// The same ray, begun where it may first meet the mesh: a start far away would cost single precision.
RayInDouble MeshQuery::Impl::ray_from_near(const Vector3& origin_mm, const Vector3& direction,
                                           double* skipped_mm) const {
  const double to_centre = direction.dot(centre_mm - origin_mm);
  *skipped_mm = std::max(0.0, to_centre - 1.01 * radius_mm);
  return RayInDouble(origin_mm, direction, *skipped_mm);
}

void MeshQuery::Impl::visit_ray(const RTCIntersectFunctionNArguments* args) {
  if (args->valid[0] == 0) return;
  RaySearch& search = *reinterpret_cast<RaySearch*>(args->context);
  const TriangleMesh& mesh = *search.mesh;
  const std::uint32_t candidate = args->primID;
  const RayCrossing crossing =
      search.ray->cross(mesh.corner(candidate, 0), mesh.corner(candidate, 1), mesh.corner(candidate, 2));
  if (crossing.kind == RayCrossing::kNone) return;
  if (search.count_all) {
    if (crossing.kind == RayCrossing::kEdgeOn || crossing.distance_mm <= search.near_mm) {
      search.uncertain = search.uncertain || crossing.kind == RayCrossing::kEdgeOn;
      return;
    }
    ++search.crossings;
    search.uncertain = search.uncertain || crossing.kind == RayCrossing::kOnRim;
    return;
  }
  const double t = crossing.distance_mm;
  if (crossing.kind == RayCrossing::kEdgeOn || t < search.near_mm || t > search.far_mm) return;
  if (t > search.best_mm || (t == search.best_mm && candidate > search.triangle)) return;
  search.best_mm = t;
  search.triangle = candidate;
  // Embree may cull what is farther, with room for its own rounding.
  RTCRayN* ray = RTCRayHitN_RayN(args->rayhit, args->N);
  const double slack = search.ray->slack_mm;
  RTCRayN_tfar(ray, args->N, 0) = static_cast<float>(t - search.ray->start_mm() + slack);
  RTCHitN_geomID(RTCRayHitN_HitN(args->rayhit, args->N), args->N, 0) = args->geomID;
}

void MeshQuery::Impl::trace(RaySearch& search) const {
  rtcInitIntersectContext(&search.context);
  const Vector3 start = search.ray->point_at(search.ray->start_mm()) - centre_mm;
  const Eigen::Vector3f o = start.cast<float>(), d = search.ray->direction().cast<float>();
  RTCRayHit hit{};
  hit.ray.org_x = o.x();
  hit.ray.org_y = o.y();
  hit.ray.org_z = o.z();
  hit.ray.dir_x = d.x();
  hit.ray.dir_y = d.y();
  hit.ray.dir_z = d.z();
  hit.ray.tnear = 0.0f;
  hit.ray.tfar = std::numeric_limits<float>::infinity();
  hit.ray.mask = 0xffffffffu;
  hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene, &search.context, &hit);
}

std::optional<RayHit> MeshQuery::ray(const Vector3& origin_mm, const Vector3& direction, double near_mm,
                                     double far_mm) const {
  if (impl_->scene == nullptr) return std::nullopt;
  double skipped = 0.0;
  RayInDouble ray = impl_->ray_from_near(origin_mm, direction, &skipped);
  ray.slack_mm = 10.0 * kSlack * impl_->radius_mm;
  RaySearch search{{}, &impl_->mesh, &ray, near_mm, far_mm};
  impl_->trace(search);
  if (search.triangle == kBoundary) return std::nullopt;
  RayHit hit;
  hit.distance_mm = search.best_mm;
  hit.triangle = search.triangle;
  hit.point_mm = origin_mm + search.best_mm * direction;
  hit.normal = face_normal_scaled(impl_->mesh, search.triangle).normalized();
  return hit;
}

int MeshQuery::count_crossings(const Vector3& origin_mm, const Vector3& direction) const {
  if (impl_->scene == nullptr) return 0;
  // A ray through an edge or a vertex has no certain count: it is turned by a hair and asked again.
  const Vector3 side = direction.unitOrthogonal(), other = direction.cross(side);
  constexpr int kAttempts = 12;
  for (int attempt = 0;; ++attempt) {
    const double angle = 2.399963 * attempt, hair = attempt * 1e-6;  // golden angle
    const Vector3 turned =
        (direction + hair * (std::cos(angle) * side + std::sin(angle) * other)).normalized();
    double skipped = 0.0;
    const RayInDouble ray = impl_->ray_from_near(origin_mm, attempt == 0 ? direction : turned, &skipped);
    RaySearch search{{}, &impl_->mesh, &ray, 0.0, kInfinity, true};
    impl_->trace(search);
    if (!search.uncertain || attempt == kAttempts) return search.crossings;
  }
}

double MeshQuery::winding_number(const Vector3& p_mm) const {
  double solid_angle = 0.0;
  for (std::size_t i = 0; i < impl_->mesh.triangles.size(); ++i) {
    const Vector3 a = impl_->mesh.corner(i, 0) - p_mm, b = impl_->mesh.corner(i, 1) - p_mm,
                  c = impl_->mesh.corner(i, 2) - p_mm;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    solid_angle +=
        2.0 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return solid_angle / (4.0 * kPi);
}

}  // namespace gnathion
