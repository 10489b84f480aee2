#include "calibration/bow_checks.h"
#include "core/angle.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

namespace gnathion {
namespace {

std::string id_list(const std::set<int>& ids) {
  std::string text;
  for (auto it = ids.begin(); it != ids.end();) {
    const int first = *it;
    int last = first;
    for (++it; it != ids.end() && *it == last + 1; ++it) last = *it;
    text += (text.empty() ? "" : ", ") +
            (first == last ? fmt::format("{}", first) : fmt::format("{} to {}", first, last));
  }
  return text;
}

Vector3 centre_of(const BodyTag& tag) {
  Vector3 sum = Vector3::Zero();
  for (const Vector3& c : tag.corners_in_body_mm) sum += 0.25 * c;
  return sum;
}

/// Point of a tag: corner, or centre for a negative number. Nothing for a tag that is not there.
std::optional<Vector3> point_of(const TagLayout& layout, int id, int corner) {
  for (std::size_t t = 0; t < layout.tags.size(); ++t) {
    if (layout.tags[t].id != id) continue;
    return corner < 0 ? layout.tags[t].body_from_tag.translation_mm
                      : layout.corner(t, static_cast<std::size_t>(corner));
  }
  return std::nullopt;
}

std::string distance_name(const KnownDistance& d) {
  const auto end = [](int tag, int corner) {
    return corner < 0 ? fmt::format("{}", tag) : fmt::format("{}.{}", tag, corner);
  };
  return end(d.tag_a, d.corner_a) + "-" + end(d.tag_b, d.corner_b);
}

Result<double> length_in(const TagLayout& layout, const KnownDistance& d) {
  const auto a = point_of(layout, d.tag_a, d.corner_a), b = point_of(layout, d.tag_b, d.corner_b);
  if (!a || !b)
    return bad_input(kBowWhat, "distance " + distance_name(d),
                     fmt::format("tag {} is not determined by the film", a ? d.tag_b : d.tag_a));
  return (*a - *b).norm();
}

}  // namespace

Status check_seen_tags(const TaggedBody& nominal, const std::vector<BodyView>& views) {
  std::set<int> wanted, seen, others;
  for (const BodyTag& tag : nominal.tags) wanted.insert(tag.id);
  std::map<int, int> images_with, doubled;
  std::size_t right = 0, wrong = 0;
  for (const BodyView& view : views)
    for (const auto& tags : view.tags) {
      std::map<int, int> count;
      for (const SeenTag& tag : tags) {
        if (wanted.count(tag.id) == 0) {
          others.insert(tag.id);
          continue;
        }
        seen.insert(tag.id);
        ++count[tag.id];
        double area = 0;  // image axes: x right, y down
        for (std::size_t k = 0; k < 4; ++k) {
          const Eigen::Vector2d &p = tag.corners_px[k], &q = tag.corners_px[(k + 1) % 4];
          area += p.x() * q.y() - q.x() * p.y();
        }
        ++(area < 0 ? right : wrong);
      }
      for (const auto& [id, n] : count) {
        ++images_with[id];
        if (n > 1) ++doubled[id];
      }
    }
  if (seen.empty() || 2 * seen.size() < wanted.size())
    return bad_input(
        kBowWhat, nominal.name,
        fmt::format("film of another body: its file has tags {}, the film shows {}", id_list(wanted),
                    seen.empty() && others.empty() ? "none" : id_list(others.empty() ? seen : others)));
  if (wrong > right)
    return bad_input(
        kBowWhat, nominal.name,
        "the tags' corners run the wrong way round: mirrored images, switch mirroring off in the camera");
  for (const auto& [id, n] : doubled)
    if (n >= 3 && 20 * n >= images_with[id])
      return bad_input(
          kBowWhat, nominal.name,
          fmt::format("tag {} is there twice in {} images: another body in view, or a tag printed twice", id,
                      n));
  return {};
}

double span_of_views_deg(const std::vector<Rigid3>& rig_from_body) {
  std::vector<Vector3> directions;
  for (const Rigid3& pose : rig_from_body) directions.push_back(pose.inverse().translation_mm.normalized());
  double least = 1;
  for (std::size_t i = 0; i < directions.size(); ++i)
    for (std::size_t k = 0; k < i; ++k) least = std::min(least, directions[i].dot(directions[k]));
  return std::acos(std::clamp(least, -1.0, 1.0)) * kDegPerRad;
}

Status check_layout(const TaggedBody& nominal, const TagLayout& layout, const Eigen::MatrixXd& covariance,
                    double largest_deviation_mm) {
  // A fit that tags at wrong places do not rule: weights fall with the distance.
  std::vector<Vector3> found, wanted;
  for (std::size_t t = 0; t < layout.tags.size(); ++t)
    for (const BodyTag& tag : nominal.tags)
      if (tag.id == layout.tags[t].id)
        for (std::size_t k = 0; k < 4; ++k) {
          found.push_back(layout.corner(t, k));
          wanted.push_back(tag.corners_in_body_mm[k]);
        }
  std::vector<double> weights(found.size(), 1.0);
  Rigid3 fit;
  for (int round = 0; round < 30; ++round) {
    fit = best_rigid_fit(found, wanted, weights);
    for (std::size_t i = 0; i < found.size(); ++i)
      weights[i] = 1 / (1 + (fit * found[i] - wanted[i]).squaredNorm());
  }
  std::string moved;
  int count = 0;
  for (std::size_t t = 0; t < layout.tags.size(); ++t) {
    double worst = 0;
    for (std::size_t k = 0; k < 4; ++k)
      worst = std::max(worst, (fit * found[4 * t + k] - wanted[4 * t + k]).norm());
    if (worst <= largest_deviation_mm) continue;
    ++count;
    const Vector3 centre = fit * layout.tags[t].body_from_tag.translation_mm;
    std::string where;
    for (const BodyTag& tag : nominal.tags)
      if (tag.id != layout.tags[t].id && (centre_of(tag) - centre).norm() < largest_deviation_mm)
        where = fmt::format(", at the place of tag {}", tag.id);
    moved += fmt::format("{}tag {} is {:.1f} mm off{}", moved.empty() ? "" : "; ", layout.tags[t].id, worst,
                         where);
  }
  if (2 * count > static_cast<int>(layout.tags.size()))
    return bad_input(kBowWhat, nominal.name,
                     "another body than the file's, most tags lie elsewhere: " + moved);
  if (count > 0)
    return bad_input(kBowWhat, nominal.name,
                     moved + " from where the file has it: glued at another place, or turned");

  std::vector<double> sizes;
  for (const LayoutTag& tag : layout.tags) sizes.push_back(0.5 * (tag.log_width + tag.log_height));
  std::vector<double> sorted = sizes;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  const double middle = sorted[sorted.size() / 2];
  for (std::size_t t = 0; t < sizes.size(); ++t) {
    const auto at = static_cast<Eigen::Index>(12 * t);
    const double sigma =
        std::sqrt(covariance.block<12, 12>(at, at).diagonal().maxCoeff()) / layout.tags[t].nominal_side_mm;
    const double off = sizes[t] - middle;
    if (std::abs(off) > std::max(0.01, 5 * sigma))
      return bad_input(kBowWhat, fmt::format("tag {}", layout.tags[t].id),
                       fmt::format("its side is {:.2f} mm where the others are like {:.2f} mm ({:+.1f} %): "
                                   "printed at another scale",
                                   layout.tags[t].nominal_side_mm * std::exp(sizes[t] - middle),
                                   layout.tags[t].nominal_side_mm, 100 * off));
  }
  return {};
}

Result<std::vector<ScaleWitness>> scale_witnesses(const TagLayout& layout, const BowGeometryOptions& options,
                                                  const std::optional<ScaleWitness>& images) {
  std::vector<ScaleWitness> out;
  double side = 0;
  for (const LayoutTag& tag : layout.tags)
    side += tag.nominal_side_mm / static_cast<double>(layout.tags.size());
  out.push_back({"tag side", options.tag_side_mm.value_or(side) / side, options.tag_side_sigma_mm / side});
  if (!options.distances.empty()) {
    double information = 0, sum = 0;
    for (const KnownDistance& d : options.distances) {
      GNATHION_TRY(const double length, length_in(layout, d));
      const double w = length * length / (d.sigma_mm * d.sigma_mm);
      information += w;
      sum += w * d.mm / length;
    }
    const double factor = std::exp(layout.log_scale) * sum / information;
    out.push_back({"distances", factor, factor / std::sqrt(information)});
  }
  if (images) out.push_back(*images);
  return out;
}

Status check_witnesses(const std::vector<ScaleWitness>& witnesses, double nominal_side_mm) {
  const ScaleWitness& side = witnesses.front();
  for (std::size_t i = 1; i < witnesses.size(); ++i) {
    const ScaleWitness& w = witnesses[i];
    const double off = w.factor / side.factor - 1, sigma = std::hypot(w.sigma, side.sigma);
    if (std::abs(off) <= 4 * sigma) continue;
    return bad_input(
        kBowWhat, "scale",
        fmt::format(
            "tag side {:.3f} mm, but by the {} it is {:.3f} mm ({:+.2f} %, {:.1f} standard deviations): "
            "measure the black square and the distances again; --tag-side-mm takes the measured side",
            nominal_side_mm * side.factor, w.name, nominal_side_mm * w.factor, 100 * off,
            std::abs(off) / sigma));
  }
  return {};
}

ScaleWitness combined(const std::vector<ScaleWitness>& witnesses, bool without_images) {
  double information = 0, sum = 0;
  for (const ScaleWitness& w : witnesses) {
    if (without_images && w.name == kImagesWitness) continue;
    information += 1 / (w.sigma * w.sigma);
    sum += w.factor / (w.sigma * w.sigma);
  }
  return {"all", sum / information, 1 / std::sqrt(information)};
}

Status check_distances(const TagLayout& layout, const BowGeometryOptions& options, double scale_sigma) {
  if (options.distances.size() < 2) return {};
  for (const KnownDistance& d : options.distances) {
    GNATHION_TRY(const double length, length_in(layout, d));
    const double sigma = std::hypot(std::hypot(d.sigma_mm, 0.03), scale_sigma * length);
    if (std::abs(d.mm - length) > 5 * sigma)
      return bad_input(
          kBowWhat, "distance " + distance_name(d),
          fmt::format("{:.2f} mm given, {:.2f} mm by the film and the other measures", d.mm, length));
  }
  return {};
}

namespace {

struct NamedMode {
  std::string name;
  Eigen::VectorXd shift;
};

/// Deformations of the whole layout that a film determines badly, in the layout's principal axes.
std::vector<NamedMode> common_modes(const std::vector<Vector3>& corners) {
  Vector3 centre = Vector3::Zero();
  for (const Vector3& c : corners) centre += c / static_cast<double>(corners.size());
  Matrix3 spread = Matrix3::Zero();
  for (const Vector3& c : corners) spread += (c - centre) * (c - centre).transpose();
  const Matrix3 axes = Eigen::SelfAdjointEigenSolver<Matrix3>(spread).eigenvectors();
  const Vector3 deep = axes.col(0), across = axes.col(1), along = axes.col(2);
  const auto mode = [&](const std::string& name, auto shift) {
    NamedMode m{name, Eigen::VectorXd(3 * static_cast<Eigen::Index>(corners.size()))};
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Vector3 p = corners[i] - centre;
      m.shift.segment<3>(3 * static_cast<Eigen::Index>(i)) = shift(deep.dot(p), across.dot(p), along.dot(p));
    }
    return m;
  };
  return {
      mode("bending along the long axis (both ends forward together)",
           [&](double, double, double l) -> Vector3 { return deep * l * l; }),
      mode("bending across the long axis", [&](double, double a, double) -> Vector3 { return deep * a * a; }),
      mode("twist about the long axis", [&](double, double a, double l) -> Vector3 { return deep * a * l; }),
      mode("stretch along the long axis", [&](double, double, double l) -> Vector3 { return along * l; }),
      mode("stretch across the long axis", [&](double, double a, double) -> Vector3 { return across * a; }),
      mode("depth of the layout", [&](double d, double, double) -> Vector3 { return deep * d; }),
      mode("shear in the layout's plane",
           [&](double, double a, double l) -> Vector3 { return along * a + across * l; }),
  };
}

/// Removes what moves the layout as a rigid body.
void without_rigid_part(const std::vector<Vector3>& corners, Eigen::VectorXd& shift) {
  Eigen::MatrixXd rigid(shift.size(), 6);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    rigid.block<3, 3>(3 * static_cast<Eigen::Index>(i), 0) = Matrix3::Identity();
    rigid.block<3, 3>(3 * static_cast<Eigen::Index>(i), 3) = -skew(corners[i]);
  }
  shift -= rigid * rigid.colPivHouseholderQr().solve(shift);
}

