#include "core/mesh_section.h"

#include <map>

namespace gnathion {
namespace {

using Edge = std::pair<std::uint32_t, std::uint32_t>;

/// A segment of the section: it enters and leaves its triangle over two edges.
struct Segment {
  Edge from, to;
  bool used = false;
};

Edge edge_of(std::uint32_t a, std::uint32_t b) {
  return a < b ? Edge{a, b} : Edge{b, a};
}

class Cutter {
 public:
  Cutter(const TriangleMesh& mesh, const SectionPlane& plane) : mesh_(mesh), plane_(plane) {
    const Vector3 normal = plane.x_axis.cross(plane.y_axis);
    height_.reserve(mesh.vertices_mm.size());
    for (const Vector3& v : mesh.vertices_mm) {
      // A vertex exactly in the plane counts as above: each triangle is cut over two edges or none.
      const double h = normal.dot(v - plane.origin_mm);
      height_.push_back(h == 0 ? 1e-12 : h);
    }
    for (const Triangle& t : mesh.triangles) cut_triangle(t);
  }

  std::vector<Polyline2> chains() {
    std::vector<Polyline2> out;
    // Open chains start at edges that only one segment touches; what is left are closed loops.
    for (std::size_t i = 0; i < segments_.size(); ++i)
      for (const Edge& e : {segments_[i].from, segments_[i].to})
        if (!segments_[i].used && at_edge_[e].size() == 1) out.push_back(follow(i, e));
    for (std::size_t i = 0; i < segments_.size(); ++i)
      if (!segments_[i].used) out.push_back(follow(i, segments_[i].from));
    return out;
  }

 private:
  void cut_triangle(const Triangle& t) {
    std::vector<Edge> crossed;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      if ((height_[a] > 0) != (height_[b] > 0)) crossed.push_back(edge_of(a, b));
    }
    if (crossed.size() != 2) return;
    for (const Edge& e : crossed) at_edge_[e].push_back(segments_.size());
    segments_.push_back({crossed[0], crossed[1]});
  }

  Eigen::Vector2d point(const Edge& e) const {
    const double a = height_[e.first], b = height_[e.second];
    const Vector3 p = mesh_.vertices_mm[e.first] +
                      (a / (a - b)) * (mesh_.vertices_mm[e.second] - mesh_.vertices_mm[e.first]);
    return {plane_.x_axis.dot(p - plane_.origin_mm), plane_.y_axis.dot(p - plane_.origin_mm)};
  }

  Polyline2 follow(std::size_t segment, Edge at) {
    Polyline2 line{point(at)};
    while (true) {
      Segment& s = segments_[segment];
      s.used = true;
      at = s.from == at ? s.to : s.from;
      line.push_back(point(at));
      const auto& here = at_edge_[at];
      const auto next =
          std::find_if(here.begin(), here.end(), [&](std::size_t i) { return !segments_[i].used; });
      if (next == here.end()) return line;
      segment = *next;
    }
  }

  const TriangleMesh& mesh_;
  const SectionPlane& plane_;
  std::vector<double> height_;
  std::vector<Segment> segments_;
  std::map<Edge, std::vector<std::size_t>> at_edge_;
};

}  // namespace

std::vector<Polyline2> cut_mesh(const TriangleMesh& mesh, const SectionPlane& plane) {
  return Cutter(mesh, plane).chains();
}

}  // namespace gnathion
