#include "pipeline/evaluation_report.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <optional>

#include "core/file.h"
#include "core/random.h"
#include "occlusion/teeth.h"
#include "occlusion/test_jaws.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

SharedMesh shared(TriangleMesh mesh) {
  return std::make_shared<const TriangleMesh>(std::move(mesh));
}

TriangleMesh offset(TriangleMesh mesh, double by_mm) {
  const std::vector<Vector3> normals = vertex_normals(mesh);
  for (std::size_t v = 0; v < normals.size(); ++v) mesh.vertices_mm[v] += by_mm * normals[v];
  return mesh;
}

/// Two sheets over the upper arch, as a splint's inner and outer surface.
TriangleMesh sheets(const TriangleMesh& arch) {
  TriangleMesh inner = offset(arch, 0.1);
  flip_orientation(inner);
  return merged(inner, offset(arch, 1.6));
}

/// A measured scan whose every distance is known: the reference pushed along its normals by a wave.
ProcedureResult made_up(Procedure procedure, const SharedMesh& reference, double amplitude_mm, double mean_mm,
                        const Rigid3& dental_from_scan) {
  ProcedureResult p;
  p.procedure = procedure;
  TriangleMesh scan = *reference;
  const std::vector<Vector3> normals = vertex_normals(scan);
  DistanceField& f = p.field;
  double sum = 0, squares = 0;
  for (std::size_t v = 0; v < normals.size(); ++v) {
    const double d = mean_mm + amplitude_mm * std::sin(0.25 * scan.vertices_mm[v].x()) *
                                   std::cos(0.4 * scan.vertices_mm[v].y());
    scan.vertices_mm[v] += d * normals[v];
    const bool hidden = scan.vertices_mm[v].x() > 20;
    f.distance_mm.push_back(hidden ? 0.0F : static_cast<float>(d));
    f.use.push_back(hidden ? PointUse::kFar : PointUse::kCore);
    if (hidden) {
      ++f.far;
      continue;
    }
    sum += d;
    squares += d * d;
    ++f.all.n;
  }
  f.all.avg_mm = sum / static_cast<double>(f.all.n);
  f.all.std_mm = std::sqrt(squares / static_cast<double>(f.all.n) - f.all.avg_mm * f.all.avg_mm);
  f.core = f.all;
  f.scan = shared(transformed(dental_from_scan.inverse(), scan));
  f.dental_from_scan = dental_from_scan;
  f.reference = reference;
  p.fitted_region = p.measured_region = "the whole of it";
  if (procedure >= Procedure::kMaxillaryClearance) {
    p.motion.emplace();
    p.motion->alpha_deg = 0.31;
    p.motion->t_mm = 0.12;
    p.motion->max_tooth_mm = 0.2;
  }
  return p;
}

SplintEvaluation made_up_splint(const std::string& name, const testing::SimpleJaws& jaws,
                                std::uint64_t seed) {
  Random random(seed);
  SplintEvaluation s;
  s.name = name;
  s.planned.name = "design";
  s.planned.maxilla = shared(jaws.maxilla);
  s.planned.mandible_mi = shared(jaws.mandible);
  s.planned.splint = shared(sheets(jaws.maxilla));
  s.planned.therapeutic.rigid = Rigid3::from_translation({0, -0.5, -2.5});
  s.mandible_tp = shared(transformed(s.planned.therapeutic.rigid, jaws.mandible));
  s.arch = *find_arch(jaws.maxilla, jaws.mandible);
  const Rigid3 anywhere{random.rotation(), 60 * random.normal3()};
  for (std::size_t k = 0; k < kProcedureCount; ++k) {
    const auto procedure = static_cast<Procedure>(k);
    const SharedMesh& reference = k == 0             ? s.planned.splint
                                  : k == 1 || k == 3 ? s.planned.maxilla
                                                     : s.mandible_tp;
    s.procedures.push_back(
        made_up(procedure, reference, random.uniform(0.05, 0.3), random.uniform(-0.05, 0.05), anywhere));
  }
  for (const ProfilePlane& plane : standard_planes(s.arch, jaws.maxilla, jaws.maxilla_fdi)) {
    ProfileFigures f;
    f.plane = plane;
    f.planned_wall = {40, 1.4, 1.5, 2.2};
    f.printed_wall = {40, 1.3, 1.5, 2.3};
    f.planned_gap = f.printed_gap = {40, 0.05, 0.1, 0.2};
    s.integrity.profiles.push_back(f);
  }
  s.warnings = {"the scan ends short of the <second> molar & its neighbour"};
  return s;
}

EvaluationReport made_up_report(std::size_t splints) {
  const testing::SimpleJaws jaws = testing::simple_jaws();
  EvaluationReport r;
  for (std::size_t i = 0; i < splints; ++i)
    r.splints.push_back(made_up_splint(i == 0 ? "</script><b>1" : std::to_string(i + 1), jaws, 10 + i));
  r.tables = tables_of(r.splints, {});
  r.core_tables = core_tables_of(r.splints, {});
  r.inputs = {{"splint 1", "scans/splint <1>.stl", std::string(64, 'a')}};
  r.parameters = {{"evaluation.reach_mm", "3"}};
  r.date_iso = "2026-01-31T12:00:00Z";
  return r;
}

class Report : public ::testing::Test {
 protected:
  void SetUp() override {
    if (const char* look = std::getenv("GNATHION_LOOK")) {
      folder = fs::path(look) / ::testing::UnitTest::GetInstance()->current_test_info()->name();
      keep = true;
    } else {
      folder = fs::temp_directory_path() / ("gnathion_report_" + std::to_string(::getpid()));
    }
    fs::create_directories(folder);
  }
  void TearDown() override {
    if (!keep) fs::remove_all(folder);
  }
  fs::path folder;
  bool keep = false;
};

