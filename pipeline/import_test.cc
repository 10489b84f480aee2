#include "pipeline/import_case.h"

#include <gtest/gtest.h>
#include <unistd.h>
#include <zip.h>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/transform_io.h"
#include "occlusion/test_jaws.h"
#include "pipeline/case_private.h"
#include "pipeline/dpvision_workspace.h"
#include "tracking/motion_file.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTetrahedron =
    "v 0 0 0\nv 40 0 0\nv 0 40 0\nv 0 0 10\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

#define EXPECT_HAS(text, part) EXPECT_NE((text).find(part), std::string::npos) << (text)

/// A zip of these entries, as bytes.
std::string zipped(const std::map<std::string, std::string>& entries) {
  const fs::path path = fs::temp_directory_path() / ("gnathion_zip_" + std::to_string(::getpid()));
  fs::remove(path);
  int code = 0;
  zip_t* zip = zip_open(path.c_str(), ZIP_CREATE, &code);
  for (const auto& [name, bytes] : entries)
    zip_file_add(zip, name.c_str(), zip_source_buffer(zip, bytes.data(), bytes.size(), 0), ZIP_FL_ENC_UTF_8);
  zip_close(zip);
  const std::string all = *read_file(path);
  fs::remove(path);
  return all;
}

std::string why(const Result<DpWorkspace>& r) {
  return r ? "read" : r.error().line();
}
std::string why(const Result<DpArchive>& r) {
  return r ? "read" : r.error().line();
}

TEST(Dpw, ReadsNestingMacrosAndPlacements) {
  const auto w = parse_dpw(R"(# a comment { [
define $NAME "lower jaw"
transformation { label "outer" translation [1, 2; 3]
  rotation { axis [0 0 1] origin [0 0 0] angle 90 }
  trans { label "transformation" matrix [1 0 0 5  0 1 0 0  0 0 1 -2  0 0 0 1] translation [9 9 9]
    shell { label $NAME keywords "lower; x" file "a b.stl" } } }
plane { center [1 2 3] normal [0 0 2] size 40 keywords "cut_plane" }
motion { sequence { frame { delay 0.5 translation [0 0 -1] } frame { time 0.25 matrix [1 0 0 0 0 1 0 0 0 0 1 -3 0 0 0 1] }
   frameset { count 3 time 2 } } shell { file "m.obj" } }
)",
                           "w.dpw");
  ASSERT_TRUE(w) << w.error().line();
  ASSERT_EQ(w->nodes.size(), 3u);
  const DpNode& outer = w->nodes[0];
  const Eigen::Vector4d moved =
      outer.matrix * Eigen::Vector4d(0, 0, 0, 1);  // first shifted to (1, 2, 3), then turned
  EXPECT_NEAR((moved.head<3>() - Vector3(-2, 1, 3)).norm(), 0, 1e-12);
  const DpNode& inner = outer.children.at(0);
  EXPECT_EQ(inner.matrix(0, 3), 5.0) << "the matrix wins over the translation";
  EXPECT_EQ(inner.children.at(0).label, "lower jaw");
  EXPECT_TRUE(inner.children.at(0).has_keyword("lower"));
  EXPECT_EQ(inner.children.at(0).file, "a b.stl");
  EXPECT_EQ(w->nodes[2].frames.size(), 2u);
  EXPECT_EQ(w->nodes[2].children.size(), 1u);
  ASSERT_EQ(w->notes.size(), 1u);
  EXPECT_HAS(w->notes[0], "line 9: unknown word 'frameset'");
}

TEST(Dpw, AnUnknownWordIsToldAndTheRestIsRead) {
  const auto w = parse_dpw(
      "glow { deep { 1 } }\nshell { file \"a\" shine 3 tint [1 2] label \"x\" }\nnoise\nshell { file \"b\" }",
      "w");
  ASSERT_TRUE(w) << w.error().line();
  ASSERT_EQ(w->nodes.size(), 2u);
  EXPECT_EQ(w->nodes[0].label, "x");
  EXPECT_EQ(w->notes.size(), 4u);
}

