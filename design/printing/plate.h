// Several splints on the printer's plates, and the compensation of what the printer does to lengths.
#pragma once

#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"
#include "design/printing/printer_profile.h"

namespace gnathion {

/// p' = linear * p + translation_mm: a rigid placement with the compensation's scale along the plate's axes.
struct PlatePlacement {
  Matrix3 linear = Matrix3::Identity();
  Vector3 translation_mm = Vector3::Zero();
  std::size_t plate = 0;
  Vector3 operator*(const Vector3& p) const { return linear * p + translation_mm; }
};

/// Turned with `up` away from the plate, laid out in rows, scaled by 1 / printed_scale about its place, and
/// lifted. In the order given; a new plate begins where the last one is full. Plate coordinates: origin at
/// the corner, x and y along the edges, z up. Refused (kGate): a part that no plate holds.
Result<std::vector<PlatePlacement>> laid_out(const std::vector<const TriangleMesh*>& parts,
                                             const std::vector<Vector3>& up,
                                             const std::vector<std::string>& names,
                                             const PrinterProfile& profile);

TriangleMesh placed(const PlatePlacement& placement, const TriangleMesh& mesh);

}  // namespace gnathion
