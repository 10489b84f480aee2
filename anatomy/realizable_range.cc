#include "anatomy/realizable_range.h"

#include <tbb/parallel_for.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <cmath>
#include <mutex>

namespace gnathion {
namespace {

constexpr double kDeg = M_PI / 180.0;
constexpr std::array<const char*, kJawAxes> kNames = {"protrusion", "laterotrusion", "lowering",
                                                      "opening",    "yaw",           "roll"};

Vector3 middle_of(const RealizabilityChecker& checker) {
  return 0.5 * (checker.condyle_mm(Side::kLeft) + checker.condyle_mm(Side::kRight));
}

/// The rotation vector's axes for opening, yaw and roll: positive opens, chin to the left, left side down.
Matrix3 turn_axes(const ArchFrame& arch) {
  Matrix3 axes;
  axes.col(0) = arch.left;
  axes.col(1) = arch.up;
  axes.col(2) = arch.up.cross(arch.left);
  return axes;
}

/// Protrusion, laterotrusion, lowering.
Matrix3 shift_axes(const ArchFrame& arch) {
  Matrix3 axes;
  axes.col(0) = arch.anterior;
  axes.col(1) = arch.left;
  axes.col(2) = -arch.up;
  return axes;
}

Status check_options(const RangeOptions& o) {
  const auto refused = [](const std::string& why) {
    return fail(ErrorCode::kUsage, "cannot map", "range", why);
  };
  if (o.x.axis == o.y.axis) return refused("both axes are " + std::string(jaw_axis_name(o.x.axis)));
  for (const RangeAxis& a : {o.x, o.y}) {
    if (a.cells < 2 || a.cells > 1000) return refused("2 to 1000 cells along an axis");
    if (!(a.high > a.low) || !std::isfinite(a.low) || !std::isfinite(a.high))
      return refused(std::string(jaw_axis_name(a.axis)) + " goes from low to high");
  }
  if (!(std::abs(o.condylar_slope_deg) < 80.0)) return refused("a condylar slope is less than 80 degrees");
  return {};
}

RangeVerdict range_verdict(const Feasibility& f) {
  RangeVerdict verdict = RangeVerdict::kRealizable;
  const auto worse = [&](RangeVerdict v) { verdict = std::min(verdict, v); };
  for (const Constraint& c : f.constraints) {
    if (c.pass) continue;
    if (c.name == "condyle_fossa" && c.checked)
      worse(RangeVerdict::kJoints);
    else if (c.name == "no_intersection" || c.name == "mandible_below_maxilla")
      worse(RangeVerdict::kTeeth);
    else if (c.severity == Severity::kBlocks)
      worse(RangeVerdict::kMovement);
    else if (c.severity == Severity::kApertures)
      worse(RangeVerdict::kApertures);
    else if (c.name == "wall_room")
      worse(RangeVerdict::kThinWall);
  }
  return verdict;
}

RangeCell cell_of(const Feasibility& f) {
  RangeCell cell;
  cell.verdict = range_verdict(f);
  cell.violated = f.violated();
  for (const Constraint& c : f.constraints)
    if (c.name == "interocclusal_clearance") cell.clearance_mm = c.value;
  for (const JointReport& r : f.joints) cell.joint_mm = std::min(cell.joint_mm.value_or(1e300), r.tp.min_mm);
  return cell;
}

/// Calls Progress from one thread at a time, and never backwards.
class Count {
 public:
  Count(Progress& progress, std::size_t all) : progress_(progress), all_(all) {}
  void one_more() {
    const std::lock_guard lock(mutex_);
    progress_.update(static_cast<double>(++done_) / static_cast<double>(all_));
  }