TEST(Dpw, RefusesByLineWhatCannotBe) {
  EXPECT_HAS(why(parse_dpw("shell {\n file \"a\"\n", "w")), "line 1");
  EXPECT_HAS(why(parse_dpw("shell\n", "w")), "needs a block");
  EXPECT_HAS(why(parse_dpw("}\n", "w")), "line 1");
  EXPECT_HAS(why(parse_dpw("\ntrans { matrix [1 2 3] }", "w")),
             "line 2: 'matrix' has 3 numbers, 16 are needed");
  EXPECT_HAS(why(parse_dpw("trans { translation [1 2 nan] }", "w")), "'nan'");
  EXPECT_HAS(why(parse_dpw("trans { translation [1 2 1e300] }", "w")), "1e7");
  EXPECT_HAS(why(parse_dpw("trans { rotation { axis [0 0 0] angle 3 } }", "w")), "no direction");
  EXPECT_HAS(why(parse_dpw("shell { label \"x }", "w")), "does not end");
  EXPECT_HAS(why(parse_dpw(std::string("a\0b", 3), "w")), "no text");
  EXPECT_HAS(why(parse_dpw("PK\x03\x04xxxx", "w")), "dpvision");
  std::string deep;
  for (int i = 0; i < 5000; ++i) deep += "trans { ";
  EXPECT_HAS(why(parse_dpw(deep, "w")), "deeper than 64");
  std::string laughs = "define $a0 \"" + std::string(1000, 'x') + "\"\n";
  for (int i = 1; i < 30; ++i)
    laughs += "define $a" + std::to_string(i) + " \"$a" + std::to_string(i - 1) + "$a" +
              std::to_string(i - 1) + "\"\n";
  EXPECT_HAS(why(parse_dpw(laughs + "shell { label $a29 }", "w")), "longer than 64 kB");
}

TEST(Dpw, WhatIsWrittenReadsTheSame) {
  DpWorkspace w;
  DpNode t;
  t.kind = DpNode::Kind::kTransformation;
  t.label = "transformation";
  t.matrix = Rigid3::about_axis({1, 2, 3}, {0.1, 0.7, 0.3}, 0.123).matrix();
  DpNode s;
  s.kind = DpNode::Kind::kShell;
  s.label = "lower";
  s.keywords = {"lower", "other"};
  s.file = "x_files/lower jaw.stl";
  t.children = {s};
  DpNode a;
  a.kind = DpNode::Kind::kAnimation;
  a.frames = {{"first", 0.1, t.matrix}, {"", 0.2, Matrix4::Identity()}};
  a.children = {s};
  DpNode p;
  p.kind = DpNode::Kind::kPlane;
  p.keywords = {"cut_plane"};
  p.centre_mm = {1.0 / 3, 2, 3};
  p.normal = {0, 0, 1};
  p.size_mm = 50;
  w.nodes = {t, a, p};
  const auto back = parse_dpw(format_dpw(w), "w");
  ASSERT_TRUE(back) << back.error().line();
  EXPECT_TRUE(back->notes.empty());
  ASSERT_EQ(back->nodes.size(), 3u);
  EXPECT_EQ(back->nodes[0].matrix, t.matrix);
  EXPECT_EQ(back->nodes[0].children[0].file, s.file);
  EXPECT_EQ(back->nodes[0].children[0].keywords, s.keywords);
  EXPECT_EQ(back->nodes[1].frames.size(), 2u);
  EXPECT_EQ(back->nodes[1].frames[0].matrix, t.matrix);
  EXPECT_EQ(back->nodes[1].children.size(), 1u);
  EXPECT_EQ(back->nodes[2].centre_mm, p.centre_mm);
  EXPECT_EQ(format_dpw(*back), format_dpw(w));
}

