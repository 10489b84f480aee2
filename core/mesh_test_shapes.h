// Shapes for the tests of meshes. Included by tests alone.
#pragma once

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>

#include "core/mesh.h"
#include "core/random.h"

namespace gnathion::test {

inline TriangleMesh tetrahedron(double size_mm = 10.0) {
  TriangleMesh m;
  m.vertices_mm = {{0, 0, 0}, {size_mm, 0, 0}, {0, size_mm, 0}, {0, 0, size_mm}};
  m.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  return m;
}

/// Axis-parallel box, closed, outward.
inline TriangleMesh box(const Vector3& low, const Vector3& high) {
  TriangleMesh m;
  for (int i = 0; i < 8; ++i)
    m.vertices_mm.emplace_back(i & 1 ? high.x() : low.x(), i & 2 ? high.y() : low.y(),
                               i & 4 ? high.z() : low.z());
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

/// Octahedron, each face split `levels` times into four, pushed to a radius of its own per direction.
template <class Radius>
TriangleMesh star_shape(int levels, Radius&& radius_mm) {
  TriangleMesh m;
  m.vertices_mm = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  m.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [it, fresh] = middles.try_emplace(std::minmax(a, b), 0u);
      if (fresh) {
        it->second = static_cast<std::uint32_t>(m.vertices_mm.size());
        m.vertices_mm.push_back((m.vertices_mm[a] + m.vertices_mm[b]).normalized());
      }
      return it->second;
    };
    std::vector<Triangle> finer;
    for (const Triangle& t : m.triangles) {
      const std::uint32_t a = middle(t[0], t[1]), b = middle(t[1], t[2]), c = middle(t[2], t[0]);
      finer.insert(finer.end(), {{t[0], a, c}, {t[1], b, a}, {t[2], c, b}, {a, b, c}});
    }
    m.triangles = std::move(finer);
  }
  for (Vector3& v : m.vertices_mm) v *= radius_mm(Vector3(v));
  return m;
}

inline TriangleMesh sphere(int levels, double radius_mm) {
  return star_shape(levels, [radius_mm](const Vector3&) { return radius_mm; });
}

/// A closed surface of deep, sharp folds; no self-intersections, since it is star-shaped.
inline TriangleMesh spiky(int levels, std::uint64_t seed) {
  Random random(seed);
  return star_shape(levels, [&random](const Vector3&) { return random.uniform(10.0, 30.0); });
}

/// Torus about z; `rings` × `sides` quads, closed, outward.
inline TriangleMesh torus(double major_mm, double minor_mm, int rings, int sides) {
  TriangleMesh m;
  for (int i = 0; i < rings; ++i)
    for (int j = 0; j < sides; ++j) {
      const double u = 2 * M_PI * i / rings, v = 2 * M_PI * j / sides, r = major_mm + minor_mm * std::cos(v);
      m.vertices_mm.emplace_back(r * std::cos(u), r * std::sin(u), minor_mm * std::sin(v));
    }
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>((i % rings) * sides + j % sides); };
  for (int i = 0; i < rings; ++i)
    for (int j = 0; j < sides; ++j) {
      m.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      m.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  return m;
}

/// n × n quads over a square of side `size_mm` about the origin, z given by `height`; open.
template <class Height>
TriangleMesh sheet(int n, double size_mm, Height&& height) {
  TriangleMesh m;
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i) {
      const double x = size_mm * (double(i) / n - 0.5), y = size_mm * (double(j) / n - 0.5);
      m.vertices_mm.emplace_back(x, y, height(x, y));
    }
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      const auto a = static_cast<std::uint32_t>(j * (n + 1) + i), b = a + 1;
      const auto c = a + static_cast<std::uint32_t>(n) + 1, d = c + 1;
      m.triangles.push_back({a, b, d});
      m.triangles.push_back({a, d, c});
    }
  return m;
}

/// Folder of shared data, or empty where it is absent.
inline std::filesystem::path shared_data() {
  const char* given = std::getenv("GNATHION_SHARED");
  const std::filesystem::path root = given != nullptr ? given : "../shared";
  return std::filesystem::exists(root / "data") ? root / "data" : std::filesystem::path();
}

}  // namespace gnathion::test
