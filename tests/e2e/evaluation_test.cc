// The six procedures on the virtual patient: known printing scale, seating and sliding must be found again.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "core/random.h"
#include "core/transform_io.h"
#include "design/splint.h"
#include "evaluation/planned_model.h"
#include "phantom/jaws.h"
#include "phantom/scanner.h"
#include "pipeline/evaluate_job.h"

namespace gnathion {
namespace {

using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::HasSubstr;

constexpr double kAlphaDeg = 0.01, kShiftMm = 0.01, kFigureMm = 0.003;  // what must be met

SharedMesh shared(TriangleMesh mesh) {
  return std::make_shared<const TriangleMesh>(std::move(mesh));
}

TriangleMesh scaled(const TriangleMesh& mesh, double factor) {
  const Vector3 centre = surface_centroid_mm(mesh);
  TriangleMesh m = mesh;
  for (Vector3& v : m.vertices_mm) v = centre + factor * (v - centre);
  return m;
}

/// The virtual patient with a splint: made once for all tests.
struct Patient {
  PhantomJaws jaws = make_phantom_jaws(20261);
  Motion<Dental> therapeutic;
  PlannedSplint planned;
  std::shared_ptr<const PlannedModel> model;

  Patient() {
    const PhantomLandmarks& l = jaws.landmarks;
    const Vector3 hinge = 0.5 * (l.condyle_left_mm + l.condyle_right_mm);
    therapeutic = Motion<Dental>(Rigid3::from_translation({0.3, -0.8, 0.0}) *
                                 Rigid3::about_axis(hinge, Vector3::UnitX(), 2.6 * M_PI / 180.0));
    SplintParameters coarse;
    coarse.voxel_mm = 0.25;
    SilentProgress silent;
    const Result<SplintDesign> design =
        design_splint({jaws.maxilla, jaws.mandible_mi, therapeutic, {}}, coarse, silent);
    planned = {"phantom", shared(design.value().splint), shared(jaws.maxilla), shared(jaws.mandible_mi),
               therapeutic};
    model = PlannedModel::make(planned, {}).value();
  }
};
const Patient& patient() {
  static const Patient instance;
  return instance;
}

Rigid3 small_motion(Random& random, const Vector3& about, double deg, double mm) {
  const Rigid3 turn = Rigid3::about_axis(about, random.unit_vector(), deg * M_PI / 180.0);
  return Rigid3::from_translation(mm * random.unit_vector()) * turn;
}

struct Faults {
  double print_scale = 1.0;
  Rigid3 seating;  ///< of the maxilla against the splint
  Rigid3 sliding;  ///< of the mandible on the splint, from TP
  Rigid3 frame;    ///< of the scanner
};

Faults random_faults(Random& random) {
  Faults f;
  f.print_scale = 1.0 + random.uniform(-0.003, 0.003);
  f.seating = small_motion(random, {0, 20, 0}, random.uniform(0.1, 0.5), random.uniform(0.1, 0.4));
  f.sliding = small_motion(random, {0, 20, 0}, random.uniform(0.1, 0.5), random.uniform(0.1, 0.4));
  f.frame = {random.rotation(), 100.0 * random.normal3()};
  return f;
}

/// What the splint covers of the maxilla is not seen.
TriangleMesh uncovered(const TriangleMesh& maxilla, const MeshQuery& splint) {
  std::vector<bool> keep(maxilla.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t)
    keep[t] =
        !splint.closest((maxilla.corner(t, 0) + maxilla.corner(t, 1) + maxilla.corner(t, 2)) / 3.0, 2.0);
  return submesh(maxilla, keep);
}

struct Noise {
  double white_mm = 0.0, correlated_mm = 0.0, edge_mm = 0.3;
};

ScannerModel scanner(const Vector3& occlusal, const Noise& noise) {
  ScannerModel m = intraoral_scanner(occlusal);
  m.edge_mm = noise.edge_mm;
  m.white_noise_mm = noise.white_mm;
  m.correlated_noise_mm = noise.correlated_mm;
  m.scale_error = 0.0;
  m.holes = 3;
  return m;
}

SplintScans scans_of(const TriangleMesh& printed, const Faults& f, const Noise& noise, std::uint64_t seed) {
  const Patient& p = patient();
  Random random(seed);
  const Vector3 down = -Vector3::UnitZ();
  SplintScans s;
  s.splint = shared(simulate_scan(printed, scanner(down, noise), f.frame, random));
  const TriangleMesh maxilla = uncovered(p.jaws.maxilla, p.model->splint().query);
  s.maxilla = shared(simulate_scan(maxilla, scanner(down, noise), f.frame * f.seating, random));
  const TriangleMesh mandible = transformed(f.sliding * p.therapeutic.rigid, p.jaws.mandible_mi);
  s.mandible = shared(simulate_scan(mandible, scanner(-down, noise), f.frame, random));
  return s;
}

Result<SplintEvaluation> evaluated(const SplintScans& scans, EvaluationOptions options = {},
                                   const std::vector<PlannedSplint>& others = {}) {
  options.integrity = false;
  SilentProgress silent;
  return evaluate_splint(*patient().model, {"7", patient().planned, scans}, others, options, silent);
}

/// Independent of the evaluation: the phantom's own labels.
struct Truth {
  double alpha_deg = 0.0, t_mm = 0.0, max_tooth_mm = 0.0;
};
Truth truth_of(const Rigid3& error, const TriangleMesh& arch, const std::vector<std::uint8_t>& fdi) {
  Vector3 centroid = Vector3::Zero();
  double area = 0.0;
  Truth t;
  for (std::size_t i = 0; i < arch.triangles.size(); ++i) {
    const Triangle& c = arch.triangles[i];
    if (!fdi[c[0]] || !fdi[c[1]] || !fdi[c[2]]) continue;
    const double a =
        (arch.corner(i, 1) - arch.corner(i, 0)).cross(arch.corner(i, 2) - arch.corner(i, 0)).norm();
    centroid += a / 3.0 * (arch.corner(i, 0) + arch.corner(i, 1) + arch.corner(i, 2));
    area += a;
  }
  centroid /= area;
  for (std::size_t v = 0; v < fdi.size(); ++v)
    if (fdi[v])
      t.max_tooth_mm = std::max(t.max_tooth_mm, (error * arch.vertices_mm[v] - arch.vertices_mm[v]).norm());
  t.alpha_deg = std::acos(std::clamp(0.5 * (error.rotation.trace() - 1.0), -1.0, 1.0)) * 180.0 / M_PI;
  t.t_mm = (error * centroid - centroid).norm();
  return t;
}

/// Mean and deviation of the scan's signed distances at the true pose, by core's query.
PointStatistics by_hand(const TriangleMesh& scan, const Rigid3& model_from_scan, const MeshQuery& model) {
  std::vector<double> d;
  for (const Vector3& v : scan.vertices_mm) {
    const auto found = model.closest(model_from_scan * v, 3.0);
    if (!found) continue;
    const bool behind = (model_from_scan * v - found->point_mm).dot(found->normal) < 0.0;
    d.push_back(behind ? -found->distance_mm : found->distance_mm);
  }
  PointStatistics s;
  s.n = d.size();
  for (double x : d) s.avg_mm += x / static_cast<double>(d.size());
  for (double x : d) s.std_mm += (x - s.avg_mm) * (x - s.avg_mm) / static_cast<double>(d.size());
  s.std_mm = std::sqrt(s.std_mm);
  return s;
}

void expect_motion(const SplintEvaluation& e, Procedure procedure, const Truth& truth) {
  const ProcedureResult* r = e.find(procedure);
  ASSERT_TRUE(r != nullptr && r->motion) << procedure_name(procedure);
  EXPECT_NEAR(r->motion->alpha_deg, truth.alpha_deg, kAlphaDeg) << procedure_name(procedure);
  EXPECT_NEAR(r->motion->t_mm, truth.t_mm, kShiftMm) << procedure_name(procedure);
  EXPECT_NEAR(r->motion->max_tooth_mm, truth.max_tooth_mm, 0.02) << procedure_name(procedure);
  std::printf("  %-26s errors: alpha %+.5f deg, t %+.5f mm, largest tooth %+.5f mm\n",
              procedure_name(procedure), r->motion->alpha_deg - truth.alpha_deg, r->motion->t_mm - truth.t_mm,
              r->motion->max_tooth_mm - truth.max_tooth_mm);
}

void expect_figures(const SplintEvaluation& e, Procedure procedure, const PointStatistics& truth) {
  const ProcedureResult* r = e.find(procedure);
  ASSERT_NE(r, nullptr);
  EXPECT_NEAR(r->field.all.avg_mm, truth.avg_mm, kFigureMm) << procedure_name(procedure);
  EXPECT_NEAR(r->field.all.std_mm, truth.std_mm, kFigureMm) << procedure_name(procedure);
  std::printf("  %-26s errors: AVG %+.5f mm, STD %+.5f mm\n", procedure_name(procedure),
              r->field.all.avg_mm - truth.avg_mm, r->field.all.std_mm - truth.std_mm);
  EXPECT_NEAR(static_cast<double>(r->field.all.n), static_cast<double>(truth.n),
              0.01 * static_cast<double>(truth.n));
}

TEST(Evaluation, KnownScaleSeatingAndSlidingAreFound) {
  const Patient& p = patient();
  for (const std::uint64_t seed : {91u, 92u}) {
    Random random(seed);
    const Faults f = random_faults(random);
    const SplintScans scans = scans_of(scaled(*p.planned.splint, f.print_scale), f, {}, seed);
    const auto e = evaluated(scans);
    ASSERT_TRUE(e.has_value()) << e.error().line();
    ASSERT_EQ(e->procedures.size(), kProcedureCount);
    const Rigid3 placed = f.frame.inverse(), seated = f.seating.inverse() * placed;
    const TriangleMesh mandible_tp = transformed(p.therapeutic.rigid, p.jaws.mandible_mi);
    expect_motion(*e, Procedure::kMaxillaryClearance,
                  truth_of(f.seating, p.jaws.maxilla, p.jaws.maxilla_fdi));
    expect_motion(*e, Procedure::kMandibularSliding, truth_of(f.sliding, mandible_tp, p.jaws.mandible_fdi));
    expect_motion(*e, Procedure::kMandibularTransformation,
                  truth_of(f.seating.inverse() * f.sliding, mandible_tp, p.jaws.mandible_fdi));
    const MeshQuery splint(*p.planned.splint), maxilla(p.jaws.maxilla), mandible(mandible_tp);
    expect_figures(*e, Procedure::kSplintVsModel, by_hand(*scans.splint, placed, splint));
    expect_figures(*e, Procedure::kMaxillaVsModel, by_hand(*scans.maxilla, placed, maxilla));
    expect_figures(*e, Procedure::kMaxillaryClearance, by_hand(*scans.maxilla, seated, maxilla));
    expect_figures(*e, Procedure::kMandibleVsModel,
                   by_hand(*scans.mandible, f.sliding.inverse() * placed, mandible));
    expect_figures(*e, Procedure::kMandibularSliding, by_hand(*scans.mandible, placed, mandible));
    expect_figures(*e, Procedure::kMandibularTransformation, by_hand(*scans.mandible, seated, mandible));
    EXPECT_NEAR(e->find(Procedure::kSplintVsModel)->fit->scale, f.print_scale, 1e-4);
    EXPECT_TRUE(e->warnings.empty()) << e->warnings.front();
  }
}

TEST(Evaluation, TheWholeIsTheClearanceAndTheSliding) {
  Random random(404);
  const Faults f = random_faults(random);
  const auto e = evaluated(scans_of(*patient().planned.splint, f, {}, 3));
  ASSERT_TRUE(e.has_value()) << e.error().line();
  const Rigid3 whole = e->find(Procedure::kMandibularTransformation)->motion->motion.rigid;
  const Rigid3 parts = e->find(Procedure::kMaxillaryClearance)->motion->motion.rigid *
                       e->find(Procedure::kMandibularSliding)->motion->motion.rigid;
  EXPECT_LT((whole.matrix() - parts.matrix()).norm(), 1e-9);
}

/// With warp and noise the truth is the same procedure on the surfaces without noise.
TEST(Evaluation, WarpAndNoise) {
  Random random(777);
  const Faults f = random_faults(random);
  TriangleMesh warped = *patient().planned.splint;
  for (Vector3& v : warped.vertices_mm) v.z() += 1e-4 * std::pow(v.y() - 25.0, 2) + 2e-5 * v.x() * v.y();
  const auto truth = evaluated(scans_of(warped, f, {}, 8));
  struct Case {
    const char* name;
    Noise noise;
    double std_added_mm;  ///< noise along normals adds to every distance
    bool meets_bars;      ///< else: by what the fits say of themselves
  };
  for (const Case& c :
       {Case{"other points", {0.0, 0.0, 0.38}, 0.0, true}, Case{"white noise", {0.01, 0.0, 0.3}, 0.01, true},
        Case{"correlated noise", {0.01, 0.015, 0.3}, 0.018, false}}) {
    const auto found = evaluated(scans_of(warped, f, c.noise, 12));
    ASSERT_TRUE(truth && found) << c.name;
    for (std::size_t i = 0; i < kProcedureCount; ++i) {
      const ProcedureResult &a = truth->procedures[i], &b = found->procedures[i];
      const double avg = b.field.core.avg_mm - a.field.core.avg_mm;
      const double std = b.field.core.std_mm - std::hypot(a.field.core.std_mm, c.std_added_mm);
      std::printf("  %-17s%-26s AVG %+.4f STD %+.4f mm", c.name, procedure_name(a.procedure), avg, std);
      // Other points and holes sample the warp differently: that is no error of the procedure.
      EXPECT_NEAR(avg, 0.0, c.meets_bars ? 0.01 : 0.02) << procedure_name(a.procedure);
      EXPECT_NEAR(std, 0.0, c.meets_bars ? 0.01 : 0.02) << procedure_name(a.procedure);
      if (!a.motion) {
        std::printf("\n");
        continue;
      }
      const double alpha = b.motion->alpha_deg - a.motion->alpha_deg, t = b.motion->t_mm - a.motion->t_mm;
      std::printf("  alpha %+.4f deg (sigma %.4f)  t %+.4f mm (sigma %.4f)\n", alpha,
                  b.motion->alpha_sigma_deg, t, b.motion->t_sigma_mm);
      const bool bars = c.meets_bars;
      EXPECT_NEAR(alpha, 0.0, bars ? kAlphaDeg : 3.5 * b.motion->alpha_sigma_deg)
          << procedure_name(a.procedure);
      EXPECT_NEAR(t, 0.0, bars ? kShiftMm : 3.5 * b.motion->t_sigma_mm) << procedure_name(a.procedure);
      EXPECT_LT(b.motion->t_sigma_mm, 0.04);
    }
  }
}

TEST(Evaluation, BadScansAreNamed) {
  const Patient& p = patient();
  Random random(55);
  const Faults f = random_faults(random);
  const SplintScans good = scans_of(*p.planned.splint, f, {}, 5);
  const auto refusal = [](const Result<SplintEvaluation>& e) {
    return e ? std::string("accepted") : e.error().line();
  };
  SplintScans bad = good;
  TriangleMesh mirror = *good.splint;
  for (Vector3& v : mirror.vertices_mm) v.y() = -v.y();
  flip_orientation(mirror);
  bad.splint = shared(mirror);
  EXPECT_THAT(refusal(evaluated(bad)), HasSubstr("mirror"));

  TriangleMesh inside_out = *good.splint;
  flip_orientation(inside_out);
  bad.splint = shared(inside_out);
  EXPECT_THAT(refusal(evaluated(bad)), HasSubstr("inside out"));

  // Half an arch: the patient's left is not scanned.
  std::vector<bool> right(good.splint->triangles.size());
  const Rigid3 back = f.frame.inverse();
  for (std::size_t t = 0; t < right.size(); ++t) right[t] = (back * good.splint->corner(t, 0)).x() < 0.0;
  bad.splint = shared(submesh(*good.splint, right));
  const auto half = evaluated(bad);
  if (half) {
    EXPECT_THAT(half->warnings, Contains(HasSubstr("half an arch")));
  } else {
    EXPECT_THAT(half.error().line(), AnyOf(HasSubstr("arch"), HasSubstr("undetermined")));
  }

  // The maxilla scanned with the splint still in place.
  bad = good;
  bad.maxilla = shared(merged(*good.maxilla, *good.splint));
  const auto covered = evaluated(bad);
  ASSERT_TRUE(covered.has_value()) << covered.error().line();
  EXPECT_THAT(covered->warnings, Contains(HasSubstr("splint still in place")));
  const auto plain = evaluated(good);
  EXPECT_NEAR(covered->find(Procedure::kMaxillaryClearance)->motion->t_mm,
              plain->find(Procedure::kMaxillaryClearance)->motion->t_mm, 0.005);
  bad.maxilla = good.splint;
  EXPECT_THAT(refusal(evaluated(bad)), HasSubstr("splint still in place"));
}

TEST(Evaluation, TheWrongSplintIsNamedWithTheRightOne) {
  const Patient& p = patient();
  // Another splint of the same patient: the same inside, another occlusal surface.
  TriangleMesh other = *p.planned.splint;
  for (Vector3& v : other.vertices_mm)
    if (v.z() < -0.5) v.z() -= 0.9;
  PlannedSplint other_plan = p.planned;
  other_plan.name = "second";
  other_plan.splint = shared(other);
  Random random(56);
  const Faults f = random_faults(random);
  const SplintScans scans = scans_of(other, f, {}, 6);
  const auto e = evaluated(scans, {}, {p.planned, other_plan});
  ASSERT_FALSE(e.has_value());
  EXPECT_THAT(e.error().line(), HasSubstr("fits design 'second' better"));
  EXPECT_TRUE(evaluated(scans_of(*p.planned.splint, f, {}, 6), {}, {p.planned, other_plan}).has_value());
}

/// The way of a user: a design's folder, scans on the disk, evaluation.toml.
TEST(Evaluation, FromFoldersToTheFilesOfTheContract) {
  namespace fs = std::filesystem;
  const Patient& p = patient();
  const fs::path root = fs::path(testing::TempDir()) / "evaluation_folders";
  fs::remove_all(root);
  fs::create_directories(root / "design");
  fs::create_directories(root / "out");
  const auto put = [&](const char* name, const TriangleMesh& mesh) {
    ASSERT_TRUE(write_mesh(root / name, mesh)) << name;
  };
  put("upper.ply", p.jaws.maxilla);
  put("lower.ply", p.jaws.mandible_mi);
  put("design/splint.stl", *p.planned.splint);
  ASSERT_TRUE(
      write_json(root / "T_th.json", motion_json(p.therapeutic, std::nullopt, nlohmann::json::object())));
  nlohmann::json design = {{"verdict", "pass"}, {"inputs", nlohmann::json::array()}};
  for (const char* name : {"upper.ply", "lower.ply", "T_th.json"})  // as `run` names them: beside the folder
    design["inputs"].push_back({{"path", name}, {"sha256", sha256_of_file(root / name).value()}});
  ASSERT_TRUE(write_json(root / "design" / "design.json", design));

  Random random(88);
  const Faults f = random_faults(random);
  const SplintScans scans = scans_of(*p.planned.splint, f, {}, 9);
  put("s.ply", *scans.splint);
  put("u.ply", *scans.maxilla);
  put("l.ply", *scans.mandible);
  std::ofstream(root / "evaluation.toml") << R"(
[[splint]]
name = 3
design = "design"
scan_splint = "s.ply"
scan_maxilla = "u.ply"
scan_mandible = "l.ply"
[tolerance]
t_mm = 0.01
)";
  const Result<EvaluateJob> job = read_evaluation_file(root / "evaluation.toml");
  ASSERT_TRUE(job.has_value()) << job.error().line();
  SilentProgress silent;
  const auto outcome = run_evaluation(*job, root / "out", silent);
  ASSERT_TRUE(outcome.has_value()) << outcome.error().line();
  EXPECT_FALSE(outcome->accepted());  // seating and sliding are more than 0.01 mm
  const nlohmann::json j = read_json(root / "out" / "evaluation.json").value();
  ASSERT_EQ(j["procedures"].size(), kProcedureCount);
  const Truth truth = truth_of(f.seating, p.jaws.maxilla, p.jaws.maxilla_fdi);
  for (const nlohmann::json& procedure : j["procedures"]) {
    const nlohmann::json& row = procedure.at("splints").at(0);
    EXPECT_EQ(row.size(), 8u);  // the contract's keys and no others
    EXPECT_EQ(row.at("splint"), "3");
    EXPECT_GT(row.at("n").get<int>(), 1000);
    EXPECT_EQ(row.at("outlier"), false);
    EXPECT_EQ(procedure.size(), 7u);
    if (procedure.at("procedure") == "maxillary_clearance") {
      EXPECT_NEAR(row.at("t_mm").get<double>(), truth.t_mm, kShiftMm);
    } else if (procedure.at("procedure") == "splint_vs_model") {
      EXPECT_TRUE(row.at("t_mm").is_null());
    }
  }
  const nlohmann::json details = read_json(root / "out" / "evaluation_details.json").value();
  EXPECT_EQ(details["splints"][0]["integrity"]["profiles"].size(), 5u);
  EXPECT_LT(details["splints"][0]["integrity"]["planned"]["maxilla"]["depth_mm"].get<double>(), 0.1);
  EXPECT_EQ(details["inputs"].size(), 9u);

  // Metres are named; a jaw that was changed since is not taken for the one designed on.
  TriangleMesh metres = *scans.splint;
  for (Vector3& v : metres.vertices_mm) v *= 0.001;
  put("metres.ply", metres);
  EvaluateJob bad = *job;
  bad.splints[0].scan_splint = root / "metres.ply";
  EXPECT_THAT(run_evaluation(bad, root / "out", silent).error().line(), HasSubstr("metres"));
  put("upper.ply", transformed(f.seating, p.jaws.maxilla));
  EXPECT_THAT(run_evaluation(*job, root / "out", silent).error().line(), HasSubstr("has changed"));
  fs::remove_all(root);
}

}  // namespace
}  // namespace gnathion
