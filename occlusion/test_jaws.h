// A pair of simple arches whose teeth, plane and midline are known by construction: for tests of occlusion
// and anatomy. Not a patient: rounded blocks on a parabola.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace gnathion::testing {

/// Axes: x left, y posterior, z up; occlusal plane z = 0, incisal edge of the upper arch near the origin.
struct SimpleJaws {
  TriangleMesh maxilla, mandible;
  std::vector<std::uint8_t> maxilla_fdi, mandible_fdi;  ///< 0 on gingiva
};

/// y = x²/22: an arch 50 mm wide and 28 mm deep. Arc length from the midline by fine summation.
class ParabolicArch {
 public:
  explicit ParabolicArch(double offset_mm) {
    for (int i = -4000; i <= 4000; ++i) {
      const double x = 0.01 * i;
      const Eigen::Vector2d outward = Eigen::Vector2d(2.0 * x / 22.0, -1.0).normalized();
      points_.push_back(Eigen::Vector2d(x, x * x / 22.0) + offset_mm * outward);
      outward_.push_back(outward);
      s_.push_back(s_.empty() ? 0.0 : s_.back() + (points_.back() - points_[points_.size() - 2]).norm());
    }
    const double middle = s_[4000];
    for (double& s : s_) s -= middle;
  }
  Eigen::Vector2d at(double s, double buccal) const {
    const auto i = static_cast<std::size_t>(std::lower_bound(s_.begin(), s_.end() - 1, s) - s_.begin());
    return points_[i] + buccal * outward_[i];
  }

 private:
  std::vector<Eigen::Vector2d> points_, outward_;
  std::vector<double> s_;
};

/// A strip of 14 rounded crowns, 6 mm high, as a height field over (arc length, buccal) with a gingival
/// shelf.
inline TriangleMesh simple_arch(bool upper, double offset_mm, double gap_mm, std::vector<std::uint8_t>* fdi) {
  const std::array<double, 7> widths = upper ? std::array<double, 7>{8.5, 6.5, 7.5, 7, 7, 10, 9}
                                             : std::array<double, 7>{5.2, 5.6, 7, 7, 7, 11, 10.5};
  std::array<double, 8> edge{};
  for (std::size_t k = 0; k < 7; ++k) edge[k + 1] = edge[k] + widths[k];
  const ParabolicArch arch(offset_mm);
  const double step = 0.35, end = edge[7] + 2.0;
  const int across = 46, along = static_cast<int>(2.0 * end / step);
  TriangleMesh mesh;
  fdi->clear();
  for (int i = 0; i <= along; ++i)
    for (int j = 0; j <= across; ++j) {
      const double s = -end + 2.0 * end * i / along, b = -8.0 + 16.0 * j / across;
      std::size_t k = 0;
      while (k < 6 && std::abs(s) > edge[k + 1]) ++k;
      const double half = 0.5 * widths[k], from_middle = (std::abs(s) - edge[k] - half) / half;
      const double half_breadth = k < 3 ? 3.2 : (k < 5 ? 4.2 : 5.2);
      // A superellipse in plan: crowns narrow towards their contacts; 6 mm walls over 0.15 of the radius.
      const double r =
          std::pow(std::pow(std::abs(from_middle), 4) + std::pow(std::abs(b) / half_breadth, 4), 0.25);
      const double crown = std::clamp((1.05 - r) / 0.3, 0.0, 1.0);
      const double rise = std::abs(from_middle) > 1.05 ? 0.0 : crown * crown * (3.0 - 2.0 * crown);
      // Occlusal relief that both arches share where they meet: none; the table is flat, the fossa 0.4 mm
      // deep.
      const double height = 6.0 * rise - 0.4 * std::exp(-b * b - 4.0 * from_middle * from_middle);
      const Eigen::Vector2d p = arch.at(s, b);
      const double depth = 6.0 - height + 0.5 * gap_mm;
      mesh.vertices_mm.emplace_back(p.x(), p.y(), upper ? depth : -depth);
      const int quadrant = upper ? (s > 0 ? 20 : 10) : (s > 0 ? 30 : 40);
      fdi->push_back(rise > 0.1 ? static_cast<std::uint8_t>(quadrant + static_cast<int>(k) + 1)
                                : std::uint8_t{0});
    }
  const auto id = [&](int i, int j) { return static_cast<std::uint32_t>(i * (across + 1) + j); };
  for (int i = 0; i < along; ++i)
    for (int j = 0; j < across; ++j) {
      mesh.triangles.push_back({id(i, j), id(i + 1, j + 1), id(i + 1, j)});
      mesh.triangles.push_back({id(i, j), id(i, j + 1), id(i + 1, j + 1)});
    }
  // Buccal × along points up for this winding or down; crowns must look at the other arch.
  const Vector3 n = face_normal_scaled(mesh, static_cast<std::size_t>(along) * across + across);
  if ((n.z() < 0.0) != upper) flip_orientation(mesh);
  return mesh;
}

/// Both arches in MI with `gap_mm` between the flat tables; the upper arch lies 1.5 mm outside the lower.
inline SimpleJaws simple_jaws(double gap_mm = 0.02) {
  SimpleJaws jaws;
  jaws.maxilla = simple_arch(true, 0.75, gap_mm, &jaws.maxilla_fdi);
  jaws.mandible = simple_arch(false, -0.75, gap_mm, &jaws.mandible_fdi);
  return jaws;
}

}  // namespace gnathion::testing
