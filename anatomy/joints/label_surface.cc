#include <algorithm>

#include "anatomy/joints/joints.h"
#include "anatomy/volume/iso_surface.h"

namespace gnathion {

Result<TriangleMesh> surface_of_labels(const Volume& labels, const std::vector<int>& which,
                                       const std::optional<Box>& box_mm, const std::string& name) {
  // Only the labelled part, two voxels around it.
  const Volume* from = &labels;
  Volume part;
  if (box_mm) part = cropped(labels, *box_mm), from = &part;
  if (from->empty()) return bad_input("cannot read labels", name, "the box lies outside the label map");
  std::array<int, 3> low = from->grid.size, high{-1, -1, -1};
  const auto wanted_in = [&](int i, int j, int k) {
    const double x = from->value(i, j, k);
    return x == std::floor(x) && std::find(which.begin(), which.end(), static_cast<int>(x)) != which.end();
  };
  for (int k = 0; k < from->grid.size[2]; ++k)
    for (int j = 0; j < from->grid.size[1]; ++j)
      for (int i = 0; i < from->grid.size[0]; ++i) {
        if (!wanted_in(i, j, k)) continue;
        const std::array<int, 3> at{i, j, k};
        for (std::size_t a = 0; a < 3; ++a)
          low[a] = std::min(low[a], at[a]), high[a] = std::max(high[a], at[a]);
      }
  if (high[0] < 0) return bad_input("cannot read labels", name, "no voxel carries the label");
  Volume field;
  field.grid = from->grid;
  field.grid.origin_mm = from->grid.frame_from_voxel(Vector3(low[0] - 2, low[1] - 2, low[2] - 2));
  for (std::size_t a = 0; a < 3; ++a) field.grid.size[a] = high[a] - low[a] + 5;
  field.voxels.assign(field.grid.count(), 0.0f);
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int i = low[0]; i <= high[0]; ++i)
        if (wanted_in(i, j, k))
          field.voxels[field.grid.index(i - low[0] + 2, j - low[1] + 2, k - low[2] + 2)] = 1.0f;
  // A binomial of three voxels along each axis takes the stairs off; a ball of 4 mm shrinks by 0.01 mm for
  // it.
  for (std::size_t a = 0; a < 3; ++a) {
    const std::size_t stride = a == 0   ? 1
                               : a == 1 ? static_cast<std::size_t>(field.grid.size[0])
                                        : static_cast<std::size_t>(field.grid.size[0]) *
                                              static_cast<std::size_t>(field.grid.size[1]);
    const std::vector<float> before = field.voxels;
    for (std::size_t v = stride; v + stride < before.size(); ++v)
      field.voxels[v] = 0.25f * before[v - stride] + 0.5f * before[v] + 0.25f * before[v + stride];
  }
  return iso_surface(field, 0.5);
}

}  // namespace gnathion
