#include "phantom/bodies_mesher.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "core/check.h"

namespace gnathion {
namespace {

constexpr int kBias = 1 << 20;

CellKey key_of(int i, int j, int k) {
  const auto part = [](int v) { return static_cast<CellKey>(v + kBias); };
  return (part(i) << 42) | (part(j) << 21) | part(k);
}

std::array<int, 3> indices_of(CellKey key) {
  const auto part = [&](int shift) { return static_cast<int>((key >> shift) & 0x1fffff) - kBias; };
  return {part(42), part(21), part(0)};
}

void sort_unique(std::vector<CellKey>& keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

/// Position in a sorted list, or -1.
std::ptrdiff_t find(const std::vector<CellKey>& keys, CellKey key) {
  const auto it = std::lower_bound(keys.begin(), keys.end(), key);
  return it != keys.end() && *it == key ? it - keys.begin() : -1;
}

constexpr std::array<int, 3> offset_of_corner(int corner) {
  return {corner & 1, (corner >> 1) & 1, (corner >> 2) & 1};
}

/// Descends an octree of cells; blocks whose centre is too far from the zero are left out.
void descend(const Field& field, const Lattice& lattice, double lipschitz, const std::array<int, 3>& low,
             int size, std::vector<CellKey>& out) {
  const Vector3 centre_index = Vector3(low[0], low[1], low[2]) + Vector3::Constant(0.5 * size);
  const double value = field(lattice.space_from_lattice * (lattice.edge_mm * centre_index));
  const double reach_mm = lipschitz * std::sqrt(3.0) * 0.5 * size * lattice.edge_mm;
  if (std::abs(value) > reach_mm) return;
  if (size == 1) {
    out.push_back(key_of(low[0], low[1], low[2]));
    return;
  }
  const int half = size / 2;
  for (int c = 0; c < 8; ++c) {
    const auto d = offset_of_corner(c);
    descend(field, lattice, lipschitz, {low[0] + half * d[0], low[1] + half * d[1], low[2] + half * d[2]},
            half, out);
  }
}

/// Values of the field at all corners of the cells.
struct Corners {
  std::vector<CellKey> keys;
  std::vector<double> values;
  double at(int i, int j, int k) const {
    const auto n = find(keys, key_of(i, j, k));
    return n < 0 ? std::numeric_limits<double>::quiet_NaN() : values[static_cast<std::size_t>(n)];
  }
};

Corners sample_corners(const std::vector<CellKey>& cells, const Lattice& lattice, const Field& field) {
  Corners corners;
  corners.keys.reserve(cells.size() * 8);
  for (const CellKey cell : cells) {
    const auto [i, j, k] = indices_of(cell);
    for (int c = 0; c < 8; ++c) {
      const auto d = offset_of_corner(c);
      corners.keys.push_back(key_of(i + d[0], j + d[1], k + d[2]));
    }
  }
  sort_unique(corners.keys);
  corners.values.resize(corners.keys.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, corners.keys.size(), 256), [&](const auto& range) {
    for (std::size_t n = range.begin(); n < range.end(); ++n) {
      const auto [i, j, k] = indices_of(corners.keys[n]);
      corners.values[n] = field(lattice.point(i, j, k));
    }
  });
  return corners;
}

/// A cell's edges: their two corners. Edges 0–3 run along x, 4–7 along y, 8–11 along z.
constexpr std::array<std::array<int, 2>, 12> kEdgeCorners = {
    {{0, 1}, {2, 3}, {4, 5}, {6, 7}, {0, 2}, {1, 3}, {4, 6}, {5, 7}, {0, 4}, {1, 5}, {2, 6}, {3, 7}}};
/// A cell's faces: their corners in cyclic order.
constexpr std::array<std::array<int, 4>, 6> kFaceCorners = {
    {{0, 2, 6, 4}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 1, 3, 2}, {4, 5, 7, 6}}};

int edge_between(int a, int b) {
  if (a > b) std::swap(a, b);
  for (int e = 0; e < 12; ++e)
    if (kEdgeCorners[e][0] == a && kEdgeCorners[e][1] == b) return e;
  return -1;
}

/// The surface inside one cell: one vertex for each of its (at most four) separate sheets, so that sheets
/// that share a cell stay apart (dual marching cubes, Nielson 2004).
struct CellSurface {
  int sheets = 0;
  std::array<std::int8_t, 12> sheet_of_edge;  ///< -1 where the edge is not crossed
  std::array<Vector3, 4> vertex;              ///< in lattice coordinates, of unit cells
  std::uint32_t first_vertex = 0;
};

/// A face between two cells: the key of the cell above it, times 4, plus the axis across it.
using FaceId = std::uint64_t;

FaceId face_id(const std::array<int, 3>& cell, int face) {
  std::array<int, 3> above = cell;
  above[face / 2] += face % 2;
  return key_of(above[0], above[1], above[2]) * 4 + static_cast<FaceId>(face / 2);
}

int root_of(const std::array<int, 12>& root, int e) {
  while (root[e] != e) e = root[e];
  return e;
}

bool is_ambiguous(const std::array<double, 8>& value, const std::array<int, 4>& face) {
  return (value[face[0]] < 0) == (value[face[2]] < 0) && (value[face[1]] < 0) == (value[face[3]] < 0) &&
         (value[face[0]] < 0) != (value[face[1]] < 0);
}

/// Joins crossings that share a face of the cell: `root` is a forest over the edges. On an ambiguous face
/// (four crossings) the negative corners are cut off from each other, on flipped ones the positive corners;
/// both cells of a face decide alike.
void join_crossings(const std::array<double, 8>& value, const std::array<bool, 6>& flipped,
                    std::array<int, 12>& root) {
  for (int f = 0; f < 6; ++f) {
    const auto& face = kFaceCorners[f];
    std::array<int, 4> edge;
    for (int c = 0; c < 4; ++c) edge[c] = edge_between(face[c], face[(c + 1) % 4]);
    if (is_ambiguous(value, face)) {
      for (int c = 0; c < 4; ++c)
        if ((value[face[c]] < 0) != flipped[f])
          root[root_of(root, edge[(c + 3) % 4])] = root_of(root, edge[c]);
      continue;
    }
    int first = -1;
    for (int c = 0; c < 4; ++c) {
      if ((value[face[c]] < 0) == (value[face[(c + 1) % 4]] < 0)) continue;
      if (first < 0) first = edge[c];
      root[root_of(root, edge[c])] = root_of(root, first);
    }
  }
}

/// No sheets where the sign does not change or a corner is unknown. Ambiguous faces on which the cell's
/// surface is one sheet only are added to `pinches`.
CellSurface surface_in_cell(CellKey cell, const Corners& corners, const std::vector<FaceId>& flipped_faces,
                            std::vector<FaceId>* pinches) {
  CellSurface out;
  out.sheet_of_edge.fill(-1);
  const auto index = indices_of(cell);
  std::array<double, 8> value;
  for (int c = 0; c < 8; ++c) {
    const auto d = offset_of_corner(c);
    value[c] = corners.at(index[0] + d[0], index[1] + d[1], index[2] + d[2]);
    if (std::isnan(value[c])) return out;
  }
  std::array<bool, 6> flipped{};
  for (int f = 0; f < 6 && !flipped_faces.empty(); ++f)
    flipped[f] = std::binary_search(flipped_faces.begin(), flipped_faces.end(), face_id(index, f));
  std::array<int, 12> root;
  for (int e = 0; e < 12; ++e) root[e] = e;
  join_crossings(value, flipped, root);
  std::array<int, 4> count{};
  std::array<int, 12> sheet_of_root;
  sheet_of_root.fill(-1);
  for (int e = 0; e < 12; ++e) {
    const auto [a, b] = kEdgeCorners[e];
    if ((value[a] < 0) == (value[b] < 0)) continue;
    int& sheet = sheet_of_root[root_of(root, e)];
    if (sheet < 0) {
      sheet = out.sheets;
      out.vertex[out.sheets++] = Vector3::Zero();
    }
    const auto da = offset_of_corner(a), db = offset_of_corner(b);
    const Vector3 pa(da[0], da[1], da[2]), pb(db[0], db[1], db[2]);
    out.vertex[sheet] += pa + value[a] / (value[a] - value[b]) * (pb - pa);
    out.sheet_of_edge[e] = static_cast<std::int8_t>(sheet);
    ++count[sheet];
  }
  for (int s = 0; s < out.sheets; ++s)
    out.vertex[s] = Vector3(index[0], index[1], index[2]) + out.vertex[s] / count[s];
  for (int f = 0; f < 6 && pinches; ++f) {
    const auto& face = kFaceCorners[f];
    if (is_ambiguous(value, face) && out.sheet_of_edge[edge_between(face[0], face[1])] ==
                                         out.sheet_of_edge[edge_between(face[2], face[3])])
      pinches->push_back(face_id(index, f));
  }
  return out;
}

/// The surface in each cell. Where both cells of an ambiguous face have one sheet on it, four quads would
/// meet in one edge: such faces are flipped (Wenger, "Isosurfaces", 2013, ch. 3).
std::vector<CellSurface> surfaces_in_cells(const std::vector<CellKey>& cells, const Corners& corners) {
  std::vector<CellSurface> surfaces(cells.size());
  std::vector<std::vector<FaceId>> pinches(cells.size());
  tbb::parallel_for(std::size_t{0}, cells.size(), [&](std::size_t n) {
    surfaces[n] = surface_in_cell(cells[n], corners, {}, &pinches[n]);
  });
  std::vector<FaceId> faces, flipped;
  for (const auto& part : pinches) faces.insert(faces.end(), part.begin(), part.end());
  std::sort(faces.begin(), faces.end());
  for (std::size_t n = 1; n < faces.size(); ++n)
    if (faces[n] == faces[n - 1]) flipped.push_back(faces[n]);
  if (!flipped.empty())
    tbb::parallel_for(std::size_t{0}, cells.size(), [&](std::size_t n) {
      if (!pinches[n].empty()) surfaces[n] = surface_in_cell(cells[n], corners, flipped, nullptr);
    });
  return surfaces;
}

/// Two triangles around a lattice edge, split along the shorter diagonal.
void add_quad(TriangleMesh& mesh, const std::array<std::uint32_t, 4>& v) {
  const auto length = [&](std::uint32_t a, std::uint32_t b) {
    return (mesh.vertices_mm[a] - mesh.vertices_mm[b]).squaredNorm();
  };
  if (length(v[0], v[2]) <= length(v[1], v[3])) {
    mesh.triangles.push_back({v[0], v[1], v[2]});
    mesh.triangles.push_back({v[0], v[2], v[3]});
  } else {
    mesh.triangles.push_back({v[0], v[1], v[3]});
    mesh.triangles.push_back({v[1], v[2], v[3]});
  }
}

/// Quads around the three lattice edges that start at the lower corner of a cell.
void add_quads_of_cell(const std::array<int, 3>& cell, const std::vector<CellKey>& cells,
                       const std::vector<CellSurface>& surfaces, const Corners& corners, TriangleMesh& mesh) {
  const double start = corners.at(cell[0], cell[1], cell[2]);
  for (int axis = 0; axis < 3; ++axis) {
    std::array<int, 3> end = cell;
    ++end[axis];
    const double stop = corners.at(end[0], end[1], end[2]);
    if (std::isnan(start) || std::isnan(stop) || (start < 0) == (stop < 0)) continue;
    const int u = (axis + 1) % 3, w = (axis + 2) % 3;
    std::array<std::uint32_t, 4> quad{};
    bool complete = true;
    for (int n = 0; n < 4 && complete; ++n) {
      std::array<int, 3> around = cell;
      int corner = 0;  // of the cell around, where this edge starts
      if (n == 1 || n == 2) --around[u], corner |= 1 << u;
      if (n >= 2) --around[w], corner |= 1 << w;
      const auto found = find(cells, key_of(around[0], around[1], around[2]));
      const int sheet = found < 0 ? -1
                                  : surfaces[static_cast<std::size_t>(found)]
                                        .sheet_of_edge[edge_between(corner, corner | 1 << axis)];
      complete = sheet >= 0;
      if (complete)
        quad[n] = surfaces[static_cast<std::size_t>(found)].first_vertex + static_cast<std::uint32_t>(sheet);
    }
    if (!complete) continue;
    if (start >= 0) std::swap(quad[1], quad[3]);
    add_quad(mesh, quad);
  }
}

Vector3 gradient(const Field& field, const Vector3& p) {
  constexpr double step_mm = 1e-3;
  Vector3 g;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3 d = step_mm * Vector3::Unit(axis);
    g[axis] = (field(p + d) - field(p - d)) / (2 * step_mm);
  }
  return g;
}

}  // namespace

