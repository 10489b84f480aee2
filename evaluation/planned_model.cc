#include "evaluation/planned_model.h"

#include <algorithm>
#include <cmath>

#include "occlusion/crowns.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kPalateInsideMm = 4.0;  // of the arch curve: crowns and their margins end there

Crowns crowns_of(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi) {
  Crowns crowns;
  for (std::size_t v = 0; v < fdi.size(); ++v) {
    if (fdi[v] == 0) continue;
    crowns.points_mm.push_back(mesh.vertices_mm[v]);
    crowns.fdi.push_back(fdi[v]);
  }
  double area = 0.0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& c = mesh.triangles[t];
    if (fdi[c[0]] == 0 || fdi[c[1]] == 0 || fdi[c[2]] == 0) continue;
    const double a = 0.5 * face_normal_scaled(mesh, t).norm();
    crowns.centroid_mm += a * (mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0;
    area += a;
  }
  if (area > 0.0) crowns.centroid_mm /= area;
  return crowns;
}

std::vector<bool> palate_of(const TriangleMesh& maxilla, const std::vector<std::uint8_t>& fdi,
                            const ArchFrame& arch) {
  const ArchRuler ruler(frame_of_jaw(maxilla, arch, Arch::kMaxilla));
  std::vector<bool> palate(maxilla.vertices_mm.size(), false);
  for (std::size_t v = 0; v < palate.size(); ++v) {
    if (fdi[v] != 0) continue;
    const ArchCoordinates at = ruler.measure(maxilla.vertices_mm[v]);
    palate[v] = at.buccal_mm < -kPalateInsideMm && at.height_mm > 0.0;
  }
  return palate;
}

}  // namespace

MotionFigure figure_of(const Motion<Dental>& motion, const Matrix6& covariance, const Crowns& crowns) {
  MotionFigure f;
  f.motion = motion;
  f.covariance = covariance;
  f.centroid_mm = crowns.centroid_mm;
  f.alpha_deg = motion.rigid.angle_rad() * 180.0 / M_PI;
  const Vector3 moved = motion * crowns.centroid_mm, step = moved - crowns.centroid_mm;
  f.t_mm = step.norm();
  for (std::size_t i = 0; i < crowns.points_mm.size(); ++i) {
    const double d = (motion * crowns.points_mm[i] - crowns.points_mm[i]).norm();
    if (d <= f.max_tooth_mm) continue;
    f.max_tooth_mm = d;
    f.max_tooth_fdi = crowns.fdi[i];
  }
  // Along the motion where there is one, else the largest in any direction.
  const auto sigma_along = [](const Matrix3& cov, const Vector3& direction) {
    const double length = direction.norm();
    if (length > 1e-12) return std::sqrt(std::max(0.0, direction.dot(cov * direction))) / length;
    return std::sqrt(std::max(0.0, cov.diagonal().maxCoeff()));
  };
  f.alpha_sigma_deg =
      sigma_along(covariance.topLeftCorner<3, 3>(), log_so3(motion.rigid.rotation)) * 180.0 / M_PI;
  f.t_sigma_mm = sigma_along(point_covariance(covariance, moved), step);
  return f;
}

Result<std::shared_ptr<const PlannedModel>> PlannedModel::make(const PlannedSplint& planned,
                                                               const EvaluationOptions& options) {
  const auto missing = [&](const char* what) {
    return bad_input("cannot evaluate", planned.name, std::string("no ") + what);
  };
  if (!planned.splint || planned.splint->empty()) return missing("splint");
  if (!planned.maxilla || planned.maxilla->empty()) return missing("model of the maxilla");
  if (!planned.mandible_mi || planned.mandible_mi->empty()) return missing("model of the mandible");
  auto m = std::make_shared<PlannedModel>();
  m->planned_ = planned;
  GNATHION_TRY(m->arch_, find_arch(*planned.maxilla, *planned.mandible_mi));
  m->maxilla_fdi_ = assign_teeth(*planned.maxilla, m->arch_, Arch::kMaxilla);
  m->mandible_fdi_ = assign_teeth(*planned.mandible_mi, m->arch_, Arch::kMandible);
  m->mandible_tp_ =
      std::make_shared<const TriangleMesh>(transformed(planned.therapeutic.rigid, *planned.mandible_mi));
  m->maxilla_crowns_ = crowns_of(*planned.maxilla, m->maxilla_fdi_);
  m->mandible_tp_crowns_ = crowns_of(*m->mandible_tp_, m->mandible_fdi_);
  m->palate_ = palate_of(*planned.maxilla, m->maxilla_fdi_, m->arch_);
  const double rim = 2.0 * options.rim_mm;
  m->splint_ = std::make_unique<SearchableSurface>(planned.splint, rim);
  m->maxilla_ = std::make_unique<SearchableSurface>(planned.maxilla, rim);
  m->mandible_ = std::make_unique<SearchableSurface>(m->mandible_tp_, rim);
  return std::shared_ptr<const PlannedModel>(std::move(m));
}

}  // namespace gnathion
