// Virtual X-rays of a joint while the mandible moves: line integrals of attenuation through a volume whose
// mandibular part moves with the jaw and whose rest stays.
//
// The moving part carries what its voxels attenuate beyond soft tissue, and the hole that it leaves is soft
// tissue: in MI the two parts add up to the volume itself, to the last digit of the sum.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "anatomy/mandible_mask.h"
#include "anatomy/volume/volume.h"
#include "core/image.h"
#include "core/result.h"
#include "occlusion/arch.h"

namespace gnathion {

/// How the beam goes and how the film is looked at, told in Dental; unit vectors at right angles to each
/// other.
struct XrayView {
  std::string name;
  Vector3 beam = -Vector3::UnitX();   ///< from the source to the film
  Vector3 right = -Vector3::UnitY();  ///< to the right on the film
  Vector3 up = Vector3::UnitZ();      ///< upwards on the film
};
/// "lateral" (from the patient's left, the face looks right), "frontal" (postero-anterior), "towne"
/// (antero-posterior, from 30° above), "submentovertex" (from below). In all but the first the patient's left
/// is on the right. Another name is refused (kUsage).
Result<XrayView> named_view(const std::string& name, const ArchFrame& arch);
/// Any: from the frontal view's beam the source goes `turn_deg` to the patient's left (90: lateral), and the
/// beam rises by `tilt_deg`.
XrayView turned_view(double turn_deg, double tilt_deg, const ArchFrame& arch);

struct XrayOptions {
  int size_px = 256;
  double field_mm = 60.0;        ///< width and height that the film shows, about the joint's centre
  double depth_mm = 70.0;        ///< only this much of the head along the beam: the other joint stays out
  double source_mm = 0.0;        ///< from the joint's centre to the focus; 0: parallel beam
  double water_per_mm = 0.0206;  ///< attenuation of water, at 60 keV (NIST XCOM)
  double air_value = -1000.0;    ///< value that attenuates nothing; less is taken for it
  double water_value = 0.0;      ///< value that attenuates as water does, linear between and beyond
  double soft_tissue = 50.0;     ///< value of what fills the hole that the mandible leaves
};

/// Line integrals of attenuation (no unit): the beam leaves exp(−value) of itself.
struct XrayFilm {
  int size_px = 0;
  std::vector<float> integral;  ///< rows from above
};
/// Bone white: `low` black, `high` white, linear between (the display of a digital detector: −log of
/// intensity).
Image8 windowed(const XrayFilm& film, double low, double high);
/// The window that shows nearly all of a film: 2 % and 99.5 % of its values.
struct XrayWindow {
  double low = 0.0, high = 1.0;
};
XrayWindow window_of(const XrayFilm& film);

/// One joint seen in one view. Immutable; the film of the resting head is made once. Thread-safe. Refers to
/// the volume, which must outlive it.
class JointXray {
 public:
  /// `centre_mm`: of the condyle in Dental; `scanned_from_mi`: motion of the mandible from MI to where it was
  /// in the volume (identity: it was scanned in MI).
  static Result<JointXray> create(const Volume& volume, const Transform<Cbct, Dental>& cbct_from_dental,
                                  const VoxelMask& mandible, const Vector3& centre_mm, const XrayView& view,
                                  const XrayOptions& options,
                                  const Motion<Dental>& scanned_from_mi = Motion<Dental>());
  ~JointXray();
  JointXray(JointXray&&) noexcept;
  JointXray& operator=(JointXray&&) noexcept;

  /// With the mandible moved from MI; on all cores.
  XrayFilm film(const Motion<Dental>& from_mi) const;
  const XrayFilm& resting() const;  ///< the head without its mandible
  /// The volume as it was scanned, in one pass: what film() must show for scanned_from_mi.
  XrayFilm scanned() const;

 private:
  struct Beam;
  explicit JointXray(std::unique_ptr<Beam> beam);
  std::unique_ptr<Beam> beam_;
};

}  // namespace gnathion
