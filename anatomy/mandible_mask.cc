#include "anatomy/mandible_mask.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot tell the mandible's voxels";

/// The voxels whose centres lie in a box of the frame; grown by `margin`, within the volume.
VoxelMask part_of(const VoxelGrid& grid, const Box& box_mm, int margin) {
  Box in_voxels;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector3 p((corner & 1 ? box_mm.max_mm : box_mm.min_mm).x(),
                    (corner & 2 ? box_mm.max_mm : box_mm.min_mm).y(),
                    (corner & 4 ? box_mm.max_mm : box_mm.min_mm).z());
    in_voxels.extend(grid.voxel_from_frame(p));
  }
  VoxelMask mask;
  for (std::size_t a = 0; a < 3; ++a) {
    const auto axis = static_cast<Eigen::Index>(a);
    const double last = grid.size[a] - 1;
    const double low = std::clamp(std::floor(in_voxels.min_mm[axis]) - margin, 0.0, last + 1.0);
    const double high = std::clamp(std::ceil(in_voxels.max_mm[axis]) + margin, -1.0, last);
    mask.low[a] = static_cast<int>(low);
    mask.size[a] = std::max(0, static_cast<int>(high) - mask.low[a] + 1);
  }
  mask.inside.assign(static_cast<std::size_t>(mask.size[0]) * static_cast<std::size_t>(mask.size[1]) *
                         static_cast<std::size_t>(mask.size[2]),
                     0);
  return mask;
}

/// Index of the voxel nearest to a point in the mask's part; nothing outside.
std::optional<std::array<int, 3>> voxel_at(const VoxelGrid& grid, const VoxelMask& mask,
                                           const Vector3& p_mm) {
  const Vector3 v = grid.voxel_from_frame(p_mm);
  std::array<int, 3> at{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double i = std::round(v[static_cast<Eigen::Index>(a)]) - mask.low[a];
    if (!(i >= 0.0 && i < mask.size[a])) return std::nullopt;
    at[a] = static_cast<int>(i);
  }
  return at;
}

template <class Visit>
void neighbours(const VoxelMask& mask, const std::array<int, 3>& at, Visit visit) {
  for (std::size_t a = 0; a < 3; ++a)
    for (const int d : {-1, 1}) {
      std::array<int, 3> n = at;
      n[a] += d;
      if (n[a] >= 0 && n[a] < mask.size[a]) visit(n);
    }
}

std::size_t index_of(const VoxelMask& mask, const std::array<int, 3>& at) {
  return mask.index(at[0], at[1], at[2]);
}

/// What a slice across axis k encloses belongs to it: marrow.
void fill_slices(VoxelMask* mask) {
  const int ni = mask->size[0], nj = mask->size[1];
  std::vector<std::uint8_t> outside(static_cast<std::size_t>(ni) * static_cast<std::size_t>(nj));
  std::vector<std::array<int, 2>> open;
  for (int k = 0; k < mask->size[2]; ++k) {
    std::fill(outside.begin(), outside.end(), std::uint8_t{0});
    const auto reach = [&](int i, int j) {
      if (i < 0 || j < 0 || i >= ni || j >= nj || mask->inside[mask->index(i, j, k)]) return;
      std::uint8_t& seen =
          outside[static_cast<std::size_t>(j) * static_cast<std::size_t>(ni) + static_cast<std::size_t>(i)];
      if (seen) return;
      seen = 1;
      open.push_back({i, j});
    };
    for (int i = 0; i < ni; ++i) reach(i, 0), reach(i, nj - 1);
    for (int j = 0; j < nj; ++j) reach(0, j), reach(ni - 1, j);
    while (!open.empty()) {
      const auto [i, j] = open.back();
      open.pop_back();
      reach(i - 1, j), reach(i + 1, j), reach(i, j - 1), reach(i, j + 1);
    }
    for (int j = 0; j < nj; ++j)
      for (int i = 0; i < ni; ++i)
        if (!outside[static_cast<std::size_t>(j) * static_cast<std::size_t>(ni) +
                     static_cast<std::size_t>(i)])
          mask->inside[mask->index(i, j, k)] = 1;
  }
}

