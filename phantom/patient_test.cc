#include "phantom/patient.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>
#include <unistd.h>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/mesh_query.h"
#include "core/transform_io.h"
#include "phantom/case_scans.h"
#include "phantom/face.h"
#include "phantom/jaw_motion.h"
#include "phantom/patient_therapy.h"

namespace gnathion {
namespace {

constexpr double kRad = std::numbers::pi / 180.0;
constexpr std::uint64_t kSeed = 20260;

/// One patient for all tests of this file: making it takes seconds.
const PhantomPatient& patient() {
  static const PhantomPatient instance = make_phantom_patient(kSeed);
  return instance;
}

TriangleMesh bow_in_dental() {
  return transformed(patient().bow_from_dental.rigid.inverse(), patient().bow.surface);
}
TriangleMesh head_frame_in_dental() {
  return transformed(patient().head_from_dental.rigid.inverse(), patient().head_frame.surface);
}

/// Smallest signed distance of the mesh's vertices, moved, to the other surface; at most 9 mm.
double clearance_mm(const std::vector<Vector3>& vertices, const Rigid3& motion, const MeshQuery& other) {
  std::vector<double> distance(vertices.size(), 9.0);
  tbb::parallel_for(std::size_t{0}, vertices.size(), [&](std::size_t v) {
    if (const auto found = other.signed_distance(motion * vertices[v], 9.0)) distance[v] = found->distance_mm;
  });
  return *std::min_element(distance.begin(), distance.end());
}

std::vector<Vector3> near_the_mouth(const TriangleMesh& bow) {
  std::vector<Vector3> out;
  for (const Vector3& p : bow.vertices_mm)
    if (p.y() > -25) out.push_back(p);
  return out;
}

JawGeometry geometry() {
  JawGeometry g;
  g.condyle_left_mm = patient().jaws.landmarks.condyle_left_mm;
  g.condyle_right_mm = patient().jaws.landmarks.condyle_right_mm;
  g.incisal_point_mm = patient().jaws.landmarks.upper_incisal_point_mm;
  return g;
}

void expect_sound_bodies() {
  SCOPED_TRACE("bodies");
  for (const PhantomBody* body : {&patient().bow, &patient().head_frame}) {
    const MeshTopology topology = mesh_topology(body->surface);
    EXPECT_TRUE(topology.watertight());
    EXPECT_TRUE(topology.manifold());
    EXPECT_EQ(topology.components, 1u);
    EXPECT_GE(body->tags.tags.size(), 8u);
    const MeshQuery surface(body->surface);
    std::vector<Vector3> normals;
    std::set<int> ids;
    for (const BodyTag& tag : body->tags.tags) {
      ids.insert(tag.id);
      const auto& c = tag.corners_in_body_mm;
      EXPECT_NEAR((c[1] - c[0]).norm(), 20, 1e-9);
      EXPECT_NEAR((c[2] - c[0]).norm(), 20 * std::numbers::sqrt2, 1e-9);
      const Vector3 right = (c[1] - c[0]) / 20, up = (c[3] - c[0]) / 20, normal = right.cross(up);
      normals.push_back(normal);
      // The plate is flat and white around the black square: the surface is met there exactly.
      for (double u = -3; u <= 23.01; u += 3.25)
        for (double v = -3; v <= 23.01; v += 3.25) {
          const auto hit = surface.ray(c[0] + u * right + v * up + 5 * normal, -normal, 0, 10);
          ASSERT_TRUE(hit.has_value()) << tag.id;
          ASSERT_NEAR(hit->distance_mm, 5.0, 0.03) << tag.id << " at " << u << ", " << v;
        }
    }
    EXPECT_EQ(ids.size(), body->tags.tags.size());
    // Not coplanar: tilted against each other, and out of any one plane by millimetres.
    double widest = 0;
    for (const Vector3& a : normals)
      for (const Vector3& b : normals)
        widest = std::max(widest, std::acos(std::clamp(a.dot(b), -1.0, 1.0)) / kRad);
    EXPECT_GT(widest, 25);
    EXPECT_LT(widest, 50);
    Vector3 mean = Vector3::Zero();
    const double weight = 1.0 / (4.0 * static_cast<double>(normals.size()));
    for (const BodyTag& tag : body->tags.tags)
      for (const Vector3& c : tag.corners_in_body_mm) mean += weight * c;
    Matrix3 scatter = Matrix3::Zero();
    for (const BodyTag& tag : body->tags.tags)
      for (const Vector3& c : tag.corners_in_body_mm) scatter += weight * (c - mean) * (c - mean).transpose();
    const Vector3 spread = Eigen::SelfAdjointEigenSolver<Matrix3>(scatter).eigenvalues().cwiseSqrt();
    EXPECT_GT(spread.minCoeff(), 7.0);
  }
}

/// Every tag's corners are in the picture and its face is open to the camera.
void expect_tags_seen(const Motion<Dental>& mandible, const Motion<Dental>& head, const MeshQuery& bow,
                      const MeshQuery& head_and_frame, const std::string& when) {
  SCOPED_TRACE(when);
  const Rig rig = phantom_rig(patient());
  const CameraModel& camera = rig.cameras[0].model;
  const Rigid3 camera_from_maxilla = phantom_camera_from_dental_at_rest().rigid * head.rigid;
  const Vector3 eye = camera_from_maxilla.inverse().translation_mm;
  const Rigid3 jaw_at_mi = mandible.rigid.inverse();
  const auto check = [&](const TaggedBody& body, const Rigid3& dental_from_body) {
    for (const BodyTag& tag : body.tags) {
      std::array<Eigen::Vector2d, 4> pixel;
      std::array<Vector3, 4> corner;
      for (std::size_t k = 0; k < 4; ++k) {
        corner[k] = dental_from_body * tag.corners_in_body_mm[k];
        const auto seen = camera.project(camera_from_maxilla * corner[k]);
        ASSERT_TRUE(seen.has_value());
        pixel[k] = *seen;
        EXPECT_GT(pixel[k].x(), 8) << body.name << tag.id;
        EXPECT_LT(pixel[k].x(), camera.width_px - 9) << body.name << tag.id;
        EXPECT_GT(pixel[k].y(), 8) << body.name << tag.id;
        EXPECT_LT(pixel[k].y(), camera.height_px - 9) << body.name << tag.id;
      }
      // Lower left, lower right, upper right, upper left, as the viewer has them (pixel y runs down).
      const auto edge = [&](std::size_t a, std::size_t b) -> Eigen::Vector2d { return pixel[b] - pixel[a]; };
      const double area = 0.5 * (edge(0, 2).y() * edge(1, 3).x() - edge(0, 2).x() * edge(1, 3).y());
      EXPECT_GT(area, 28.0 * 28.0) << body.name << tag.id << ": pixels² of the black square";
      EXPECT_GT(edge(0, 1).x(), 25);
      EXPECT_LT(edge(0, 3).y(), -25);
      for (double u = -0.17; u < 1.2; u += 0.223)
        for (double v = -0.17; v < 1.2; v += 0.223) {
          const Vector3 p = corner[0] + u * (corner[1] - corner[0]) + v * (corner[3] - corner[0]);
          const Vector3 to_eye = (eye - p).normalized();
          const Vector3 start = p + 0.05 * to_eye;
          EXPECT_FALSE(head_and_frame.ray(start, to_eye, 0.0, 600))
              << body.name << tag.id << " behind the head";
          EXPECT_FALSE(bow.ray(jaw_at_mi * start, jaw_at_mi.rotation * to_eye, 0.0, 600))
              << body.name << tag.id << " behind the bow";
        }
    }
  };
  check(rig.bow, mandible.rigid * patient().bow_from_dental.rigid.inverse());
  check(rig.head_frame, patient().head_from_dental.rigid.inverse());
}

void expect_tags_seen_through_the_session() {
  SCOPED_TRACE("visibility");
  JawState open;
  open.opening_rad = 25 * kRad;
  open.slide_left_mm = open.slide_right_mm = 8;
  JawState to_the_left;
  to_the_left.slide_right_mm = 7;
  to_the_left.opening_rad = 3 * kRad;
  JawState hinge_only;
  hinge_only.opening_rad = 25 * kRad;
  const Vector3 neck(0, 90, -40);
  const Motion<Dental> still;
  const Motion<Dental> nodded(Rigid3::from_translation({3, 4, -3}) *
                              Rigid3::about_axis(neck, {1, 0, 0}, 2.5 * kRad));
  const Motion<Dental> turned(Rigid3::from_translation({8, 4, 4}) *
                              Rigid3::about_axis(neck, {0, 0.3, 1}, 5 * kRad));
  const Motion<Dental> turned_back(Rigid3::from_translation({-8, 0, -3}) *
                                   Rigid3::about_axis(neck, {0.1, 0.2, -1}, 5 * kRad));
  const Motion<Dental> lifted(Rigid3::from_translation({-8, -5, 6}) *
                              Rigid3::about_axis(neck, {-1, 0.2, -0.3}, 4 * kRad));
  const MeshQuery bow(bow_in_dental()), head_and_frame(merged(head_frame_in_dental(), patient().face));
  const std::array<std::pair<const char*, JawState>, 4> jaws = {
      {{"MI", {}}, {"open", open}, {"hinge", hinge_only}, {"to the left", to_the_left}}};
  const std::array<std::pair<const char*, Motion<Dental>>, 5> heads = {{{"still", still},
                                                                        {"nodded", nodded},
                                                                        {"turned", turned},
                                                                        {"turned back", turned_back},
                                                                        {"lifted", lifted}}};
  for (const auto& [jaw_name, jaw] : jaws)
    for (const auto& [head_name, head] : heads)
      expect_tags_seen(motion_of(jaw, geometry()), head, bow, head_and_frame,
                       std::string(jaw_name) + ", head " + head_name);
  expect_tags_seen(patient().therapeutic, still, bow, head_and_frame, "TP");
}

void expect_bow_clear_of_everything() {
  SCOPED_TRACE("clearance of the bow");
  const TriangleMesh bow = bow_in_dental();
  const MeshQuery maxilla(patient().jaws.maxilla), mandible(patient().jaws.mandible_mi);
  const std::vector<Vector3> clutch = near_the_mouth(bow);
  // MI closes with the bow on: it sits on the lower teeth without entering them, away from the upper ones.
  EXPECT_GE(clearance_mm(clutch, {}, maxilla), 0.3);
  const double seat = clearance_mm(clutch, {}, mandible);
  EXPECT_GT(seat, 0.02);
  EXPECT_LT(seat, 0.2);
  EXPECT_GT(clearance_mm(clutch, patient().therapeutic.rigid, maxilla), 0.3);
  std::size_t fitting = 0;
  for (const Vector3& p : clutch) {
    const auto found = mandible.closest(p, 0.3);
    fitting += found.has_value();
  }
  EXPECT_GT(fitting, 400u) << "the clutch fits the labial surfaces";
  // Upper teeth never meet it either, seen from their side (a thin rim could slip between vertices).
  const MeshQuery bow_query(bow);
  EXPECT_GE(clearance_mm(patient().jaws.maxilla.vertices_mm, {}, bow_query), 0.3);

  // In contact movements (edge to edge, to the sides) the jaw opens just so far that the teeth pass.
  std::vector<Vector3> crowns;
  for (std::size_t v = 0; v < patient().jaws.mandible_fdi.size(); v += 5)
    if (patient().jaws.mandible_fdi[v]) crowns.push_back(patient().jaws.mandible_mi.vertices_mm[v]);
  for (const auto& [left, right] :
       {std::pair{1.0, 1.0}, {2.5, 2.5}, {4.0, 4.0}, {0.0, 2.5}, {0.0, 5.0}, {2.5, 0.0}, {5.0, 0.0}}) {
    JawState state;
    state.slide_left_mm = left;
    state.slide_right_mm = right;
    while (clearance_mm(crowns, motion_of(state, geometry()).rigid, maxilla) < 0)
      state.opening_rad += 0.25 * kRad;
    ASSERT_LT(state.opening_rad, 10 * kRad);
    EXPECT_GT(clearance_mm(clutch, motion_of(state, geometry()).rigid, maxilla), 0.2)
        << left << ", " << right;
  }

  // Bow, head frame and face never touch, wide open or closed.
  const MeshQuery head(merged(head_frame_in_dental(), patient().face));
  JawState open;
  open.opening_rad = 25 * kRad;
  EXPECT_GT(clearance_mm(bow.vertices_mm, {}, head), 1.0);
  EXPECT_GT(clearance_mm(bow.vertices_mm, motion_of(open, geometry()).rigid, head), 2.0);
}

void expect_therapeutic_position() {
  SCOPED_TRACE("therapeutic position");
  const double opening_deg = patient().therapeutic.rigid.angle_rad() / kRad;
  EXPECT_GE(opening_deg, 2.0);
  EXPECT_LE(opening_deg, 5.01);
  TherapeuticPosition position;
  position.motion = patient().therapeutic;
  measure_clearance(patient().jaws, position);
  EXPECT_GE(position.posterior_clearance_mm, 1.0);
  EXPECT_GT(position.clearance_mm, 0.25);
  // The condyles went 0.5–2 mm forward and down, and a little to the side.
  const PhantomLandmarks& at = patient().jaws.landmarks;
  const Vector3 condyles = 0.5 * (at.condyle_left_mm + at.condyle_right_mm);
  const Vector3 slide = patient().therapeutic * condyles - condyles;
  EXPECT_LT(slide.y(), 0);
  EXPECT_LT(slide.z(), 0);
  EXPECT_LT(std::abs(slide.x()), 0.7);
  EXPECT_GT(slide.tail<2>().norm(), 0.45);
  EXPECT_LT(slide.tail<2>().norm(), 2.05);
  const Vector3 incisal = patient().therapeutic * at.lower_incisal_point_mm;
  EXPECT_LT(incisal.z(), at.lower_incisal_point_mm.z() - 2) << "opening takes the lower incisors away";
}

/// Both routes of the design (section 1) from true poses alone, told apart from how the truth file is made.
void expect_consistent_truth() {
  SCOPED_TRACE("truth");
  const PhantomScanPoses poses = phantom_scan_poses(kSeed);
  const PhantomTruth truth = phantom_truth(patient(), poses);
  const auto expect_equal = [](const Rigid3& a, const Rigid3& b) {
    EXPECT_LT(difference(a, b).head<3>().norm(), 1e-9);
    EXPECT_LT(difference(a, b).tail<3>().norm(), 1e-7);
  };
  // Route of the face scans: T = T_D⁻¹·T_F, T_th = T·T_B·T⁻¹.
  const auto dental_from_face = patient().bow_from_dental.inverse() * truth.bow_from_face;
  expect_equal(dental_from_face.rigid, truth.dental_from_face.rigid);
  expect_equal(express_in(dental_from_face, truth.bow_motion).rigid, patient().therapeutic.rigid);
  // T_B moves a point of the bow, seen in MI, to where the scan in TP has it, once the faces coincide.
  const Vector3 on_bow = patient().bow.tags.tags[0].corners_in_body_mm[0];
  EXPECT_LT((truth.bow_motion * (truth.bow_from_face.inverse() * on_bow) -
             truth.face_mi_from_face_tp * (truth.face_tp_from_bow * on_bow))
                .norm(),
            1e-9);
  // Route of the cameras, the head moving in between.
  const Rigid3 head_motion{exp_so3(Vector3(0.05, -0.03, 0.02)), Vector3(4, -6, 2)};
  const Transform<Camera, Dental> at_mi = phantom_camera_from_dental_at_rest(),
                                  at_tp(at_mi.rigid * head_motion);
  const auto dental_from_head = patient().head_from_dental.inverse();
  const auto dental_from_bow = patient().bow_from_dental.inverse();
  const Transform<Dental, Dental> in_tp(patient().therapeutic.rigid);
  const BowAndHead<Camera> mi{at_mi * dental_from_bow, at_mi * dental_from_head};
  const BowAndHead<Camera> tp{at_tp * in_tp * dental_from_bow, at_tp * dental_from_head};
  const Motion<Dental> by_camera =
      express_in(dental_from_measurement(patient().bow_from_dental, mi), relative_motion(mi, tp));
  expect_equal(by_camera.rigid, patient().therapeutic.rigid);
}

void expect_scan_true(const std::filesystem::path& file, const MeshQuery& truth,
                      const Rigid3& surface_from_scan, double sigma_mm, std::size_t least, std::size_t most) {
  SCOPED_TRACE(file.filename());
  const auto scan = read_mesh(file);
  ASSERT_TRUE(scan.has_value()) << scan.error().line();
  EXPECT_GE(scan->triangles.size(), least);
  EXPECT_LE(scan->triangles.size(), most);
  EXPECT_EQ(mesh_topology(*scan).degenerate_triangles, 0u);
  std::vector<double> squares(scan->vertices_mm.size());
  tbb::parallel_for(std::size_t{0}, squares.size(), [&](std::size_t v) {
    squares[v] = std::pow(truth.closest(surface_from_scan * scan->vertices_mm[v])->distance_mm, 2);
  });
  double sum = 0;
  for (const double s : squares) sum += s;
  const double rms = std::sqrt(sum / static_cast<double>(squares.size()));
  EXPECT_GT(rms, 0.5 * sigma_mm);
  EXPECT_LT(rms, 1.8 * sigma_mm);
}

void expect_case_folder() {
  SCOPED_TRACE("case folder");
  namespace fs = std::filesystem;
  const fs::path root = fs::temp_directory_path() / ("gnathion_case_test_" + std::to_string(::getpid()));
  SilentProgress silent;
  for (const char* name : {"a", "b"}) {
    fs::create_directories(root / name);
    const Status status = write_phantom_case(patient(), kSeed, root / name, silent);
    ASSERT_TRUE(status.has_value()) << status.error().line();
  }
  std::size_t files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(root / "a")) {
    if (!entry.is_regular_file()) continue;
    ++files;
    const fs::path twin = root / "b" / fs::relative(entry.path(), root / "a");
    EXPECT_EQ(*sha256_of_file(entry.path()), *sha256_of_file(twin)) << twin;
  }
  EXPECT_EQ(files, 7u + 2u + 3u + 7u + 2u);

