// What a film of a body must be before its tags are calibrated, and what the result must be. Private to the
// bow's calibration.
#pragma once

#include <vector>

#include "calibration/bow_layout.h"

namespace gnathion {

/// Ids, doubles, winding: refuses a film of another body, a tag that is there twice, mirrored images.
Status check_seen_tags(const TaggedBody& nominal, const std::vector<BodyView>& views);
/// Largest angle between two directions from the body to the rig, degrees.
double span_of_views_deg(const std::vector<Rigid3>& rig_from_body);
/// Refuses tags far from their nominal places (naming exchanged ones) and tags of another size than the rest.
Status check_layout(const TaggedBody& nominal, const TagLayout& layout, const Eigen::MatrixXd& covariance,
                    double largest_deviation_mm);
/// The factor on nominal lengths that each witness asks for; `images` the one of several cameras.
Result<std::vector<ScaleWitness>> scale_witnesses(const TagLayout& layout, const BowGeometryOptions& options,
                                                  const std::optional<ScaleWitness>& images);
/// Refuses witnesses that disagree, saying by how much.
Status check_witnesses(const std::vector<ScaleWitness>& witnesses, double nominal_side_mm);
/// Inverse-variance mean of the witnesses; those of the images left out where `without_images`.
ScaleWitness combined(const std::vector<ScaleWitness>& witnesses, bool without_images);
/// Distances against the finished layout; names one that does not fit.
Status check_distances(const TagLayout& layout, const BowGeometryOptions& options, double scale_sigma);
/// The worst determined directions of the layout, in words.
std::vector<std::string> weak_directions(const TagLayout& layout, const Eigen::MatrixXd& shape,
                                         double scale_sigma);

inline constexpr const char* kBowWhat = "cannot calibrate the body's tags";
inline constexpr const char* kImagesWitness = "distance between the cameras";

}  // namespace gnathion
