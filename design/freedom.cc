#include "design/freedom.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "design/distances.h"
#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr double kRestMm = 0.3;      // nearer to the start than this is a rest, and its noise
constexpr double kSpacingMm = 0.25;  // between poses, on the arch: a cusp of 1 mm leaves scallops of 0.01 mm
constexpr double kGapMm = 4.0;       // farther apart than this frames do not follow each other
constexpr double kFarOpenMm = 6.0;   // every point of the arch this far down: nothing meets
constexpr double kRampMm = 2.0;      // over which the disclusion grows
constexpr double kBodyMm = 1.0;      // relief is known this far outside of the body
constexpr double kBandMm = 2.4;
constexpr float kFarMm = 9.0f;
constexpr double kGridError = 0.35;  // of the spacing: what linear interpolation takes from a sharp cusp
constexpr double kRadians = M_PI / 180.0;

/// Incisal point and both ends of the arch: they tell a pose as finely as the teeth feel it.
using Marks = std::array<Vector3, 3>;

Marks marks_of(const ArchFrame& arch) {
  return {arch.incisal_mm, arch.curve_mm.front(), arch.curve_mm.back()};
}

double way_mm(const Rigid3& motion, const Marks& marks) {
  double way = 0.0;
  for (const Vector3& m : marks) way = std::max(way, (motion * m - m).norm());
  return way;
}

bool far_open(const Rigid3& motion, const Marks& marks, const Vector3& up) {
  return std::all_of(marks.begin(), marks.end(),
                     [&](const Vector3& m) { return up.dot(m - motion * m) > kFarOpenMm; });
}

/// With places between those that follow each other, so that no ridge stays between two frames of a fast
/// movement. Across a gap in the recording nothing is invented.
std::vector<Rigid3> filled_in(const std::vector<Rigid3>& motions, const Marks& marks) {
  std::vector<Rigid3> out;
  for (std::size_t i = 0; i < motions.size(); ++i) {
    if (i > 0) {
      const Rigid3 step = motions[i] * motions[i - 1].inverse();
      Marks before;
      for (std::size_t m = 0; m < marks.size(); ++m) before[m] = motions[i - 1] * marks[m];
      const double way = way_mm(step, before);
      const int between = way < kGapMm ? static_cast<int>(way / kSpacingMm) : 0;
      for (int k = 1; k <= between; ++k)
        out.push_back(exp_se3(log_se3(step) * (static_cast<double>(k) / (between + 1))) * motions[i - 1]);
    }
    out.push_back(motions[i]);
  }
  return out;
}

/// One of those that lie within the spacing of each other, in order.
std::vector<Rigid3> thinned(const std::vector<Rigid3>& motions, const ArchFrame& arch) {
  const Marks marks = marks_of(arch);
  std::set<std::array<long, 9>> seen;
  std::vector<Rigid3> out;
  for (const Rigid3& motion : motions) {
    if (way_mm(motion, marks) < kRestMm || far_open(motion, marks, arch.up)) continue;
    std::array<long, 9> cell{};
    for (std::size_t m = 0; m < marks.size(); ++m)
      for (int d = 0; d < 3; ++d)
        cell[3 * m + static_cast<std::size_t>(d)] =
            std::lround((motion * marks[m] - marks[m])[d] / kSpacingMm);
    if (seen.insert(cell).second) out.push_back(motion);
  }
  return out;
}

/// Forward and to both sides, straight, down at the given angles.
std::vector<Rigid3> straight_excursions(const ArchFrame& arch, const SplintParameters& p) {
  std::vector<Rigid3> out;
  const auto along = [&](const Vector3& level, double down_deg) {
    const Vector3 direction = std::cos(down_deg * kRadians) * level - std::sin(down_deg * kRadians) * arch.up;
    for (double way = kRestMm; way < p.excursion_mm; way += kSpacingMm)
      out.push_back(Rigid3::from_translation(way * direction));
    out.push_back(Rigid3::from_translation(p.excursion_mm * direction));
  };
  along(arch.anterior, p.protrusion_deg);
  along(arch.left, p.laterotrusion_deg);
  along(-arch.left, p.laterotrusion_deg);
  return out;
}

/// The design's box with room on all sides for arches that come from outside of it.
GridShape widened(const GridShape& shape, double by_mm) {
  const int more = static_cast<int>(std::ceil(by_mm / shape.spacing_mm));
  GridShape wide = shape;
  wide.origin_mm -= Vector3::Constant(more * shape.spacing_mm);
  wide.nodes += Eigen::Vector3i::Constant(2 * more);
  return wide;
}

}  // namespace

std::vector<FreePose> free_poses(const SplintInputs& inputs, const ArchFrame& arch,
                                 const Rigid3& design_from_dental, const SplintParameters& p) {
  const Marks marks = marks_of(arch);
  const Rigid3 th = inputs.therapeutic.rigid;
  std::vector<Rigid3> motions =
      inputs.excursions.empty() ? std::vector<Rigid3>() : filled_in(inputs.excursions, marks);
  if (motions.empty() && p.excursion_mm > 0.0)
    for (const Rigid3& straight : straight_excursions(arch, p))
      motions.push_back(th.inverse() * straight * th);  // straight as seen from the maxilla, in TP
  std::vector<FreePose> poses;
  for (const Rigid3& motion : thinned(motions, arch)) {
    // On the mandible it is the maxilla that passes, and both are told from its place in TP.
    const Rigid3 from_tp = inputs.on_maxilla() ? th * motion * th.inverse() : motion.inverse();
    const double grown = std::min(1.0, way_mm(motion, marks) / kRampMm);
    poses.push_back({design_from_dental * from_tp * design_from_dental.inverse(), grown});
  }
  return poses;
}

CoarseGrid swept_along(const std::vector<FreePose>& poses, double disclusion_mm, const MeshQuery& opposing,
                       const CoarseGrid& body) {
  double reach = 0.0;  // how far the box's corners move
  const GridShape& shape = body.shape();
  for (const FreePose& pose : poses)
    for (int corner = 0; corner < 8; ++corner) {
      const Vector3 p = shape.position(corner & 1 ? shape.nodes.x() : 0, corner & 2 ? shape.nodes.y() : 0,
                                       corner & 4 ? shape.nodes.z() : 0);
      reach = std::max(reach, (pose.from_tp.inverse() * p - p).norm());
    }
  const CoarseGrid at_tp =
      sampled_distance(widened(shape, std::min(reach, 15.0)), opposing, {}, kBandMm, OutsideEnd::kTop);
  const double margin = disclusion_mm + kGridError * shape.spacing_mm;
  std::vector<Rigid3> back(poses.size());
  std::transform(poses.begin(), poses.end(), back.begin(),
                 [](const FreePose& f) { return f.from_tp.inverse(); });
  CoarseGrid out(shape, kFarMm);
  parallel_each(shape.nodes.x(), [&](int i) {
    for (int j = 0; j < shape.nodes.y(); ++j)
      for (int k = 0; k < shape.nodes.z(); ++k) {
        if (body.at(i, j, k) > kBodyMm) continue;
        const Vector3 p = shape.position(i, j, k);
        double least = kFarMm;
        for (std::size_t n = 0; n < poses.size(); ++n)
          least = std::min(least, at_tp.linear(back[n] * p) - margin * poses[n].away);
        out.at(i, j, k) = static_cast<float>(least);
      }
  });
  return out;
}

}  // namespace gnathion
