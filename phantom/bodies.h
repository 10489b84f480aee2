// Rigid bodies of the phantom with tags on flat plates, and the small solid modeller that shapes them.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/camera_model.h"
#include "core/mesh.h"

namespace gnathion {

/// A device's body as its CAD file has it: surface and tags in the body's own frame.
struct PhantomBody {
  TriangleMesh surface;  ///< closed
  TaggedBody tags;       ///< each tag's corners lie on the flat front of its plate
};

/// Side of a tag's black square, and of the flat white front of its plate.
inline constexpr double kTagSide_mm = 20.0;
inline constexpr double kPlateSide_mm = 29.0;
inline constexpr double kPlateThickness_mm = 2.5;

/// A plate that carries one tag. `facing` maps plate coordinates (x to the viewer's right, y up, z
/// towards the viewer, origin in the middle of the front face) to the frame of the layout.
struct TagPlate {
  int id = 0;
  Rigid3 facing;
};

/// A plate at `centre_mm` that looks along -y (to the patient's front) turned by `yaw_deg` to the patient's
/// left, by `pitch_deg` upwards and rolled by `roll_deg` in its own plane.
TagPlate tag_plate(int id, const Vector3& centre_mm, double yaw_deg, double pitch_deg, double roll_deg);

/// The tag of a plate, corners in the order of BodyTag.
BodyTag tag_of(const TagPlate& plate);

/// The plate as a solid, with the post that holds it from behind.
class PlateOnPost {
 public:
  /// `anchor_mm`: where the post is rooted, in the frame of the layout.
  PlateOnPost(const TagPlate& plate, const Vector3& anchor_mm);
  /// Union (smooth at the roots) of `other_mm`, a distance to something else, with plate and post at `p_mm`.
  double united_with(double other_mm, const Vector3& p_mm) const;

 private:
  Rigid3 plate_from_space_;
  Vector3 post_from_mm_, post_to_mm_, middle_mm_;
  double reach_mm_;
};

/// A solid built around tags, as a body: closed surface of the zero of `solid`, and the plates' tags.
/// `edge_mm` is the lattice's.
PhantomBody body_of(const char* name, const std::function<double(const Vector3&)>& solid, const Box& box,
                    const std::vector<TagPlate>& plates, double edge_mm);

/// Tags and surface re-expressed.
PhantomBody transformed(const Rigid3& to_from_body, const PhantomBody& body);

}  // namespace gnathion
