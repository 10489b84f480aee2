// Which positions a splint can hold: a map over two of the mandible's six degrees of freedom.
#pragma once

#include <array>
#include <atomic>
#include <optional>
#include <string>
#include <vector>

#include "anatomy/realizability.h"
#include "core/progress.h"

namespace gnathion {

/// The six, in this order. Displacements are those of the point midway between the condyles.
enum class JawAxis { kProtrusion, kLaterotrusion, kLowering, kOpening, kYaw, kRoll };
inline constexpr int kJawAxes = 6;
const char* jaw_axis_name(JawAxis axis);  ///< "protrusion", …
const char* jaw_axis_unit(JawAxis axis);  ///< "mm" or "deg"
std::optional<JawAxis> jaw_axis_of(const std::string& name);

/// A position of the mandible from MI. Translations in mm: forwards, to the patient's left, downwards;
/// rotations in degrees about axes through the middle of the condyles: opening about the transverse axis, yaw
/// (chin to the left) about the occlusal normal, roll (left side down) about the sagittal axis. The three
/// turns are one rotation vector, so that every motion has one set of coordinates and every set one motion.
struct JawCoordinates {
  std::array<double, kJawAxes> value{};
  double& operator[](JawAxis axis) { return value[static_cast<std::size_t>(axis)]; }
  double operator[](JawAxis axis) const { return value[static_cast<std::size_t>(axis)]; }
};
Rigid3 motion_of(const JawCoordinates& c, const ArchFrame& arch, const Vector3& condyle_middle_mm);
JawCoordinates coordinates_of(const Rigid3& motion, const ArchFrame& arch, const Vector3& condyle_middle_mm);

/// What a position is, the first that applies.
enum class RangeVerdict : std::uint8_t {
  kJoints,     ///< the joints forbid it
  kTeeth,      ///< the jaws would pass through each other, or past
  kMovement,   ///< farther than mandibles go
  kApertures,  ///< realizable, open where no wall can stand
  kThinWall,   ///< realizable, less than a full wall somewhere
  kRealizable,
};
const char* range_verdict_name(RangeVerdict verdict);  ///< "joints", "teeth", …

struct RangeAxis {
  JawAxis axis = JawAxis::kProtrusion;
  double low = 0.0, high = 1.0;
  int cells = 2;  ///< values at low, …, high, evenly
  double at(int i) const { return low + (high - low) * i / (cells - 1); }
};
struct RangeOptions {
  RangeAxis x{JawAxis::kProtrusion, -2.0, 8.0, 41};
  RangeAxis y{JawAxis::kOpening, 0.0, 12.0, 41};
  JawCoordinates through;  ///< the other four
  /// Protrusion p > 0 lowers by p·tan(slope) more: the condyles' path down the eminences.
  double condylar_slope_deg = 0.0;
};
struct RangeCell {
  RangeVerdict verdict = RangeVerdict::kRealizable;
  double clearance_mm = 0.0;          ///< smallest between the teeth, negative inside
  std::optional<double> joint_mm;     ///< smaller of the joints' distances; nothing: not checked
  std::vector<std::string> violated;  ///< as in feasibility.json
};
struct RealizableRange {
  RangeOptions options;
  std::vector<RangeCell> cells;  ///< x fastest
  bool joints_checked = false;
  const RangeCell& at(int ix, int iy) const {
    return cells[static_cast<std::size_t>(iy) * static_cast<std::size_t>(options.x.cells) +
                 static_cast<std::size_t>(ix)];
  }
  /// Share of cells that a splint can hold.
  double realizable_share() const;
};
/// The motion that a cell stands for.
Rigid3 range_motion(const RangeOptions& options, const RealizabilityChecker& checker, double x, double y);
/// Where a position lies on the map: the values on its two axes.
Eigen::Vector2d range_place(const RangeOptions& options, const JawCoordinates& position);

/// Every cell is one full check (docs/realizability.md); on all cores, the same result on any number. With
/// `cancel` set from another thread the work ends soon, with kInternal "cancelled". Refused with kUsage: the
/// same axis twice, fewer than 2 cells, more than 1e6, an empty range.
Result<RealizableRange> realizable_range(const RealizabilityChecker& checker, const RangeOptions& options,
                                         Progress& progress, const std::atomic<bool>* cancel = nullptr);

}  // namespace gnathion