std::vector<CellKey> cells_near_zero(const Field& field, const Box& box, const Lattice& lattice,
                                     double lipschitz) {
  constexpr int kBlock = 16;
  Box in_lattice;
  const Rigid3 lattice_from_space = lattice.space_from_lattice.inverse();
  for (int c = 0; c < 8; ++c) {
    const auto d = offset_of_corner(c);
    const Vector3 corner(d[0] ? box.max_mm.x() : box.min_mm.x(), d[1] ? box.max_mm.y() : box.min_mm.y(),
                         d[2] ? box.max_mm.z() : box.min_mm.z());
    in_lattice.extend(lattice_from_space * corner / lattice.edge_mm);
  }
  std::vector<std::array<int, 3>> blocks;
  std::array<int, 3> low, high;
  for (std::size_t a = 0; a < 3; ++a) {
    low[a] = static_cast<int>(std::floor(in_lattice.min_mm[static_cast<int>(a)] / kBlock));
    high[a] = static_cast<int>(std::floor(in_lattice.max_mm[static_cast<int>(a)] / kBlock));
  }
  for (int i = low[0]; i <= high[0]; ++i)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int k = low[2]; k <= high[2]; ++k) blocks.push_back({i * kBlock, j * kBlock, k * kBlock});
  std::vector<std::vector<CellKey>> found(blocks.size());
  tbb::parallel_for(std::size_t{0}, blocks.size(),
                    [&](std::size_t b) { descend(field, lattice, lipschitz, blocks[b], kBlock, found[b]); });
  std::vector<CellKey> cells;
  for (const auto& part : found) cells.insert(cells.end(), part.begin(), part.end());
  sort_unique(cells);
  return cells;
}

