// What a design makes of its inputs: holes, margins, corrected teeth, and scans with brackets, missing teeth,
// a base plate or a second shell. Coarse voxels: it is the inputs that are looked at.
#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>

#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "core/transform_io.h"
#include "design/preparation.h"
#include "design/preview.h"
#include "design/splint.h"
#include "occlusion/crowns.h"
#include "phantom/jaws.h"
#include "pipeline/design_job.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

const PhantomJaws& jaws() {
  static const PhantomJaws instance = make_phantom_jaws(47);
  return instance;
}

/// Opening by 3° about the condyles, 1 mm forward.
SplintInputs inputs() {
  const PhantomLandmarks& l = jaws().landmarks;
  const Vector3 hinge = 0.5 * (l.condyle_left_mm + l.condyle_right_mm);
  const Rigid3 opening = Rigid3::about_axis(hinge, Vector3::UnitX(), 3.0 * M_PI / 180.0);
  return {jaws().maxilla, jaws().mandible_mi,
          Motion<Dental>(Rigid3::from_translation({0.0, -1.0, 0.0}) * opening)};
}

SplintParameters coarse() {
  SplintParameters p;
  p.voxel_mm = 0.3;
  p.aperture_limit_mm = 0.6;
  p.insertion_search_deg = 0.0;
  return p;
}

Vector3 crown_centre(const TriangleMesh& mesh, const std::vector<std::uint8_t>& labels, std::uint8_t fdi) {
  Vector3 sum = Vector3::Zero();
  double count = 0.0;
  for (std::size_t v = 0; v < labels.size(); ++v)
    if (labels[v] == fdi) {
      sum += mesh.vertices_mm[v];
      count += 1.0;
    }
  return sum / count;
}

/// Vertex of a tooth that lies farthest along `way`.
Vector3 farthest(const TriangleMesh& mesh, const std::vector<std::uint8_t>& labels, std::uint8_t fdi,
                 const Vector3& way) {
  Vector3 best = Vector3::Zero();
  double most = -1e300;
  for (std::size_t v = 0; v < labels.size(); ++v)
    if (labels[v] == fdi && way.dot(mesh.vertices_mm[v]) > most) {
      most = way.dot(mesh.vertices_mm[v]);
      best = mesh.vertices_mm[v];
    }
  return best;
}

TriangleMesh with_hole(const TriangleMesh& mesh, const Vector3& at, double radius_mm) {
  std::vector<bool> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t)
    keep[t] = ((mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)) / 3.0 - at).norm() > radius_mm;
  return submesh(mesh, keep);
}

TEST(DesignInputs, HolesOfTheOpposingArchAreTold) {
  SplintInputs in = inputs();
  const Vector3 at = farthest(in.mandible_mi, jaws().mandible_fdi, 36, Vector3::UnitZ());
  in.mandible_mi = with_hole(in.mandible_mi, at, 1.1);
  const auto prepared = prepare(in, coarse());
  ASSERT_TRUE(prepared.has_value()) << prepared.error().line();
  const auto& told = prepared->warnings;
  EXPECT_EQ(std::count_if(told.begin(), told.end(),
                          [](const std::string& w) { return w.rfind("mandible: hole of 2.", 0) == 0; }),
            1)
      << ::testing::PrintToString(told);
}

/// All along the arch, `depth_mm` behind the cusps' own level.
MarginCurve margin_at(double depth_mm, const ArchFrame& arch) {
  const ArchRuler ruler(arch);
  const OcclusalLevel level(jaws().maxilla, arch, Arch::kMaxilla);
  MarginCurve margin;
  for (double s = -40.0; s <= 40.0; s += 2.0)
    margin.points_mm.push_back(ruler.at(s) + (level.depth_mm(s) + depth_mm) * arch.up);
  return margin;
}

TEST(DesignInputs, AMarginTakesPartInTheInsertionAndInThePreview) {
  SplintInputs in = inputs();
  SplintPreviewer remembers;
  const auto plain = remembers.build(in, coarse());
  ASSERT_TRUE(plain.has_value()) << plain.error().line();
  in.edits.margins = {margin_at(2.0, plain->arch)};
  const auto drawn = remembers.build(in, coarse());
  ASSERT_TRUE(drawn.has_value()) << drawn.error().line();
  // Walls that end 2 mm earlier have less undercut to block out, and less of a splint.
  EXPECT_LT(drawn->insertion.undercut_at_normal_mm3, 0.8 * plain->insertion.undercut_at_normal_mm3);
  EXPECT_LT(signed_volume_mm3(drawn->splint), 0.9 * signed_volume_mm3(plain->splint));
}

