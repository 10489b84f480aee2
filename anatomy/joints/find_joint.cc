#include <fmt/format.h>

#include <algorithm>

#include "anatomy/joints/joints.h"
#include "anatomy/joints/voxel_parts.h"
#include "anatomy/volume/iso_surface.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot find joint";
constexpr double kLeastBoneMm3 = 100.0;  ///< a condylar head alone has 1500 and more
constexpr double kSealMm = 0.4;          ///< vessels and partial volume open the cortex about so far
constexpr double kSeedReachMm = 5.0;

/// Index axis that runs most along z of the frame, and whether it rises with it.
struct UpAxis {
  std::size_t axis = 2;
  bool rising = true;
};
UpAxis up_axis(const VoxelGrid& grid) {
  UpAxis up;
  double most = -1.0;
  for (int a = 0; a < 3; ++a) {
    const double z = grid.step_mm.col(a).normalized().z();
    if (std::abs(z) > most) most = std::abs(z), up = {static_cast<std::size_t>(a), z > 0.0};
  }
  return up;
}

/// Which parts reach the upper or lower face of the region.
std::vector<bool> touching(const Volume& region, const VoxelParts& parts, bool top) {
  std::vector<bool> out(parts.voxels.size(), false);
  const UpAxis up = up_axis(region.grid);
  const int face = (top == up.rising) ? region.grid.size[up.axis] - 1 : 0;
  for (int k = 0; k < region.grid.size[2]; ++k)
    for (int j = 0; j < region.grid.size[1]; ++j)
      for (int i = 0; i < region.grid.size[0]; ++i) {
        const std::array<int, 3> at{i, j, k};
        if (at[up.axis] == face) out[static_cast<std::size_t>(parts.part[region.grid.index(i, j, k)])] = true;
      }
  return out;
}

/// The part of the bone voxel that is nearest to a seed; 0 if there is none near.
std::int32_t part_at(const Volume& region, const VoxelParts& parts, const Vector3& seed_mm) {
  std::int32_t best = 0;
  double nearest = kSeedReachMm;
  for (int k = 0; k < region.grid.size[2]; ++k)
    for (int j = 0; j < region.grid.size[1]; ++j)
      for (int i = 0; i < region.grid.size[0]; ++i) {
        const std::int32_t part = parts.part[region.grid.index(i, j, k)];
        if (part == 0) continue;
        const double d = (region.grid.frame_from_voxel(Vector3(i, j, k)) - seed_mm).norm();
        if (d < nearest) nearest = d, best = part;
      }
  return best;
}

/// The greatest z of each part.
std::vector<double> highest_of(const Volume& region, const VoxelParts& parts) {
  std::vector<double> z(parts.voxels.size(), -1e300);
  for (int k = 0; k < region.grid.size[2]; ++k)
    for (int j = 0; j < region.grid.size[1]; ++j)
      for (int i = 0; i < region.grid.size[0]; ++i) {
        double& most = z[static_cast<std::size_t>(parts.part[region.grid.index(i, j, k)])];
        most = std::max(most, region.grid.frame_from_voxel(Vector3(i, j, k)).z());
      }
  return z;
}

struct Chosen {
  std::int32_t condyle = 0, fossa = 0;
};

Chosen choose_parts(const Volume& region, const VoxelParts& parts, const JointRegion& where) {
  const std::vector<bool> top = touching(region, parts, true), bottom = touching(region, parts, false);
  const auto least = static_cast<std::size_t>(kLeastBoneMm3 / region.grid.voxel_mm3());
  Chosen c;
  std::size_t most_condyle = least, most_fossa = least;
  for (std::size_t p = 1; p < parts.voxels.size(); ++p)
    if (bottom[p] && !top[p] && parts.voxels[p] > most_condyle)
      most_condyle = parts.voxels[p], c.condyle = static_cast<std::int32_t>(p);
  const std::vector<double> heights = highest_of(region, parts);
  for (std::size_t p = 1; p < parts.voxels.size(); ++p) {
    const bool above = c.condyle == 0 ? top[p] : heights[p] > heights[static_cast<std::size_t>(c.condyle)];
    if (static_cast<std::int32_t>(p) != c.condyle && above && parts.voxels[p] > most_fossa)
      most_fossa = parts.voxels[p], c.fossa = static_cast<std::int32_t>(p);
  }
  if (where.condyle_seed_mm) c.condyle = part_at(region, parts, *where.condyle_seed_mm);
  if (where.fossa_seed_mm) c.fossa = part_at(region, parts, *where.fossa_seed_mm);
  return c;
}

double percentile(std::vector<float> values, double share) {
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return static_cast<double>(values[static_cast<std::size_t>(at)]);
}

/// Typical values on either side of the threshold.
struct Sides {
  double soft = 0.0, hard = 0.0;
};
Sides sides_of(const Volume& region, double threshold) {
  std::vector<float> below, above;
  for (std::size_t v = 0; v < region.grid.count(); ++v) {
    const double x = region.value(v);
    (x < threshold ? below : above).push_back(static_cast<float>(x));
  }
  Sides s;
  s.hard = above.empty() ? threshold : percentile(above, 0.7);
  s.soft = below.empty() ? threshold : percentile(below, 0.5);
  return s;
}

