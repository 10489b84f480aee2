#include "phantom/jaws_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include <tbb/parallel_for.h>

namespace gnathion {
namespace {

constexpr int kBlock = 4;

/// A dense grid of samples; far from the surface only the sign counts.
struct Grid {
  Vector3 origin_mm;
  double step_mm = 0.3;
  int nx = 0, ny = 0, nz = 0;
  std::vector<float> value;

  std::size_t at(int x, int y, int z) const {
    return (static_cast<std::size_t>(z) * static_cast<std::size_t>(ny) + static_cast<std::size_t>(y)) *
               static_cast<std::size_t>(nx) +
           static_cast<std::size_t>(x);
  }
  Vector3 point(int x, int y, int z) const { return origin_mm + step_mm * Vector3(x, y, z); }
};

Grid sampled(const SurfaceField& field, const Box& box, double step) {
  Grid grid;
  grid.step_mm = step;
  grid.origin_mm = box.min_mm;
  const auto blocks = [&](double size) {
    return std::max(1, static_cast<int>(std::ceil(size / step / kBlock)));
  };
  const Vector3 size = box.size_mm();
  const int bx = blocks(size.x()), by = blocks(size.y()), bz = blocks(size.z());
  grid.nx = bx * kBlock;
  grid.ny = by * kBlock;
  grid.nz = bz * kBlock;
  grid.value.assign(static_cast<std::size_t>(grid.nx) * grid.ny * grid.nz, 1.0f);
  // The fields are first-order distances whose slope may reach 1.5 in places.
  const double far = 1.5 * 0.5 * std::sqrt(3.0) * kBlock * step + 0.3;
  tbb::parallel_for(0, bx * by * bz, [&](int b) {
    const int x0 = b % bx * kBlock, y0 = b / bx % by * kBlock, z0 = b / (bx * by) * kBlock;
    const double half = 0.5 * (kBlock - 1);
    const double centre = field(grid.origin_mm + step * Vector3(x0 + half, y0 + half, z0 + half));
    for (int z = z0; z < z0 + kBlock; ++z) {
      for (int y = y0; y < y0 + kBlock; ++y) {
        for (int x = x0; x < x0 + kBlock; ++x) {
          const double v = std::abs(centre) > far ? centre : field(grid.point(x, y, z));
          grid.value[grid.at(x, y, z)] = static_cast<float>(std::clamp(v, -9.0, 9.0));
        }
      }
    }
  });
  return grid;
}

/// Whether the inside corners, and the outside ones, each hang together along edges of the cell: then the
/// surface passes the cell in one sheet.
std::array<bool, 256> simple_cells() {
  std::array<bool, 256> simple{};
  const auto parts = [](int mask) {
    int seen = 0, count = 0;
    for (int start = 0; start < 8; ++start) {
      if (!(mask >> start & 1) || (seen >> start & 1)) continue;
      ++count;
      int open = 1 << start;
      while (open) {
        seen |= open;
        int next = 0;
        for (int c = 0; c < 8; ++c) {
          if (!(open >> c & 1)) continue;
          for (const int bit : {1, 2, 4}) next |= 1 << (c ^ bit);
        }
        open = next & mask & ~seen;
      }
    }
    return count;
  };
  for (int mask = 0; mask < 256; ++mask) simple[mask] = parts(mask) <= 1 && parts(255 - mask) <= 1;
  return simple;
}

int corner_mask(const Grid& g, int x, int y, int z) {
  int mask = 0;
  for (int c = 0; c < 8; ++c) {
    if (g.value[g.at(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2 & 1))] < 0.0f) mask |= 1 << c;
  }
  return mask;
}

using Cells = std::vector<std::array<int, 3>>;

/// The cells that the surface does not pass in one sheet.
Cells cells_to_mend(const Grid& g, const std::array<bool, 256>& simple) {
  std::vector<Cells> by_slice(g.nz - 1);
  tbb::parallel_for(0, g.nz - 1, [&](int z) {
    for (int y = 0; y + 1 < g.ny; ++y) {
      for (int x = 0; x + 1 < g.nx; ++x) {
        if (!simple[corner_mask(g, x, y, z)]) by_slice[z].push_back({x, y, z});
      }
    }
  });
  Cells cells;
  for (const Cells& c : by_slice) cells.insert(cells.end(), c.begin(), c.end());
  return cells;
}

/// Fills crevices narrower than the grid until every cell is passed in one sheet; then the surface net is a
/// manifold. Each filling may disturb the cells around it, which are looked at again; the number of samples
/// outside falls with each, so this ends.
void make_simple(Grid& g, const std::array<bool, 256>& simple) {
  Cells open = cells_to_mend(g, simple);
  while (!open.empty()) {
    const auto [x, y, z] = open.back();
    if (simple[corner_mask(g, x, y, z)]) {
      open.pop_back();
      continue;
    }
    std::array<int, 3> nearest{};
    float least = 1e9f;
    for (int c = 0; c < 8; ++c) {
      const std::array<int, 3> at = {x + (c & 1), y + (c >> 1 & 1), z + (c >> 2 & 1)};
      const float v = g.value[g.at(at[0], at[1], at[2])];
      if (v < 0.0f || v >= least) continue;
      least = v;
      nearest = at;
    }
    g.value[g.at(nearest[0], nearest[1], nearest[2])] = static_cast<float>(-0.05 * g.step_mm);
    for (int c = 0; c < 8; ++c) {
      const std::array<int, 3> cell = {nearest[0] - (c & 1), nearest[1] - (c >> 1 & 1),
                                       nearest[2] - (c >> 2 & 1)};
      if (cell[0] < 0 || cell[1] < 0 || cell[2] < 0) continue;
      if (cell[0] + 1 >= g.nx || cell[1] + 1 >= g.ny || cell[2] + 1 >= g.nz) continue;
      open.push_back(cell);
    }
  }
}

TriangleMesh surface_net(const Grid& g) {
  TriangleMesh mesh;
  constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  std::vector<std::uint32_t> vertex(g.value.size(), kNone);
  for (int z = 0; z + 1 < g.nz; ++z) {
    for (int y = 0; y + 1 < g.ny; ++y) {
      for (int x = 0; x + 1 < g.nx; ++x) {
        const int mask = corner_mask(g, x, y, z);
        if (mask == 0 || mask == 255) continue;
        Vector3 sum = Vector3::Zero();
        int count = 0;
        for (int a = 0; a < 8; ++a) {
          for (const int bit : {1, 2, 4}) {
            const int b = a | bit;
            if (b == a || (mask >> a & 1) == (mask >> b & 1)) continue;
            const auto corner = [&](int c) {
              return Vector3(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2 & 1));
            };
            const auto value = [&](int c) {
              return static_cast<double>(g.value[g.at(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2 & 1))]);
            };
            const double t = value(a) / (value(a) - value(b));
            sum += corner(a) + t * (corner(b) - corner(a));
            ++count;
          }
        }
        vertex[g.at(x, y, z)] = static_cast<std::uint32_t>(mesh.vertices_mm.size());
        mesh.vertices_mm.push_back(g.origin_mm + g.step_mm / count * sum);
      }
    }
  }
  const std::array<std::array<int, 3>, 3> axes = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (int z = 1; z + 1 < g.nz; ++z) {
    for (int y = 1; y + 1 < g.ny; ++y) {
      for (int x = 1; x + 1 < g.nx; ++x) {
        const bool inside = g.value[g.at(x, y, z)] < 0.0f;
        for (int k = 0; k < 3; ++k) {
          const auto& e = axes[k];
          const auto& a = axes[(k + 1) % 3];
          const auto& b = axes[(k + 2) % 3];
          if ((g.value[g.at(x + e[0], y + e[1], z + e[2])] < 0.0f) == inside) continue;
          const auto cell = [&](int i, int j) {
            return vertex[g.at(x - i * a[0] - j * b[0], y - i * a[1] - j * b[1], z - i * a[2] - j * b[2])];
          };
          std::array<std::uint32_t, 4> q = {cell(1, 1), cell(0, 1), cell(0, 0), cell(1, 0)};
          if (!inside) std::swap(q[1], q[3]);
          const auto& v = mesh.vertices_mm;
          if ((v[q[0]] - v[q[2]]).squaredNorm() <= (v[q[1]] - v[q[3]]).squaredNorm()) {
            mesh.triangles.push_back({q[0], q[1], q[2]});
            mesh.triangles.push_back({q[0], q[2], q[3]});
          } else {
            mesh.triangles.push_back({q[0], q[1], q[3]});
            mesh.triangles.push_back({q[1], q[2], q[3]});
          }
        }
      }
    }
  }
  return mesh;
}

