// The bite of jaws whose edges are known by construction.
#include "occlusion/clinical.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/random.h"

namespace gnathion {
namespace {

struct Bite {
  TriangleMesh maxilla, mandible;
  std::vector<std::uint8_t> maxilla_fdi, mandible_fdi;
  ArchFrame arch;
};

/// Incisors as small plates: upper edges 2.4 mm before the lower ones and 1.6 mm below them; molars at the
/// back. x left, y posterior, z up.
Bite plates() {
  Bite b;
  const auto tooth = [](TriangleMesh& mesh, std::vector<std::uint8_t>& fdi, std::uint8_t number,
                        const Vector3& edge, double root) {
    for (const double x : {-3.0, 0.0, 3.0})
      for (const double z : {0.0, root}) {
        mesh.vertices_mm.push_back(edge + Vector3(x, 0, z));
        fdi.push_back(number);
      }
  };
  tooth(b.maxilla, b.maxilla_fdi, 11, {-4, 0, 0}, 9.0);
  tooth(b.maxilla, b.maxilla_fdi, 21, {4, 0, 0}, 9.0);
  tooth(b.mandible, b.mandible_fdi, 31, {3, 2.4, 1.6}, -8.0);
  tooth(b.mandible, b.mandible_fdi, 41, {-3, 2.4, 1.6}, -8.0);
  tooth(b.mandible, b.mandible_fdi, 36, {22, 28, 0}, -6.0);
  tooth(b.mandible, b.mandible_fdi, 47, {-22, 36, 0}, -6.0);
  return b;
}

void turn(Bite& b, const Rigid3& place) {
  b.maxilla = transformed(place, b.maxilla);
  b.mandible = transformed(place, b.mandible);
  for (Vector3* d : {&b.arch.up, &b.arch.anterior, &b.arch.left}) *d = place.rotation * *d;
}

std::optional<BitePoints> points_of(const Bite& b) {
  return bite_points(b.maxilla, b.maxilla_fdi, b.mandible, b.mandible_fdi, b.arch);
}

TEST(BiteReadout, IsThatOfTheTeethWhereverTheyLie) {
  Random random(5);
  for (int n = 0; n < 4; ++n) {
    Bite b = plates();
    const Rigid3 place = n == 0 ? Rigid3::identity() : Rigid3{random.rotation(), 40.0 * random.normal3()};
    turn(b, place);
    const auto points = points_of(b);
    ASSERT_TRUE(points);
    // 2.5 mm down, 1 mm forward, 0.5 mm to the left.
    const Rigid3 motion = place * Rigid3::from_translation({0.5, -1.0, -2.5}) * place.inverse();
    const BiteReadout r = bite_readout(*points, b.arch, motion);
    EXPECT_NEAR(r.overjet_mi_mm, 2.4, 1e-9);
    EXPECT_NEAR(r.overbite_mi_mm, 1.6, 1e-9);
    EXPECT_NEAR(r.overjet_mm, 1.4, 1e-9);
    EXPECT_NEAR(r.overbite_mm, -0.9, 1e-9);
    EXPECT_NEAR(r.vertical_mm, 2.5, 1e-9);
    EXPECT_NEAR(r.vertical_left_mm.value(), 2.5, 1e-9);
    EXPECT_NEAR(r.vertical_right_mm.value(), 2.5, 1e-9);
    EXPECT_NEAR(r.midline_mm, 0.5, 1e-9);
  }
}

TEST(BiteReadout, AHingeOpensTheFrontMore) {
  const Bite b = plates();
  // About an axis 90 mm behind the edges, level with them: 3° drop the front by 90·sin 3°.
  const double angle = 3.0 * M_PI / 180.0;
  const Rigid3 opening = Rigid3::about_axis({0, 92.4, 1.6}, Vector3::UnitX(), angle);
  const BiteReadout r = bite_readout(*points_of(b), b.arch, opening);
  EXPECT_NEAR(r.vertical_mm, 90.0 * std::sin(angle), 1e-6);
  EXPECT_GT(r.vertical_mm, *r.vertical_left_mm);
  EXPECT_GT(*r.vertical_left_mm, *r.vertical_right_mm);  // the right one stands farther back
  EXPECT_GT(r.overjet_mm, r.overjet_mi_mm);
}

TEST(BiteReadout, OneCentralStandsForBothAndNoneGivesNothing) {
  Bite b = plates();
  for (std::uint8_t& f : b.maxilla_fdi)
    if (f == 21) f = 0;
  const auto points = points_of(b);
  ASSERT_TRUE(points);
  EXPECT_NEAR(points->upper_incisal_mm.x(), -4.0, 1e-9);
  for (std::uint8_t& f : b.maxilla_fdi) f = 0;
  EXPECT_FALSE(points_of(b));
}

}  // namespace
}  // namespace gnathion
