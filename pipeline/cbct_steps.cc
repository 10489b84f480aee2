#include "pipeline/cbct_steps.h"

#include <fmt/format.h>

#include <algorithm>

#include "anatomy/realizability.h"
#include "anatomy/volume/iso_surface.h"
#include "occlusion/arch.h"
#include "occlusion/teeth.h"

namespace gnathion {

std::vector<bool> crown_mask(const TriangleMesh& arch, const ArchFrame& frame, Arch which) {
  std::vector<bool> mask;
  for (const std::uint8_t fdi : assign_teeth(arch, frame, which)) mask.push_back(fdi != 0);
  return mask;
}

namespace {

constexpr const char* kWhat = "cannot find joints";
/// A mandible that lies less beside MI than this at the condyles was in MI, as far as a bite repeats itself.
constexpr double kInMiMm = 0.3;

/// How the mandible lay in the scan, by its own crowns.
struct MandibleInScan {
  Rigid3 cbct_from_mandible;
  Matrix6 covariance = Matrix6::Zero();  ///< of the left perturbation, in Cbct
  bool in_mi = true;
  bool found = false;  ///< else MI is only assumed
  std::string note;
};

MandibleInScan find_mandible(const RegisteredVolume& volume, const TriangleMesh& mandible,
                             const ArchFrame& frame, const CbctOptions& options) {
  MandibleInScan out;
  out.cbct_from_mandible = volume.cbct_from_dental.rigid;
  const std::vector<bool> crowns = crown_mask(mandible, frame, Arch::kMandible);
  const auto look = [&](const std::optional<Rigid3>& guess) {
    return register_crowns(volume.file.volume, mandible, crowns, options, guess,
                           "lower crowns in the volume");
  };
  auto found = look(volume.cbct_from_dental.rigid);
  if (!found || found->fit.inlier_fraction < 0.45) {
    auto anywhere = look({});
    if (anywhere || !found) found = std::move(anywhere);
  }
  if (!found) {
    out.note = "the lower teeth are not found in the volume (" + found.error().why +
               "): the scan is taken to be in MI";
    return out;
  }
  out.found = true;
  const Rigid3 beside_mi = volume.cbct_from_dental.rigid.inverse() * found->fit.target_from_source;
  double most = 0.0, sigma = 0.0;
  for (const Side side : {Side::kLeft, Side::kRight}) {
    const Vector3 p = mean_condyle_mm(frame, side), q = found->fit.target_from_source * p;
    most = std::max(most, (beside_mi * p - p).norm());
    double variance = point_covariance(found->fit.covariance, q).trace();
    if (volume.covariance) variance += point_covariance(*volume.covariance, q).trace();
    sigma = std::max(sigma, std::sqrt(variance));
  }
  if (most < std::max(kInMiMm, 3.0 * sigma)) return out;
  out.in_mi = false;
  out.cbct_from_mandible = found->fit.target_from_source;
  out.covariance = found->fit.covariance;
  out.note = fmt::format(
      "the scan was not taken in MI: by the lower teeth the condyles lay up to {:.1f} mm beside it, and were "
      "brought "
      "there (1 sigma {:.2f} mm)",
      most, sigma);
  return out;
}

/// Around where a condyle should be, and where this mandible had it. Arches tell it within a centimetre or
/// so: the head's top is looked for in a wide box, and the box is set about it.
Result<JointRegion> found_region(const Volume& volume, double level, const ArchFrame& frame, Side side,
                                 const Rigid3& cbct_from_dental, const Rigid3& cbct_from_mandible,
                                 std::vector<std::string>& warnings) {
  const Vector3 centre = mean_condyle_mm(frame, side), of_mandible = cbct_from_mandible * centre;
  const Box whole = volume.grid.box_mm();
  constexpr double kHeadMm = 8.0;
  for (const Rigid3& pose : {cbct_from_dental, cbct_from_mandible}) {
    const Vector3 p = pose * centre;
    if ((p - Vector3::Constant(kHeadMm) - whole.min_mm).minCoeff() < 0.0 ||
        (whole.max_mm - Vector3::Constant(kHeadMm) - p).minCoeff() < 0.0)
      return bad_input(kWhat, std::string(side_name(side)) + " joint",
                       "the volume does not contain the joint: it ends before where the arch says it is");
  }
  Box wide;
  wide.extend((of_mandible - Vector3(22, 26, 26)).cwiseMax(whole.min_mm));
  wide.extend((of_mandible + Vector3(22, 26, 24)).cwiseMin(whole.max_mm));
  const Vector3 top =
      condyle_top(volume, level, wide, of_mandible, 18.0).value_or(of_mandible + Vector3(0, 0, 5));
  // A roof that is cut off leaves the fossa's side walls, and these a distance that is too large.
  constexpr double kAboveMm = 5.0, kBesideMm = 8.0;
  const double above = whole.max_mm.z() - top.z();
  const double beside =
      std::min((whole.max_mm - top).head<2>().minCoeff(), (top - whole.min_mm).head<2>().minCoeff());
  if (above < kAboveMm || beside < kBesideMm)
    warnings.push_back(fmt::format(
        "{} joint: the volume ends {:.1f} mm {} the condyle: the fossa may be cut off, and "
        "the true distance smaller",
        side_name(side), above < kAboveMm ? above : beside, above < kAboveMm ? "above" : "beside"));
  JointRegion region;  // as far as the volume goes: a head has room above its joints, a field of view may not
  region.box_mm.extend((top - Vector3(17, 20, 20)).cwiseMax(whole.min_mm));
  region.box_mm.extend((top + Vector3(17, 17, 10)).cwiseMin(whole.max_mm));
  return region;
}

class JointFinder {
 public:
  JointFinder(const RegisteredVolume& volume, const ArchFrame& frame, const MandibleInScan& mandible,
              const CbctOptions& options, std::optional<Volume> labels)
      : volume_(volume), frame_(frame), mandible_(mandible), options_(options), labels_(std::move(labels)) {
    level_ = options.bone_level ? *options.bone_level : tissue_levels(volume.file.volume).bone;
  }
  double level() const { return level_; }

