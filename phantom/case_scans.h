// The scans of a phantom's case: what each instrument has before it, and where its frame lies.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "phantom/case.h"

namespace gnathion {

enum class PhantomScanKind {
  kMaxillaMi,
  kMandibleMi,
  kMaxillaTp,
  kMandibleTp,
  kMandibleClutch,
  kFaceMi,
  kFaceTp
};
inline constexpr std::array<PhantomScanKind, 7> kPhantomScans = {
    PhantomScanKind::kMaxillaMi,  PhantomScanKind::kMandibleMi,     PhantomScanKind::kMaxillaTp,
    PhantomScanKind::kMandibleTp, PhantomScanKind::kMandibleClutch, PhantomScanKind::kFaceMi,
    PhantomScanKind::kFaceTp};

const char* file_stem(PhantomScanKind kind);  ///< "maxilla_mi", …

/// One scan in its own frame. Each kind draws from a random stream of its own, so the order does not matter.
/// `scanner_seed` draws the scanners' scales: repeats by the same scanners share it; none: the seed itself.
TriangleMesh simulate_phantom_scan(const PhantomPatient& patient, const PhantomScanPoses& poses,
                                   PhantomScanKind kind, std::uint64_t seed,
                                   std::optional<std::uint64_t> scanner_seed = {});

/// What follows from the patient and the scans' poses: the true values of what calibration estimates.
struct PhantomTruth {
  Transform<Bow, FaceScanMi> bow_from_face;        ///< T_F
  Transform<Dental, FaceScanMi> dental_from_face;  ///< T
  Motion<FaceScanMi> bow_motion;                   ///< T_B, head motion removed
  Transform<FaceScanMi, FaceScanTp> face_mi_from_face_tp;
  Transform<FaceScanTp, Bow> face_tp_from_bow;  ///< where the bow is seen in TP
};
PhantomTruth phantom_truth(const PhantomPatient& patient, const PhantomScanPoses& poses);

}  // namespace gnathion
