// Which tooth a vertex belongs to.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "occlusion/arch.h"

namespace gnathion {

/// FDI numbers in the order of the arch curve, right to left: 18…11 21…28, or 48…41 31…38.
std::vector<std::uint8_t> fdi_order(Arch arch);
/// +1 for the patient's left (quadrants 2 and 3), −1 for the right; 0 for "no tooth".
int fdi_side(std::uint8_t fdi);
/// Position in the quadrant, 1 (central incisor) to 8; 0 for "no tooth".
int fdi_position(std::uint8_t fdi);
/// Incisors and canines.
inline bool fdi_is_front(std::uint8_t fdi) {
  return fdi_position(fdi) >= 1 && fdi_position(fdi) <= 3;
}
/// Mean mesiodistal crown width, mm (Wheeler's dental anatomy; Ash & Nelson 2003).
double mean_crown_width_mm(std::uint8_t fdi);
/// Mean height of the anatomical crown, mm (same source).
double mean_crown_height_mm(std::uint8_t fdi);

/// Corrections by hand of what partition_teeth() would find. Entries of the other arch are left alone.
struct ToothCorrections {
  std::vector<std::uint8_t> missing;  ///< FDI numbers of teeth that are not there, gap closed or open
  struct Label {
    std::uint8_t fdi = 0;
    Vector3 at_mm = Vector3::Zero();  ///< on that tooth, in the frame of the mesh
  };
  std::vector<Label> labels;
  bool empty() const { return missing.empty() && labels.empty(); }
};

/// The crowns of one arch, cut at the interdental minima along the arch curve.
struct ToothPartition {
  std::vector<std::uint8_t> fdi;      ///< per tooth, right to left; 0: the place of a missing one
  std::vector<double> boundaries_mm;  ///< fdi.size() + 1 arc lengths from the midline (ArchRuler), ascending
  double cost = 0.0;                  ///< of the dynamic programme; lower is better
};
/// Empty where no partition agrees with the corrections.
ToothPartition partition_teeth(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                               const ToothCorrections& corrections = {});

/// The teeth of one arch.
struct ArchTeeth {
  ToothPartition partition;
  std::vector<std::uint8_t> fdi;  ///< of every vertex; 0 for gingiva, palate and base
};
ArchTeeth find_teeth(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                     const ToothCorrections& corrections = {});

/// A pair of jaws with its orientation and teeth: found once, asked by many steps.
struct NamedJaws {
  ArchFrame arch;
  ArchTeeth maxilla, mandible;
  const ArchTeeth& of(Arch which) const { return which == Arch::kMaxilla ? maxilla : mandible; }
};
/// Refused as by find_arch(). Where no partition agrees with the corrections that arch has no teeth.
Result<NamedJaws> name_jaws(const TriangleMesh& maxilla, const TriangleMesh& mandible_mi,
                            const ToothCorrections& corrections = {});

/// FDI number of every vertex; 0 for gingiva, palate and base.
std::vector<std::uint8_t> assign_teeth(const TriangleMesh& arch_mesh, const ArchFrame& frame, Arch which,
                                       const ToothCorrections& corrections = {});

}  // namespace gnathion
