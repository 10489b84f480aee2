// The worked example of docs/frames.md, and the algebra behind it.
#include "core/transform.h"

#include <gtest/gtest.h>

#include <type_traits>

#include "core/random.h"

namespace gnathion {
namespace {

constexpr double kRad = M_PI / 180;

/// The example's axes: the dental frame has x to the patient's left, y posterior, z up and its origin
/// at the upper incisal point; the camera looks at the face, x to the patient's left, y down, z away.
struct Example {
  // The bow's origin is 60 mm in front of the incisors and 20 mm below; its axes are the dental ones.
  Transform<Bow, Dental> bow_from_dental{Rigid3::from_translation({0, 60, 20})};
  Transform<HeadFrame, Dental> head_from_dental{Rigid3::from_translation({0, 40, -90})};
  Transform<Camera, Dental> camera_from_dental_mi, camera_from_dental_tp;
  Motion<Dental> therapeutic;  // 3 degrees of opening about the condylar axis, 88 mm behind, 35 mm up
  Example() {
    Matrix3 r;
    r << 1, 0, 0, 0, 0, -1, 0, 1, 0;  // camera y = -dental z, camera z = dental y
    camera_from_dental_mi = Transform<Camera, Dental>(Rigid3{r, {0, 0, 460}});
    // Between MI and TP the patient nods by 2 degrees and moves 5 mm to the left.
    camera_from_dental_tp = Transform<Camera, Dental>(Rigid3::from_translation({5, 0, 0}) *
                                                      Rigid3::about_axis({0, 0, 560}, {1, 0, 0}, 2 * kRad) *
                                                      camera_from_dental_mi.rigid);
    therapeutic = Motion<Dental>(Rigid3::about_axis({0, 88, 35}, {1, 0, 0}, 3 * kRad));
  }
  BowAndHead<Camera> at_mi() const {
    return {camera_from_dental_mi * bow_from_dental.inverse(),
            camera_from_dental_mi * head_from_dental.inverse()};
  }
  BowAndHead<Camera> at_tp() const {
    const Rigid3 moved = camera_from_dental_tp.rigid * therapeutic.rigid;
    return {Transform<Camera, Bow>(moved * bow_from_dental.rigid.inverse()),
            camera_from_dental_tp * head_from_dental.inverse()};
  }
};

TEST(Frames, OpeningMovesTheIncisalPointAwayFromTheMaxilla) {
  const Vector3 moved = Example().therapeutic * Vector3(0, 0, 0);
  // By hand: r = (0, -88, -35) from the axis; 3 degrees about +x.
  const double y = 88 + (-88 * std::cos(3 * kRad) + 35 * std::sin(3 * kRad));
  const double z = 35 + (-88 * std::sin(3 * kRad) - 35 * std::cos(3 * kRad));
  EXPECT_NEAR(moved.y(), y, 1e-12);
  EXPECT_NEAR(moved.z(), z, 1e-12);
  EXPECT_NEAR(moved.z(), -4.5576, 1e-4);  // the figures of docs/frames.md
  EXPECT_NEAR(moved.y(), 1.9523, 1e-4);
  EXPECT_LT(moved.z(), 0);
}

TEST(Frames, CameraRouteGivesTth) {
  const Example e;
  // T = T_D⁻¹·M0⁻¹ re-expresses camera coordinates at MI in the dental frame.
  const auto dental_from_camera = dental_from_measurement(e.bow_from_dental, e.at_mi());
  EXPECT_LT((dental_from_camera.rigid.matrix() - e.camera_from_dental_mi.inverse().rigid.matrix()).norm(),
            1e-9);
  const Motion<Dental> t_th = express_in(dental_from_camera, relative_motion(e.at_mi(), e.at_tp()));
  EXPECT_LT((t_th.rigid.matrix() - e.therapeutic.rigid.matrix()).norm(), 1e-9);
  // The other way of writing it: T_D⁻¹·(H0⁻¹M0)⁻¹·(H1⁻¹M1)·T_D.
  const auto mi = e.at_mi(), tp = e.at_tp();
  const auto head_from_bow_mi = mi.f_from_head.inverse() * mi.f_from_bow;
  const auto head_from_bow_tp = tp.f_from_head.inverse() * tp.f_from_bow;
  const Rigid3 other =
      (e.bow_from_dental.inverse() * head_from_bow_mi.inverse() * head_from_bow_tp * e.bow_from_dental).rigid;
  EXPECT_LT((other.matrix() - t_th.rigid.matrix()).norm(), 1e-9);
  // Swapped times give the inverse, which closes: the sign test of the "opening".
  const Motion<Dental> swapped = express_in(dental_from_measurement(e.bow_from_dental, e.at_tp()),
                                            relative_motion(e.at_tp(), e.at_mi()));
  EXPECT_GT((swapped * Vector3(0, 0, 0)).z(), 0);
}

TEST(Frames, BowAloneMixesInTheHead) {
  const Example e;
  const auto mi = e.at_mi(), tp = e.at_tp();
  const Motion<Camera> naive(tp.f_from_bow.rigid * mi.f_from_bow.rigid.inverse());
  const auto t = dental_from_measurement(e.bow_from_dental, mi);
  const Vector3 wrong = express_in(t, naive) * Vector3(0, 0, 0), right = e.therapeutic * Vector3(0, 0, 0);
  EXPECT_GT((wrong - right).norm(), 3.0);
}

TEST(Frames, FaceRouteGivesTth) {
  const Example e;
  Random random(21);
  // Two face scans in frames of their own; the head has moved between them.
  const Transform<FaceScanMi, Dental> face_mi_from_dental(Rigid3{random.rotation(), 100 * random.normal3()});
  const Transform<FaceScanTp, Dental> face_tp_from_dental(Rigid3{random.rotation(), 100 * random.normal3()});
  // What registration finds: the bow in each scan, and the upper face of one on the other.
  const Transform<Bow, FaceScanMi> bow_from_face = e.bow_from_dental * face_mi_from_dental.inverse();  // T_F
  const Transform<Bow, FaceScanTp> bow_from_face_tp(e.bow_from_dental.rigid * e.therapeutic.rigid.inverse() *
                                                    face_tp_from_dental.rigid.inverse());
  const auto face_mi_from_tp = face_mi_from_dental * face_tp_from_dental.inverse();
  // T_B = M1·M0⁻¹, both in FaceScanMi.
  const auto bow_mi = bow_from_face.inverse();
  const auto bow_tp = face_mi_from_tp * bow_from_face_tp.inverse();
  const Motion<FaceScan> bow_motion(bow_tp.rigid * bow_mi.rigid.inverse());
  const Transform<Dental, FaceScan> dental_from_face =
      e.bow_from_dental.inverse() * bow_from_face;  // T = T_D⁻¹·T_F
  const Motion<Dental> t_th = express_in(dental_from_face, bow_motion);
  EXPECT_LT((t_th.rigid.matrix() - e.therapeutic.rigid.matrix()).norm(), 1e-9);
}

// Chains in the wrong order do not compile; here as facts about types, and as real compiler runs in
// tests/compile_fail.
template <class A, class B>
concept Composes = requires(A a, B b) {
  a* b;
};
template <class T, class M>
concept Expresses = requires(T t, M m) {
  express_in(t, m);
};

static_assert(Composes<Transform<Dental, Bow>, Transform<Bow, FaceScan>>);
static_assert(!Composes<Transform<Bow, FaceScan>, Transform<Dental, Bow>>);
static_assert(!Composes<Transform<Dental, Bow>, Motion<Bow>>);
static_assert(Expresses<Transform<Dental, FaceScan>, Motion<FaceScan>>);
static_assert(!Expresses<Transform<Dental, FaceScan>, Motion<Dental>>);
static_assert(!std::is_convertible_v<Rigid3, Motion<Dental>>);

}  // namespace
}  // namespace gnathion