std::string single_tag(const LayoutTag& tag, const Eigen::VectorXd& shift) {
  Vector3 mean = Vector3::Zero();
  for (int k = 0; k < 4; ++k) mean += 0.25 * shift.segment<3>(3 * k);
  const Matrix3& r = tag.body_from_tag.rotation;
  const double all = shift.squaredNorm(), normal = 4 * std::pow(r.col(2).dot(mean), 2);
  double off_plane = 0;
  for (int k = 0; k < 4; ++k) off_plane += std::pow(r.col(2).dot(shift.segment<3>(3 * k) - mean), 2);
  if (off_plane > 0.5 * all) return fmt::format("tilt of tag {}", tag.id);
  if (normal > 0.5 * all) return fmt::format("tag {} along its normal", tag.id);
  return fmt::format("tag {} in its plane", tag.id);
}

}  // namespace

std::vector<std::string> weak_directions(const TagLayout& layout, const Eigen::MatrixXd& shape,
                                         double scale_sigma) {
  std::vector<Vector3> corners;
  for (std::size_t t = 0; t < layout.tags.size(); ++t)
    for (std::size_t k = 0; k < 4; ++k) corners.push_back(layout.corner(t, k));
  std::vector<std::string> out;
  out.push_back(fmt::format("scale: {:.3f} mm on 100 mm", 100 * scale_sigma));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(shape);
  std::vector<NamedMode> known = common_modes(corners);
  for (NamedMode& m : known) {
    without_rigid_part(corners, m.shift);
    m.shift.normalize();
  }
  for (Eigen::Index n = 1; n <= 2; ++n) {
    const Eigen::VectorXd v = modes.eigenvectors().col(shape.cols() - n);
    const double sigma = std::sqrt(std::max(0.0, modes.eigenvalues()(shape.cols() - n)));
    Eigen::Index worst_corner = 0;
    double worst = 0, energy = 0;
    std::size_t tag = 0;
    for (Eigen::Index i = 0; i < v.size() / 3; ++i)
      if (v.segment<3>(3 * i).norm() > worst) worst = v.segment<3>(3 * i).norm(), worst_corner = i;
    for (std::size_t t = 0; t < layout.tags.size(); ++t) {
      const double e = v.segment<12>(12 * static_cast<Eigen::Index>(t)).squaredNorm();
      if (e > energy) energy = e, tag = t;
    }
    std::string name = fmt::format("tags about {} against the rest",
                                   layout.tags[static_cast<std::size_t>(worst_corner / 4)].id);
    double overlap = 0.6;
    for (const NamedMode& m : known)
      if (std::abs(m.shift.dot(v)) > overlap) overlap = std::abs(m.shift.dot(v)), name = m.name;
    if (energy > 0.5) name = single_tag(layout.tags[tag], v.segment<12>(12 * static_cast<Eigen::Index>(tag)));
    out.push_back(fmt::format("{}: {:.3f} mm", name, sigma * worst));
  }
  return out;
}

}  // namespace gnathion
