// Vertices that moved, what lies about them, and moves that made the mesh cross itself.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace gnathion {

/// The cells of a grid over a mesh that the listed triangles' boxes touch: what lies about them is found
/// again without looking at the rest.
class Surroundings {
 public:
  Surroundings(const TriangleMesh& mesh, const std::vector<std::uint32_t>& triangles, double margin_mm)
      : box_(bounding_box(mesh)), margin_mm_(margin_mm) {
    nodes_ = (box_.size_mm() / kCellMm).cast<int>() + Eigen::Vector3i::Ones();
    marked_.assign(static_cast<std::size_t>(nodes_.x()) * static_cast<std::size_t>(nodes_.y()) *
                       static_cast<std::size_t>(nodes_.z()),
                   0);
    for (const std::uint32_t t : triangles)
      each_cell(marked_, box_of(mesh, t), margin_mm_, [](char& cell) {
        cell = 1;
        return true;
      });
  }
  /// Within the margin of a listed triangle, or not much farther.
  bool hold(const Vector3& p) const {
    Box box;
    box.extend(p);
    return meet(box);
  }
  /// The triangles that come so near, and what they are called in the whole mesh.
  TriangleMesh part_of(const TriangleMesh& mesh, std::vector<std::uint32_t>& names) const {
    std::vector<bool> kept(mesh.triangles.size());
    names.clear();
    for (std::uint32_t t = 0; t < kept.size(); ++t) {
      kept[t] = meet(box_of(mesh, t));
      if (kept[t]) names.push_back(t);
    }
    return submesh(mesh, kept);
  }

 private:
  static constexpr double kCellMm = 0.4;

  static Box box_of(const TriangleMesh& mesh, std::size_t t) {
    Box box;
    for (int k = 0; k < 3; ++k) box.extend(mesh.corner(t, k));
    return box;
  }
  bool meet(const Box& box) const {
    if ((box.max_mm.array() < box_.min_mm.array() - margin_mm_).any() ||
        (box.min_mm.array() > box_.max_mm.array() + margin_mm_).any())
      return false;
    bool found = false;
    each_cell(marked_, box, 0.0, [&](char cell) {
      found = cell != 0;
      return !found;
    });
    return found;
  }
  /// Calls body(cell) for the cells that the widened box touches, until it returns false.
  template <class Cells, class Body>
  void each_cell(Cells& cells, const Box& box, double margin_mm, const Body& body) const {
    const auto cell_at = [&](const Vector3& p) -> Eigen::Vector3i {
      return Eigen::Vector3i(((p - box_.min_mm) / kCellMm).array().floor().cast<int>())
          .cwiseMax(0)
          .cwiseMin(nodes_ - Eigen::Vector3i::Ones());
    };
    const Eigen::Vector3i low = cell_at(box.min_mm - Vector3::Constant(margin_mm));
    const Eigen::Vector3i high = cell_at(box.max_mm + Vector3::Constant(margin_mm));
    for (int i = low.x(); i <= high.x(); ++i)
      for (int j = low.y(); j <= high.y(); ++j)
        for (int k = low.z(); k <= high.z(); ++k)
          if (!body(cells[(static_cast<std::size_t>(i) * static_cast<std::size_t>(nodes_.y()) +
                           static_cast<std::size_t>(j)) *
                              static_cast<std::size_t>(nodes_.z()) +
                          static_cast<std::size_t>(k)]))
            return;
  }

  Box box_;
  double margin_mm_;
  Eigen::Vector3i nodes_ = Eigen::Vector3i::Zero();
  std::vector<char> marked_;
};

/// Triangles with a vertex that `marked` holds.
std::vector<std::uint32_t> triangles_at(const TriangleMesh& mesh, const std::vector<char>& marked);

/// Of a mesh that had no crossings with its vertices at `before`: takes moves back, by half at first, until
/// it does not cross itself. Returns whether any was taken back.
bool take_back_crossings(TriangleMesh& mesh, const std::vector<Vector3>& before);

}  // namespace gnathion