std::vector<CellKey> cells_near_mesh(const TriangleMesh& mesh, const Lattice& lattice) {
  const Rigid3 lattice_from_space = lattice.space_from_lattice.inverse();
  const double half_diagonal = 0.5 * std::sqrt(3.0) + 1e-6;
  std::vector<CellKey> cells;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    Box box;
    for (int c = 0; c < 3; ++c) box.extend(lattice_from_space * mesh.corner(t, c) / lattice.edge_mm);
    const Vector3 normal = lattice_from_space.rotation * face_normal_scaled(mesh, t).normalized();
    const Vector3 on_plane = lattice_from_space * mesh.corner(t, 0) / lattice.edge_mm;
    const Vector3 low = box.min_mm.array().floor(), high = box.max_mm.array().floor();
    for (int i = static_cast<int>(low.x()); i <= static_cast<int>(high.x()); ++i)
      for (int j = static_cast<int>(low.y()); j <= static_cast<int>(high.y()); ++j)
        for (int k = static_cast<int>(low.z()); k <= static_cast<int>(high.z()); ++k) {
          const Vector3 centre = Vector3(i, j, k) + Vector3::Constant(0.5);
          if (!(std::abs(normal.dot(centre - on_plane)) > half_diagonal)) cells.push_back(key_of(i, j, k));
        }
    if (cells.size() > (std::size_t{1} << 22)) sort_unique(cells);
  }
  sort_unique(cells);
  return cells;
}