TEST(Dpvision, HostileArchivesAreRefusedInOneLine) {
  const std::string shell =
      R"(<workspace><object id="1" label="upper" path="o"><file data="a.obj" format="obj"/></object></workspace>)";
  EXPECT_EQ(why(parse_dpvision(zipped({{"structure.xml", shell}, {"o/a.obj", kTetrahedron}}), "z")), "read");
  EXPECT_HAS(why(parse_dpvision("PK nonsense", "z")), "no zip");
  EXPECT_NE(why(parse_dpvision("", "z")), "read");
  EXPECT_HAS(why(parse_dpvision(zipped({{"other.xml", "x"}}), "z")), "no structure.xml");
  EXPECT_HAS(why(parse_dpvision(zipped({{"structure.xml", shell}}), "z")), "o/a.obj is not in it");
  for (const char* name : {"../evil.obj", "/etc/passwd", "a/../../b", "c:/x"})
    EXPECT_HAS(why(parse_dpvision(zipped({{"structure.xml", shell}, {name, "x"}}), "z")), "lies outside");
  EXPECT_HAS(why(parse_dpvision(
                 zipped({{"structure.xml",
                          R"(<workspace><object id="1"><file data="../../x.obj"/></object></workspace>)"}}),
                 "z")),
             "outside of it");
  EXPECT_HAS(why(parse_dpvision(zipped({{"structure.xml", std::string(70u << 20, ' ')}}), "z")),
             "more than 64 MB");
  EXPECT_HAS(why(parse_dpvision_structure("<workspace><object>", "z")), "line 1, column");
  EXPECT_HAS(why(parse_dpvision_structure("<other/>", "z")), "not <workspace>");
  EXPECT_HAS(
      why(parse_dpvision_structure("<!DOCTYPE x [<!ENTITY a \"aaaa\">]><workspace>&a;</workspace>", "z")),
      "document type");
  EXPECT_HAS(why(parse_dpvision_structure(
                 "<workspace><object id='1'><matrix>1 2 3</matrix></object></workspace>", "z")),
             "16 are needed");
  EXPECT_HAS(why(parse_dpvision_structure("<workspace><object id='1'><matrix>1e308 0 0 0 0 1 0 0 0 0 1 0 0 0 "
                                          "0 1</matrix></object></workspace>",
                                          "z")),
             "1e7");
  EXPECT_HAS(why(parse_dpvision_structure(
                 "<workspace><object id='1' parent='2'/><object id='2' parent='1'/></workspace>", "z")),
             "loop");
  EXPECT_HAS(why(parse_dpvision_structure("<workspace><object id='1' parent='1'/></workspace>", "z")),
             "loop");
  EXPECT_HAS(why(parse_dpvision_structure("<workspace><object id='1'/><object id='1'/></workspace>", "z")),
             "the id 1");
  std::string chain = "<workspace>";
  for (int i = 1; i < 3000; ++i)
    chain += "<object id='" + std::to_string(i) + "' parent='" + std::to_string(i - 1) + "'/>";
  EXPECT_HAS(why(parse_dpvision_structure(chain + "</workspace>", "z")), "deeper than 64");
}

class Import : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("gnathion_import_" + std::to_string(::getpid()));
    fs::remove_all(root_);
    fs::create_directories(root_ / "in");
    ASSERT_TRUE(write_mesh(root_ / "in" / "Kowalski_Upper.stl", jaws().maxilla));
    ASSERT_TRUE(write_mesh(root_ / "in" / "Kowalski_lower.stl", jaws().mandible));
  }
  void TearDown() override { fs::remove_all(root_); }
  static const testing::SimpleJaws& jaws() {
    static const testing::SimpleJaws all = testing::simple_jaws();
    return all;
  }

  Result<ImportReport> import(const fs::path& from, const std::string& id,
                              std::map<std::string, std::string> roles = {}, bool trust = false) {
    CaseImport what;
    what.from = from;
    what.folder = root_ / id;
    what.id = id;
    what.patient.name = "Piotr Kowalski";
    what.roles = std::move(roles);
    what.trust_names = trust;
    ManualClock clock(HostTime{1'700'000'000'000'000'000});
    SilentProgress silent;
    return import_case(what, clock, silent);
  }
  /// Nothing of the patient outside of case.toml, no name of theirs in any path.
  void expect_no_identity(const fs::path& folder) const {
    for (const auto& f : fs::recursive_directory_iterator(folder)) {
      EXPECT_EQ(f.path().filename().string().find("owalski"), std::string::npos) << f.path();
      if (!f.is_regular_file() || f.path().filename() == "case.toml") continue;
      EXPECT_EQ(read_file(f.path())->find("owalski"), std::string::npos) << f.path();
    }
  }

  fs::path root_;
};

