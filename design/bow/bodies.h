// Bow and head frame as solids. Private to design/bow/.
#pragma once

#include <functional>

#include "design/bow/bow.h"
#include "design/bow/clutch.h"
#include "design/bow/tag_plates.h"
#include "design/extraction.h"

namespace gnathion {

/// Ten plates in two rows before the mouth; neighbours are turned against each other.
std::vector<TagPlate> bow_plates(const BowParameters& p);
std::vector<TagPlate> head_plates(const BowParameters& p);

/// The field of a body with the box that holds it.
struct BodyField {
  ExtractionField field;
  Box box;
};
/// `clutch` and `plates` must outlive the field.
BodyField bow_field(const Clutch& clutch, const PlateSolids& plates, const BowParameters& p);
BodyField head_field(const PlateSolids& plates, const BowParameters& p);

/// Closed, simplified where it is flat, rounded to what an STL keeps; the largest piece.
TriangleMesh body_surface(const BodyField& body, double fine_mm,
                          const std::function<double(const Vector3&)>& tolerance_mm,
                          std::vector<std::string>& warnings);

}  // namespace gnathion
