#include "design/label.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/transform_io.h"
#include "design/parallel.h"

namespace gnathion {
namespace {

constexpr double kStepSMm = 0.5, kStepZMm = 0.25;  // of the wall's samples
constexpr double kFarMm = 14.0;                    // from the arch curve: outside of any splint
constexpr double kMarchMm = 0.3;
constexpr double kRimMm = 0.4;       // between letters and the rim's rounding
constexpr double kOpposingMm = 1.0;  // between wall and opposing arch
constexpr double kClearMm = 0.5;     // between letters and it, where the samples saw too little
constexpr double kAboveMm = 2.5;     // how far towards the opposing arch walls are looked at
constexpr double kSteepest = 0.85;   // slope of the wall against a, and along the arch
constexpr double kTextMarginMm = 0.4;
constexpr double kWallDepthMm = 0.8;  // about the wall: letters and what its samples are off
constexpr double kSmileMm = 18.0;     // along the arch from the midline: seen when the patient smiles
/// Behind the canines first, then anywhere; large letters first.
constexpr std::pair<double, double> kTries[] = {{kSmileMm, 3.0}, {kSmileMm, 2.5}, {kSmileMm, 2.0},
                                                {0.0, 3.0},      {0.0, 2.5},      {0.0, 2.0}};
constexpr double kNotHere = std::numeric_limits<double>::quiet_NaN();

/// One side of the splint as a height field over arc length and height: how far the wall stands from the arch
/// curve.
class Wall {
 public:
  Wall(bool buccal, const Preparation& prep, const SplintParameters& par, const LabelSurroundings& around)
      : ruler_(prep.arch), dental_(prep.design_from_dental), buccal_(buccal) {
    s0_ = ruler_.s_min_mm();
    columns_ = static_cast<int>((ruler_.s_max_mm() - s0_) / kStepSMm) + 1;
    rows_ = static_cast<int>((par.depth_mm + kAboveMm) / kStepZMm) + 1;
    off_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), kNotHere);
    level_.resize(static_cast<std::size_t>(columns_));
    parallel_each(columns_, [&](int c) {
      const double s = s_mm(c);
      Vector3 on_curve = dental_ * ruler_.at(s), out = dental_.rotation * ruler_.outward(s);
      out.z() = 0.0;
      out.normalize();
      on_curve.z() = 0.0;
      const double level = prep.level.level_mm(on_curve);
      level_[static_cast<std::size_t>(c)] = level;
      for (int r = 0; r < rows_; ++r) {
        const double z = level - kAboveMm + r * kStepZMm;
        double off = kFarMm, before = 1e9;
        for (; off > 0.0; off -= kMarchMm) {
          const Vector3 p(on_curve.x() + side() * off * out.x(), on_curve.y() + side() * off * out.y(), z);
          const double body = around.body(p);
          if (body < 0.0) {
            off += kMarchMm * (before < 1e8 ? -body / (before - body) : 0.0);
            break;
          }
          before = body;
        }
        if (off <= 0.0 || before > 1e8) continue;
        const Vector3 p(on_curve.x() + side() * off * out.x(), on_curve.y() + side() * off * out.y(), z);
        const double below_rim = prep.cut_mm(p, par.depth_mm) - z;
        if (below_rim < par.rim_radius_mm + kRimMm || around.opposing(p) < kOpposingMm ||
            prep.level.behind_teeth_mm(p) > 0.0 || prep.level.beyond_cover_mm(p) > -1.0 ||
            (prep.edits.has_cutouts() && prep.edits.cutout_mm(p) < 1.0))
          continue;
        at(c, r) = off;
      }
    });
  }

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  double side() const { return buccal_ ? 1.0 : -1.0; }
  double s_mm(int column) const { return s0_ + column * kStepSMm; }
  bool usable(int c, int r) const {
    return c >= 0 && r >= 0 && c < columns_ && r < rows_ && !std::isnan(off(c, r));
  }
  Vector3 place(int c, int r) const {
    const double s = s_mm(c);
    const Vector3 on_curve = dental_ * ruler_.at(s);
    Vector3 out = dental_.rotation * ruler_.outward(s);
    out.z() = 0.0;
    out.normalize();
    return {on_curve.x() + side() * off(c, r) * out.x(), on_curve.y() + side() * off(c, r) * out.y(),
            level_[static_cast<std::size_t>(c)] - kAboveMm + r * kStepZMm};
  }
  /// Squared slope of the wall there, or not a number where it is too steep or unknown about.
  double slope2(int c, int r) const {
    if (!usable(c, r) || !usable(c + 1, r) || !usable(c - 1, r) || !usable(c, r + 1) || !usable(c, r - 1))
      return kNotHere;
    const double along = (off(c + 1, r) - off(c - 1, r)) / (2.0 * kStepSMm);
    const double up = (off(c, r + 1) - off(c, r - 1)) / (2.0 * kStepZMm);
    return std::max(std::abs(along), std::abs(up)) > kSteepest ? kNotHere : along * along + up * up;
  }