TEST_F(Import, AFolderByNamesThatTheShapesConfirm) {
  const auto r = import(root_ / "in", "p-1");
  ASSERT_TRUE(r) << r.error().line();
  const auto c = read_case(root_ / "p-1", CaseTrust::kConfined);
  ASSERT_TRUE(c) << c.error().line();
  EXPECT_EQ(*read_file(c->maxilla_mi), *read_file(root_ / "in" / "Kowalski_Upper.stl"));
  EXPECT_EQ(c->patient.name, "Piotr Kowalski");
  expect_no_identity(root_ / "p-1");
}

TEST_F(Import, WhatIsUnsureIsAskedFor) {
  fs::rename(root_ / "in" / "Kowalski_lower.stl", root_ / "in" / "scan2.stl");
  auto r = import(root_ / "in", "p-1");
  ASSERT_FALSE(r);
  EXPECT_HAS(r.error().line(), "--role mandible_mi=");
  EXPECT_TRUE(import(root_ / "in", "p-1", {{"mandible_mi", "scan2.stl"}}));
  ASSERT_TRUE(write_mesh(root_ / "in" / "upper_again.stl", jaws().maxilla));
  r = import(root_ / "in", "p-2", {{"mandible_mi", "scan2.stl"}});
  ASSERT_FALSE(r);
  EXPECT_HAS(r.error().line(), "could be it; --role maxilla_mi=");
  fs::remove(root_ / "in" / "upper_again.stl");
  // Apart by 40 mm: not in one frame.
  ASSERT_TRUE(write_mesh(root_ / "in" / "scan2.stl",
                         transformed(Rigid3::from_translation({0, 0, -40}), jaws().mandible)));
  r = import(root_ / "in", "p-2", {{"mandible_mi", "scan2.stl"}});
  ASSERT_FALSE(r);
  EXPECT_HAS(r.error().line(), "--trust-names goes on");
  EXPECT_TRUE(import(root_ / "in", "p-2", {{"mandible_mi", "scan2.stl"}}, true));
  EXPECT_FALSE(import(root_ / "in", "p-1")) << "the case is there already";
  EXPECT_FALSE(import(root_ / "absent", "p-3"));
  ASSERT_TRUE(write_file(root_ / "x.dcm", "x"));
  EXPECT_FALSE(import(root_ / "x.dcm", "p-3"));
  EXPECT_FALSE(fs::exists(root_ / "p-3"));
  for (const auto& f : fs::directory_iterator(root_))
    EXPECT_EQ(f.path().filename().string().find(".import"), std::string::npos);
}

TEST_F(Import, NoLinkLeadsOutOfAFolder) {
  ASSERT_TRUE(write_mesh(root_ / "secret.stl", jaws().maxilla));
  fs::create_symlink(root_ / "secret.stl", root_ / "in" / "face.stl");
  fs::create_symlink(root_ / "secret.stl", root_ / "in" / "other.stl");
  ASSERT_TRUE(import(root_ / "in", "p-1"));
  EXPECT_TRUE(read_case(root_ / "p-1")->face_mi.empty());
  for (const char* name : {"other.stl", "../secret.stl", "none.stl"})
    EXPECT_FALSE(import(root_ / "in", "p-2", {{"face_mi", name}})) << name;
  EXPECT_FALSE(import(root_ / "in", "p-2", {{"face_mi", (root_ / "secret.stl").string()}}));
  // A rig's bodies travel with it; a link to a body does not.
  ASSERT_TRUE(write_file(root_ / "secret.toml", "x"));
  ASSERT_TRUE(write_file(root_ / "in" / "rig.toml", "bow = \"bow.toml\"\n"));
  fs::create_symlink(root_ / "secret.toml", root_ / "in" / "bow.toml");
  EXPECT_FALSE(import(root_ / "in", "p-2"));
  fs::remove(root_ / "in" / "bow.toml");
  ASSERT_TRUE(write_file(root_ / "in" / "bow.toml", "x"));
  EXPECT_TRUE(import(root_ / "in", "p-2"));
  EXPECT_FALSE(copy_private(root_ / "in" / "face.stl", root_ / "copy.stl", LinkUse::kRefuse));
  EXPECT_FALSE(fs::exists(root_ / "copy.stl"));
}

