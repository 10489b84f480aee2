// The tags of a body (bow or head frame) as they were really glued: their corners in the body's frame from a
// film of the body, by bundle adjustment. Gets detected corners, never images.
//
// Model: every tag is a flat rectangle (its own width and height, near the common side) with a pose of its
// own on a rigid body. What is not modelled: tags that are bent.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/camera_model.h"
#include "core/result.h"

namespace gnathion {

/// One tag in one image: corners in the order of BodyTag, px, with the detector's covariance of (x0, y0 …
/// y3).
struct SeenTag {
  int id = 0;
  std::array<Eigen::Vector2d, 4> corners_px;
  Eigen::Matrix<double, 8, 8> covariance_px2 = Eigen::Matrix<double, 8, 8>::Identity();
};

/// One instant, seen by the cameras of the rig.
struct BodyView {
  std::string name;                        ///< for reports: "frame 120"
  std::vector<std::vector<SeenTag>> tags;  ///< per camera of the rig; ids of other bodies may be among them
  std::optional<Rigid3>
      rig_from_body;  ///< a start, good to some mm and degrees; without it the view is not used
};

/// A length measured on the body: between corners, or centres (corner < 0), of two tags.
struct KnownDistance {
  int tag_a = 0, corner_a = -1, tag_b = 0, corner_b = -1;
  double mm = 0, sigma_mm = 0.05;
};

struct BowGeometryOptions {
  std::optional<double> tag_side_mm;  ///< measured side of the black square; else the nominal layout's
  double tag_side_sigma_mm = 0.02;    ///< how well that is known
  std::vector<KnownDistance> distances;
  int least_views = 8;                ///< of a tag: less is "seen too seldom", and the tag is left out
  double least_turn_deg = 20.0;       ///< the views' directions must span this much
  double largest_sigma_mm = 0.1;      ///< of a corner (scale apart): more is not determined
  double largest_deviation_mm = 3.0;  ///< of a tag from the nominal layout
  std::size_t most_views = 160;       ///< for the fit; more are thinned out evenly
};

using Matrix12 = Eigen::Matrix<double, 12, 12>;

struct TagGeometry {
  BodyTag tag;  ///< calibrated corners, body frame
  double width_mm = 0, height_mm = 0;
  Matrix12 covariance_mm2 = Matrix12::Zero();  ///< of the four corners (x0 y0 z0 … z3), scale's part included
  double sigma_mm = 0;                         ///< largest standard deviation of a corner in any direction
  Vector3 shift_mm = Vector3::Zero();          ///< of the centre against the nominal layout, body frame
  double turn_deg = 0;                         ///< against the nominal layout
  double rms_px = 0;                           ///< per coordinate
  int views = 0, rejected = 0;                 ///< observations used, and those at odds with the rest
};

struct ViewResidual {
  std::string name;
  double rms_px = 0;
  int tags = 0;
};

/// One witness of the metric scale: factor on the nominal lengths.
struct ScaleWitness {
  std::string name;  ///< "tag side", "distances", "distance between the cameras"
  double factor = 1, sigma = 0;
};

struct LeftOutTag {
  int id = 0;
  std::string reason;
};

struct BowGeometry {
  TaggedBody body;                ///< calibrated; tags that are not determined are not in it
  std::vector<TagGeometry> tags;  ///< of body.tags, in order
  std::vector<LeftOutTag> left_out;
  std::vector<ViewResidual> views;  ///< used in the fit
  double rms_px = 0;                ///< per coordinate, over the fit
  double residual_scale =
      1;  ///< √(χ²/dof) against the detector's covariances; above 1 it widens the covariance
  double held_out_px = 0;  ///< each tag of a held-out view predicted by its other tags; RMS per coordinate
  std::size_t held_out_tags = 0;
  std::vector<ScaleWitness> scale_witnesses;
  double scale = 1, scale_sigma = 0;  ///< factor on the nominal lengths, as used
  double shape_sigma_mm = 0;          ///< largest standard deviation of a corner, scale apart
  double focal_sensitivity_mm = 0;    ///< largest shift of a corner when the focal length is 0.1 % larger
  double datum_sigma_mm = 0,
         datum_sigma_deg = 0;     ///< how well the nominal layout fixes the frame: the tags' scatter about it
  double condition = 1;           ///< largest over smallest standard deviation of the layout's directions
  std::vector<std::string> weak;  ///< the worst determined directions, in words
  std::vector<std::string> warnings;
  double turn_deg = 0;  ///< what the views' directions span
};

/// `cameras` as in the rig; `nominal` the CAD layout. The frame of the result: the rigid best fit (least
/// squares over all corners of the tags that are determined) of the calibrated corners to the nominal ones is
/// the identity. Scale: tag side, distances, and the distance between cameras where there are several; they
/// must agree. Refused (kInput): a film of another body, a tag that is there twice, too little movement,
/// witnesses of the scale that disagree (by how much is said), tags at places or of a size that the nominal
/// layout does not have, mirrored corners.
Result<BowGeometry> calibrate_bow_geometry(const std::vector<RigCamera>& cameras, const TaggedBody& nominal,
                                           const std::vector<BodyView>& views,
                                           const BowGeometryOptions& options);

}  // namespace gnathion