TriangleMesh surface_net(const std::vector<CellKey>& cells, const Lattice& lattice, const Field& field) {
  const Corners corners = sample_corners(cells, lattice, field);
  std::vector<CellSurface> surfaces = surfaces_in_cells(cells, corners);
  TriangleMesh mesh;
  for (CellSurface& surface : surfaces) {
    surface.first_vertex = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    for (int s = 0; s < surface.sheets; ++s)
      mesh.vertices_mm.push_back(lattice.space_from_lattice * (lattice.edge_mm * surface.vertex[s]));
  }
  for (std::size_t n = 0; n < cells.size(); ++n)
    if (surfaces[n].sheets > 0) add_quads_of_cell(indices_of(cells[n]), cells, surfaces, corners, mesh);
  return submesh(mesh, std::vector<bool>(mesh.triangles.size(), true));
}

void move_without_folds(TriangleMesh& mesh, const std::vector<Vector3>& targets) {
  const TriangleMesh before = mesh;
  mesh.vertices_mm = targets;
  constexpr double kLeastCosine = 0.3, kLeastArea = 0.1;
  for (int round = 0; round < 8; ++round) {
    std::vector<std::uint8_t> folded(mesh.triangles.size(), 0);
    tbb::parallel_for(std::size_t{0}, mesh.triangles.size(), [&](std::size_t t) {
      const Vector3 was = face_normal_scaled(before, t), is = face_normal_scaled(mesh, t);
      folded[t] = is.dot(was) < kLeastCosine * is.norm() * was.norm() || is.norm() < kLeastArea * was.norm();
    });
    bool any = false;
    for (std::size_t t = 0; t < folded.size(); ++t) {
      if (!folded[t]) continue;
      for (const std::uint32_t v : mesh.triangles[t]) {
        any = any || mesh.vertices_mm[v] != before.vertices_mm[v];
        mesh.vertices_mm[v] = before.vertices_mm[v];
      }
    }
    if (!any) return;
  }
}