TEST_F(Import, WhatIsSentIsWhatIsRead) {
  const auto names_of = [&](const fs::path& from) {
    std::string text;
    for (const ImportSource& s : import_sources(from).value_or(std::vector<ImportSource>{}))
      text += s.name + " ";
    return text;
  };
  EXPECT_EQ(names_of(root_ / "in"), "Kowalski_Upper.stl Kowalski_lower.stl ");
  ASSERT_TRUE(write_file(root_ / "w.dpw", "shell { label \"u\" file \"in/Kowalski_Upper.stl\" }\n"));
  EXPECT_EQ(names_of(root_ / "w.dpw"), "w.dpw in/Kowalski_Upper.stl ");
  ASSERT_TRUE(write_file(root_ / "w.dpw",
                         "shell { label \"u\" file \"./in//Kowalski_Upper.stl\" }\n"
                         "shell { label \"v\" file \"in/Kowalski_Upper.stl\" }\n"));
  EXPECT_EQ(names_of(root_ / "w.dpw"), "w.dpw in/Kowalski_Upper.stl ");
  const std::string absolute = (root_ / "in" / "Kowalski_Upper.stl").string();
  ASSERT_TRUE(write_file(root_ / "w.dpw", "shell { label \"u\" file \"" + absolute + "\" }\n"));
  EXPECT_FALSE(import_sources(root_ / "w.dpw"));
  ASSERT_TRUE(write_file(root_ / "w.dpw", "shell { file \"../passwd\" }\n"));
  EXPECT_FALSE(import_sources(root_ / "w.dpw"));
  ASSERT_TRUE(write_file(root_ / "s.mhd", "NDims = 3\nElementDataFile = w.dpw\n"));
  EXPECT_EQ(names_of(root_ / "s.mhd"), "s.mhd w.dpw ");
  EXPECT_FALSE(import_sources(root_ / "none"));
}

TEST_F(Import, AWorkspaceGoesInAndOutAndInAgain) {
  const Rigid3 t = Rigid3::about_axis({0, 60, 30}, {1, 0, 0}, 0.05);
  const Rigid3 outer = Rigid3::about_axis({5, 5, 5}, {0, 0, 1}, 0.7);
  DpWorkspace w;
  DpNode world{DpNode::Kind::kTransformation, "scanner", "", {}, outer.matrix()};
  DpNode upper{DpNode::Kind::kShell, "a", "", {"upper"}};
  upper.file = "Kowalski_Upper.stl";
  DpNode lower{DpNode::Kind::kShell, "zuchwa", "", {}};
  lower.file = "Kowalski_lower.stl";
  DpNode th{DpNode::Kind::kTransformation, "transformation", "", {}, t.matrix()};
  th.children = {lower};
  world.children = {upper, th};
  DpNode plane{DpNode::Kind::kPlane, "", "", {"cut_plane"}};
  plane.centre_mm = {1, 2, 3};
  plane.normal = {0, 0, 1};
  plane.size_mm = 60;
  DpNode movie{DpNode::Kind::kAnimation, "chewing"};
  movie.frames = {{"", 0.1, Matrix4::Identity()}, {"", 0.1, t.matrix()}};
  movie.children = {lower};
  w.nodes = {world, plane, movie};
  ASSERT_TRUE(write_file(root_ / "in" / "w.dpw", format_dpw(w)));
  const auto r = import(root_ / "in" / "w.dpw", "p-1");
  ASSERT_TRUE(r) << r.error().line();
  const auto c = read_case(root_ / "p-1");
  ASSERT_TRUE(c) << c.error().line();
  const auto th_read = read_motion(c->transform);
  ASSERT_TRUE(th_read);
  // T acts inside `outer`: in the workspace's frame it is outer · T · outer⁻¹.
  const Rigid3 expected = outer * t * outer.inverse();
  EXPECT_LT((th_read->motion.rigid.matrix() - expected.matrix()).norm(), 1e-9);
  const auto mesh = read_mesh(c->maxilla_mi);
  ASSERT_TRUE(mesh);
  EXPECT_LT(
      (bounding_box(*mesh).centre_mm() - bounding_box(transformed(outer, jaws().maxilla)).centre_mm()).norm(),
      1e-3);
  ASSERT_EQ(c->planes.size(), 1u);
  EXPECT_EQ(c->planes[0].name, "cut_plane");
  const auto motion = read_motion_csv(c->motion);
  ASSERT_TRUE(motion) << motion.error().line();
  EXPECT_EQ(motion->rows.size(), 2u);
  EXPECT_LT((motion->rows[1].motion.matrix() - t.matrix()).norm(), 1e-6);
  expect_no_identity(root_ / "p-1");

  const auto out = export_dpw(root_ / "p-1", root_ / "p-1.dpw", false);
  ASSERT_TRUE(out) << out.error().line();
  EXPECT_EQ(export_dpw(root_ / "p-1", root_ / "p-1.dpw", false).error().code, ErrorCode::kUsage);
  EXPECT_TRUE(export_dpw(root_ / "p-1", root_ / "p-1.dpw", true));
  EXPECT_EQ(read_file(root_ / "p-1.dpw")->find("owalski"), std::string::npos);
  const auto again = import(root_ / "p-1.dpw", "p-2");
  ASSERT_TRUE(again) << again.error().line();
  const auto c2 = read_case(root_ / "p-2");
  ASSERT_TRUE(c2);
  EXPECT_EQ(*read_file(c2->maxilla_mi), *read_file(c->maxilla_mi));
  EXPECT_EQ(*read_file(c2->mandible_mi), *read_file(c->mandible_mi));
  EXPECT_LT((read_motion(c2->transform)->motion.rigid.matrix() - expected.matrix()).norm(), 1e-12);
  EXPECT_EQ(c2->planes[0].centre_mm, c->planes[0].centre_mm);
  EXPECT_LT((read_motion_csv(c2->motion)->rows[1].motion.matrix() - motion->rows[1].motion.matrix()).norm(),
            1e-6);
  expect_no_identity(root_ / "p-1_files");
}

