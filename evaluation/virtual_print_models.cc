#include "evaluation/virtual_print_models.h"

#include <tbb/parallel_for.h>

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace gnathion {
namespace {

/// A smooth random function with unit variance and correlation exp(−d²/2ℓ²): a sum of random waves (Rahimi &
/// Recht 2007).
class SmoothField {
 public:
  SmoothField(double length_mm, Random& random) {
    for (Wave& wave : waves_) {
      wave.vector = random.normal3() / length_mm;
      wave.phase = random.uniform(0, 2 * std::numbers::pi);
    }
  }
  double operator()(const Vector3& p) const {
    double sum = 0;
    for (const Wave& wave : waves_) sum += std::cos(wave.vector.dot(p) + wave.phase);
    return sum * std::sqrt(2.0 / static_cast<double>(waves_.size()));
  }

 private:
  struct Wave {
    Vector3 vector;
    double phase;
  };
  std::array<Wave, 96> waves_;
};

/// How an arch bends: its ends lift, spread and twist, by so much at the last tooth (arch frame, mm).
struct Bend {
  double lift_mm, spread_mm, twist_mm;
  static Bend drawn(double sigma_mm, Random& random) {
    const double lift = sigma_mm * random.normal(), spread = sigma_mm * random.normal();
    return {lift, spread, sigma_mm * random.normal()};
  }
};

/// Smooth displacement of a whole body in the arch's axes about its middle.
struct BodyError {
  Vector3 centre, half_size, scale;
  Bend bend;
  Vector3 at(const Vector3& p) const {
    const Vector3 q = p - centre;
    // Forward of the middle an arch is stiff; behind it, the two limbs are free.
    const double behind = std::max(0.0, q.y() / half_size.y()), aside = q.x() / half_size.x();
    const double far = behind * behind;
    return q.cwiseProduct(scale) +
           Vector3(bend.spread_mm * aside * far, 0, bend.lift_mm * far + bend.twist_mm * aside * far);
  }
};

BodyError body_error(const TriangleMesh& mesh, const ArchFrame& arch, const Vector3& scale,
                     const Bend& bend) {
  Box box;
  for (const Vector3& v : mesh.vertices_mm) box.extend(arch.to_arch(v));
  return {box.centre_mm(), 0.5 * box.size_mm().cwiseMax(Vector3::Constant(1)), scale, bend};
}

/// Moves every vertex by the body's error and, along its normal, by offset + waves + grain.
TriangleMesh displaced(const TriangleMesh& mesh, const ArchFrame& arch, const BodyError& body,
                       double offset_mm, double wave_mm, double wave_length_mm, double grain_mm,
                       Random& random) {
  const std::vector<Vector3> normals = vertex_normals(mesh);
  const SmoothField waves(wave_length_mm, random);
  std::vector<double> along(mesh.vertices_mm.size());
  for (double& d : along) d = offset_mm + grain_mm * random.normal();  // drawn in order, whatever the threads
  const Matrix3 turn_back = arch.arch_from_dental.rotation.transpose();
  TriangleMesh out = mesh;
  tbb::parallel_for(std::size_t{0}, along.size(), [&](std::size_t v) {
    const Vector3& p = mesh.vertices_mm[v];
    out.vertices_mm[v] = p + turn_back * body.at(arch.to_arch(p)) +
                         (along[v] + (wave_mm > 0 ? wave_mm * waves(p) : 0.0)) * normals[v];
  });
  return out;
}

}  // namespace

namespace {

/// Mean squared length of the edges at each vertex, and the sum and number of its neighbours.
struct Fans {
  std::vector<Vector3> sum;
  std::vector<double> squares, count;
};

Fans fans_of(const TriangleMesh& mesh) {
  const std::size_t n = mesh.vertices_mm.size();
  Fans f{std::vector<Vector3>(n, Vector3::Zero()), std::vector<double>(n, 0), std::vector<double>(n, 0)};
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      const double d2 = (mesh.vertices_mm[a] - mesh.vertices_mm[b]).squaredNorm();
      for (const auto& [from, to] : {std::pair(a, b), std::pair(b, a)}) {
        f.sum[from] += mesh.vertices_mm[to];
        f.squares[from] += d2;
        ++f.count[from];
      }
    }
  return f;
}

}  // namespace

