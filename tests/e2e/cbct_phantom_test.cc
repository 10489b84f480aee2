// The way from a phantom's CBCT to joints in the dental frame, against what is true.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "core/random.h"
#include "core/transform_io.h"
#include "phantom/cbct_dicom.h"
#include "phantom/joints.h"
#include "pipeline/case_folder.h"
#include "pipeline/cbct_steps.h"
#include "pipeline/check_job.h"
#include "pipeline/frames_steps.h"
#include "pipeline/run_case.h"
#include "tests/support/realizability_trials.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr double kVoxelMm = 0.5;
SilentProgress silent;

std::uint64_t seed() {
  const char* given = std::getenv("GNATHION_SEED");
  return given ? std::strtoull(given, nullptr, 10) : 4;
}

const PhantomJaws& jaws() {
  static const PhantomJaws made = [] {
    std::printf("seed %llu (GNATHION_SEED repeats it)\n", static_cast<unsigned long long>(seed()));
    return make_phantom_jaws(seed());
  }();
  return made;
}

const PhantomJoints& true_joints() {
  static const PhantomJoints made = phantom_joints(jaws());
  return made;
}

PhantomCbct scan(const Motion<Dental>& mandible, bool joints = true) {
  PhantomCbctOptions options;
  options.seed = seed();
  options.voxel_mm = kVoxelMm;
  options.blur_mm = 0.5 * kVoxelMm;
  options.mandible = mandible;
  options.joints = joints;
  return make_phantom_cbct(jaws(), draw_face_shape(seed()), options);
}
const PhantomCbct& scan_in_mi() {
  static const PhantomCbct made = scan({});
  return made;
}

