// Slices of one series put in order by where they lie.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "anatomy/volume/dicom_file.h"

namespace gnathion {

/// A picture among the files of a series.
struct SliceRef {
  std::size_t file = 0, plane = 0;
  bool operator==(const SliceRef&) const = default;
};

struct SliceStack {
  VoxelGrid grid;
  /// For each k of the grid the picture, or nothing where one is missing between two others.
  std::vector<std::optional<SliceRef>> slices;
  /// Pictures at the place of another: equal pixels, or the series cannot be used.
  struct Twin {
    SliceRef kept, other;
  };
  std::vector<Twin> twins;
  double tilt_deg = 0.0;
  std::vector<std::string> warnings;
};

/// Orders the placed pictures of one series along the normal of their planes, never by name or number. Drops
/// localizers and pictures of another orientation, by name. Refused (kInput): pictures without a place
/// (photographs, secondary captures), colour, uneven spacing, more missing slices than one in fifty or two in
/// a row. `only_one`: a single slice is enough.
Result<SliceStack> stack_slices(const std::vector<DicomHeader>& files, const std::string& name,
                                bool only_one = false);

}  // namespace gnathion
