#include "anatomy/limits.h"

namespace gnathion {

const char* severity_name(Severity severity) {
  switch (severity) {
    case Severity::kInforms:
      return "informs";
    case Severity::kApertures:
      return "apertures";
    case Severity::kBlocks:
      break;
  }
  return "blocks";
}

std::vector<LimitRow> limit_table(const RealizabilityLimits& l) {
  constexpr Severity kBlocks = Severity::kBlocks, kInforms = Severity::kInforms;
  const bool at_least = true, at_most = false;
  return {
      {"mandible_below_maxilla", "height of the maxilla over a tooth's occlusal surface, least of all teeth",
       at_least, 0.0, "mm", kBlocks,
       "a mandible above the maxilla touches nothing and still is impossible [1]"},
      {"no_intersection", "deepest point of one jaw inside the other", at_most, l.overlap_beyond_mi_mm, "mm",
       kBlocks, "beyond MI's own, which is up to 0.3 mm in scans and computed closures [1]"},
      {"interocclusal_clearance", "smallest distance between the jaws", at_least, l.aperture_mm, "mm",
       Severity::kApertures, "a printed wall under 0.5 mm is not reliable: an aperture opens instead [2]"},
      {"wall_room", "smallest distance between the jaws", at_least, l.wall_mm, "mm", kInforms,
       "too small interocclusal distance, e.g. < 1 mm [1]"},
      {"opening_rotation", "rotation about the transverse axis", at_most, l.opening_deg, "deg", kBlocks,
       "full opening of 50-60 mm at an incisor radius of about 100 mm, with translation [3, 4]"},
      {"closing_rotation", "the same, past MI", at_most, l.closing_deg, "deg", kBlocks,
       "the front teeth stop it; room for a bite whose MI was scanned open (this project's choice)"},
      {"yaw", "rotation about the occlusal normal", at_most, l.yaw_deg, "deg", kBlocks,
       "12 mm of laterotrusion over a radius of 88 mm [3]"},
      {"roll", "rotation about the sagittal axis", at_most, l.roll_deg, "deg", kBlocks,
       "one condyle 5-9 mm lower than the other (this project's choice)"},
      {"vertical_opening", "descent of the incisal point", at_most, l.vertical_opening_mm, "mm", kBlocks,
       "opening that is a rotation about the terminal hinge axis, 20-25 mm [5]; splints take 2-15 mm [2]"},
      {"protrusion", "advance of the incisal point", at_most, l.protrusion_mm, "mm", kBlocks,
       "mean 8.8 mm, SD 2.3 mm in 500 patients [3]"},
      {"laterotrusion", "sideways shift of the incisal point", at_most, l.laterotrusion_mm, "mm", kBlocks,
       "means 9.4 and 11.8 mm, right and left, in 500 patients [3]"},
      {"condyle_forward", "advance of the more advanced condyle", at_most, l.condyle_forward_mm, "mm",
       kBlocks, "condylar path in full opening and protrusion [4, 6]"},
      {"condyle_back", "retrusion of the more retruded condyle", at_most, l.condyle_back_mm, "mm", kBlocks,
       "from MI to the retruded contact position: about 1.25 mm [5]"},
      {"condyle_up", "rise of the higher condyle", at_most, l.condyle_up_mm, "mm", kBlocks,
       "the joint space above the condyle is about 2.5 mm [7]"},
      {"condyle_down", "descent of the lower condyle", at_most, l.condyle_down_mm, "mm", kBlocks,
       "descent along the eminence in full opening [4, 6]"},
      {"condyle_lateral", "mean sideways shift of both condyles", at_most, l.condyle_lateral_mm, "mm",
       kBlocks, "Bennett movement: usually under 2 mm, 3 mm at most [6]"},
      {"recorded_envelope", "how far outside the patient's own recorded motion", at_most, l.envelope_mm, "mm",
       kInforms, "two or three times the error of a recorded position (this project's choice)"},
      {"uniform_contact", "weaker side's share of MI's contact area that keeps a wall", at_least,
       l.weaker_side_share, "share", kInforms, "contact on one side only makes the splint rock [1]"},
      {"support_polygon", "how far inside the hull of these contacts the arch's middle lies", at_least,
       l.support_margin_mm, "mm", kInforms, "outside it a bite in the middle tips the splint (statics)"},
      {"condyle_fossa", "distance of condyle and fossa, the smaller of both joints", at_least,
       l.condyle_fossa_mm, "mm", kBlocks, "bone does not pass through bone [1]"},
      {"joint_space", "the same", at_least, l.joint_space_mm, "mm", kInforms,
       "the disc is about 1 mm thick at its thinnest; the narrowest space on CBCT is 1.3 mm on average [7]"},
  };
}

}  // namespace gnathion