class Folder {
 public:
  explicit Folder(const char* name)
      : path_(fs::temp_directory_path() / fmt::format("gnathion_{}_{}", name, getpid())) {
    fs::remove_all(path_);
    fs::create_directories(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

/// Largest displacement between two poses at the condyles.
double at_condyles_mm(const Rigid3& a, const Rigid3& b) {
  double most = 0.0;
  for (const Vector3& p : {jaws().landmarks.condyle_left_mm, jaws().landmarks.condyle_right_mm})
    most = std::max(most, (a * p - b * p).norm());
  return most;
}

/// Distances of the true surface's vertices that face the other bone to the surface that was found.
struct Deviation {
  double mean_mm = 0.0, p99_mm = 0.0;
};
Deviation deviation(const TriangleMesh& truth, const TriangleMesh& found, const MeshQuery& other) {
  const MeshQuery query(found);
  std::vector<double> d;
  double sum = 0.0;
  for (const Vector3& v : truth.vertices_mm) {
    if (!other.closest(v, 5.0)) continue;
    const auto near = query.signed_distance(v);
    if (near->closest.on_boundary) continue;
    d.push_back(std::abs(near->distance_mm));
    sum += near->distance_mm;
  }
  std::sort(d.begin(), d.end());
  if (d.empty()) return {1e9, 1e9};
  return {sum / static_cast<double>(d.size()), d[d.size() * 99 / 100]};
}

void expect_true_joint(const Joint& joint, const PhantomJoint& truth, double tolerance_mm) {
  const MeshQuery condyle(truth.condyle), fossa(truth.fossa);
  const Deviation of_condyle = deviation(truth.condyle, joint.condyle, fossa),
                  of_fossa = deviation(truth.fossa, joint.fossa, condyle);
  const double gap = smallest_gap(joint.condyle, joint.fossa).distance_mm;
  std::printf(
      "%s: condyle mean %+.3f p99 %.3f mm, fossa mean %+.3f p99 %.3f mm, distance %.3f mm, truth %.3f mm, "
      "poles "
      "%.2f and %.2f mm off\n",
      side_name(joint.side), of_condyle.mean_mm, of_condyle.p99_mm, of_fossa.mean_mm, of_fossa.p99_mm, gap,
      truth.distance_mm, (joint.medial_pole_mm - truth.medial_pole_mm).norm(),
      (joint.lateral_pole_mm - truth.lateral_pole_mm).norm());
  EXPECT_LT(of_condyle.p99_mm, tolerance_mm);
  EXPECT_LT(of_fossa.p99_mm, tolerance_mm);
  EXPECT_NEAR(gap, truth.distance_mm, tolerance_mm);
  EXPECT_LT((joint.medial_pole_mm - truth.medial_pole_mm).norm(), 1.5);
  EXPECT_LT((joint.lateral_pole_mm - truth.lateral_pole_mm).norm(), 1.5);
}

TEST(CbctPhantom, JointsFromADicomSeriesWithinHalfAVoxel) {
  Folder dicom("cbct_dicom"), out("cbct_joints");
  ASSERT_TRUE(write_phantom_dicom(dicom.path(), scan_in_mi()).has_value());
  CbctOptions options;
  const auto volume = registered_volume(dicom.path(), jaws().maxilla, jaws().mandible_mi, options, silent);
  ASSERT_TRUE(volume.has_value()) << volume.error().line();
  EXPECT_EQ(volume->file.info.format, "DICOM");
  for (std::size_t v = 0; v < scan_in_mi().hu.size(); v += 997)
    ASSERT_EQ(volume->file.volume.value(v), scan_in_mi().hu[v]);
  const double off = at_condyles_mm(volume->cbct_from_dental.rigid, scan_in_mi().cbct_from_dental.rigid);
  const Vector6 xi = difference(volume->cbct_from_dental.rigid, scan_in_mi().cbct_from_dental.rigid);
  const double nees = xi.dot(volume->covariance->inverse() * xi);
  std::printf("registration: %.3f mm at the condyles, NEES %.1f of 6\n", off, nees);
  EXPECT_LT(off, 0.5 * kVoxelMm);
  EXPECT_LT(nees, 22.5);  // chi-square, 6 degrees of freedom, p = 0.001
  const auto joints = joints_in_volume(*volume, jaws().maxilla, jaws().mandible_mi, options, silent);
  ASSERT_TRUE(joints.has_value()) << joints.error().line();
  ASSERT_TRUE(joints->left && joints->right);
  for (const std::string& w : joints->warnings) std::printf("warning: %s\n", w.c_str());
  const PhantomJoints& truth = true_joints();
  expect_true_joint(*joints->left, truth.left, 0.5 * kVoxelMm);
  expect_true_joint(*joints->right, truth.right, 0.5 * kVoxelMm);
  EXPECT_TRUE(joints->condyle_covariance && joints->condyle_covariance->isZero());

  // Written, they are read again by the same function.
  ASSERT_TRUE(write_joints(*joints, out.path()).has_value());
  const auto again = joints_from_cbct(out.path(), jaws().maxilla, jaws().mandible_mi, {}, silent);
  ASSERT_TRUE(again.has_value()) << again.error().line();
  EXPECT_EQ(again->left->condyle.triangles.size(), joints->left->condyle.triangles.size());
  EXPECT_EQ(again->source, joints->source);
  EXPECT_EQ(again->surface_sigma_mm, joints->surface_sigma_mm);
  EXPECT_LT((again->left->lateral_pole_mm - joints->left->lateral_pole_mm).norm(), 1e-3);
  fs::remove(out.path() / "fossa_left.stl");
  const auto half = joints_from_cbct(out.path(), jaws().maxilla, jaws().mandible_mi, {}, silent);
  ASSERT_FALSE(half.has_value());
  EXPECT_NE(half.error().line().find("its fossa is not beside it"), std::string::npos);
}

TEST(CbctPhantom, AScanWithTheJawOpenIsBroughtToMi) {
  const Vector3 hinge = 0.5 * (jaws().landmarks.condyle_left_mm + jaws().landmarks.condyle_right_mm);
  Motion<Dental> open(Rigid3::from_translation({0.2, -1.0, -0.8}) *
                      Rigid3::about_axis(hinge, Vector3::UnitX(), 4.0 * M_PI / 180.0));
  if ((open * jaws().landmarks.lower_incisal_point_mm).z() > jaws().landmarks.lower_incisal_point_mm.z())
    open = Motion<Dental>(Rigid3::from_translation({0.2, -1.0, -0.8}) *
                          Rigid3::about_axis(hinge, -Vector3::UnitX(), 4.0 * M_PI / 180.0));
  const PhantomCbct c = scan(open);
  RegisteredVolume volume;
  volume.file.volume.grid = {c.size, c.step_mm.asDiagonal(), c.origin_mm};
  volume.file.volume.voxels16 = c.hu;
  volume.cbct_from_dental = c.cbct_from_dental;
  volume.covariance = Matrix6::Zero();
  const auto joints = joints_in_volume(volume, jaws().maxilla, jaws().mandible_mi, {}, silent);
  ASSERT_TRUE(joints.has_value()) << joints.error().line();
  ASSERT_TRUE(joints->left && joints->right);
  ASSERT_FALSE(joints->warnings.empty());
  EXPECT_NE(joints->warnings[0].find("was not taken in MI"), std::string::npos) << joints->warnings[0];
  EXPECT_TRUE(joints->condyle_covariance && !joints->condyle_covariance->isZero());
  const PhantomJoints& truth = true_joints();
  expect_true_joint(*joints->left, truth.left, kVoxelMm);
  expect_true_joint(*joints->right, truth.right, kVoxelMm);
}

/// Opened by 11 degrees and both condyles pressed up by 4.5 mm: free at the teeth, not in the joints.
Motion<Dental> pressed_into_the_joints() {
  const PhantomLandmarks& l = jaws().landmarks;
  return Motion<Dental>(
      Rigid3::from_translation({0, 0, 4.5}) *
      Rigid3::about_axis(l.condyle_right_mm, l.condyle_left_mm - l.condyle_right_mm, 11.0 * M_PI / 180.0));
}

TEST(CbctPhantom, ARunHangsTheVolumeIntoItsFramesAndChecksTheJoints) {
  Folder folder("cbct_case");
  PhantomCbctOptions options;
  options.seed = seed();
  options.voxel_mm = 0.6;
  options.blur_mm = 0.3;
  options.skin = true;
  const FaceShape shape = draw_face_shape(seed());
  const PhantomCbct volume = make_phantom_cbct(jaws(), shape, options);
  ASSERT_TRUE(write_phantom_nrrd(folder.path() / "head.nrrd", volume));
  ASSERT_TRUE(write_mesh(folder.path() / "u.stl", jaws().maxilla));
  ASSERT_TRUE(write_mesh(folder.path() / "l.stl", jaws().mandible_mi));
  const Rigid3 face_from_dental = Rigid3::about_axis({0, 0, 0}, Vector3(1, 2, 3).normalized(), 0.7) *
                                  Rigid3::from_translation({40, -10, 90});
  ASSERT_TRUE(write_mesh(folder.path() / "f.ply", transformed(face_from_dental, make_face(shape))));
  ASSERT_TRUE(write_json(folder.path() / "t.json", motion_json(pressed_into_the_joints(), std::nullopt, {})));
  NewCase c;
  c.id = "p-1";
  c.files = {{"maxilla_mi", folder.path() / "u.stl"},
             {"mandible_mi", folder.path() / "l.stl"},
             {"face_mi", folder.path() / "f.ply"},
             {"cbct", folder.path() / "head.nrrd"},
             {"position.transform", folder.path() / "t.json"}};
  ManualClock clock(HostTime{1'700'000'000'000'000'000});
  const auto files = create_case(folder.path() / "case", c, clock);
  ASSERT_TRUE(files) << files.error().line();
  RunOptions run;
  run.clock = &clock;
  const auto results = run_case(*files, run, silent);
  ASSERT_TRUE(results) << results.error().line();

  const nlohmann::json& feasibility = *results->design.feasibility;
  EXPECT_EQ(feasibility["verdict"], "not_realizable");
  std::map<std::string, bool> passes;
  for (const auto& one : feasibility["constraints"]) passes[one["name"]] = one["pass"].get<bool>();
  EXPECT_FALSE(passes.at("condyle_fossa"));
  EXPECT_TRUE(passes.at("no_intersection"));
  EXPECT_EQ(feasibility["joints"]["source"].get<std::string>().rfind("NRRD", 0), 0u) << feasibility["joints"];
  const auto graph = read_case_frames(files->folder);
  ASSERT_TRUE(graph) << graph.error().line();
  const auto face = graph->path("dental", "face_mi");
  ASSERT_TRUE(face) << face.error().line();
  const Vector3 nose(0, -60, 40);
  const double off = (face->to_from_from * (face_from_dental * nose) - nose).norm();
  std::printf("face scan in the dental frame through the volume: %.3f mm at the nose\n", off);
  EXPECT_LT(off, options.voxel_mm);
}

TEST(CbctPhantom, JointsThatAreNotThePatientsAreRefused) {
  Folder folder("cbct_wrong_joints");
  auto checker = RealizabilityChecker::create(jaws().maxilla, jaws().mandible_mi);
  ASSERT_TRUE(checker) << checker.error().line();
  KnowledgeFiles files;
  files.cbct = folder.path() / "joints";
  const auto use = [&](const Joints& joints) {
    fs::remove_all(files.cbct);
    fs::create_directory(files.cbct);
    EXPECT_TRUE(write_joints(joints, files.cbct));
    std::vector<std::string> notes;
    return add_knowledge(files, jaws().maxilla, jaws().mandible_mi, &*checker, &notes, silent);
  };
  const Joints truth = test::joints_of(true_joints());
  const auto refused = [&](const Joints& joints, const char* why) {
    const Status outcome = use(joints);
    ASSERT_FALSE(outcome) << why;
    EXPECT_EQ(outcome.error().code, ErrorCode::kInput);
    EXPECT_NE(outcome.error().line().find(why), std::string::npos) << outcome.error().line();
  };
  Joints swapped = truth;
  std::swap(swapped.left, swapped.right);
  swapped.left->side = Side::kLeft, swapped.right->side = Side::kRight;
  refused(swapped, "left for right");
  Joints elsewhere = truth;
  for (auto* joint : {&elsewhere.left, &elsewhere.right}) {
    (*joint)->condyle = transformed(Rigid3::from_translation({0, 0, 80}), (*joint)->condyle);
    (*joint)->fossa = transformed(Rigid3::from_translation({0, 0, 80}), (*joint)->fossa);
  }
  refused(elsewhere, "another frame");
  Joints inside_out = truth;
  flip_orientation(inside_out.left->fossa);
  refused(inside_out, "inside out");
  Joints assumed = truth;
  assumed.mi_assumed = true;
  assumed.surface_sigma_mm = 0.2;
  ASSERT_TRUE(use(assumed));
  const Feasibility unsure = checker->check({}, Matrix6(Matrix6::Zero()));
  EXPECT_EQ(unsure.joints.size(), 2u);
  for (const JointReport& r : unsure.joints) EXPECT_FALSE(r.sigma_mm.has_value());
  assumed.mi_assumed = false;
  assumed.condyle_covariance = assumed.fossa_covariance = Matrix6(Matrix6::Zero());
  ASSERT_TRUE(use(assumed));
  for (const JointReport& r : checker->check({}, Matrix6(Matrix6::Zero())).joints)
    EXPECT_TRUE(r.sigma_mm.has_value());
}

TEST(CbctPhantom, WhatCannotBeIsRefusedByName) {
  const PhantomCbct& c = scan_in_mi();
  Volume volume;
  volume.grid = {c.size, c.step_mm.asDiagonal(), c.origin_mm};
  volume.voxels16 = c.hu;
  const Rigid3& pose = c.cbct_from_dental.rigid;
  const auto box_at = [&](const Vector3& p, double half) {
    JointRegion r;
    r.box_mm.extend(pose * p - Vector3::Constant(half));
    r.box_mm.extend(pose * p + Vector3::Constant(half));
    return r;
  };
  const Vector3 condyle = jaws().landmarks.condyle_left_mm;
  const auto beyond = find_joint(volume, 700.0, box_at(condyle + Vector3(30, 0, 0), 17), "left joint");
  ASSERT_FALSE(beyond.has_value());
  EXPECT_NE(beyond.error().line().find("does not contain the joint"), std::string::npos)
      << beyond.error().line();
  const auto soft = find_joint(volume, 700.0, box_at({0, 75, 30}, 10), "left joint");
  ASSERT_FALSE(soft.has_value());
  EXPECT_NE(soft.error().line().find("no bone above 700"), std::string::npos) << soft.error().line();
  const auto whole = find_joint(volume, -500.0, box_at(condyle, 17), "left joint");
  ASSERT_FALSE(whole.has_value());
  EXPECT_NE(whole.error().line().find("not two pieces"), std::string::npos) << whole.error().line();
  // Seeds say which bone is meant.
  JointRegion seeded = box_at(condyle, 16);
  seeded.condyle_seed_mm = pose * true_joints().left.on_condyle_mm;
  seeded.fossa_seed_mm = pose * true_joints().left.on_fossa_mm;
  EXPECT_TRUE(find_joint(volume, 700.0, seeded, "left joint").has_value());

  // An arch of another patient, and a mirrored one, do not fit.
  TriangleMesh mirrored = jaws().maxilla;
  for (Vector3& v : mirrored.vertices_mm) v.x() = -v.x() + 0.15 * v.y();  // and sheared
  flip_orientation(mirrored);
  std::vector<bool> crowns;
  for (const std::uint8_t fdi : jaws().maxilla_fdi) crowns.push_back(fdi != 0);
  const auto stranger = register_crowns(volume, mirrored, crowns, {}, {}, "upper crowns in the volume");
  ASSERT_FALSE(stranger.has_value()) << "rms " << stranger->fit.rms_mm << " found "
                                     << stranger->fit.inlier_fraction;
  std::printf("%s\n", stranger.error().line().c_str());
}

}  // namespace
}  // namespace gnathion
