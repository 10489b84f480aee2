#include "calibration/chain_derived.h"

namespace gnathion {
namespace {

/// Builds a product from left to right. exp(ξ)X after a prefix P moves the product by Ad_P ξ; X⁻¹ with X
/// perturbed is X⁻¹exp(−ξ), so that it moves by −Ad_{P·X⁻¹} ξ.
class Product {
 public:
  Product& times(ChainState state, const Rigid3& x) {
    block(state) += adjoint(out_.value);
    out_.value = out_.value * x;
    return *this;
  }
  Product& times_inverse(ChainState state, const Rigid3& x) {
    out_.value = out_.value * x.inverse();
    block(state) -= adjoint(out_.value);
    return *this;
  }
  ChainDerived done() const { return out_; }

 private:
  Eigen::Block<Eigen::Matrix<double, 6, 6 * kChainStates>, 6, 6> block(ChainState state) {
    return out_.jacobian.block<6, 6>(0, 6 * static_cast<int>(state));
  }
  ChainDerived out_;
};

}  // namespace

ChainDerived dental_from_face_of(const Chain& chain) {
  return Product()
      .times_inverse(ChainState::kBowFromDental, chain.bow_from_dental.value)
      .times(ChainState::kBowFromFace, chain.bow_from_face.value)
      .done();
}

ChainDerived bow_motion_of(const Chain& chain) {
  return Product()
      .times(ChainState::kFaceMiFromFaceTp, chain.face_mi_from_face_tp.value)
      .times_inverse(ChainState::kBowFromFaceTp, chain.bow_from_face_tp.value)
      .times(ChainState::kBowFromFace, chain.bow_from_face.value)
      .done();
}

ChainDerived therapeutic_of(const Chain& chain) {
  return Product()
      .times_inverse(ChainState::kBowFromDental, chain.bow_from_dental.value)
      .times(ChainState::kBowFromFace, chain.bow_from_face.value)
      .times(ChainState::kFaceMiFromFaceTp, chain.face_mi_from_face_tp.value)
      .times_inverse(ChainState::kBowFromFaceTp, chain.bow_from_face_tp.value)
      .times(ChainState::kBowFromDental, chain.bow_from_dental.value)
      .done();
}

}  // namespace gnathion
