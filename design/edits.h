// Edits by hand, as part of a design: strokes of a wax knife, drawn cutouts, contacts to keep.
//
// Told in Dental, where the splint lies. They are replayed in order over whatever the parameters give, so
// that a rebuild with another parameter keeps them; taking the last one away undoes it.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"
#include "core/rigid.h"
#include "occlusion/teeth.h"

namespace gnathion {

/// Moves the outer surface by up to depth_mm (out, in, or to its smoothed place) along a path; the effect
/// fades to nothing at radius_mm from it.
struct Stroke {
  enum class Kind { kAdd, kRemove, kSmooth };
  Kind kind = Kind::kAdd;
  std::vector<Vector3> path_mm;  ///< at least one point
  double radius_mm = 2.0;        ///< 0.5 to 10
  double depth_mm =
      0.3;  ///< at the path; up to 1, and at most 0.5·radius_mm, so that the surface does not fold
};

/// A region of the arch: what lies inside its outline, seen along the seating direction.
struct Region {
  std::vector<Vector3> outline_mm;  ///< three points or more, closed by itself
};

/// Where the splint ends on the crowns, drawn on the arch that wears it: the cutting surface passes through.
struct MarginCurve {
  std::vector<Vector3> points_mm;  ///< two or more; along the gingiva, on one side of the arch or round it
};

struct SplintEdits {
  std::vector<Stroke> strokes;       ///< in order
  std::vector<Region> cutouts;       ///< no splint inside
  std::vector<Region> contacts;      ///< where given: contacts inside only; elsewhere the clearance o is kept
  ToothCorrections teeth;            ///< over the automatic partition; the mandible's points in MI
  std::vector<MarginCurve> margins;  ///< in place of the cutting plane's depth, where they are drawn
  std::string label;                 ///< embossed where there is room; empty: none
  bool empty() const {
    return strokes.empty() && cutouts.empty() && contacts.empty() && teeth.empty() && margins.empty() &&
           label.empty();
  }
};

/// What can be embossed: 1 to 24 of A-Z, a-z, 0-9, space and . - _ # / : + (kUsage otherwise).
Status check_label(const std::string& text);
/// "16=missing" or "24=x,y,z" (mm, Dental), as the command line has it.
Status add_tooth_correction(ToothCorrections& teeth, const std::string& text);

/// [[design.tooth]], [[design.margin]] and design.label as TOML, for files that keep edits.
std::string marks_toml(const SplintEdits& edits);

/// [[design.stroke]] kind, path_mm, radius_mm, depth_mm; [[design.cutout]] and [[design.contact]] outline_mm;
/// [[design.tooth]] fdi with missing = true or at_mm; [[design.margin]] points_mm; [design] label.
/// Refuses (kInput) unknown keys, too few points, values out of range, by entry.
Result<SplintEdits> parse_edits(std::string_view toml, const std::string& name);

/// As design.json has them.
nlohmann::json edits_json(const SplintEdits& edits);

/// The edits in the design frame, as functions of the place.
class EditField {
 public:
  EditField() = default;
  EditField(const SplintEdits& edits, const Rigid3& design_from_dental);

  bool has_strokes() const { return !strokes_.empty(); }
  bool smooths() const;
  bool has_cutouts() const { return !cutouts_.empty(); }
  bool limits_contacts() const { return !contacts_.empty(); }

  /// The body's distance after all strokes; `smoothed` is that of the smoothed body there.
  double stroked(const Vector3& p_mm, double body_mm, double smoothed_mm) const;
  /// Distance across z to the nearest cutout's outline, negative inside.
  double cutout_mm(const Vector3& p_mm) const;
  /// 0 inside of a contact region, growing to 1 within 0.4 mm outside.
  double without_contact(const Vector3& p_mm) const;

 private:
  using Outline = std::vector<Eigen::Vector2d>;
  static double outside_mm(const std::vector<Outline>& outlines, const Vector3& p_mm);
  std::vector<Stroke> strokes_;
  std::vector<Outline> cutouts_, contacts_;
};

}  // namespace gnathion
