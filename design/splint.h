// The splint: from two jaws and T_th to a printable solid with its verification (docs/design.md).
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/mesh.h"
#include "core/progress.h"
#include "core/result.h"
#include "core/transform.h"
#include "design/edits.h"
#include "design/flat_plane.h"
#include "design/parameters.h"
#include "design/verification.h"
#include "occlusion/arch.h"
#include "occlusion/teeth.h"

namespace gnathion {

/// All in Dental, both jaws in MI as scanned. The mandible arrives in MI (a caller with the mandible in
/// TP applies T_th⁻¹ first).
///
/// The arch that wears the splint is the support, the other one opposes it. On the maxilla the opposing arch
/// in TP is T_th·L0; on the mandible, which stays in MI, it is T_th⁻¹·U0.
struct SplintInputs {
  TriangleMesh maxilla, mandible_mi;
  Motion<Dental> therapeutic;  ///< T_th: L1 = T_th · L0
  /// S_occ of the support, open or closed, where it lies in MI; else the support's crowns are taken.
  std::optional<TriangleMesh> occlusal_surface = {};
  Arch arch = Arch::kMaxilla;  ///< that wears the splint
  /// Displacements of the mandible from MI, as recorded, that must run free from TP (freedom.h); may be
  /// empty.
  std::vector<Rigid3> excursions = {};
  SplintEdits edits = {};
  /// Of T_th's left perturbation (rotation, translation), rad and mm, where it is known.
  std::optional<Matrix6> therapeutic_covariance = {};

  bool on_maxilla() const { return arch == Arch::kMaxilla; }
  const TriangleMesh& support() const { return on_maxilla() ? maxilla : mandible_mi; }
  const TriangleMesh& opposing_mi() const { return on_maxilla() ? mandible_mi : maxilla; }
  Arch opposing_arch() const { return on_maxilla() ? Arch::kMandible : Arch::kMaxilla; }
  /// The opposing arch's motion from MI to TP, with the support at rest; S_occ goes with it.
  Rigid3 opposing_motion() const { return on_maxilla() ? therapeutic.rigid : therapeutic.rigid.inverse(); }
};

/// What is embossed, and where.
struct EmbossedLabel {
  std::string text;
  bool buccal = true;                   ///< else palatal or lingual
  double letter_mm = 0.0;               ///< height of the letters
  double width_mm = 0.0;                ///< of the text
  Vector3 centre_mm = Vector3::Zero();  ///< Dental
};

/// Wall-clock seconds of one named stage, in order.
using StageTimes = std::vector<std::pair<std::string, double>>;

struct SplintDesign {
  TriangleMesh splint;              ///< Dental; also present when the verdict is "fail"
  std::vector<float> thickness_mm;  ///< per vertex, to the other side of the wall; negative on rims
  std::vector<std::uint8_t> part;   ///< per vertex: SurfacePart of splint_field.h
  SplintParameters parameters;
  SplintVerification verification;
  std::vector<Gate> gates;
  std::string verdict;                ///< "pass" or "fail"
  std::vector<std::string> violated;  ///< names of the blocking gates that failed
  std::vector<std::string> warnings;
  StageTimes timing_s;
  ArchFrame arch;
  ToothPartition support_teeth;  ///< of the arch that wears the splint
  Arch worn_on = Arch::kMaxilla;
  Insertion insertion;  ///< direction in Dental
  SplintEdits edits;
  std::optional<EmbossedLabel> label;
  std::optional<FlatPlane> flat;  ///< of a stabilisation splint, in the design frame
  Rigid3 dental_from_design;
  /// For pictures and profiles, in Dental.
  TriangleMesh opposing_tp;          ///< L_TP; T_th⁻¹·U0 over a mandibular splint
  TriangleMesh occlusal_surface_tp;  ///< S_occ carried likewise
  TriangleMesh cavity;               ///< inner surface, down to the rim
  TriangleMesh outer;                ///< outer surface with the imprint
};

/// Builds and verifies. Refused (kInput) are jaws that occlusion/arch.h refuses; a splint that fails a gate
/// is a value with verdict "fail". Deterministic on any number of threads. `known`: name_jaws() of these
/// inputs and corrections, where the caller has it.
Result<SplintDesign> design_splint(const SplintInputs& inputs, const SplintParameters& parameters,
                                   Progress& progress, const NamedJaws* known = nullptr);

/// One input file as it stands in design.json and in the 3MF.
struct InputRecord {
  std::string path, sha256;
};

/// design.json: exactly the keys of the contract. `total_s` and `peak_rss_mib` from the caller.
nlohmann::json design_json(const SplintDesign& design, const std::vector<InputRecord>& inputs,
                           const std::string& version, double total_s, double peak_rss_mib);

/// The same splint turned into the design of a command's caller: metadata for write_3mf.
std::vector<std::pair<std::string, std::string>> splint_metadata(const SplintDesign& design,
                                                                 const Motion<Dental>& therapeutic,
                                                                 const std::vector<InputRecord>& inputs);

}  // namespace gnathion
