#include "daemon/jaw.h"

namespace gnathion::daemon {

LivePose JawFollower::next(const MotionRow& row) {
  LivePose jaw;
  jaw.body = "jaw";
  jaw.reference = bow_from_dental_ ? "dental" : "head_frame";
  jaw.tags = row.bow.tags_used + row.head.tags_used;
  if (!row.valid()) {
    jaw.reason = row.reason();
    return jaw;
  }
  const Transform<HeadFrame, Bow> head_from_bow = row.head_from_bow();
  const Matrix6 covariance = row.head_from_bow_covariance();
  if (pending_ || !at_mi_) {
    at_mi_ = AtMi{head_from_bow, covariance, pending_.value_or("first pose")};
    pending_.reset();
  }
  jaw.valid = true;
  if (!bow_from_dental_) {
    jaw.reference_from_body = head_from_bow.rigid;
    jaw.covariance = covariance;
    return jaw;
  }
  // T_D⁻¹ X0⁻¹ X1 T_D. Left perturbations of X0 and X1 (taken as independent) enter through one adjoint; the
  // error of T_D itself, which small motions hardly feel, is not in this covariance.
  const Rigid3 dental_from_head = bow_from_dental_->rigid.inverse() * at_mi_->head_from_bow.rigid.inverse();
  jaw.reference_from_body = dental_from_head * head_from_bow.rigid * bow_from_dental_->rigid;
  const Matrix6 a = adjoint(dental_from_head);
  jaw.covariance = a * (covariance + at_mi_->covariance) * a.transpose();
  jaw.mi = at_mi_->what;
  return jaw;
}

}  // namespace gnathion::daemon