 private:
  double off(int c, int r) const {
    return off_[static_cast<std::size_t>(c) * static_cast<std::size_t>(rows_) + static_cast<std::size_t>(r)];
  }
  double& at(int c, int r) {
    return off_[static_cast<std::size_t>(c) * static_cast<std::size_t>(rows_) + static_cast<std::size_t>(r)];
  }
  ArchRuler ruler_;
  Rigid3 dental_;  ///< design_from_dental
  bool buccal_;
  double s0_ = 0.0;
  int columns_ = 0, rows_ = 0;
  std::vector<double> off_, level_;
};

/// Columns from first to last, text centred on `row`.
struct Spot {
  int first = 0, last = -1, row = 0;
  double slope2 = 1e300;
};

/// The flattest rectangle of that size, by mean squared slope; no part of it nearer than `front_mm` to the
/// midline.
Spot flattest(const Wall& wall, double width_mm, double height_mm, double front_mm) {
  const int half = static_cast<int>(std::ceil((0.5 * height_mm + kTextMarginMm) / kStepZMm));
  std::vector<double> slope(static_cast<std::size_t>(wall.columns()) * static_cast<std::size_t>(wall.rows()));
  const auto at = [&](int c, int r) -> double& {
    return slope[static_cast<std::size_t>(c) * static_cast<std::size_t>(wall.rows()) +
                 static_cast<std::size_t>(r)];
  };
  for (int c = 0; c < wall.columns(); ++c)
    for (int r = 0; r < wall.rows(); ++r) at(c, r) = wall.slope2(c, r);
  Spot best;
  for (int r = half; r + half < wall.rows(); ++r)
    for (int first = 0; first < wall.columns(); ++first) {
      double length = 0.0, sum = 0.0;
      int count = 0, last = first;
      for (; last < wall.columns() && length < width_mm + 2.0 * kTextMarginMm; ++last) {
        for (int k = r - half; k <= r + half; ++k) {
          sum += at(last, k);
          ++count;
        }
        if (std::isnan(sum)) break;
        if (std::abs(wall.s_mm(last)) < front_mm) break;
        if (last > first) length += (wall.place(last, r) - wall.place(last - 1, r)).norm();
      }
      if (std::isnan(sum) || length < width_mm + 2.0 * kTextMarginMm || sum / count >= best.slope2) continue;
      best = {first, last - 1, r, sum / count};
    }
  return best;
}

/// How far the wall under the text stands out from the baseline or back from it.
double leaning_mm(const Wall& wall, const Spot& spot, double height_mm) {
  const int half = static_cast<int>(std::ceil((0.5 * height_mm + kTextMarginMm) / kStepZMm));
  double most = 0.0;
  for (int c = spot.first; c <= spot.last; ++c)
    for (int r = spot.row - half; r <= spot.row + half; ++r)
      most = std::max(most, (wall.place(c, r) - wall.place(c, spot.row)).head<2>().norm());
  return most;
}

}  // namespace