TriangleMesh largest_sheet(const TriangleMesh& mesh) {
  if (mesh.empty()) return mesh;
  std::size_t count = 0;
  const std::vector<std::uint32_t> component = triangle_components(mesh, &count);
  std::vector<double> area(count, 0.0);
  for (std::size_t t = 0; t < component.size(); ++t) area[component[t]] += face_normal_scaled(mesh, t).norm();
  const auto best = static_cast<std::uint32_t>(std::max_element(area.begin(), area.end()) - area.begin());
  std::vector<bool> keep(component.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = component[t] == best;
  return submesh(mesh, keep);
}

/// The outer surface of one part alone: other bone becomes soft tissue, what the part encloses becomes bone.
TriangleMesh outer_surface(const Volume& region, const VoxelParts& parts, std::int32_t which,
                           double threshold, const Sides& sides) {
  std::vector<std::uint8_t> own(parts.part.size());
  for (std::size_t v = 0; v < own.size(); ++v) own[v] = parts.part[v] == which;
  const double spacing = region.grid.spacing_mm().maxCoeff();
  const std::vector<std::uint8_t> inside =
      enclosed_by(region.grid, own, std::max(1, static_cast<int>(std::lround(kSealMm / spacing))));
  Volume alone;
  alone.grid = region.grid;
  alone.voxels.resize(own.size());
  for (std::size_t v = 0; v < own.size(); ++v) {
    double x = region.value(v);
    if (inside[v]) x = std::max(x, sides.hard);
    if (parts.part[v] != 0 && !own[v]) x = sides.soft;
    alone.voxels[v] = static_cast<float>(x);
  }
  return largest_sheet(iso_surface(alone, threshold));
}

/// Without the side of the skull that looks up into the brain's room.
TriangleMesh lower_side(const TriangleMesh& skull) {
  std::vector<bool> keep(skull.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = face_normal_scaled(skull, t).normalized().z() < 0.6;
  return largest_sheet(submesh(skull, keep));
}

/// Which side of the volume cuts the box, in a patient's words; empty if none.
std::string cut_side(const VoxelGrid& grid, const Box& box) {
  const Box whole = grid.box_mm();
  static const char* const kLow[] = {"right", "front", "lower"};
  static const char* const kHigh[] = {"left", "back", "upper"};
  const double slack = grid.spacing_mm().maxCoeff();
  for (int a = 0; a < 3; ++a) {
    if (box.min_mm[a] < whole.min_mm[a] - slack) return kLow[a];
    if (box.max_mm[a] > whole.max_mm[a] + slack) return kHigh[a];
  }
  return "";
}

/// The bones of a joint as parts. Where cartilage is thin, partial volume bridges the joint. Denser cores
/// part it: the lowest level that does.
struct Parted {
  VoxelParts parts;
  Chosen chosen;
  bool bridged = false;
};
std::optional<Parted> part_bones(const Volume& region, double threshold, const Sides& sides,
                                 const JointRegion& where) {
  constexpr int kSteps = 8;
  for (int step = 0; step < kSteps; ++step) {
    Parted out;
    out.parts = parts_above(region, threshold + step * 0.1 * (sides.hard - threshold));
    if (out.parts.voxels.size() < 2) return {};
    out.chosen = choose_parts(region, out.parts, where);
    if (out.chosen.condyle == 0 || out.chosen.fossa == 0 || out.chosen.condyle == out.chosen.fossa) continue;
    out.bridged = step > 0;
    if (out.bridged) grow_parts(region, threshold, out.parts);
    return out;
  }
  return {};
}

}  // namespace

std::optional<Vector3> condyle_top(const Volume& volume, double threshold, const Box& search_mm,
                                   const Vector3& expected_mm, double across_mm) {
  const Volume region = cropped(volume, search_mm);
  if (region.empty()) return {};
  const auto parted = part_bones(region, threshold, sides_of(region, threshold), {search_mm, {}, {}});
  if (!parted) return {};
  std::optional<Vector3> top;
  for (int k = 0; k < region.grid.size[2]; ++k)
    for (int j = 0; j < region.grid.size[1]; ++j)
      for (int i = 0; i < region.grid.size[0]; ++i) {
        if (parted->parts.part[region.grid.index(i, j, k)] != parted->chosen.condyle) continue;
        const Vector3 p = region.grid.frame_from_voxel(Vector3(i, j, k));
        if ((p - expected_mm).head<2>().norm() < across_mm && (!top || p.z() > top->z())) top = p;
      }
  return top;
}

Result<JointSurfaces> find_joint(const Volume& volume, double threshold, const JointRegion& where,
                                 const std::string& name) {
  if (const std::string side = cut_side(volume.grid, where.box_mm); !side.empty())
    return bad_input(kWhat, name,
                     "the volume does not contain the joint: its box goes beyond the " + side + " end");
  const Volume region = cropped(volume, where.box_mm);
  if (region.empty()) return bad_input(kWhat, name, "its box holds no voxels");
  const Sides sides = sides_of(region, threshold);
  const std::optional<Parted> parted = part_bones(region, threshold, sides, where);
  if (parted) {
    JointSurfaces out;
    out.condyle = outer_surface(region, parted->parts, parted->chosen.condyle, threshold, sides);
    out.fossa = lower_side(outer_surface(region, parted->parts, parted->chosen.fossa, threshold, sides));
    out.bridged = parted->bridged;
    if (!out.condyle.empty() && !out.fossa.empty()) return out;
  }
  bool any_bone = false;
  for (std::size_t v = 0; v < region.grid.count() && !any_bone; ++v) any_bone = region.value(v) >= threshold;
  if (!any_bone)
    return bad_input(
        kWhat, name,
        fmt::format("no bone above {:.0f} in its box: the volume does not contain the joint there",
                    threshold));
  return bad_input(
      kWhat, name,
      fmt::format(
          "condyle and fossa are not two pieces of bone above {:.0f}: set another bone level, give seeds, "
          "label maps or meshes",
          threshold));
}

}  // namespace gnathion