  const auto rig = read_rig(root / "a" / "rig.toml");
  ASSERT_TRUE(rig.has_value()) << rig.error().line();
  EXPECT_EQ(rig->bow.tags.size(), patient().bow.tags.tags.size());
  const auto truth = read_json(root / "a" / "truth.json");
  ASSERT_TRUE(truth.has_value());
  const auto pose = [&](const char* name) {
    return Rigid3::from_matrix(*matrix_from_json((*truth)[name]["matrix"], name));
  };
  EXPECT_LT(
      difference(pose("bow_from_dental").inverse() * pose("bow_from_face"), pose("dental_from_face")).norm(),
      1e-7);
  const Rigid3 t = pose("dental_from_face");
  EXPECT_LT(difference(t * pose("bow_motion") * t.inverse(), pose("therapeutic")).norm(), 1e-7);

  // Each scan shows its truth from the pose that truth.json gives, within its scanner's noise.
  const fs::path scans = root / "a" / "scans";
  const MeshQuery maxilla(patient().jaws.maxilla), mandible(patient().jaws.mandible_mi);
  const Rigid3 th = patient().therapeutic.rigid;
  constexpr double kIntraoral = 0.018, kFace = 0.058;  // white and correlated noise together
  expect_scan_true(scans / "maxilla_mi.ply", maxilla, {}, kIntraoral, 90000, 260000);
  expect_scan_true(scans / "mandible_mi.ply", mandible, {}, kIntraoral, 70000, 260000);
  const Rigid3 dental_from_tp = pose("tp_scan_from_dental").inverse();
  expect_scan_true(scans / "maxilla_tp.ply", maxilla, dental_from_tp, kIntraoral, 90000, 260000);
  expect_scan_true(scans / "mandible_tp.ply", mandible, th.inverse() * dental_from_tp, kIntraoral, 70000,
                   260000);
  const MeshQuery with_bow(merged(patient().jaws.mandible_mi, bow_in_dental()));
  expect_scan_true(scans / "mandible_clutch.ply", with_bow, pose("clutch_scan_from_dental").inverse(),
                   kIntraoral, 100000, 300000);
  const MeshQuery head(merged(merged(patient().face, bow_in_dental()), head_frame_in_dental()));
  expect_scan_true(scans / "face_mi.ply", head, t, kFace, 150000, 250000);
  const MeshQuery head_tp(
      merged(merged(with_soft_tissue_shift(patient().face, 0.3, kSeed), transformed(th, bow_in_dental())),
             head_frame_in_dental()));
  expect_scan_true(scans / "face_tp.ply", head_tp, pose("face_tp_from_dental").inverse(), kFace, 150000,
                   250000);
  fs::remove_all(root);
}

// One test, since CTest runs each in a process of its own and each would have to make the patient.
TEST(Patient, IsWhatItsTruthSays) {
  expect_sound_bodies();
  expect_consistent_truth();
  expect_therapeutic_position();
  expect_bow_clear_of_everything();
  expect_tags_seen_through_the_session();
  expect_case_folder();
}

}  // namespace
}  // namespace gnathion
