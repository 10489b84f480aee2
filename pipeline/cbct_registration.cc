// Surfaces of the patient found in a volume: crowns and skin.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "anatomy/volume/iso_surface.h"
#include "core/transform_io.h"
#include "pipeline/cbct_steps.h"

namespace gnathion {
namespace {

using nlohmann::json;
constexpr const char* kWhat = "cannot register volume";
/// Optical scanners and volumes differ in scale by about this much (distances in CBCT: Lascala et al. 2004).
constexpr double kScaleSigma = 0.001;

Result<CbctRegistration> align_to_level(const TriangleMesh& source, const Volume& volume, double level,
                                        const AlignOptions& options) {
  const TriangleMesh surface = iso_surface(volume, level);
  if (surface.empty())
    return bad_input(kWhat, options.name, fmt::format("nothing in the volume reaches {:.0f}", level));
  CbctRegistration out;
  out.level = level;
  GNATHION_TRY(out.fit, align_surfaces(source, surface, options));
  return out;
}

/// A fit that the volume's resolution does not explain is no fit.
Status convincing(const CbctRegistration& found, double most_mm, const std::string& name) {
  const double worst = std::max(found.fit.rms_mm, found.fit.held_out_mm);
  if (worst <= most_mm) return {};
  return bad_input(
      kWhat, name,
      fmt::format("not convincing: surfaces stay {:.2f} mm apart, {:.2f} mm are allowed", worst, most_mm));
}

}  // namespace

Result<CbctRegistration> register_crowns(const Volume& volume, const TriangleMesh& arch,
                                         const std::vector<bool>& crowns, const CbctOptions& options,
                                         const std::optional<Rigid3>& guess, const std::string& name) {
  const double voxel = volume.grid.spacing_mm().maxCoeff();
  AlignOptions align;
  align.initial_target_from_source = guess;
  align.source_vertex_mask = crowns;
  align.overlap = crowns.empty() ? 0.35 : 0.6;  // without gingiva, palate, and what touches the other arch
  align.noise_mm = 0.25 * voxel;
  align.gate_mm = std::max(1.0, 2.0 * voxel);
  align.scale_sigma = kScaleSigma;
  align.name = name;
  const double level = options.crown_level ? *options.crown_level : tissue_levels(volume).crown;
  GNATHION_TRY(const CbctRegistration found, align_to_level(arch, volume, level, align));
  GNATHION_CHECK_OK(convincing(found, 0.1 + 0.5 * voxel, name));
  return found;
}

Result<CbctRegistration> register_face(const Volume& volume, const TriangleMesh& face_scan,
                                       const CbctOptions& options) {
  AlignOptions align;
  align.overlap = 0.5;
  align.noise_mm = 0.3;
  align.gate_mm = 2.0;
  align.scale_sigma = kScaleSigma;
  align.name = "face scan on the skin in the volume";
  const double level = options.skin_level ? *options.skin_level : tissue_levels(volume).skin;
  GNATHION_TRY(const CbctRegistration found, align_to_level(face_scan, volume, level, align));
  GNATHION_CHECK_OK(convincing(found, 1.0, align.name));
  return found;
}

json cbct_registration_json(const CbctRegistration& r, const std::string& from, const std::string& source) {
  return {{"kind", "pose"},
          {"to", Cbct::name},
          {"from", from},
          {"unit", "mm"},
          {"matrix", matrix_json(r.fit.target_from_source.matrix())},
          {"covariance", covariance_json(r.fit.covariance)},
          {"rms_mm", r.fit.rms_mm},
          {"held_out_mm", r.fit.held_out_mm},
          {"condition", r.fit.condition},
          {"weak", r.fit.weak},
          {"inlier_fraction", r.fit.inlier_fraction},
          {"level", r.level},
          {"source", source}};
}

Status read_cbct_registration(const std::filesystem::path& path, CbctOptions& options) {
  GNATHION_TRY(const json j, read_json(path));
  const char* const what = "cannot read registration";
  if (!j.is_object() || j.value("kind", json()) != "pose" || j.value("to", json()) != Cbct::name ||
      j.value("from", json()) != Dental::name)
    return bad_input(what, path.string(),
                     "not a pose from dental to cbct, as `gnathion cbct register` writes it");
  GNATHION_TRY(const Matrix4 m, matrix_from_json(j.value("matrix", json()), path.string()));
  if (!rigidity_deviation(m).is_rigid()) return bad_input(what, path.string(), "not a rigid motion");
  options.cbct_from_dental = Transform<Cbct, Dental>(nearest_rigid(m));
  if (j.contains("covariance") && !j["covariance"].is_null()) {
    GNATHION_TRY(options.covariance, covariance_from_json(j["covariance"], path.string()));
  }
  return {};
}

}  // namespace gnathion