std::vector<std::string> label_texts(const SplintInputs& inputs, const SplintParameters& parameters) {
  if (inputs.edits.label.empty()) return {};
  std::string hash = sha256_hex(parameters_json(parameters).dump() + edits_json(inputs.edits).dump() +
                                matrix_json(inputs.therapeutic.rigid.matrix()).dump())
                         .substr(0, 6);
  for (char& c : hash)
    if (c >= 'a') c = static_cast<char>(c - 'a' + 'A');
  return {inputs.edits.label + " " + hash, inputs.edits.label};
}

std::optional<Label> Label::placed(const std::string& text, const Preparation& preparation,
                                   const SplintParameters& parameters, const LabelSurroundings& around) {
  const Wall walls[2] = {Wall(true, preparation, parameters, around),
                         Wall(false, preparation, parameters, around)};
  for (const auto& [front_mm, height] : kTries) {
    const auto glyphs = std::make_shared<const LabelText>(text, height);
    const Spot spots[2] = {flattest(walls[0], glyphs->width_mm(), height, front_mm),
                           flattest(walls[1], glyphs->width_mm(), height, front_mm)};
    const int side = spots[0].slope2 <= spots[1].slope2 ? 0 : 1;
    const Spot& spot = spots[side];
    if (spot.last < spot.first) continue;
    Label label;
    label.text_ = text;
    label.glyphs_ = glyphs;
    label.buccal_ = side == 0;
    // Upright as the patient stands; z of the design frame leads to the gingiva.
    label.up_ = (preparation.design_from_dental.rotation * preparation.arch.up).z() > 0.0 ? 1.0 : -1.0;
    for (int c = spot.first; c <= spot.last; ++c) label.baseline_.push_back(walls[side].place(c, spot.row));
    label.reach_mm_ = kWallDepthMm + leaning_mm(walls[side], spot, height);
    // From outside the text runs to the patient's left, from the palate to the right.
    if (!label.buccal_) std::reverse(label.baseline_.begin(), label.baseline_.end());
    double length = 0.0;
    for (std::size_t i = 0; i < label.baseline_.size(); ++i) {
      if (i > 0) length += (label.baseline_[i] - label.baseline_[i - 1]).norm();
      label.along_mm_.push_back(length);
    }
    const double start = 0.5 * (length - glyphs->width_mm());
    for (double& along : label.along_mm_) along -= start;
    for (const Vector3& p : label.baseline_) label.box_.extend(p);
    label.box_.min_mm -= Vector3::Constant(0.5 * height + 1.5);
    label.box_.max_mm += Vector3::Constant(0.5 * height + 1.5);
    label.centre_mm_ = label.baseline_[label.baseline_.size() / 2];
    return label;
  }
  return std::nullopt;
}

double Label::raised_mm(const Vector3& p, double body_mm, double opposing_mm) const {
  if (body_mm < -0.5 || body_mm > kProudMm + 1.0) return body_mm;  // inside, or far: no letter comes near
  if ((p.array() < box_.min_mm.array()).any() || (p.array() > box_.max_mm.array()).any()) return body_mm;
  double least = 1e300, along = 0.0, height = 0.0;
  for (std::size_t i = 0; i + 1 < baseline_.size(); ++i) {
    const Eigen::Vector2d a = baseline_[i].head<2>(), step = (baseline_[i + 1] - baseline_[i]).head<2>();
    const double t = std::clamp((p.head<2>() - a).dot(step) / std::max(1e-12, step.squaredNorm()), 0.0, 1.0);
    const double d = (p.head<2>() - a - t * step).squaredNorm();
    if (d >= least) continue;
    least = d;
    along = along_mm_[i] + t * (along_mm_[i + 1] - along_mm_[i]);
    height = baseline_[i].z() + t * (baseline_[i + 1].z() - baseline_[i].z());
  }
  if (least > reach_mm_ * reach_mm_) return body_mm;  // another wall
  const double letters = glyphs_->distance_mm(along, up_ * (p.z() - height) + 0.5 * glyphs_->height_mm());
  return std::min(body_mm, std::max({letters, body_mm - kProudMm, kClearMm - opposing_mm}));
}

}  // namespace gnathion