/// One voxel more, where `may` allows it.
template <class May>
void grow(VoxelMask* mask, May may) {
  std::vector<std::size_t> more;
  for (int k = 0; k < mask->size[2]; ++k)
    for (int j = 0; j < mask->size[1]; ++j)
      for (int i = 0; i < mask->size[0]; ++i) {
        const std::array<int, 3> at{i, j, k};
        const std::size_t index = index_of(*mask, at);
        if (mask->inside[index] || !may(index)) continue;
        bool beside = false;
        neighbours(*mask, at, [&](const auto& n) { beside |= mask->inside[index_of(*mask, n)] != 0; });
        if (beside) more.push_back(index);
      }
  for (const std::size_t index : more) mask->inside[index] = 1;
}

}  // namespace

std::size_t VoxelMask::count() const {
  return static_cast<std::size_t>(std::count(inside.begin(), inside.end(), std::uint8_t{1}));
}

Result<VoxelMask> mandible_from_bone(const Volume& volume, double level, const std::vector<Vector3>& seeds_mm,
                                     const std::vector<Vector3>& not_these_mm, const Box& box_mm) {
  const VoxelGrid& grid = volume.grid;
  VoxelMask mask = part_of(grid, box_mm, 0);
  if (mask.inside.empty()) return bad_input(kWhat, "box", "it lies outside the volume");
  std::vector<std::uint8_t> bone(mask.inside.size(), 0);
  for (int k = 0; k < mask.size[2]; ++k)
    for (int j = 0; j < mask.size[1]; ++j)
      for (int i = 0; i < mask.size[0]; ++i)
        bone[mask.index(i, j, k)] = volume.value(mask.low[0] + i, mask.low[1] + j, mask.low[2] + k) >= level;

  std::vector<std::array<int, 3>> open;
  const auto reach = [&](const std::array<int, 3>& at) {
    const std::size_t index = index_of(mask, at);
    if (!bone[index] || mask.inside[index]) return;
    mask.inside[index] = 1;
    open.push_back(at);
  };
  // A point of the surface lies between a bone voxel and one that is not.
  for (const Vector3& p : seeds_mm)
    if (const auto at = voxel_at(grid, mask, p)) {
      reach(*at);
      neighbours(mask, *at, reach);
    }
  if (open.empty()) return bad_input(kWhat, "seeds", "there is no bone at them");
  while (!open.empty()) {
    const auto at = open.back();
    open.pop_back();
    neighbours(mask, at, reach);
  }
  std::size_t shared = 0, asked = 0;
  for (const Vector3& p : not_these_mm)
    if (const auto at = voxel_at(grid, mask, p)) {
      ++asked;
      shared += mask.inside[index_of(mask, *at)];
    }
  if (20 * shared > asked)
    return bad_input(kWhat, "condyle and fossa", "they are one piece of bone at this level: raise it");
  fill_slices(&mask);
  // The rim of partial volume goes with the bone, but the fossa's bone and its rim stay.
  grow(&mask, [&](std::size_t index) { return !bone[index]; });
  return mask;
}

Result<VoxelMask> mandible_from_labels(const Volume& volume, const Volume& labels,
                                       const std::vector<int>& which, const Box& box_mm) {
  VoxelMask mask = part_of(volume.grid, box_mm, 0);
  if (mask.inside.empty()) return bad_input(kWhat, "box", "it lies outside the volume");
  for (int k = 0; k < mask.size[2]; ++k)
    for (int j = 0; j < mask.size[1]; ++j)
      for (int i = 0; i < mask.size[0]; ++i) {
        const Vector3 p =
            volume.grid.frame_from_voxel(Vector3(mask.low[0] + i, mask.low[1] + j, mask.low[2] + k));
        const Vector3 v = labels.grid.voxel_from_frame(p);
        std::array<int, 3> at{};
        bool there = true;
        for (std::size_t a = 0; a < 3; ++a) {
          const double r = std::round(v[static_cast<Eigen::Index>(a)]);
          there = there && r >= 0.0 && r < labels.grid.size[a];
          at[a] = there ? static_cast<int>(r) : 0;
        }
        if (!there) continue;
        const int label = static_cast<int>(std::lround(labels.value(at[0], at[1], at[2])));
        mask.inside[mask.index(i, j, k)] = std::find(which.begin(), which.end(), label) != which.end();
      }
  if (mask.count() == 0) return bad_input(kWhat, "label map", "none of the labels is in the box");
  grow(&mask, [](std::size_t) { return true; });
  return mask;
}

}  // namespace gnathion
