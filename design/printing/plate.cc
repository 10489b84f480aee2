#include "design/printing/plate.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace gnathion {
namespace {

constexpr int kTurns = 90;  // looked at over a half turn

/// Turned so that `up` is z, and about z so that the box about it has the least area, longer side along x.
Matrix3 lying(const TriangleMesh& mesh, const Vector3& up) {
  Matrix3 frame;
  frame.row(2) = up;
  frame.row(0) = up.unitOrthogonal();
  frame.row(1) = up.cross(Vector3(frame.row(0)));
  const auto turned = [&](double angle_rad) {
    return Matrix3(Eigen::AngleAxisd(angle_rad, Vector3::UnitZ()).toRotationMatrix() * frame);
  };
  const auto area = [&](double angle_rad) {
    const Matrix3 turn = turned(angle_rad);
    Box box;
    for (const Vector3& v : mesh.vertices_mm) box.extend(turn * v);
    const Vector3 size = box.size_mm();
    return size.x() >= size.y() ? size.x() * size.y() : 1e300;
  };
  double best = 0.0, least = 1e300;
  const auto look = [&](double angle_rad) {
    const double here = area(angle_rad);
    if (here >= least - 1e-9) return false;
    least = here;
    best = angle_rad;
    return true;
  };
  for (int n = 0; n < kTurns; ++n) look(M_PI * n / kTurns);
  for (double step = 0.5 * M_PI / kTurns; step > 1e-6; step *= 0.5)
    if (!look(best + step)) look(best - step);
  return turned(best);
}

struct Part {
  Matrix3 linear;  // with the compensation
  Box box;         // of linear * mesh
};

/// Rows along x, filled from the front; plates one after the other.
class Rows {
 public:
  explicit Rows(const PrinterProfile& profile) : profile_(profile) { begin_plate(0); }
  bool holds(const Vector3& size) const {
    const Vector3 room = profile_.room_mm - Vector3(2, 2, 0) * profile_.margin_mm;
    return size.x() <= room.x() && size.y() <= room.y() && size.z() + profile_.lift_mm <= room.z();
  }
  /// Lower front left corner for a part of this size, and its plate.
  std::pair<Vector3, std::size_t> place(const Vector3& size) {
    if (x_ + size.x() > profile_.room_mm.x() - profile_.margin_mm) next_row();
    if (y_ + size.y() > profile_.room_mm.y() - profile_.margin_mm) begin_plate(plate_ + 1);
    const Vector3 corner(x_, y_, profile_.lift_mm);
    x_ += size.x() + profile_.spacing_mm;
    row_ = std::max(row_, size.y());
    return {corner, plate_};
  }

 private:
  void next_row() {
    x_ = profile_.margin_mm;
    y_ += row_ + profile_.spacing_mm;
    row_ = 0.0;
  }
  void begin_plate(std::size_t plate) {
    plate_ = plate;
    x_ = y_ = profile_.margin_mm;
    row_ = 0.0;
  }
  const PrinterProfile& profile_;
  double x_ = 0.0, y_ = 0.0, row_ = 0.0;
  std::size_t plate_ = 0;
};

}  // namespace

Result<std::vector<PlatePlacement>> laid_out(const std::vector<const TriangleMesh*>& parts,
                                             const std::vector<Vector3>& up,
                                             const std::vector<std::string>& names,
                                             const PrinterProfile& profile) {
  Rows rows(profile);
  std::vector<PlatePlacement> out;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    // The printer multiplies lengths along the plate's axes by printed_scale: the file divides by it.
    const auto compensated = [&](const Matrix3& turned) {
      Part part{profile.printed_scale.cwiseInverse().asDiagonal() * turned, {}};
      for (const Vector3& v : parts[i]->vertices_mm) part.box.extend(part.linear * v);
      return part;
    };
    const Matrix3 along_x = lying(*parts[i], up[i]);
    Part part = compensated(along_x);
    if (!rows.holds(part.box.size_mm())) {
      const Matrix3 quarter = Eigen::AngleAxisd(0.5 * M_PI, Vector3::UnitZ()).toRotationMatrix();
      part = compensated(quarter * along_x);
    }
    if (!rows.holds(part.box.size_mm())) {
      const Vector3 size = part.box.size_mm();
      return fail(ErrorCode::kGate, "cannot lay out", names[i],
                  fmt::format("{:.1f} x {:.1f} x {:.1f} mm does not fit on the plate of {}", size.x(),
                              size.y(), size.z(), profile.name));
    }
    const auto [corner, plate] = rows.place(part.box.size_mm());
    out.push_back({part.linear, corner - part.box.min_mm, plate});
  }
  return out;
}

TriangleMesh placed(const PlatePlacement& placement, const TriangleMesh& mesh) {
  TriangleMesh out = mesh;
  for (Vector3& v : out.vertices_mm) v = placement * v;
  return out;
}

}  // namespace gnathion