void project_to_zero(TriangleMesh& mesh, const Field& field, double limit_mm) {
  std::vector<Vector3> targets = mesh.vertices_mm;
  tbb::parallel_for(std::size_t{0}, targets.size(), [&](std::size_t n) {
    Vector3 p = targets[n];
    for (int step = 0; step < 4; ++step) {
      const double value = field(p);
      if (std::abs(value) < 1e-5) break;
      const Vector3 g = gradient(field, p);
      if (!(g.squaredNorm() > 0.05)) break;  // a crease: the gradient says nothing
      p -= std::clamp(value, -limit_mm, limit_mm) / g.squaredNorm() * g;
    }
    if ((p - targets[n]).norm() <= limit_mm) targets[n] = p;
  });
  move_without_folds(mesh, targets);
}

TriangleMesh mesh_of_field(const Field& field, const Box& box, double edge_mm, double lipschitz) {
  // A lattice turned by an odd angle: flat faces of modelled parts never lie in its planes, where the sign of
  // rounding errors would decide.
  const Lattice lattice{{exp_so3(Vector3(0.211, -0.173, 0.307)), box.centre_mm()}, edge_mm};
  TriangleMesh mesh = surface_net(cells_near_zero(field, box, lattice, lipschitz), lattice, field);
  project_to_zero(mesh, field, 0.75 * edge_mm);
  return mesh;
}

TriangleMesh clipped(const TriangleMesh& mesh, const std::function<double(const Vector3&)>& keep) {
  TriangleMesh out;
  out.vertices_mm = mesh.vertices_mm;
  std::vector<double> value(mesh.vertices_mm.size());
  tbb::parallel_for(std::size_t{0}, value.size(),
                    [&](std::size_t n) { value[n] = keep(mesh.vertices_mm[n]); });
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> cut;
  const auto crossing = [&](std::uint32_t a, std::uint32_t b) {
    if (a > b) std::swap(a, b);
    const auto [it, fresh] = cut.try_emplace({a, b}, static_cast<std::uint32_t>(out.vertices_mm.size()));
    if (fresh) {
      const double t = value[a] / (value[a] - value[b]);
      out.vertices_mm.push_back(mesh.vertices_mm[a] + t * (mesh.vertices_mm[b] - mesh.vertices_mm[a]));
    }
    return it->second;
  };
  for (const Triangle& triangle : mesh.triangles) {
    std::vector<std::uint32_t> polygon;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint32_t a = triangle[c], b = triangle[(c + 1) % 3];
      if (value[a] > 0) polygon.push_back(a);
      if ((value[a] > 0) != (value[b] > 0)) polygon.push_back(crossing(a, b));
    }
    for (std::size_t c = 2; c < polygon.size(); ++c)
      out.triangles.push_back({polygon[0], polygon[c - 1], polygon[c]});
  }
  return submesh(out, std::vector<bool>(out.triangles.size(), true));
}

TriangleMesh without_islands(const TriangleMesh& mesh, std::size_t smallest) {
  std::size_t count = 0;
  const auto component = triangle_components(mesh, &count);
  std::vector<std::size_t> size(count, 0);
  for (const auto c : component) ++size[c];
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = size[component[t]] >= smallest;
  return submesh(mesh, keep);
}

}  // namespace gnathion