class DesignFiles : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_design_inputs_" + std::to_string(::getpid()));
    fs::create_directories(folder_ / "out");
    job_.maxilla = folder_ / "maxilla.stl";
    job_.mandible = folder_ / "mandible.stl";
    job_.transform = folder_ / "T.txt";
    ASSERT_TRUE(write_mesh(job_.maxilla, jaws().maxilla));
    ASSERT_TRUE(write_mesh(job_.mandible, jaws().mandible_mi));
    // No splint fits: 3 mm up. What comes after the check costs nothing here.
    std::ofstream(job_.transform) << "1 0 0 0\n0 1 0 0\n0 0 1 3\n0 0 0 1\n";
    job_.parameters = coarse();
    job_.pictures = false;
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
  DesignJob job_;
  SilentProgress silent_;
};

TEST_F(DesignFiles, CorrectedTeethStandInTheFeasibility) {
  // 37 is lost and 38 has come into its place.
  job_.edits.teeth.missing = {37};
  job_.edits.teeth.labels = {{38, crown_centre(jaws().mandible_mi, jaws().mandible_fdi, 37)}};
  for (ToothCorrections::Label& label : job_.edits.teeth.labels)
    label.at_mm = MeshQuery(jaws().mandible_mi).closest(label.at_mm)->point_mm;
  const auto outcome = run_design(job_, folder_ / "out", silent_);
  ASSERT_TRUE(outcome.has_value()) << outcome.error().line();
  EXPECT_FALSE(outcome->accepted());
  nlohmann::json told;
  std::ifstream(folder_ / "out/feasibility.json") >> told;
  std::vector<int> teeth;
  for (const auto& tooth : told.at("teeth")) teeth.push_back(tooth.at("fdi").get<int>());
  EXPECT_EQ(std::count(teeth.begin(), teeth.end(), 37), 0) << ::testing::PrintToString(teeth);
  EXPECT_EQ(std::count(teeth.begin(), teeth.end(), 38), 1) << ::testing::PrintToString(teeth);
  EXPECT_EQ(std::count(teeth.begin(), teeth.end(), 47), 1) << ::testing::PrintToString(teeth);
}

TEST_F(DesignFiles, WrongCorrectionsAreRefusedBeforeTheCheck) {
  job_.edits.teeth.labels = {{26, jaws().landmarks.molar_left_mm + Vector3(0, 0, 60)}};
  const auto outcome = run_design(job_, folder_ / "out", silent_);
  ASSERT_FALSE(outcome.has_value());
  EXPECT_NE(outcome.error().line().find("tooth 26"), std::string::npos) << outcome.error().line();
  EXPECT_FALSE(fs::exists(folder_ / "out/feasibility.json"));  // which the check writes
}

TEST(DesignInputs, ARefusalsPointsAreInTheDentalFrame) {
  // A wall worn too thin at one place; everything lies far off and turned.
  const Rigid3 place = Rigid3::from_translation({310.0, -90.0, 150.0}) *
                       Rigid3::about_axis(Vector3::Zero(), Vector3(1, 2, -1).normalized(), 1.1);
  SplintInputs in = inputs();
  const Vector3 buccal = farthest(jaws().maxilla, jaws().maxilla_fdi, 26, Vector3(1.0, 0.0, -0.3));
  Stroke thin;
  thin.kind = Stroke::Kind::kRemove;
  thin.path_mm = {place * Vector3(buccal + Vector3(1.1, 0.0, -0.2))};
  thin.radius_mm = 3.0;
  thin.depth_mm = 1.0;
  in = {transformed(place, in.maxilla), transformed(place, in.mandible_mi),
        Motion<Dental>(place * in.therapeutic.rigid * place.inverse())};
  in.edits.strokes = {thin};
  SilentProgress silent;
  const auto design = design_splint(in, coarse(), silent);
  ASSERT_TRUE(design.has_value()) << design.error().line();
  EXPECT_EQ(design->verdict, "fail");
  EXPECT_LT(design->verification.thickness.min_mm, 0.5);
  EXPECT_LT((design->verification.thickness.where_mm - thin.path_mm.front()).norm(), 3.0);
  const MeshQuery splint(design->splint);
  const nlohmann::json told = design_json(*design, {}, "test", 0.0, 0.0);
  const auto on_splint = [&](const nlohmann::json& at, const char* what) {
    const Vector3 p(at[0].get<double>(), at[1].get<double>(), at[2].get<double>());
    EXPECT_LT(splint.closest(p)->distance_mm, 0.2) << what;
  };
  on_splint(told.at("thickness_mm").at("where_mm"), "thickness");
  on_splint(told.at("insertability").at("where_mm"), "insertability");
  on_splint(told.at("imprint").at("where_mm"), "imprint");
}

