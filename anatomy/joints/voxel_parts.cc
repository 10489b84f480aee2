#include "anatomy/joints/voxel_parts.h"

#include <deque>

namespace gnathion {
namespace {

/// Calls f(index of the neighbour) for the up to six neighbours of a voxel.
template <class F>
void for_neighbours(const VoxelGrid& grid, std::size_t voxel, F&& f) {
  const auto nx = static_cast<std::size_t>(grid.size[0]), ny = static_cast<std::size_t>(grid.size[1]),
             nz = static_cast<std::size_t>(grid.size[2]);
  const std::size_t i = voxel % nx, j = voxel / nx % ny, k = voxel / (nx * ny);
  if (i > 0) f(voxel - 1);
  if (i + 1 < nx) f(voxel + 1);
  if (j > 0) f(voxel - nx);
  if (j + 1 < ny) f(voxel + nx);
  if (k > 0) f(voxel - nx * ny);
  if (k + 1 < nz) f(voxel + nx * ny);
}

/// Adds what is within `steps` faces of the set and not `blocked`.
void dilate(const VoxelGrid& grid, std::vector<std::uint8_t>& set, int steps,
            const std::vector<std::uint8_t>* blocked = nullptr) {
  std::vector<std::size_t> front, next;
  for (std::size_t v = 0; v < set.size(); ++v)
    if (set[v]) front.push_back(v);
  for (int s = 0; s < steps; ++s) {
    next.clear();
    for (const std::size_t v : front)
      for_neighbours(grid, v, [&](std::size_t n) {
        if (set[n] || (blocked != nullptr && (*blocked)[n])) return;
        set[n] = 1;
        next.push_back(n);
      });
    front.swap(next);
  }
}

/// On one face of the volume: the free pixels that hang together with the face's edge. They are outside.
void open_face(const VoxelGrid& grid, const std::vector<std::uint8_t>& wall, int axis, bool far,
               std::vector<std::size_t>& seeds) {
  const int a = (axis + 1) % 3, b = (axis + 2) % 3;
  const int na = grid.size[static_cast<std::size_t>(a)], nb = grid.size[static_cast<std::size_t>(b)];
  const auto voxel = [&](int u, int v) {
    std::array<int, 3> at{};
    at[static_cast<std::size_t>(axis)] = far ? grid.size[static_cast<std::size_t>(axis)] - 1 : 0;
    at[static_cast<std::size_t>(a)] = u;
    at[static_cast<std::size_t>(b)] = v;
    return grid.index(at[0], at[1], at[2]);
  };
  std::vector<std::uint8_t> seen(static_cast<std::size_t>(na) * static_cast<std::size_t>(nb), 0);
  std::vector<std::array<int, 2>> stack;
  const auto visit = [&](int u, int v) {
    if (u < 0 || v < 0 || u >= na || v >= nb) return;
    std::uint8_t& s =
        seen[static_cast<std::size_t>(v) * static_cast<std::size_t>(na) + static_cast<std::size_t>(u)];
    if (s || wall[voxel(u, v)]) return;
    s = 1;
    stack.push_back({u, v});
    seeds.push_back(voxel(u, v));
  };
  for (int u = 0; u < na; ++u) visit(u, 0), visit(u, nb - 1);
  for (int v = 0; v < nb; ++v) visit(0, v), visit(na - 1, v);
  while (!stack.empty()) {
    const auto [u, v] = stack.back();
    stack.pop_back();
    visit(u - 1, v), visit(u + 1, v), visit(u, v - 1), visit(u, v + 1);
  }
}

}  // namespace

VoxelParts parts_above(const Volume& volume, double level) {
  VoxelParts out;
  out.part.assign(volume.grid.count(), 0);
  out.voxels.push_back(0);
  std::vector<std::size_t> stack;
  for (std::size_t first = 0; first < out.part.size(); ++first) {
    if (out.part[first] != 0 || volume.value(first) < level) continue;
    const auto number = static_cast<std::int32_t>(out.voxels.size());
    out.voxels.push_back(0);
    out.part[first] = number;
    stack.push_back(first);
    while (!stack.empty()) {
      const std::size_t v = stack.back();
      stack.pop_back();
      ++out.voxels.back();
      for_neighbours(volume.grid, v, [&](std::size_t n) {
        if (out.part[n] != 0 || volume.value(n) < level) return;
        out.part[n] = number;
        stack.push_back(n);
      });
    }
  }
  return out;
}

void grow_parts(const Volume& volume, double level, VoxelParts& parts) {
  std::deque<std::size_t> front;
  for (std::size_t v = 0; v < parts.part.size(); ++v)
    if (parts.part[v] != 0) front.push_back(v);
  while (!front.empty()) {
    const std::size_t v = front.front();
    front.pop_front();
    for_neighbours(volume.grid, v, [&](std::size_t n) {
      if (parts.part[n] != 0 || volume.value(n) < level) return;
      parts.part[n] = parts.part[v];
      ++parts.voxels[static_cast<std::size_t>(parts.part[v])];
      front.push_back(n);
    });
  }
}

std::vector<std::uint8_t> enclosed_by(const VoxelGrid& grid, const std::vector<std::uint8_t>& part,
                                      int seal) {
  std::vector<std::uint8_t> wall = part;
  dilate(grid, wall, seal);
  std::vector<std::size_t> stack;
  for (int axis = 0; axis < 3; ++axis)
    for (const bool far : {false, true}) open_face(grid, wall, axis, far, stack);
  std::vector<std::uint8_t> outside(part.size(), 0);
  for (const std::size_t v : stack) outside[v] = 1;
  while (!stack.empty()) {
    const std::size_t v = stack.back();
    stack.pop_back();
    for_neighbours(grid, v, [&](std::size_t n) {
      if (outside[n] || wall[n]) return;
      outside[n] = 1;
      stack.push_back(n);
    });
  }
  dilate(grid, outside, seal, &part);
  std::vector<std::uint8_t> inside(part.size());
  for (std::size_t v = 0; v < part.size(); ++v) inside[v] = !part[v] && !outside[v];
  return inside;
}

}  // namespace gnathion