 private:
  Progress& progress_;
  std::mutex mutex_;
  std::size_t done_ = 0, all_;
};

}  // namespace

const char* jaw_axis_name(JawAxis axis) {
  return kNames[static_cast<std::size_t>(axis)];
}
const char* jaw_axis_unit(JawAxis axis) {
  return axis < JawAxis::kOpening ? "mm" : "deg";
}
std::optional<JawAxis> jaw_axis_of(const std::string& name) {
  for (std::size_t i = 0; i < kNames.size(); ++i)
    if (name == kNames[i]) return static_cast<JawAxis>(i);
  return std::nullopt;
}
const char* range_verdict_name(RangeVerdict verdict) {
  constexpr std::array<const char*, 6> kVerdicts = {"joints",    "teeth",     "movement",
                                                    "apertures", "thin_wall", "realizable"};
  return kVerdicts[static_cast<std::size_t>(verdict)];
}

Rigid3 motion_of(const JawCoordinates& c, const ArchFrame& arch, const Vector3& middle_mm) {
  const Vector3 turn(c[JawAxis::kOpening], c[JawAxis::kYaw], c[JawAxis::kRoll]);
  const Vector3 shift(c[JawAxis::kProtrusion], c[JawAxis::kLaterotrusion], c[JawAxis::kLowering]);
  Rigid3 motion;
  motion.rotation = exp_so3(turn_axes(arch) * (turn * kDeg));
  motion.translation_mm = middle_mm - motion.rotation * middle_mm + shift_axes(arch) * shift;
  return motion;
}

JawCoordinates coordinates_of(const Rigid3& motion, const ArchFrame& arch, const Vector3& middle_mm) {
  const Vector3 turn = turn_axes(arch).transpose() * log_so3(motion.rotation) / kDeg;
  const Vector3 shift = shift_axes(arch).transpose() * (motion * middle_mm - middle_mm);
  JawCoordinates c;
  c[JawAxis::kOpening] = turn[0], c[JawAxis::kYaw] = turn[1], c[JawAxis::kRoll] = turn[2];
  c[JawAxis::kProtrusion] = shift[0], c[JawAxis::kLaterotrusion] = shift[1], c[JawAxis::kLowering] = shift[2];
  return c;
}

Rigid3 range_motion(const RangeOptions& o, const RealizabilityChecker& checker, double x, double y) {
  JawCoordinates c = o.through;
  c[o.x.axis] = x;
  c[o.y.axis] = y;
  c[JawAxis::kLowering] += std::max(0.0, c[JawAxis::kProtrusion]) * std::tan(o.condylar_slope_deg * kDeg);
  return motion_of(c, checker.arch(), middle_of(checker));
}

Eigen::Vector2d range_place(const RangeOptions& o, const JawCoordinates& position) {
  return {position[o.x.axis], position[o.y.axis]};
}

double RealizableRange::realizable_share() const {
  const auto held = std::count_if(cells.begin(), cells.end(),
                                  [](const RangeCell& c) { return c.verdict >= RangeVerdict::kApertures; });
  return cells.empty() ? 0.0 : static_cast<double>(held) / static_cast<double>(cells.size());
}

Result<RealizableRange> realizable_range(const RealizabilityChecker& checker, const RangeOptions& options,
                                         Progress& progress, const std::atomic<bool>* cancel) {
  GNATHION_CHECK_OK(check_options(options));
  RealizableRange range;
  range.options = options;
  range.joints_checked = !checker.joints().empty();
  const std::size_t columns = static_cast<std::size_t>(options.x.cells);
  range.cells.resize(columns * static_cast<std::size_t>(options.y.cells));
  const auto cancelled = [&] { return cancel != nullptr && cancel->load(); };
  Count count(progress, range.cells.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, range.cells.size(), 1), [&](const auto& cells) {
    for (std::size_t i = cells.begin(); i != cells.end(); ++i) {
      if (cancelled()) return;
      const double x = options.x.at(static_cast<int>(i % columns)),
                   y = options.y.at(static_cast<int>(i / columns));
      const Motion<Dental> motion(range_motion(options, checker, x, y));
      range.cells[i] = cell_of(checker.check(motion, {}, false));
      count.one_more();
    }
  });
  if (cancelled()) return fail(ErrorCode::kInternal, "cannot map", "range", "cancelled");
  return range;
}

}  // namespace gnathion