/// Vertices used by no triangle go.
TriangleMesh compact(const TriangleMesh& mesh) {
  return submesh(mesh, std::vector<bool>(mesh.triangles.size(), true));
}

struct Neighbours {
  std::vector<std::uint32_t> start, list;
  std::vector<bool> boundary;
};

Neighbours neighbours_of(const TriangleMesh& mesh) {
  Neighbours n;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> directed;
  directed.reserve(3 * mesh.triangles.size());
  for (const Triangle& t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) directed.emplace_back(t[k], t[(k + 1) % 3]);
  }
  std::sort(directed.begin(), directed.end());
  n.boundary.assign(mesh.vertices_mm.size(), false);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> both = directed;
  for (const auto& [a, b] : directed) {
    if (std::binary_search(directed.begin(), directed.end(), std::make_pair(b, a))) continue;
    n.boundary[a] = n.boundary[b] = true;
    both.emplace_back(b, a);
  }
  std::sort(both.begin(), both.end());
  n.start.assign(mesh.vertices_mm.size() + 1, 0);
  for (const auto& [a, b] : both) ++n.start[a + 1];
  for (std::size_t i = 1; i < n.start.size(); ++i) n.start[i] += n.start[i - 1];
  for (const auto& [a, b] : both) n.list.push_back(b);
  return n;
}