  Result<Joint> find(Side side, std::vector<std::string>& warnings) const {
    const auto& given = side == Side::kLeft ? options_.left : options_.right;
    JointRegion region;
    if (given) {
      region = *given;
    } else {
      GNATHION_TRY(region,
                   found_region(volume_.file.volume, level_, frame_, side, volume_.cbct_from_dental.rigid,
                                mandible_.cbct_from_mandible, warnings));
    }
    GNATHION_TRY(const JointSurfaces s, surfaces(side, region, warnings));
    Joint joint;
    joint.side = side;
    joint.condyle = transformed(mandible_.cbct_from_mandible.inverse(), s.condyle);
    joint.fossa = transformed(volume_.cbct_from_dental.rigid.inverse(), s.fossa);
    const CondylarPoles poles = condylar_poles(joint.condyle, side, frame_.up, frame_.left);
    joint.medial_pole_mm = poles.medial_mm;
    joint.lateral_pole_mm = poles.lateral_mm;
    return joint;
  }

 private:
  Result<JointSurfaces> surfaces(Side side, const JointRegion& region,
                                 std::vector<std::string>& warnings) const {
    const std::string name = std::string(side_name(side)) + " joint";
    JointSurfaces s;
    const bool condyle_label = labels_ && !options_.condyle_labels.empty();
    const bool fossa_label = labels_ && !options_.fossa_labels.empty();
    if (!condyle_label || !fossa_label) {
      GNATHION_TRY(s, find_joint(volume_.file.volume, level_, region, name));
      if (s.bridged)
        warnings.push_back(
            name +
            ": condyle and fossa hang together at this bone level; where they come close, their "
            "distance is known to a voxel only");
    }
    if (condyle_label) {
      GNATHION_TRY(s.condyle, surface_of_labels(*labels_, options_.condyle_labels, region.box_mm, name));
    }
    if (fossa_label) {
      GNATHION_TRY(s.fossa, surface_of_labels(*labels_, options_.fossa_labels, region.box_mm, name));
    }
    return s;
  }