TriangleMesh blurred(const TriangleMesh& mesh, double radius_mm) {
  if (radius_mm <= 0 || mesh.empty()) return mesh;
  // Mean curvature flow for the time ½r². The mean of a fan's neighbours lies ½κℓ² below its middle, so that
  // a weight of 2r²/ℓ² moves it by ½r²(κ1 + κ2); weights up to ½ are stable, and larger ones are taken in
  // steps.
  const double edge2 =
      surface_area_mm2(mesh) / static_cast<double>(mesh.triangles.size()) * 4 / std::sqrt(3.0);
  const double r2 = radius_mm * radius_mm;
  const int steps = static_cast<int>(std::clamp(std::ceil(4 * r2 / edge2), 1.0, 40.0));
  TriangleMesh out = mesh;
  for (int step = 0; step < steps; ++step) {
    const Fans fans = fans_of(out);
    const std::vector<Vector3> normals = vertex_normals(out);
    for (std::size_t v = 0; v < out.vertices_mm.size(); ++v) {
      if (fans.count[v] == 0) continue;
      const double weight = std::min(0.5, 2 * r2 / steps / (fans.squares[v] / fans.count[v]));
      const double move = weight * normals[v].dot(fans.sum[v] / fans.count[v] - out.vertices_mm[v]);
      out.vertices_mm[v] += std::clamp(move, -radius_mm / steps, radius_mm / steps) * normals[v];
    }
  }
  return out;
}

TriangleMesh print_virtually(const TriangleMesh& design, const ArchFrame& arch, const PrintErrorModel& model,
                             Random& random) {
  const double common = model.common_scale_sigma * random.normal();
  const Vector3 scale = Vector3::Constant(common) + model.scale_sigma * random.normal3();
  const Bend bend = Bend::drawn(model.warp_sigma_mm, random);
  const double growth = model.growth_sigma_mm * random.normal();
  const TriangleMesh rounded = blurred(design, model.blur_mm);
  return displaced(rounded, arch, body_error(design, arch, scale, bend), growth, model.waviness_mm,
                   model.waviness_length_mm, model.roughness_mm, random);
}

TriangleMesh scan_virtually(const TriangleMesh& surface, const ArchFrame& arch, const ScanErrorModel& model,
                            Random& random) {
  const Vector3 scale = Vector3::Constant(model.scale_sigma * random.normal());
  const Bend bend = Bend::drawn(model.stitch_sigma_mm, random);
  return displaced(surface, arch, body_error(surface, arch, scale, bend), 0, model.waviness_mm,
                   model.waviness_length_mm, model.noise_mm, random);
}

Rigid3 drawn_motion(const ArchFrame& arch, const Vector3& shift_sigma_mm, double turn_sigma_deg,
                    Random& random) {
  Vector3 shift = shift_sigma_mm.cwiseProduct(random.normal3());
  shift.z() = -std::abs(shift.z());
  const Vector3 turn = turn_sigma_deg * std::numbers::pi / 180 * random.normal3();
  return arch.dental_from_arch() * Rigid3{exp_so3(turn), shift} * arch.arch_from_dental;
}

Rigid3 best_motion(const std::vector<Vector3>& from, const std::vector<Vector3>& to,
                   const std::vector<std::uint8_t>& use) {
  Vector3 a = Vector3::Zero(), b = Vector3::Zero();
  double n = 0;
  for (std::size_t i = 0; i < from.size(); ++i)
    if (use[i]) {
      a += from[i];
      b += to[i];
      ++n;
    }
  if (n < 3) return {};
  a /= n;
  b /= n;
  Matrix3 cross = Matrix3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i)
    if (use[i]) cross += (to[i] - b) * (from[i] - a).transpose();
  const Eigen::JacobiSVD<Matrix3> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix3 keep = Matrix3::Identity();
  keep(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  const Matrix3 rotation = svd.matrixU() * keep * svd.matrixV().transpose();
  return {rotation, b - rotation * a};
}

}  // namespace gnathion