Vector3 gradient(const SurfaceField& field, const Vector3& p, double f) {
  constexpr double h = 0.02;
  return Vector3(field(p + Vector3(h, 0, 0)) - f, field(p + Vector3(0, h, 0)) - f,
                 field(p + Vector3(0, 0, h)) - f) /
         h;
}

/// Evens the triangles out and brings the vertices onto the zero of the field.
void relax_onto(TriangleMesh& mesh, const SurfaceField& field, double step, int rounds) {
  const Neighbours n = neighbours_of(mesh);
  std::vector<Vector3> next = mesh.vertices_mm;
  const auto count = mesh.vertices_mm.size();
  for (int round = 0; round <= rounds; ++round) {
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
      Vector3 p = mesh.vertices_mm[i];
      if (n.boundary[i]) return;
      const double f = field(p);
      const Vector3 g = gradient(field, p, f);
      const double g2 = std::max(g.squaredNorm(), 0.05);
      Vector3 mean = Vector3::Zero();
      for (auto k = n.start[i]; k < n.start[i + 1]; ++k) mean += mesh.vertices_mm[n.list[k]];
      mean /= std::max(1u, n.start[i + 1] - n.start[i]);
      Vector3 along = mean - p;
      along -= g * (g.dot(along) / g2);
      Vector3 move = -f / g2 * g + (round < rounds ? 0.5 : 0.0) * along;
      if (move.norm() > 0.5 * step) move *= 0.5 * step / move.norm();
      p += move;
      if (round == rounds) {
        const double f2 = field(p);  // a second step with the same slope
        Vector3 last = -f2 / g2 * g;
        if (last.norm() > 0.2 * step) last *= 0.2 * step / last.norm();
        p += last;
      }
      next[i] = p;
    });
    mesh.vertices_mm = next;
  }
}

