// Printer profiles, build direction, plates.
#include <gtest/gtest.h>

#include <unistd.h>
#include <cmath>
#include <filesystem>

#include "core/file.h"
#include "core/random.h"
#include "design/printing/build_direction.h"
#include "design/printing/plate.h"
#include "design/printing/printer_profile.h"
#include "design/splint_field.h"
#include "design/write_ply.h"

namespace gnathion {
namespace {

constexpr char kProfile[] = R"(
name = "Test printer"
[plate]
x_mm = 120
y_mm = 70
height_mm = 150
[scale]
x = 0.995
y = 1.002
z = 1.0
source = "bars of 60 mm, 2026-01-05"
[[material]]
name = "clear"
gap_mm = 0.08
source = "ladder of 2026-01-06"
)";

/// A block of 30 x 20 x 10 mm with a pocket of 20 x 12 x 6 mm that opens to +z; the pocket is the cavity.
SplintSurface block_with_pocket() {
  SplintSurface out;
  const auto ring = [&](double x, double y, double z, std::uint8_t part) {
    for (const auto& [sx, sy] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
      out.mesh.vertices_mm.emplace_back(0.5 * sx * x, 0.5 * sy * y, z);
      out.part.push_back(part);
      out.thickness_mm.push_back(4.0f);
    }
  };
  const auto outer = static_cast<std::uint8_t>(SurfacePart::kOuter);
  ring(30, 20, 0, outer);
  ring(30, 20, 10, outer);
  ring(20, 12, 10, 0);
  ring(20, 12, 4, 0);
  const auto quad = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    out.mesh.triangles.push_back({a, b, c});
    out.mesh.triangles.push_back({a, c, d});
  };
  quad(3, 2, 1, 0);
  for (std::uint32_t k = 0; k < 4; ++k) {
    const std::uint32_t n = (k + 1) % 4;
    quad(k, n, 4 + n, 4 + k);
    quad(4 + k, 4 + n, 8 + n, 8 + k);
    quad(8 + k, 8 + n, 12 + n, 12 + k);
  }
  quad(12, 13, 14, 15);
  return out;
}

TEST(PrinterProfile, IsReadWithItsSources) {
  const auto profile = parse_printer_profile(kProfile, "p.toml");
  ASSERT_TRUE(profile) << profile.error().line();
  EXPECT_EQ(profile->name, "Test printer");
  EXPECT_DOUBLE_EQ(profile->printed_scale.y(), 1.002);
  ASSERT_TRUE(profile->material("clear"));
  EXPECT_DOUBLE_EQ(profile->material("clear")->gap_mm, 0.08);
  EXPECT_FALSE(profile->material("grey"));
}

TEST(PrinterProfile, FaultsAreNamed) {
  const auto fault = [](const std::string& text) {
    const auto profile = parse_printer_profile(text, "p.toml");
    return profile ? std::string() : profile.error().line();
  };
  EXPECT_NE(fault("[plate]\nx_mm = 100\n").find("name: missing"), std::string::npos);
  EXPECT_NE(fault("name = \"a\"\nspeed = 3\n").find("speed: no such key"), std::string::npos);
  EXPECT_NE(fault("name = \"a\"\n[scale]\nx = 0.99\n").find("source: missing"), std::string::npos);
  EXPECT_NE(fault("name = \"a\"\n[scale]\nx = 99\nsource = \"s\"\n").find("scale.x"), std::string::npos);
  EXPECT_NE(fault("name = \"a\"\n[[material]]\nname = \"m\"\ngap_mm = 0.1\n").find("source: missing"),
            std::string::npos);
  EXPECT_NE(fault("name = \"a\"\nplate = 3\n").find("plate: not a table"), std::string::npos);
  EXPECT_NE(fault("name = ").find("p.toml:1"), std::string::npos);
}

TEST(BuildDirection, OverhangsAreTheFacesThatLookDown) {
  const SplintSurface block = block_with_pocket();
  ASSERT_TRUE(mesh_topology(block.mesh).watertight());
  ASSERT_NEAR(signed_volume_mm3(block.mesh), 30 * 20 * 10 - 20 * 12 * 6, 1e-9);
  const BuildDirection open = overhang_along(block, Vector3::UnitZ(), 45.0);
  EXPECT_NEAR(open.cavity_overhang_mm2, 0.0, 1e-9);
  EXPECT_NEAR(open.overhang_mm2, 600.0, 1e-9);
  EXPECT_NEAR(open.height_mm, 10.0, 1e-9);
  const BuildDirection over = overhang_along(block, -Vector3::UnitZ(), 45.0);
  EXPECT_NEAR(over.cavity_overhang_mm2, 240.0, 1e-9);
  // On its side the pocket's upper wall hangs, and nothing else does but the block's own side.
  const BuildDirection side = overhang_along(block, Vector3::UnitX(), 45.0);
  EXPECT_NEAR(side.cavity_overhang_mm2, 72.0, 1e-9);
  EXPECT_NEAR(side.overhang_mm2, 272.0, 1e-9);
}

