#include "calibration/bow_geometry.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include "calibration/bow_checks.h"
#include "core/angle.h"

namespace gnathion {
namespace {

constexpr double kMedianChi2 = 7.344;  // of eight squared normal residuals
constexpr double kOutlierChi2 = 40;    // P = 3e-6
constexpr double kHuber = 5;           // of eight whitened residuals: 25 has P = 0.0016
constexpr std::size_t kHeldOutEvery = 5;
constexpr double kFreeScaleSigma = 0.05;   // what the images alone may say about the scale
constexpr double kBaselineSigma = 0.0005;  // of the distance between calibrated cameras
constexpr double kFocalChange = 1e-3;

/// The film sorted out: tags of the body by index, views with a pose.
struct Film {
  TaggedBody nominal;  ///< tags that the film determines, in the nominal order
  std::vector<BodyView> views;
  std::vector<LayoutObservation> observations;
  std::vector<Rigid3> poses;
  std::vector<bool> held_out;
};

std::vector<LayoutObservation> observations_of(const BodyView& view, int index,
                                               const std::map<int, int>& tag_of) {
  std::vector<LayoutObservation> out;
  for (std::size_t c = 0; c < view.tags.size(); ++c) {
    std::map<int, int> count;
    for (const SeenTag& tag : view.tags[c]) ++count[tag.id];
    for (const SeenTag& tag : view.tags[c]) {
      const auto found = tag_of.find(tag.id);
      if (found == tag_of.end() || count[tag.id] > 1) continue;  // a chance double: neither is believed
      LayoutObservation o;
      o.view = index;
      o.camera = static_cast<int>(c);
      o.tag = found->second;
      for (int k = 0; k < 4; ++k)
        o.corners_px.segment<2>(2 * k) = tag.corners_px[static_cast<std::size_t>(k)];
      const Eigen::LLT<Eigen::Matrix<double, 8, 8>> llt(tag.covariance_px2);
      if (llt.info() != Eigen::Success || !o.corners_px.allFinite()) continue;
      o.whitening = llt.matrixL().solve(Eigen::Matrix<double, 8, 8>::Identity());
      out.push_back(o);
    }
  }
  return out;
}

/// Tags seen too seldom, or never together with the others, go; then views with fewer than two tags.
TaggedBody determined_tags(const TaggedBody& nominal, const std::vector<BodyView>& views, int least_views,
                           std::vector<LeftOutTag>& left_out) {
  std::map<int, int> seen;
  std::map<int, std::map<int, int>> together;
  for (const BodyView& view : views) {
    if (!view.rig_from_body) continue;
    std::set<int> ids;
    for (const auto& tags : view.tags)
      for (const SeenTag& tag : tags) ids.insert(tag.id);
    if (ids.size() < 2) continue;
    for (const int a : ids) {
      ++seen[a];
      for (const int b : ids) ++together[a][b];
    }
  }
  TaggedBody frequent = nominal, out = nominal;
  frequent.tags.clear();
  out.tags.clear();
  for (const BodyTag& tag : nominal.tags) {
    if (seen[tag.id] >= least_views)
      frequent.tags.push_back(tag);
    else
      left_out.push_back({tag.id, seen[tag.id] == 0
                                      ? std::string("never seen together with another tag")
                                      : fmt::format("seen too seldom: in {} views, {} are needed",
                                                    seen[tag.id], least_views)});
  }
  // Groups of tags that are linked by views; the largest stays.
  std::vector<int> group(frequent.tags.size());
  std::iota(group.begin(), group.end(), 0);
  for (std::size_t i = 0; i < group.size(); ++i)
    for (std::size_t k = 0; k < i; ++k)
      if (together[frequent.tags[i].id][frequent.tags[k].id] >= 3) {
        const int from = group[i], to = group[k];
        std::replace(group.begin(), group.end(), from, to);
      }
  std::map<int, int> members;
  for (const int g : group) ++members[g];
  int largest = -1;
  for (const auto& [g, n] : members)
    if (largest < 0 || n > members[largest]) largest = g;
  for (std::size_t i = 0; i < group.size(); ++i) {
    if (group[i] == largest)
      out.tags.push_back(frequent.tags[i]);
    else
      left_out.push_back({frequent.tags[i].id, "never seen together with the other tags"});
  }
  return out;
}

Result<Film> sorted_film(const std::vector<RigCamera>& cameras, const TaggedBody& nominal,
                         const std::vector<BodyView>& views, const BowGeometryOptions& options,
                         std::vector<LeftOutTag>& left_out) {
  Film film;
  film.nominal = determined_tags(nominal, views, options.least_views, left_out);
  const auto with_pose =
      std::count_if(views.begin(), views.end(), [](const BodyView& v) { return v.rig_from_body; });
  if (film.nominal.tags.size() < 3)
    return bad_input(kBowWhat, nominal.name,
                     fmt::format("{} tags are seen often enough, 3 are needed; {} of {} views have a pose",
                                 film.nominal.tags.size(), with_pose, views.size()));
  std::map<int, int> tag_of;
  for (std::size_t t = 0; t < film.nominal.tags.size(); ++t)
    tag_of[film.nominal.tags[t].id] = static_cast<int>(t);
  std::vector<const BodyView*> usable;
  for (const BodyView& view : views) {
    if (!view.rig_from_body) continue;
    std::set<int> tags;
    for (const LayoutObservation& o : observations_of(view, 0, tag_of)) tags.insert(o.tag);
    if (tags.size() >= 2) usable.push_back(&view);
  }
  const std::size_t most = options.most_views * kHeldOutEvery / (kHeldOutEvery - 1);
  const std::size_t count = std::min(most, usable.size());
  const TagLayout start = layout_of(film.nominal);
  for (std::size_t i = 0; i < count; ++i) {
    const BodyView& view = *usable[i * usable.size() / count];
    const int index = static_cast<int>(film.views.size());
    const auto seen = observations_of(view, index, tag_of);
    std::vector<const LayoutObservation*> all;
    for (const LayoutObservation& o : seen) all.push_back(&o);
    const auto pose = fit_view(cameras, start, all, *view.rig_from_body);
    if (!pose) continue;
    film.poses.push_back(*pose);
    film.views.push_back(view);
    film.held_out.push_back(i % kHeldOutEvery == kHeldOutEvery - 1);
    film.observations.insert(film.observations.end(), seen.begin(), seen.end());
  }
  if (film.views.size() < 10)
    return bad_input(
        kBowWhat, nominal.name,
        fmt::format("{} views with two tags or more and a pose, 10 are needed", film.views.size()));
  return film;
}

double chi2_of(const std::vector<RigCamera>& cameras, const LayoutObservation& o, const LayoutState& state) {
  ObservationTerms terms;
  if (!evaluate_observation(cameras[static_cast<std::size_t>(o.camera)], o, state.layout,
                            state.rig_from_body[static_cast<std::size_t>(o.view)], terms))
    return std::numeric_limits<double>::infinity();
  return terms.residual.squaredNorm();
}

/// Adjusts, rejects tags at odds with the rest, adjusts again; returns the scale of the residuals (1: as the
/// detector says), at least 1 where it is used for rejection.
Status adjust_robustly(const std::vector<RigCamera>& cameras, std::vector<LayoutObservation>& observations,
                       const LayoutPrior& prior, LayoutState& state) {
  double huber = 30;  // printed tags are some tenths off their nominal places: the start is rough
  for (int round = 0; round < 3; ++round) {
    GNATHION_CHECK_OK(adjust_layout(cameras, observations, prior, huber, state));
    std::vector<double> chi2;
    for (const LayoutObservation& o : observations) chi2.push_back(chi2_of(cameras, o, state));
    std::vector<double> sorted = chi2;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                     sorted.end());
    const double scale2 = std::max(1.0, sorted[sorted.size() / 2] / kMedianChi2);
    for (std::size_t i = 0; i < observations.size(); ++i)
      observations[i].used = chi2[i] < kOutlierChi2 * scale2;
    huber = kHuber * std::sqrt(scale2);
  }
  return adjust_layout(cameras, observations, prior, huber, state);
}

std::vector<Vector3> corners_of(const TaggedBody& body) {
  std::vector<Vector3> out;
  for (const BodyTag& tag : body.tags)
    out.insert(out.end(), tag.corners_in_body_mm.begin(), tag.corners_in_body_mm.end());
  return out;
}

std::vector<Vector3> corners_of(const TagLayout& layout) {
  std::vector<Vector3> out;
  for (std::size_t t = 0; t < layout.tags.size(); ++t)
    for (std::size_t k = 0; k < 4; ++k) out.push_back(layout.corner(t, k));
  return out;
}

/// The body's frame is where the best rigid fit of the corners to the nominal ones is the identity.
void put_on_nominal(const TaggedBody& nominal, LayoutState& state) {
  const Rigid3 fit = best_rigid_fit(corners_of(state.layout), corners_of(nominal));
  for (LayoutTag& tag : state.layout.tags) tag.body_from_tag = fit * tag.body_from_tag;
  for (Rigid3& pose : state.rig_from_body) pose = pose * fit.inverse();
}

void fill_residuals(const std::vector<RigCamera>& cameras, const std::vector<LayoutObservation>& observations,
                    const LayoutState& state, const Film& film, BowGeometry& out) {
  struct Sum {
    double squares = 0;
    int count = 0;
    double rms() const { return count == 0 ? 0 : std::sqrt(squares / (8.0 * count)); }
  };
  std::vector<Sum> by_tag(state.layout.tags.size()), by_view(film.views.size());
  Sum all;
  double chi2 = 0;
  std::set<int> views;
  ObservationTerms terms;
  for (LayoutObservation o : observations) {
    const auto t = static_cast<std::size_t>(o.tag), v = static_cast<std::size_t>(o.view);
    if (!o.used) {
      ++out.tags[t].rejected;
      continue;
    }
    chi2 += chi2_of(cameras, o, state);
    o.whitening.setIdentity();
    const double squares = chi2_of(cameras, o, state);
    for (Sum* s : {&by_tag[t], &by_view[v], &all}) s->squares += squares, ++s->count;
    views.insert(o.view);
  }
  for (std::size_t t = 0; t < by_tag.size(); ++t) {
    out.tags[t].rms_px = by_tag[t].rms();
    out.tags[t].views = by_tag[t].count;
  }
  for (const int v : views)
    out.views.push_back({film.views[static_cast<std::size_t>(v)].name,
                         by_view[static_cast<std::size_t>(v)].rms(),
                         by_view[static_cast<std::size_t>(v)].count});
  out.rms_px = all.rms();
  const double dof = 8.0 * all.count - 6.0 * static_cast<double>(views.size()) -
                     8.0 * static_cast<double>(by_tag.size()) + 6;
  out.residual_scale = std::sqrt(chi2 / std::max(1.0, dof));
}

/// Each tag of a held-out view, predicted from the pose that the view's other tags give.
void fill_held_out(const std::vector<RigCamera>& cameras, const std::vector<LayoutObservation>& held,
                   const LayoutState& state, BowGeometry& out) {
  double squares = 0;
  ObservationTerms terms;
  for (const LayoutObservation& o : held) {
    std::vector<const LayoutObservation*> others;
    for (const LayoutObservation& p : held)
      if (p.view == o.view && p.tag != o.tag) others.push_back(&p);
    if (others.size() < 2) continue;
    const auto pose =
        fit_view(cameras, state.layout, others, state.rig_from_body[static_cast<std::size_t>(o.view)]);
    if (!pose) continue;
    LayoutObservation plain = o;
    plain.whitening.setIdentity();
    if (!evaluate_observation(cameras[static_cast<std::size_t>(o.camera)], plain, state.layout, *pose, terms))
      continue;
    squares += terms.residual.squaredNorm();
    ++out.held_out_tags;
  }
  if (out.held_out_tags > 0)
    out.held_out_px = std::sqrt(squares / (8.0 * static_cast<double>(out.held_out_tags)));
}

void fill_deviations(const TaggedBody& nominal, const TagLayout& layout, BowGeometry& out) {
  const TagLayout wanted = layout_of(nominal);
  Vector3 centre = Vector3::Zero();
  double squares = 0;
  const double n = static_cast<double>(layout.tags.size());
  for (const LayoutTag& tag : wanted.tags) centre += tag.body_from_tag.translation_mm / n;
  Matrix3 spread = Matrix3::Zero();
  for (std::size_t t = 0; t < layout.tags.size(); ++t) {
    const Rigid3 &is = layout.tags[t].body_from_tag, &was = wanted.tags[t].body_from_tag;
    out.tags[t].shift_mm = is.translation_mm - was.translation_mm;
    out.tags[t].turn_deg =
        Rigid3{is.rotation * was.rotation.transpose(), Vector3::Zero()}.angle_rad() * kDegPerRad;
    squares += out.tags[t].shift_mm.squaredNorm();
    const Vector3 arm = was.translation_mm - centre;
    spread += arm.squaredNorm() * Matrix3::Identity() - arm * arm.transpose();
  }
  // As a mean of n independent shifts, and as the turn that such shifts make.
  const double each = std::sqrt(squares / std::max(1.0, 3 * n - 6));
  out.datum_sigma_mm = each / std::sqrt(n);
  const double least = Eigen::SelfAdjointEigenSolver<Matrix3>(spread).eigenvalues()(0);
  out.datum_sigma_deg = each / std::sqrt(std::max(1.0, least)) * kDegPerRad;
}

void fill_covariance(const LayoutState& state, LayoutCovariance covariance, BowGeometry& out) {
  const double widen = std::pow(std::max(1.0, out.residual_scale), 2);
  // The scale's part comes from the witnesses, not from the residuals.
  covariance.total += (widen - 1) * covariance.shape;
  covariance.shape *= widen;
  for (std::size_t t = 0; t < out.tags.size(); ++t) {
    const auto at = static_cast<Eigen::Index>(12 * t);
    TagGeometry& g = out.tags[t];
    g.covariance_mm2 = covariance.total.block<12, 12>(at, at);
    for (int k = 0; k < 4; ++k) {
      const Eigen::SelfAdjointEigenSolver<Matrix3> own(g.covariance_mm2.block<3, 3>(3 * k, 3 * k));
      g.sigma_mm = std::max(g.sigma_mm, std::sqrt(own.eigenvalues()(2)));
      const Eigen::SelfAdjointEigenSolver<Matrix3> shape(
          Matrix3(covariance.shape.block<3, 3>(at + 3 * k, at + 3 * k)));
      out.shape_sigma_mm = std::max(out.shape_sigma_mm, std::sqrt(std::max(0.0, shape.eigenvalues()(2))));
      out.focal_sensitivity_mm =
          std::max(out.focal_sensitivity_mm,
                   kFocalChange * covariance.corner_by_focal_mm.segment<3>(at + 3 * k).norm());
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(covariance.shape, Eigen::EigenvaluesOnly);
  const Eigen::Index free = 8 * static_cast<Eigen::Index>(out.tags.size()) - 7;
  const double high = modes.eigenvalues()(modes.eigenvalues().size() - 1);
  const double low = modes.eigenvalues()(modes.eigenvalues().size() - free);
  out.condition = std::sqrt(high / std::max(low, 1e-300));
  out.scale_sigma = covariance.log_scale_sigma;
  out.weak = weak_directions(state.layout, covariance.shape, out.scale_sigma);
}

void fill_tags(const LayoutState& state, const TaggedBody& nominal, BowGeometry& out) {
  out.body = nominal;
  for (std::size_t t = 0; t < state.layout.tags.size(); ++t) {
    TagGeometry g;
    g.tag.id = state.layout.tags[t].id;
    for (std::size_t k = 0; k < 4; ++k) g.tag.corners_in_body_mm[k] = state.layout.corner(t, k);
    g.width_mm = (g.tag.corners_in_body_mm[1] - g.tag.corners_in_body_mm[0]).norm();
    g.height_mm = (g.tag.corners_in_body_mm[3] - g.tag.corners_in_body_mm[0]).norm();
    out.tags.push_back(g);
    out.body.tags[t] = g.tag;
  }
}

void add_warnings(const Film& film, BowGeometry& out) {
  for (const LeftOutTag& t : out.left_out)
    out.warnings.push_back(fmt::format("tag {} is left out: {}", t.id, t.reason));
  std::vector<double> rms;
  for (const TagGeometry& t : out.tags) rms.push_back(t.rms_px);
  std::nth_element(rms.begin(), rms.begin() + static_cast<std::ptrdiff_t>(rms.size() / 2), rms.end());
  for (const TagGeometry& t : out.tags) {
    if (t.rejected > 0.2 * (t.views + t.rejected))
      out.warnings.push_back(
          fmt::format("tag {} does not keep its place: {} of {} views reject it; is it loose or bent?",
                      t.tag.id, t.rejected, t.views + t.rejected));
    else if (t.rms_px > 4 * rms[rms.size() / 2] && t.rms_px > 0.1)
      out.warnings.push_back(
          fmt::format("tag {} fits worse than the others ({:.2f} px against {:.2f} px): is it flat?",
                      t.tag.id, t.rms_px, rms[rms.size() / 2]));
  }
  if (out.residual_scale > 2)
    out.warnings.push_back(
        fmt::format("residuals are {:.1f} times what the detector states: lens, focus or flatness; the "
                    "covariance is widened by it",
                    out.residual_scale));
  if (out.held_out_px > 2 * out.rms_px && out.held_out_px > 0.2)
    out.warnings.push_back(
        fmt::format("held-out error {:.2f} px against {:.2f} px in the fit", out.held_out_px, out.rms_px));
  if (film.views.size() < 30) out.warnings.push_back(fmt::format("only {} views", film.views.size()));
}

}  // namespace

Result<BowGeometry> calibrate_bow_geometry(const std::vector<RigCamera>& cameras, const TaggedBody& nominal,
                                           const std::vector<BodyView>& views,
                                           const BowGeometryOptions& options) {
  BowGeometry out;
  GNATHION_CHECK_OK(check_seen_tags(nominal, views));
  GNATHION_TRY(Film film, sorted_film(cameras, nominal, views, options, out.left_out));
  out.turn_deg = span_of_views_deg(film.poses);
  if (out.turn_deg < options.least_turn_deg)
    return bad_input(
        kBowWhat, nominal.name,
        fmt::format("too little movement: the views' directions span {:.0f} deg, {:.0f} are needed; turn the "
                    "body before the camera about both axes",
                    out.turn_deg, options.least_turn_deg));
  std::vector<LayoutObservation> fitted, held;
  for (const LayoutObservation& o : film.observations)
    (film.held_out[static_cast<std::size_t>(o.view)] ? held : fitted).push_back(o);
  LayoutState state{layout_of(film.nominal), film.poses};

  // First what the images say by themselves: the shape, and with several cameras the scale.
  LayoutPrior free_scale{0, kFreeScaleSigma, cameras.size() == 1, 0.005};
  GNATHION_CHECK_OK(adjust_robustly(cameras, fitted, free_scale, state));
  put_on_nominal(film.nominal, state);
  GNATHION_TRY(const LayoutCovariance by_images,
               layout_covariance(cameras, fitted, free_scale, state, corners_of(film.nominal)));
  GNATHION_CHECK_OK(check_layout(film.nominal, state.layout, by_images.shape, options.largest_deviation_mm));
  std::optional<ScaleWitness> images;
  if (cameras.size() > 1 && by_images.log_scale_sigma < 0.3 * kFreeScaleSigma)
    images = ScaleWitness{kImagesWitness, std::exp(state.layout.log_scale),
                          std::hypot(by_images.log_scale_sigma, kBaselineSigma)};
  GNATHION_TRY(out.scale_witnesses, scale_witnesses(state.layout, options, images));
  GNATHION_CHECK_OK(check_witnesses(out.scale_witnesses, state.layout.tags.front().nominal_side_mm));

  // Then with the scale that all witnesses agree on.
  const ScaleWitness prior_scale = combined(out.scale_witnesses, true);
  const LayoutPrior prior{std::log(prior_scale.factor), prior_scale.sigma / prior_scale.factor, false, 0.005};
  if (cameras.size() == 1) {
    for (LayoutTag& tag : state.layout.tags) tag.body_from_tag.translation_mm *= prior_scale.factor;
    for (Rigid3& pose : state.rig_from_body) pose.translation_mm *= prior_scale.factor;
    state.layout.log_scale = prior.log_scale;
  }
  GNATHION_CHECK_OK(adjust_layout(cameras, fitted, prior, kHuber, state));
  put_on_nominal(film.nominal, state);
  GNATHION_TRY(LayoutCovariance covariance,
               layout_covariance(cameras, fitted, prior, state, corners_of(film.nominal)));

  fill_tags(state, film.nominal, out);
  fill_residuals(cameras, fitted, state, film, out);
  fill_held_out(cameras, held, state, out);
  fill_deviations(film.nominal, state.layout, out);
  fill_covariance(state, std::move(covariance), out);
  out.scale = std::exp(state.layout.log_scale);
  GNATHION_CHECK_OK(check_distances(state.layout, options, out.scale_sigma));
  if (out.shape_sigma_mm > options.largest_sigma_mm)
    return bad_input(
        kBowWhat, nominal.name,
        fmt::format(
            "a corner is known to {:.2f} mm only, {:.2f} mm are allowed; worst: {}; turn the body more, "
            "nearer to the camera",
            out.shape_sigma_mm, options.largest_sigma_mm, out.weak.size() > 1 ? out.weak[1] : "all"));
  add_warnings(film, out);
  return out;
}

}  // namespace gnathion