/// What headless Chromium makes of a page, or nothing where it is not installed.
std::optional<std::string> dom_in_chromium(const fs::path& page, const fs::path& profile) {
  for (const char* name : {"chromium", "chromium-browser", "google-chrome"}) {
    if (std::system((std::string("command -v ") + name + " > /dev/null 2>&1").c_str()) != 0) continue;
    // No host resolves: what the page would fetch, it does not get.
    const std::string command =
        std::string("timeout 400 ") + name +
        " --headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --disable-dev-shm-usage"
        " --host-resolver-rules='MAP * ~NOTFOUND' --window-size=1200,900 --virtual-time-budget=60000"
        " --user-data-dir='" +
        profile.string() + "' --dump-dom 'file://" + fs::absolute(page).string() + "#check' 2>/dev/null";
    std::string out;
    FILE* pipe = ::popen(command.c_str(), "r");
    if (!pipe) return "";
    char buffer[65536];
    for (std::size_t n; (n = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) out.append(buffer, n);
    ::pclose(pipe);
    return out;
  }
  return std::nullopt;
}

double number_in(const std::string& dom, const std::string& attribute) {
  const std::size_t at = dom.find(attribute + "=\"");
  return at == std::string::npos ? -1 : std::strtod(dom.c_str() + at + attribute.size() + 2, nullptr);
}

TEST_F(Report, IsWholeInOneFileAndDrawsIn3d) {
  SilentProgress progress;
  const auto sizes = write_evaluation_report(made_up_report(2), folder, progress);
  ASSERT_TRUE(sizes) << sizes.error().line();
  const std::string html = *read_file(folder / "report.html");
  EXPECT_EQ(sizes->html_bytes, html.size());
  EXPECT_NE(html.find("Research use only"), std::string::npos);
  EXPECT_NE(html.find(std::string(64, 'a')), std::string::npos) << "hash of an input";
  EXPECT_NE(html.find("scans/splint &lt;1&gt;.stl"), std::string::npos);
  // Nothing is fetched, and a name cannot end a script.
  for (const std::string attribute : {" src=", " href=", "url("})
    for (std::size_t at = html.find(attribute); at != std::string::npos; at = html.find(attribute, at + 1)) {
      const std::size_t value = at + attribute.size() + (html[at + attribute.size()] == '"');
      EXPECT_EQ(html.substr(value, 5), "data:");
    }
  EXPECT_EQ(html.find("</script><b>1"), std::string::npos);

  const auto dom = dom_in_chromium(folder / "report.html", folder / "chromium");
  if (!dom) GTEST_SKIP() << "no Chromium on this machine: the 3D view was not drawn";
  ASSERT_FALSE(dom->empty()) << "Chromium gave nothing back";
  EXPECT_NE(dom->find("data-drawn=\"yes\""), std::string::npos) << "the 3D view drew nothing";
  EXPECT_EQ(number_in(*dom, "data-error"), 0);
  // The scanned splint fills a good part of the view, not all of it.
  EXPECT_GT(number_in(*dom, "data-coverage"), 0.03);
  EXPECT_LT(number_in(*dom, "data-coverage"), 0.9);
  // Both splints, six procedures and the plan, five views each: all drawn without an error of WebGL.
  EXPECT_EQ(number_in(*dom, "data-frames"), 2 * 7 * 5);
  EXPECT_EQ(number_in(*dom, "data-errors"), 0);
  // Clicks on the surface read distances that were made up within ±0.35 mm.
  EXPECT_GT(number_in(*dom, "data-readings"), 3);
  EXPECT_LT(std::abs(number_in(*dom, "data-reading")), 0.36);
}

TEST_F(Report, SameInSameBytesOut) {
  SilentProgress progress;
  const EvaluationReport report = made_up_report(1);
  fs::create_directories(folder / "a");
  fs::create_directories(folder / "b");
  ASSERT_TRUE(write_evaluation_report(report, folder / "a", progress));
  ASSERT_TRUE(write_evaluation_report(report, folder / "b", progress));
  for (const char* file : {"report.html", "report.pdf"})
    EXPECT_EQ(sha256_hex(*read_file(folder / "a" / file)), sha256_hex(*read_file(folder / "b" / file)))
        << file;
}

TEST_F(Report, OfPublishedRowsHasTablesAndChartsAlone) {
  EvaluationReport r;
  std::vector<SplintRow> rows;
  for (int i = 1; i <= 8; ++i) {
    SplintRow row;
    row.splint = std::to_string(i);
    row.n = 158000 + static_cast<std::size_t>(i);
    row.avg_mm = 0.01 * i - 0.04;
    row.std_mm = 0.1 + 0.01 * i;
    rows.push_back(row);
  }
  for (const char* name : {"splint_vs_model", "maxilla_vs_model", "mandible_vs_model"})
    r.tables.push_back(tabulate(name, rows, {}));
  SilentProgress progress;
  const auto sizes = write_evaluation_report(r, folder, progress);
  ASSERT_TRUE(sizes) << sizes.error().line();
  const std::string html = *read_file(folder / "report.html"), pdf = *read_file(folder / "report.pdf");
  EXPECT_EQ(html.find("view-canvas\""), std::string::npos);
  EXPECT_NE(html.find("<svg"), std::string::npos);
  EXPECT_EQ(pdf.substr(0, 5), "%PDF-");
  EXPECT_TRUE(fs::exists(folder / "pictures" / "error_bars.svg"));
  EXPECT_TRUE(fs::exists(folder / "pictures" / "radar.svg"));
}

}  // namespace
}  // namespace gnathion
