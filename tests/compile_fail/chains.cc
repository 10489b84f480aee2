// Each CASE must be refused by the compiler; without a CASE the file must compile.
#include "core/transform.h"

using namespace gnathion;

Motion<Dental> right_order(Transform<Bow, Dental> bow_from_dental, Transform<Bow, FaceScan> bow_from_face,
                           Motion<FaceScan> bow_motion) {
  return express_in(bow_from_dental.inverse() * bow_from_face, bow_motion);
}

#if defined(CASE_WRONG_ORDER)
auto wrong(Transform<Bow, Dental> bow_from_dental, Transform<Bow, FaceScan> bow_from_face) {
  return bow_from_face * bow_from_dental;
}
#elif defined(CASE_FORGOTTEN_INVERSE)
auto wrong(Transform<Bow, Dental> bow_from_dental, Transform<Bow, FaceScan> bow_from_face) {
  return bow_from_dental * bow_from_face;
}
#elif defined(CASE_MOTION_IN_THE_WRONG_FRAME)
auto wrong(Transform<Dental, FaceScan> dental_from_face, Motion<Dental> motion) {
  return express_in(dental_from_face, motion);
}
#elif defined(CASE_POSE_AS_MOTION)
Motion<Dental> wrong(Transform<Dental, FaceScan> dental_from_face) { return dental_from_face; }
#elif defined(CASE_MI_AND_TP_SCANS_MIXED)
Transform<Bow, FaceScanMi> wrong(Transform<Bow, FaceScanTp> bow_from_face_tp) { return bow_from_face_tp; }
#elif defined(CASE_MOTIONS_OF_TWO_FRAMES)
auto wrong(Motion<Dental> a, Motion<FaceScan> b) { return a * b; }
#elif defined(CASE_DEVICE_TIME_AS_HOST_TIME)
#include "core/time.h"
bool wrong(HostTime host, DeviceTime device) { return host < device; }
#endif