/// Brackets on 14 to 24: bumps of 3 by 3 mm, 1.2 mm proud.
void add_brackets(TriangleMesh& maxilla) {
  const auto normals = vertex_normals(maxilla);
  for (const std::uint8_t fdi : std::array<std::uint8_t, 8>{14, 13, 12, 11, 21, 22, 23, 24}) {
    const Vector3 c = crown_centre(maxilla, jaws().maxilla_fdi, fdi);
    const Vector3 outwards = Vector3(c.x(), c.y() - 25.0, 0.0).normalized();
    const Vector3 along = outwards.cross(Vector3::UnitZ());
    const Vector3 face = farthest(maxilla, jaws().maxilla_fdi, fdi, outwards);
    for (std::size_t v = 0; v < normals.size(); ++v) {
      Vector3& p = maxilla.vertices_mm[v];
      if (jaws().maxilla_fdi[v] != fdi || normals[v].dot(outwards) < 0.5) continue;
      if (std::abs(along.dot(p - face)) < 1.5 && std::abs(p.z() - face.z()) < 1.5) p += 1.2 * outwards;
    }
  }
}

/// A tooth that was lost: a low ridge stands in its place.
void lose_tooth(TriangleMesh& mesh, const std::vector<std::uint8_t>& labels, std::uint8_t fdi) {
  const Vector3 up = fdi < 30 ? Vector3(-Vector3::UnitZ()) : Vector3::UnitZ();  // away from the gingiva
  const Vector3 neck = farthest(mesh, labels, fdi, -up), tip = farthest(mesh, labels, fdi, up);
  const Vector3 middle = crown_centre(mesh, labels, fdi);
  const double tall = up.dot(tip - neck);
  for (std::size_t v = 0; v < labels.size(); ++v) {
    if (labels[v] != fdi) continue;
    Vector3& p = mesh.vertices_mm[v];
    const double height = up.dot(p - neck), part = std::max(0.0, height / tall);
    const Vector3 aside = (p - middle) - up.dot(p - middle) * up;
    p -= 0.75 * height * up + 0.5 * part * aside;
  }
}

TEST(BadInput, BracketsMissingTeethAndBasePlatesAreBuiltUpon) {
  SplintInputs in = inputs();
  add_brackets(in.maxilla);
  lose_tooth(in.maxilla, jaws().maxilla_fdi, 16);
  lose_tooth(in.mandible_mi, jaws().mandible_fdi, 45);
  in.mandible_mi = closed_to_solid(in.mandible_mi, -Vector3::UnitZ(), nullptr);
  ASSERT_TRUE(mesh_topology(in.mandible_mi).watertight());
  SplintParameters p = coarse();
  p.voxel_mm = 0.2;  // brackets have sharp edges
  SilentProgress silent;
  const auto design = design_splint(in, p, silent);
  ASSERT_TRUE(design.has_value()) << design.error().line();
  EXPECT_EQ(design->verdict, "pass") << ::testing::PrintToString(design->violated) << " "
                                     << design->verification.maxilla_penetration_mm;
  const MeshQuery splint(design->splint);
  double depth = 0.0;
  for (const Vector3& v : in.maxilla.vertices_mm)
    if (const auto d = splint.signed_distance(v, 1.0)) depth = std::max(depth, -d->distance_mm);
  EXPECT_LE(depth, 0.02);
  EXPECT_GT(design->verification.kept_fraction, 0.5);
}

}  // namespace
}  // namespace gnathion
