// Undercuts of the arch seen along the seating direction, and what of them the splint still holds on to.
#pragma once

#include <cstdint>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace gnathion {

struct ToothRetention {
  std::uint8_t fdi = 0;
  double undercut_max_mm = 0.0;    ///< of the crown above the cutting surface
  double undercut_area_mm2 = 0.0;  ///< of the crown's surface that is deeper than kUndercutShownMm
  double engaged_max_mm = 0.0;     ///< how deep the splint reaches below the height of contour, across a
  double engaged_area_mm2 = 0.0;   ///< of the cavity's surface there
};

/// Shallower undercuts are the grid's noise.
constexpr double kUndercutShownMm = 0.02;

struct Retention {
  std::vector<ToothRetention> per_tooth;  ///< teeth that are covered, by FDI number
  /// Per vertex of the arch's scan as given: its distance from the surface of M ⊕ R_a, which is what
  /// block-out would fill there. 0 where nothing is undercut and beyond the cutting surface. Good to 0.05 mm
  /// (coarse grid).
  std::vector<float> undercut_mm;
  double undercut_max_mm() const;
  double engaged_max_mm() const;
  double engaged_area_mm2() const;
};

nlohmann::json retention_json(const Retention& retention);

}  // namespace gnathion