TEST(BuildDirection, KeepsTheCavityFreeHoweverThePartLies) {
  Random random(11);
  for (int n = 0; n < 5; ++n) {
    const Rigid3 place{random.rotation(), 50.0 * random.normal3()};
    SplintSurface block = block_with_pocket();
    block.mesh = transformed(place, block.mesh);
    const BuildDirection best = find_build_direction(block, place.rotation.col(2));
    EXPECT_NEAR(best.cavity_overhang_mm2, 0.0, 1e-9);
    EXPECT_NEAR(best.standing_in_cavity_mm2, 0.0, 1e-9);
    // A tilt by more than 45° lets the bottom stand by itself; the pocket's wall must not hang then.
    EXPECT_LT(best.overhang_mm2, 600.0 + 1e-9);
  }
}

TEST(Plate, PartsLieApartOnThePlateAndScaleIsUndone) {
  const auto profile = parse_printer_profile(kProfile, "p.toml");
  ASSERT_TRUE(profile);
  const SplintSurface block = block_with_pocket();
  Random random(7);
  std::vector<TriangleMesh> meshes;
  std::vector<Vector3> up;
  for (int n = 0; n < 9; ++n) {
    const Rigid3 place{random.rotation(), 30.0 * random.normal3()};
    meshes.push_back(transformed(place, block.mesh));
    up.push_back(place.rotation.col(2));
  }
  std::vector<const TriangleMesh*> parts;
  for (const TriangleMesh& mesh : meshes) parts.push_back(&mesh);
  const auto out = laid_out(parts, up, std::vector<std::string>(9, "block"), *profile);
  ASSERT_TRUE(out) << out.error().line();
  std::vector<Box> boxes;
  for (std::size_t n = 0; n < 9; ++n) {
    const Box box = bounding_box(placed((*out)[n], meshes[n]));
    boxes.push_back(box);
    EXPECT_GE(box.min_mm.x(), profile->margin_mm - 1e-9);
    EXPECT_GE(box.min_mm.y(), profile->margin_mm - 1e-9);
    EXPECT_NEAR(box.min_mm.z(), profile->lift_mm, 1e-9);
    EXPECT_LE(box.max_mm.x(), 120.0 - profile->margin_mm + 1e-9);
    EXPECT_LE(box.max_mm.y(), 70.0 - profile->margin_mm + 1e-9);
    // As printed it has the lengths of the design: 30 x 20 x 10 with the pocket up.
    EXPECT_NEAR(box.size_mm().x() * 0.995, 30.0, 1e-3);
    EXPECT_NEAR(box.size_mm().y() * 1.002, 20.0, 1e-3);
    EXPECT_NEAR(box.size_mm().z(), 10.0, 1e-9);
    EXPECT_GT((*out)[n].linear.determinant(), 0.0);
    for (std::size_t m = 0; m < n; ++m) {
      if ((*out)[m].plate != (*out)[n].plate) continue;
      const Vector3 gap = (boxes[m].min_mm - box.max_mm).cwiseMax(box.min_mm - boxes[m].max_mm);
      EXPECT_GE(std::max(gap.x(), gap.y()), profile->spacing_mm - 1e-9);
    }
  }
  EXPECT_EQ(out->front().plate, 0u);
  EXPECT_LE(out->back().plate, 1u);
}

TEST(Plate, APartThatNoPlateHoldsIsRefused) {
  auto profile = parse_printer_profile(kProfile, "p.toml");
  ASSERT_TRUE(profile);
  profile->room_mm = {40, 20, 150};
  const SplintSurface block = block_with_pocket();
  const auto out = laid_out({&block.mesh}, {Vector3::UnitZ()}, {"block"}, *profile);
  ASSERT_FALSE(out);
  EXPECT_EQ(out.error().code, ErrorCode::kGate);
}

TEST(SplintPly, ComesBackAsItWasAndNothingElseIsTaken) {
  const auto path =
      std::filesystem::temp_directory_path() / ("gnathion_splint_ply_" + std::to_string(::getpid()) + ".ply");
  SplintSurface block = block_with_pocket();
  block.thickness_mm[3] = -1.0f;
  ASSERT_TRUE(write_splint_ply(path, block));
  const auto back = read_splint_ply(path);
  ASSERT_TRUE(back) << back.error().line();
  EXPECT_EQ(back->mesh.vertices_mm, block.mesh.vertices_mm);
  EXPECT_EQ(back->mesh.triangles, block.mesh.triangles);
  EXPECT_EQ(back->thickness_mm, block.thickness_mm);
  EXPECT_EQ(back->part, block.part);
  const auto bytes = read_file(path);
  ASSERT_TRUE(bytes);
  for (const std::size_t size : {std::size_t{0}, std::size_t{10}, bytes->size() / 2, bytes->size() - 1}) {
    ASSERT_TRUE(write_file(path, bytes->substr(0, size)));
    EXPECT_FALSE(read_splint_ply(path)) << size;
  }
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace gnathion
