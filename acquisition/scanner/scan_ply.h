// Scans as PLY, with what each vertex knows about its own error.
#pragma once

#include <string>
#include <vector>

#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

/// A surface with the standard deviation of each vertex along its normal.
struct ScanSurface {
  TriangleMesh mesh;
  std::vector<double> deviation_mm;  ///< one a vertex
};

/// Binary little-endian PLY; vertex properties x, y, z (double), red, green, blue (where the mesh has them)
/// and deviation (float, mm). Readers that do not know `deviation` skip it.
std::string format_scan_ply(const ScanSurface& surface);
/// The `deviation` of each vertex of such a file, in the file's order. Error (kInput): none in it.
Result<std::vector<double>> scan_ply_deviation(const std::string& bytes, const std::string& name);

}  // namespace gnathion
