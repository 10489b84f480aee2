#include "phantom/face.h"

#include <algorithm>
#include <cmath>

#include "core/random.h"
#include "phantom/bodies_field.h"
#include "phantom/bodies_mesher.h"

namespace gnathion {
namespace {

using field::ellipsoid;
using field::rod;
using field::smooth_step;
using field::sphere;
using field::subtract;
using field::unite;

// The numbers below are one average adult face (anthropometric means: Farkas 1994), in the Dental frame: z is
// up from the upper incisal edge, y back. Stomion z 1, subnasale z 21, pronasale (z 33, y -31), nasion z 70,
// glabella z 83, hairline z 138; cheekbones 66 mm to either side.

/// Braincase, temples, and the block of the midface.
double cranium(const FaceShape& s, const Vector3& p) {
  double d = ellipsoid(p, {0, 82, 96}, {73, 96, 80});
  const double temple = ellipsoid(p, {84 * s.width, 22, 84}, {22, 30, 30});
  d = subtract(d, temple, 22);
  const double midface = ellipsoid(p, {0, 50, 26}, {57, 60.5, 72});
  d = unite(d, midface, 16);
  const double jaw_angle = ellipsoid(p, {40, 62, -18}, {19, 30, 40});
  return unite(d, jaw_angle, 22);
}

double brow_and_cheek(const FaceShape& s, const Vector3& p, double d) {
  const double brow = rod(p, {9, -9.5, 83}, {30, -7.0, 87.5}, 6.0 * s.brow, 5.6 * s.brow);
  const double tail = rod(p, {30, -7.0, 87.5}, {50, 15, 79}, 5.6 * s.brow, 4.2);
  d = unite(d, unite(brow, tail, 6), 15);
  const double zygoma = ellipsoid(p, {42, 16, 47}, {17 * s.cheek, 17.5, 13});
  const double arch = rod(p, {50, 28, 50}, {59.5, 66, 54}, 9, 7);
  d = unite(d, zygoma, 20);
  d = unite(d, arch, 20);
  const double cheek_fat = ellipsoid(p, {34, 16, 20}, {17, 17.5, 24});
  return unite(d, cheek_fat, 24);
}

/// Hollow of the orbit, the eyeball under its closed lids, and the slit between them.
double eyes(const Vector3& p, double d) {
  const double hollow = ellipsoid(p, {31, -11, 69.5}, {17.5, 16, 12.0});
  d = subtract(d, hollow, 12);
  const double inner_corner = sphere(p, {16, -6.5, 68.5}, 6.0);
  d = subtract(d, inner_corner, 8);
  const double lids = ellipsoid(p, {32, 13.2, 68.6}, {14.5, 12.6, 11.8});
  d = unite(d, lids, 4.0);
  // The lid slit follows the eyeball a little below its equator, its ends turned down and up.
  const double x = (p.x() - 32) / 14.0;
  const double slit_z = 66.2 - 1.2 * (1 - x * x) + 0.9 * x;
  const double along = 1 - smooth_step(0.82, 1.05, std::abs(x));
  const double slit = std::hypot(p.z() - slit_z, 0.55 * (p.y() - 1.2 - 3.4 * x * x)) - 0.75 * along;
  if (along > 0 && p.y() < 18) d = subtract(d, slit, 1.4);
  // Fold of the upper lid.
  const double fold_z = 74.2 - 4.2 * x * x;
  const double fold = std::hypot(p.z() - fold_z, 0.6 * (p.y() - 2.6 - 3.8 * x * x)) - 0.7 * along;
  if (along > 0 && p.y() < 18) d = subtract(d, fold, 2.4);
  return d;
}

/// `q` is told with the nose's length and width taken out; x not mirrored.
double nose(const FaceShape& s, const Vector3& p, const Vector3& p_mirrored, double d) {
  const auto stretch = [&](const Vector3& q) {
    return Vector3(q.x() / s.nose_width, q.y(), 70 + (q.z() - 70) / s.nose_length);
  };
  const Vector3 q = stretch(p), m = stretch(p_mirrored);
  const double root = rod(q, {0, -3.0, 73}, {0, -11.5, 60}, 5.6, 5.9);
  const double bridge = rod(q, {0, -11.5, 60}, {0, -21.0, 42}, 5.9, 6.8);
  const double dorsum = rod(q, {0, -21.0, 42}, {0, -24.0, 34}, 6.8, 6.9);
  const double flank = rod(m, {4, -4, 56}, {8.5, -9, 36}, 7, 8.4);
  const double dome = sphere(m, {3.0, -24.4, 33.4}, 5.9);
  const double ala = ellipsoid(m, {10.6, -13.6, 29.4}, {5.8, 8.8, 6.2});
  const double columella = rod(q, {0, -25.5, 28.5}, {0, -13.5, 23.5}, 3.0, 3.4);
  double n = unite(root, bridge, 4);
  n = unite(n, dorsum, 4);
  n = unite(n, flank, 9);
  n = unite(n, dome, 4);
  n = unite(n, ala, 3.4);
  n = unite(n, columella, 3);
  d = unite(d, n, 6.5);
  const double wing_groove = rod(m, {17.3, -15.5, 35.5}, {18.6, -13.5, 26}, 1.2);
  d = subtract(d, wing_groove, 3.0);
  const double nostril = ellipsoid(m, {6.2, -17.6, 22.6}, {2.9, 5.4, 5.2});
  return subtract(d, nostril, 2.0);
}

double upper_lip(const Vector3& p, double d) {
  const double muzzle = ellipsoid(p, {0, 6, 9}, {27, 20.5, 17});
  d = unite(d, muzzle, 9);
  const double bow = rod(p, {0, -12.2, 4.4}, {7, -12.6, 5.4}, 3.3, 3.5);
  const double side = rod(p, {7, -12.6, 5.4}, {17, -9.0, 4.0}, 3.5, 3.0);
  const double corner = rod(p, {17, -9.0, 4.0}, {26, -1.5, 1.8}, 3.0, 1.8);
  const double vermilion = unite(unite(bow, side, 5), corner, 5);
  d = unite(d, vermilion, 2.2);
  const double tubercle = sphere(p, {0, -12.0, 2.6}, 3.4);
  d = unite(d, tubercle, 3);
  const double philtrum = rod(p, {0, -17.6, 19}, {0, -18.6, 10}, 2.4, 3.4);
  d = subtract(d, philtrum, 2.6);
  const double fold = rod(p, {20.5, -13.5, 25}, {31.5, -8.4, 4}, 1.1, 1.6);
  return subtract(d, fold, 5.5);
}

/// How soft the skin sits on the bone: 0 at forehead and bridge of the nose, 1 at cheeks and upper lip.
double softness(const Vector3& p) {
  const double low = 1 - smooth_step(24, 66, p.z());
  const double beside_nose = smooth_step(6, 20, std::abs(p.x()));
  const double bridge = p.z() > 30 ? beside_nose : 1.0;
  return low * (0.15 + 0.85 * bridge);
}

}  // namespace

FaceShape draw_face_shape(std::uint64_t seed) {
  Random random(seed, 0xFACE);
  FaceShape s;
  s.width = random.uniform(0.965, 1.035);
  s.nose_length = random.uniform(0.95, 1.05);
  s.nose_width = random.uniform(0.92, 1.1);
  s.brow = random.uniform(0.8, 1.15);
  s.cheek = random.uniform(0.94, 1.06);
  s.asymmetry_mm = random.uniform(-1.5, 1.5);
  return s;
}

double skin_distance_mm(const FaceShape& s, const Vector3& p_dental_mm) {
  Vector3 p = p_dental_mm;
  // Nobody's nose is quite straight: it bends towards its tip, and the rest of the face with it a little.
  const double bend = (1 - smooth_step(25, 80, p.z())) * (1 - smooth_step(-12, 10, p.y()));
  p.x() = (p.x() - s.asymmetry_mm * bend) / s.width;
  Vector3 m = p;
  m.x() = std::abs(m.x());
  double d = cranium(s, m);
  d = brow_and_cheek(s, m, d);
  if (p.y() < 30) {
    d = eyes(m, d);
    d = nose(s, p, m, d);
    d = upper_lip(m, d);
  }
  return d;
}

TriangleMesh make_face(const FaceShape& shape) {
  Box box;
  box.extend({-86, -42, -40});
  box.extend({86, 84, 160});
  constexpr double edge_mm = 1.15;
  const auto skin = [&](const Vector3& p) { return skin_distance_mm(shape, p); };
  const TriangleMesh whole = mesh_of_field(skin, box, edge_mm, 1.7);
  // Lower rim: along the upper lip, then down across the cheeks. Back: before the ears. Top: the hairline.
  const auto kept = [&](const Vector3& p) {
    const double rim_z = 0.8 - 27 * smooth_step(20, 52, std::abs(p.x()));
    return std::min({p.z() - rim_z, 147 - p.z() + 0.25 * p.y(), 72 - p.y() + 0.1 * (p.z() - 60)});
  };
  return without_islands(clipped(whole, kept), 2000);
}

TriangleMesh with_soft_tissue_shift(const TriangleMesh& face, double largest_mm, std::uint64_t seed) {
  Random random(seed, 0x50F7);
  // Two lobes (left, right cheek) with directions of their own; the lip takes the mean of both.
  const Vector3 left = random.unit_vector(), right = random.unit_vector();
  TriangleMesh out = face;
  for (Vector3& p : out.vertices_mm) {
    const double to_left = smooth_step(-30, 30, p.x());
    const Vector3 direction = to_left * left + (1 - to_left) * right;
    p += largest_mm * softness(p) * direction;
  }
  return out;
}

}  // namespace gnathion