/// Vertices beside folded triangles are drawn to the mean of their neighbours until no fold is left.
void unfold(TriangleMesh& mesh) {
  const Neighbours n = neighbours_of(mesh);
  for (int round = 0; round < 30; ++round) {
    const std::vector<Vector3> normal = vertex_normals(mesh);
    std::vector<bool> folded(mesh.vertices_mm.size(), false);
    bool any = false;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const Triangle& t = mesh.triangles[i];
      const Vector3 f = face_normal_scaled(mesh, i).normalized();
      double least = 1.0;
      for (int k = 0; k < 3; ++k) least = std::min(least, f.dot(normal[t[k]]));
      if (least > 0.25) continue;
      any = true;
      for (int k = 0; k < 3; ++k) {
        folded[t[k]] = true;
        for (auto j = n.start[t[k]]; j < n.start[t[k] + 1]; ++j) folded[n.list[j]] = true;
      }
    }
    if (!any) return;
    const std::vector<Vector3> before = mesh.vertices_mm;
    for (std::size_t i = 0; i < before.size(); ++i) {
      if (!folded[i] || n.boundary[i]) continue;
      Vector3 mean = Vector3::Zero();
      for (auto j = n.start[i]; j < n.start[i + 1]; ++j) mean += before[n.list[j]];
      mesh.vertices_mm[i] = 0.4 * before[i] + 0.6 / (n.start[i + 1] - n.start[i]) * mean;
    }
  }
}

}  // namespace

TriangleMesh polygonised(const SurfaceField& field, const Box& box, double step_mm) {
  Grid grid = sampled(field, box, step_mm);
  make_simple(grid, simple_cells());
  TriangleMesh mesh = surface_net(grid);
  mesh = compact(mesh);
  relax_onto(mesh, field, step_mm, 2);
  unfold(mesh);
  return mesh;
}

TriangleMesh trimmed(const TriangleMesh& mesh, const SurfaceField& outside) {
  std::vector<double> value(mesh.vertices_mm.size());
  tbb::parallel_for(std::size_t{0}, value.size(),
                    [&](std::size_t i) { value[i] = outside(mesh.vertices_mm[i]); });
  TriangleMesh out;
  out.vertices_mm = mesh.vertices_mm;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> cuts;
  const auto cut = [&](std::uint32_t a, std::uint32_t b) {
    const auto key = std::minmax(a, b);
    const auto [it, fresh] = cuts.emplace(key, static_cast<std::uint32_t>(out.vertices_mm.size()));
    if (fresh) {
      const auto [i, j] = key;
      // Kept off the ends, so that no sliver arises; the rim is off by less than 0.05 mm.
      const double t = std::clamp(value[i] / (value[i] - value[j]), 0.2, 0.8);
      out.vertices_mm.push_back(mesh.vertices_mm[i] + t * (mesh.vertices_mm[j] - mesh.vertices_mm[i]));
    }
    return it->second;
  };
  for (const Triangle& t : mesh.triangles) {
    int k = 0;
    const auto in = [&](int c) { return value[t[c % 3]] < 0.0; };
    const int inside = in(0) + in(1) + in(2);
    if (inside == 0) continue;
    if (inside == 3) {
      out.triangles.push_back(t);
      continue;
    }
    while (in(k) != (inside == 1)) ++k;  // the corner that is alone on its side
    const std::uint32_t a = t[k % 3], b = t[(k + 1) % 3], c = t[(k + 2) % 3];
    const std::uint32_t ab = cut(a, b), ac = cut(a, c);
    if (inside == 1) {
      out.triangles.push_back({a, ab, ac});
    } else {
      out.triangles.push_back({ab, b, c});
      out.triangles.push_back({ab, c, ac});
    }
  }
  return compact(out);
}

TriangleMesh largest_component(const TriangleMesh& mesh) {
  std::size_t count = 0;
  const std::vector<std::uint32_t> component = triangle_components(mesh, &count);
  std::vector<std::size_t> size(count, 0);
  for (const std::uint32_t c : component) ++size[c];
  const auto largest = static_cast<std::uint32_t>(std::max_element(size.begin(), size.end()) - size.begin());
  std::vector<bool> keep(component.size());
  for (std::size_t i = 0; i < keep.size(); ++i) keep[i] = component[i] == largest;
  return submesh(mesh, keep);
}

}  // namespace gnathion