TEST_F(Import, WorkspacesThatReachOutsideOrLackAMeshAreRefused) {
  for (const std::string& file : std::vector<std::string>{"../secret.stl", "/etc/passwd", "gone.stl", ""}) {
    ASSERT_TRUE(write_file(root_ / "in" / "w.dpw", "shell { keywords \"upper\" file \"" + file + "\" }"));
    const auto r = import(root_ / "in" / "w.dpw", "p-1");
    ASSERT_FALSE(r) << file;
    EXPECT_EQ(r.error().code, ErrorCode::kInput);
    EXPECT_FALSE(fs::exists(root_ / "p-1"));
  }
  ASSERT_TRUE(write_file(root_ / "in" / "w.dpw",
                         "trans { matrix [2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1] shell { keywords \"upper\" file "
                         "\"Kowalski_Upper.stl\" } }"));
  const auto r = import(root_ / "in" / "w.dpw", "p-1");
  ASSERT_FALSE(r);
  EXPECT_HAS(r.error().line(), "determinant is 8");
}

TEST_F(Import, AZippedWorkspace) {
  const std::string upper = format_mesh(jaws().maxilla, MeshFormat::kObj),
                    lower = format_mesh(jaws().mandible, MeshFormat::kObj);
  const std::string xml =
      "<workspace><object id=\"1\" class=\"CModel3D\" type=\"transformation\" label=\"szczeka upper\" "
      "path=\"1\"><file data=\"u.obj\" format=\"obj\"/></object>"
      "<object id=\"2\" label=\"transformation\"><matrix>1 0 0 0  0 1 0 0  0 0 1 -2  0 0 0 "
      "1</matrix></object>"
      "<object id=\"3\" parent=\"2\" label=\"lower\" path=\"2/3\"><file data=\"l.obj\" format=\"obj\" "
      "material=\"l.mtl\"/></object></workspace>";
  ASSERT_TRUE(write_file(root_ / "w.dpvision",
                         zipped({{"structure.xml", xml}, {"1/u.obj", upper}, {"2/3/l.obj", lower}})));
  const auto r = import(root_ / "w.dpvision", "p-1");
  ASSERT_TRUE(r) << r.error().line();
  const auto c = read_case(root_ / "p-1", CaseTrust::kConfined);
  ASSERT_TRUE(c) << c.error().line();
  EXPECT_EQ(*read_file(c->mandible_mi), lower);
  EXPECT_EQ(read_motion(c->transform)->motion.rigid.translation_mm.z(), -2.0);
}

}  // namespace
}  // namespace gnathion
