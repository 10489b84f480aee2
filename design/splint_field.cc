#include "design/splint_field.h"

#include <algorithm>
#include <cmath>

#include <tbb/parallel_invoke.h>

#include "design/blockout.h"
#include "design/distances.h"
#include "design/extraction.h"
#include "design/freedom.h"
#include "design/parallel.h"
#include "design/shells.h"
#include "design/solid_distance.h"
#include "design/stamp.h"

namespace gnathion {
namespace {

constexpr double kBandMm = 2.4;      // of coarse distances: wall, occlusal thickness and a margin
constexpr double kEstimateMm = 0.3;  // estimates are never worse than this
constexpr double kReachMm = 1.5;     // of exact queries; farther distances do not matter
constexpr double kSweepStartMm =
    0.6;  // the coarse sweep of the opposing arch leaves its own surface to exact distances
constexpr double kSweepErrorMm = 0.05;
constexpr double kUprightSlope = 0.004;  // 0.02 mm over the deepest imprint
constexpr double kStampNearMm = 0.6;     // up to here from the opposing arch the stamp is exact ...
constexpr double kStampFade = 0.3;       // ... and sinks into the smooth body beyond it
constexpr double kStampTopFade = 0.8;    // likewise over the last kStampTopMm below the stamp's height
constexpr double kStampTopMm = 1.0;
constexpr double kTipGapVoxels = 0.5;       // room at tips of the support that are narrower than the grid
constexpr double kImprintTipVoxels = 0.25;  // the same at tips of the opposing arch
constexpr double kFreeErrorMm = 0.03;       // the coarse sweep leaves contacts in TP to exact distances
constexpr double kBlurMm = 0.8;             // of smoothing strokes, standard deviation
constexpr double kTipRoomMm = 0.1;          // on the way onto the arch, at the support's sharp tips
constexpr double kShadowMm = 0.03;          // less between solid and sweep: no undercut here
constexpr double kDistalMm = 0.8;
constexpr double kSolidError = 0.15;  // of the coarse spacing: what counts as material over an imprint
constexpr double kWallErrorMm = 0.1;  // of the coarse cavity, a wall away from it
constexpr double kFilmMarginMm = 0.02;
constexpr double kFilmMarginVoxels = 0.5;  // what triangles may take from the thinnest wall
constexpr double kFullGapDeg = 60.0;       // from the stop angle to here the gap grows from h to g

double smoothstep(double t) {
  t = std::clamp(t, 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

double sharpness_at(const TriangleMesh& mesh, const std::vector<double>& sharpness,
                    const ClosestPoint& closest) {
  double sum = 0.0;
  for (std::size_t k = 0; k < 3; ++k)
    sum += closest.barycentric[static_cast<int>(k)] * sharpness[mesh.triangles[closest.triangle][k]];
  return sum;
}

/// max(a, b) whose edge is rounded with `radius`: never less than max(a, b).
double rounded_max(double a, double b, double radius) {
  if (a < -radius || b < -radius) return std::max(a, b);
  return std::hypot(a + radius, b + radius) - radius;
}

/// Moves a grid along z by whole nodes: result(z) = f(z + steps·spacing).
CoarseGrid looked_up(const CoarseGrid& f, int steps) {
  CoarseGrid out = f;
  const int last = f.shape().nodes.z() - 1;
  parallel_each(f.shape().nodes.x(), [&](int i) {
    for (int j = 0; j < f.shape().nodes.y(); ++j)
      for (int k = 0; k <= last; ++k) out.at(i, j, k) = f.at(i, j, std::min(last, k + steps));
  });
  return out;
}

}  // namespace

struct SplintField::Ingredients {
  double support = 0.0;  // φ_M
  double gap = 0.0;      // g at the closest point
  double support_swept = 0.0;
  double cavity_closed = 0.0;
  double stamp = 0.0;     // φ of T_th M
  double opposing = 0.0;  // φ of L_TP
  double opposing_swept = 0.0;
  double body = 0.0;
  double body_smoothed = 0.0;
  double free = 1e9;  // distance from what must run free
};

namespace {

/// By node, the z from which swept_up() has its value.
CoarseGrid heights_of_sweep(const CoarseGrid& f) {
  CoarseGrid out = f;
  const GridShape& shape = f.shape();
  for (int i = 0; i < shape.nodes.x(); ++i)
    for (int j = 0; j < shape.nodes.y(); ++j) {
      const float* value = f.column(i, j);
      float* height = out.column(i, j);
      int least = 0;
      for (int k = 0; k < shape.nodes.z(); ++k) {
        if (value[k] < value[least]) least = k;
        height[k] = static_cast<float>(shape.position(i, j, least).z());
      }
    }
  return out;
}

void sample_support(const Preparation& prep, JawDistances& jaws) {
  jaws.support = sampled_distance(prep.coarse, prep.support, {}, kBandMm, OutsideEnd::kBottom);
  jaws.support_swept = swept_up(jaws.support);
  jaws.swept_from = heights_of_sweep(jaws.support);
}

void sample_stamp(const Preparation& prep, JawDistances& jaws) {
  jaws.stamp = sampled_distance(prep.coarse, prep.stamp_source(), prep.tp_from_mi.inverse(), kBandMm,
                                OutsideEnd::kBottom);
}

void sample_opposing(const Preparation& prep, JawDistances& jaws) {
  jaws.opposing = sampled_distance(prep.coarse, prep.opposing, {}, kBandMm, OutsideEnd::kTop);
  const int steps = std::max(1, static_cast<int>(std::lround(kSweepStartMm / prep.coarse.spacing_mm)));
  // Down the opening path, which the seating direction may be tilted against: columns along it.
  const Vector3 up = opening_axes(prep).col(2);
  const double x = up.x() / up.z(), y = up.y() / up.z();
  jaws.opposing_swept =
      std::hypot(x, y) < kUprightSlope
          ? looked_up(swept_down(jaws.opposing), steps)
          : sheared(
                looked_up(swept_down(sheared(jaws.opposing, x, y, sheared_box(prep.coarse, x, y))), steps),
                -x, -y, prep.coarse);
}

}  // namespace

JawDistances sampled_jaws(const Preparation& prep) {
  JawDistances jaws;
  tbb::parallel_invoke([&] { sample_support(prep, jaws); }, [&] { sample_stamp(prep, jaws); },
                       [&] { sample_opposing(prep, jaws); });
  return jaws;
}

JawDistances resampled_opposing(const Preparation& prep, JawDistances last) {
  tbb::parallel_invoke([&] { sample_stamp(prep, last); }, [&] { sample_opposing(prep, last); });
  return last;
}

SplintField::SplintField(const Preparation& preparation, const SplintParameters& parameters,
                         JawDistances jaws)
    : prep_(preparation),
      par_(parameters),
      natural_from_tp_(preparation.tp_from_mi.inverse()),
      jaws_(std::move(jaws)) {
  build_shapes();
  place_label();
}

namespace {

/// The flat plane in S_occ's place.
CoarseGrid sampled_slab(const Preparation& prep) {
  CoarseGrid out(prep.coarse, 0.0f);
  parallel_each(prep.coarse.nodes.x(), [&](int i) {
    for (int j = 0; j < prep.coarse.nodes.y(); ++j)
      for (int k = 0; k < prep.coarse.nodes.z(); ++k)
        out.at(i, j, k) = static_cast<float>(prep.flat->slab_mm(prep.coarse.position(i, j, k)));
  });
  return out;
}

}  // namespace

void SplintField::build_shapes() {
  if (prep_.flat) jaws_.stamp = sampled_slab(prep_);
  tbb::parallel_invoke(
      [&] {
        cavity_closed_ = without_embrasures(coarse_cavity(jaws_.support, jaws_.support_swept, par_), par_);
      },
      [&] {
        const CoarseGrid outline = distance_from_rim_outline(jaws_.support_swept, prep_, par_);
        const CoarseGrid shell = outer_shell(jaws_.support_swept, outline, par_);
        const CoarseGrid stamp = stamp_body(jaws_.stamp, shell, prep_, par_);
        body_ = joined_body(shell, stamp, jaws_.opposing, par_);
        if (prep_.edits.smooths()) body_smoothed_ = blurred(body_, kBlurMm);
        if (!prep_.free_poses.empty())
          free_ = swept_along(prep_.free_poses, par_.disclusion_mm, prep_.opposing, body_);
      });
  const double near_mm = kSolidError * prep_.coarse.spacing_mm;
  const auto solid = [&](const Vector3& p) { return estimate(p).value <= near_mm; };  // without the limit yet
  if (!prep_.flat) limit_ = ImprintLimit(prep_, par_.imprint_depth_mm, solid);
}

void SplintField::place_label() {
  const LabelSurroundings around{[&](const Vector3& p) { return estimate(p).body; },
                                 [&](const Vector3& p) {
                                   const Ingredients in = interpolated(p);
                                   return std::min({in.opposing, in.opposing_swept, in.free});
                                 }};
  for (const std::string& text : prep_.label_texts)
    if (!label_) label_ = Label::placed(text, prep_, par_, around);
}

bool SplintField::near_jaw(const Vector3& p, double distance_mm) const {
  const GridCell cell = located(prep_.coarse, p);
  return std::min(jaws_.support.linear(cell), jaws_.opposing.linear(cell)) < distance_mm + kEstimateMm;
}

double SplintField::seat_gap_mm(const ClosestPoint& closest) const {
  const Triangle& t = prep_.support.mesh().triangles[closest.triangle];
  Vector3 normal = Vector3::Zero();
  for (std::size_t k = 0; k < 3; ++k)
    normal += closest.barycentric[static_cast<int>(k)] * prep_.support_normals[t[k]];
  const double sharp = sharpness_at(prep_.support.mesh(), prep_.support_sharpness, closest);
  const double cosine = normal.norm() > 1e-9 ? -normal.normalized().z() : 0.0;
  const double stop = std::cos(par_.stop_angle_deg * M_PI / 180.0);
  const double full = std::cos(std::max(kFullGapDeg, par_.stop_angle_deg + 10.0) * M_PI / 180.0);
  // Tips narrower than the grid get room, or the triangles would cut them off.
  return kTipGapVoxels * par_.voxel_mm * sharp + par_.gap_mm +
         (par_.stop_gap_mm - par_.gap_mm) * smoothstep((cosine - full) / (stop - full));
}

SplintField::Ingredients SplintField::interpolated(const Vector3& p) const {
  return interpolated(p, located(prep_.coarse, p));
}

SplintField::Ingredients SplintField::interpolated(const Vector3& p, const GridCell& cell) const {
  Ingredients in;
  in.support = jaws_.support.linear(cell);
  in.gap = 0.5 * (par_.gap_mm + par_.stop_gap_mm);
  in.support_swept = jaws_.support_swept.linear(cell);
  in.cavity_closed = cavity_closed_.linear(cell);
  in.stamp = prep_.flat ? prep_.flat->slab_mm(p) : jaws_.stamp.linear(cell);
  in.opposing = jaws_.opposing.linear(cell);
  in.opposing_swept = jaws_.opposing_swept.linear(cell);
  in.body = body_.linear(cell);
  if (prep_.edits.smooths()) in.body_smoothed = body_smoothed_.linear(cell);
  if (!prep_.free_poses.empty()) in.free = free_.linear(cell);
  return in;
}

/// Cavity = (M ⊕ B_g) ∪ ((M ⊕ R_a) ⊖ D_r), embrasures closed.
double SplintField::cavity(const Ingredients& in) const {
  return std::min({in.support - in.gap, in.support_swept + par_.engagement_mm, in.cavity_closed});
}

/// What the opposing arch takes: itself and its way down; within o of it all but the natural relief T_th
/// S_occ; and what must run free.
double SplintField::cut(const Vector3& p, const Ingredients& in) const {
  const double opposing = std::min(in.opposing, in.opposing_swept + kSweepErrorMm);
  const double relief = std::max(opposing - par_.occlusion_clearance_mm, -in.stamp);
  const double all = std::min({opposing, relief, in.free + kFreeErrorMm});
  if (!prep_.edits.limits_contacts()) return all;
  return std::min(all, opposing - par_.occlusion_clearance_mm * prep_.edits.without_contact(p));
}

/// The exact stamp near the opposing arch, sinking into the smooth body away from it.
double SplintField::stamp(const Vector3& p, const Ingredients& in) const {
  if (prep_.flat) return in.stamp;
  if (in.stamp >= in.body + kEstimateMm) return in.stamp;  // within the body, wherever it fades
  double top = -kStampTopMm;
  if (!prep_.given_stamp) {
    const Vector3 natural = natural_from_tp_ * p;
    top = natural.z() - prep_.level.level_mm(natural) - par_.stamp_height_mm;
  }
  return in.stamp + kStampFade * std::max(0.0, in.opposing - kStampNearMm) +
         kStampTopFade * std::max(0.0, top + kStampTopMm);
}

/// Shell with stamp, strokes and letters.
double SplintField::body(const Vector3& p, const Ingredients& in, double cavity_mm, double stamp_mm) const {
  double out = std::min(in.body, stamp_mm), smoothed = in.body_smoothed;
  const double wall = cavity_mm - par_.wall_mm - kWallErrorMm;
  // Nothing but the wall over the cavity stands beyond a flat plane and its ramps, or what strokes add there.
  if (prep_.flat) {
    const double beyond = std::min(prep_.flat->beyond_mm(p), wall);
    out = std::max(out, beyond);
    smoothed = std::max(smoothed, beyond);
  }
  if (prep_.edits.has_strokes()) out = prep_.edits.stroked(p, out, smoothed);
  // Beside the imprint nothing stands lower than d beyond the natural relief, but for the wall over the
  // cavity.
  const double may_go = std::min(wall, in.stamp);
  if (may_go > out && !limit_.empty()) out = std::max(out, std::min(limit_.below_mm(p), may_go));
  return label_ ? label_->raised_mm(p, out, std::min({in.opposing, in.opposing_swept, in.free})) : out;
}

/// The cutting surface, and the end behind the last teeth: their distal wall and no more.
double SplintField::rim(const Vector3& p) const {
  const double behind = prep_.level.behind_teeth_mm(p) - (par_.gap_mm + par_.wall_mm + kDistalMm);
  return std::max({p.z() - prep_.cut_mm(p, par_.depth_mm), behind, prep_.level.beyond_cover_mm(p)});
}

/// Positive where less than the aperture limit remains between cavity and cut.
double SplintField::film(double cavity_mm, double cut_mm) const {
  return par_.aperture_limit_mm + kFilmMarginMm + kFilmMarginVoxels * par_.voxel_mm - cavity_mm - cut_mm;
}

bool SplintField::by_stamp(const Ingredients& in, double stamp_mm) const {
  return stamp_mm < in.body + kEstimateMm && in.opposing < kStampNearMm + 1.0;
}

FieldTerms SplintField::compose(const Vector3& p, const Ingredients& in) const {
  FieldTerms f;
  f.cavity = cavity(in);
  f.cut = cut(p, in);
  const double stamped = stamp(p, in);
  f.body = body(p, in, f.cavity, stamped);
  f.body_by_stamp = by_stamp(in, stamped);
  f.rim = rim(p);
  const double thin = film(f.cavity, f.cut);
  const double walls = rounded_max(f.body, f.rim, par_.rim_radius_mm);
  const double inner = rounded_max(-f.cavity, f.rim, 0.5 * par_.rim_radius_mm);
  const double drawn = prep_.edits.has_cutouts() ? -prep_.edits.cutout_mm(p) : -1e9;
  f.value = std::max({walls, inner, -f.cut, thin, drawn});
  if (f.value == thin || f.value == drawn)
    f.part = SurfacePart::kAperture;
  else if (f.value == -f.cut)
    f.part = f.cut == in.free + kFreeErrorMm ? SurfacePart::kRelief : SurfacePart::kImprint;
  else if (f.value == inner)
    f.part = f.rim > -0.5 * par_.rim_radius_mm ? SurfacePart::kRim : SurfacePart::kCavity;
  else if (f.rim > -par_.rim_radius_mm)
    f.part = SurfacePart::kRim;
  else
    f.part = stamped < in.body ? SurfacePart::kStamp : SurfacePart::kOuter;
  return f;
}

FieldTerms SplintField::estimate(const Vector3& p) const {
  return compose(p, interpolated(p));
}

/// Whether no point of a coarse cell is in the splint, nor within kSureMm of it, by the least and greatest of
/// its corners: trilinear values lie between them.
bool SplintField::all_outside(const GridCell& cell) const {
  const double sure = kSureMm + 0.01;
  const auto within = [&](const CoarseGrid& solid, double by_mm) {
    return solid.range(cell).second < -by_mm;
  };
  if (within(jaws_.support, sure - std::min(par_.gap_mm, par_.stop_gap_mm))) return true;
  if (within(cavity_closed_, sure) || within(jaws_.opposing, sure)) return true;
  if (prep_.edits.has_strokes() || prep_.flat) return false;
  const double beyond = sure + Label::kProudMm;
  return body_.range(cell).first > beyond && jaws_.stamp.range(cell).first > beyond;
}

void SplintField::estimate_cell(const Eigen::Vector3i& cell, int k, float* values) const {
  GridCell at;
  at.index = cell;
  const std::size_t count =
      static_cast<std::size_t>(k) * static_cast<std::size_t>(k) * static_cast<std::size_t>(k);
  if (all_outside(at)) {
    std::fill(values, values + count, static_cast<float>(2.0 * kSureMm));
    return;
  }
  const Vector3 low = prep_.coarse.position(cell.x(), cell.y(), cell.z());
  for (int x = 0; x < k; ++x)
    for (int y = 0; y < k; ++y)
      for (int z = 0; z < k; ++z) {
        at.fraction = Vector3(x, y, z) / k;
        const Vector3 p = low + prep_.coarse.spacing_mm * at.fraction;
        *values++ = static_cast<float>(compose(p, interpolated(p, at)).value);
      }
}

/// The points of a block that need a distance, and where each stands in the block.
struct SplintField::Questions {
  struct Asked {
    std::vector<SolidGroup::Point> points;
    std::vector<std::size_t> index;
    void add(const Vector3& p_mm, double estimate_mm, std::size_t i) {
      points.push_back({p_mm, std::min(kReachMm, std::abs(estimate_mm) + kEstimateMm), false, {}});
      index.push_back(i);
    }
    template <class Body>
    void measure(const MeshQuery& solid, const Body& take) {
      if (points.empty()) return;
      SolidGroup(solid).measure(points);
      for (std::size_t n = 0; n < points.size(); ++n)
        if (points[n].found) take(index[n], points[n].distance);
    }
  };
  Asked support, opposing, stamp, sweep;
};

/// Below p, where the columns around it say that M bulges most, in an undercut whose depth is near r.
void SplintField::ask_passed(const Vector3& p, const Ingredients& in, std::size_t i,
                             Questions& questions) const {
  const double swept_mm = in.support_swept;
  if (swept_mm > in.support - kShadowMm || std::abs(swept_mm + par_.engagement_mm) > kEstimateMm) return;
  const GridCell cell = located(prep_.coarse, p);
  const double spacing = prep_.coarse.spacing_mm;
  double before = 1e9;
  for (int corner = 0; corner < 4; ++corner) {
    const double z = jaws_.swept_from.at(cell.index.x() + (corner & 1), cell.index.y() + (corner >> 1),
                                         cell.index.z() + (cell.fraction.z() > 0.5 ? 1 : 0));
    if (std::abs(z - before) < 0.5 * spacing) continue;
    before = z;
    for (const double off : {-0.75, -0.25, 0.25, 0.75})
      questions.sweep.add({p.x(), p.y(), std::min(z + off * spacing, p.z())}, swept_mm, i);
  }
}

/// Asks for the terms that may decide at p.
void SplintField::ask(const Vector3& p, const Ingredients& in, std::size_t i, Questions& questions) const {
  const double cavity_mm = cavity(in), cut_mm = cut(p, in);
  const double film_mm = cavity_mm + cut_mm - par_.aperture_limit_mm;
  const bool thin =
      std::abs(film_mm) < kEstimateMm || (film_mm < 0.0 && std::abs(compose(p, in).value) < kEstimateMm);
  if (std::abs(cavity_mm) < kEstimateMm || thin) {
    questions.support.add(p, in.support, i);
    ask_passed(p, in, i, questions);
  }
  if (std::abs(cut_mm) < kEstimateMm || thin || by_stamp(in, stamp(p, in))) {
    questions.opposing.add(p, in.opposing, i);
    if (!prep_.flat) questions.stamp.add(natural_from_tp_ * p, in.stamp, i);
  }
}

/// Puts the answers in place of the estimates.
void SplintField::answer(Questions& questions, std::vector<Ingredients>& in) const {
  questions.support.measure(prep_.support, [&](std::size_t i, const SignedDistance& d) {
    in[i].support = d.distance_mm;
    in[i].gap = seat_gap_mm(d.closest);
  });
  // What a rigid splint passes on its way is the least distance below: exact, since r is thinner than the
  // coarse grid's error.
  std::vector<double> passed(questions.sweep.points.empty() ? 0 : in.size(), 1e9);
  questions.sweep.measure(prep_.support, [&](std::size_t i, const SignedDistance& d) {
    // A tip that is thinner than r would pass by that rule, and yet stand in the splint's way.
    const double tip_mm = (par_.engagement_mm + kTipRoomMm) *
                          sharpness_at(prep_.support.mesh(), prep_.support_sharpness, d.closest);
    passed[i] = std::min(passed[i], d.distance_mm - tip_mm);
    in[i].support_swept = passed[i];
  });
  questions.opposing.measure(prep_.opposing, [&](std::size_t i, const SignedDistance& d) {
    in[i].opposing =
        d.distance_mm - kImprintTipVoxels * par_.voxel_mm *
                            sharpness_at(prep_.opposing.mesh(), prep_.opposing_sharpness, d.closest);
  });
  questions.stamp.measure(prep_.stamp_source(),
                          [&](std::size_t i, const SignedDistance& d) { in[i].stamp = d.distance_mm; });
}

void SplintField::exact(const std::vector<Vector3>& points, std::vector<double>& values) const {
  std::vector<Ingredients> in(points.size());
  Questions questions;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const GridCell cell = located(prep_.coarse, points[i]);
    in[i] = interpolated(points[i], cell);
    in[i].body = body_.smooth(cell);
    ask(points[i], in[i], i, questions);
  }
  answer(questions, in);
  for (std::size_t i = 0; i < points.size(); ++i) values[i] = compose(points[i], in[i]).value;
}

TriangleMesh extracted_splint(const SplintField& field) {
  ExtractionField f;
  f.estimate = [&](const Vector3& p) { return field.estimate(p).value; };
  f.estimate_cell = [&](const Eigen::Vector3i& cell, int k, float* values) {
    field.estimate_cell(cell, k, values);
  };
  f.exact = [&](const std::vector<Vector3>& p, std::vector<double>& values) { field.exact(p, values); };
  return extracted_surface(f, field.preparation().coarse, field.preparation().refinement);
}

}  // namespace gnathion