  const RegisteredVolume& volume_;
  const ArchFrame& frame_;
  const MandibleInScan& mandible_;
  const CbctOptions& options_;
  std::optional<Volume> labels_;
  double level_ = 0.0;
};

/// Covariance of the inverse pose, which brings the volume's surfaces to the dental frame.
Matrix6 brought_back(const Matrix6& covariance, const Rigid3& cbct_from_other) {
  return inverse_covariance(covariance, cbct_from_other);
}

}  // namespace

Result<RegisteredVolume> registered_volume(const std::filesystem::path& path, const TriangleMesh& maxilla,
                                           const TriangleMesh& mandible_mi, const CbctOptions& options,
                                           Progress& progress) {
  progress.begin_step("reading volume", 0.3);
  RegisteredVolume out;
  GNATHION_TRY(out.file, read_volume(path, options.read, progress));
  if (options.cbct_from_dental) {
    out.cbct_from_dental = *options.cbct_from_dental;
    out.covariance = options.covariance;
    return out;
  }
  progress.begin_step("upper crowns in the volume", 0.3);
  GNATHION_TRY(const ArchFrame frame, find_arch(maxilla, mandible_mi));
  GNATHION_TRY(const CbctRegistration found,
               register_crowns(out.file.volume, maxilla, crown_mask(maxilla, frame, Arch::kMaxilla), options,
                               {}, "upper crowns in the volume"));
  out.cbct_from_dental.rigid = found.fit.target_from_source;
  out.covariance = found.fit.covariance;
  return out;
}

Result<Joints> joints_in_volume(const RegisteredVolume& registered, const TriangleMesh& maxilla,
                                const TriangleMesh& mandible_mi, const CbctOptions& options,
                                Progress& progress) {
  GNATHION_TRY(const ArchFrame frame, find_arch(maxilla, mandible_mi));
  progress.begin_step("lower crowns in the volume", 0.2);
  const MandibleInScan mandible = find_mandible(registered, mandible_mi, frame, options);
  progress.begin_step("joints", 0.2);
  std::optional<Volume> labels;
  if (!options.labels.empty()) {
    SilentProgress silent;
    GNATHION_TRY(VolumeFile file, read_volume(options.labels, options.read, silent));
    labels = std::move(file.volume);
  }
  const JointFinder finder(registered, frame, mandible, options, std::move(labels));
  Joints joints;
  joints.source = fmt::format("{}, bone above {:.0f}", registered.file.info.format, finder.level());
  joints.surface_sigma_mm = 0.5 * registered.file.volume.grid.spacing_mm().maxCoeff();
  if (!mandible.note.empty()) joints.warnings.push_back(mandible.note);
  if (mandible.in_mi && !mandible.found) {
    joints.mi_assumed = true;
  } else if (mandible.in_mi) {
    joints.condyle_covariance = joints.fossa_covariance = Matrix6::Zero();
  } else {
    joints.condyle_covariance = brought_back(mandible.covariance, mandible.cbct_from_mandible);
    joints.scanned_from_mi.rigid = registered.cbct_from_dental.rigid.inverse() * mandible.cbct_from_mandible;
    if (registered.covariance)
      joints.fossa_covariance = brought_back(*registered.covariance, registered.cbct_from_dental.rigid);
  }
  std::optional<Error> why;
  for (const Side side : {Side::kLeft, Side::kRight}) {
    auto found = finder.find(side, joints.warnings);
    if (found) {
      (side == Side::kLeft ? joints.left : joints.right) = std::move(*found);
    } else {
      joints.warnings.push_back(fmt::format("{} joint: {}", side_name(side), found.error().why));
      if (!why) why = found.error();
    }
  }
  if (joints.empty()) return tl::unexpected<Error>(*why);
  return joints;
}

Result<Joints> joints_from_cbct(const std::filesystem::path& path, const TriangleMesh& maxilla,
                                const TriangleMesh& mandible_mi, const CbctOptions& options,
                                Progress& progress) {
  std::error_code ec;
  if (!std::filesystem::exists(path, ec))
    return bad_input(kWhat, path.string(), "there is no such file or folder");
  if (std::filesystem::is_directory(path, ec) && holds_joint_meshes(path)) {
    GNATHION_TRY(const ArchFrame frame, find_arch(maxilla, mandible_mi));
    return read_joint_meshes(path, frame.up, frame.left);
  }
  GNATHION_TRY(const RegisteredVolume registered,
               registered_volume(path, maxilla, mandible_mi, options, progress));
  GNATHION_TRY(Joints joints, joints_in_volume(registered, maxilla, mandible_mi, options, progress));
  const std::vector<std::string>& odd = registered.file.info.warnings;
  joints.warnings.insert(joints.warnings.end(), odd.begin(), odd.end());
  return joints;
}

}  // namespace gnathion
