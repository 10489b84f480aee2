// How a surface goes wrong on its way through printer and scanner; internal to the virtual print.
#pragma once

#include "core/mesh.h"
#include "core/random.h"
#include "evaluation/virtual_print.h"

namespace gnathion {

/// The mesh rounded off as by a Gaussian blur of the solid with standard deviation `radius_mm`, to first
/// order: the surface moves by −½r²·(κ1 + κ2) along its normal.
TriangleMesh blurred(const TriangleMesh& mesh, double radius_mm);

/// One draw of the printer's faults: `printed_from` the design's vertices, one by one.
TriangleMesh print_virtually(const TriangleMesh& design, const ArchFrame& arch, const PrintErrorModel& model,
                             Random& random);
/// One draw of the scanner's faults, before the scan gets its own frame.
TriangleMesh scan_virtually(const TriangleMesh& surface, const ArchFrame& arch, const ScanErrorModel& model,
                            Random& random);

/// Rigid motion with normally distributed shifts and turns about the arch's axes and origin; the vertical
/// shift is taken downwards, away from what lies above.
Rigid3 drawn_motion(const ArchFrame& arch, const Vector3& shift_sigma_mm, double turn_sigma_deg,
                    Random& random);

/// The rigid motion that brings `from` onto `to` in least squares (Arun 1987), over the vertices marked in
/// `use`.
Rigid3 best_motion(const std::vector<Vector3>& from, const std::vector<Vector3>& to,
                   const std::vector<std::uint8_t>& use);

}  // namespace gnathion
