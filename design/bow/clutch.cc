#include "design/bow/clutch.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>

#include "design/bow/shapes.h"
#include "design/distances.h"
#include "design/parallel.h"
#include "design/solid_distance.h"
#include "occlusion/teeth.h"

namespace gnathion {
namespace {

constexpr double kSpacing_mm = 0.3;
constexpr double kBand_mm = 4.0;
constexpr double kStep_mm = 0.5;           // of profiles along the arch
constexpr double kTallest_mm = 8.0;        // of the clutch below the incisal edges
constexpr double kGingivaRelief_mm = 0.9;  // what stands below the clutch keeps this, besides the gap
constexpr double kForward_mm = 16.0;       // how far before the teeth the maxilla matters
constexpr double kPapilla_mm = 0.8;        // between two teeth the margin stands higher by this
constexpr double kKnife_mm = 0.5;          // half the least thickness of the shell
constexpr double kEnd_mm = 1.5;            // the shell ends this far before the canines do
constexpr double kEmbrasure_mm = 0.6;  // grooves between teeth narrower than twice this stay empty: no fins
constexpr double kGridError_mm = 0.04;
constexpr double kSmoothing_mm = 1.2;  // closing radius of the outer face: embrasures
constexpr double kFar = 1e3;

bool is_clutch_tooth(std::uint8_t fdi) {
  return (fdi / 10 == 3 || fdi / 10 == 4) && fdi % 10 >= 1 && fdi % 10 <= 3;
}

}  // namespace

ArcProfile::ArcProfile(double first_mm, double step_mm, std::vector<double> values)
    : first_(first_mm), step_(step_mm), values_(std::move(values)) {}

double ArcProfile::operator()(double s_mm) const {
  const double at = std::clamp((s_mm - first_) / step_, 0.0, static_cast<double>(values_.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(at), values_.size() - 2);
  const double f = at - static_cast<double>(i);
  return values_[i] * (1 - f) + values_[i + 1] * f;
}

ArcProfile ArcProfile::lowered(double reach_mm) const {
  const auto n = static_cast<std::ptrdiff_t>(values_.size());
  const auto reach = static_cast<std::ptrdiff_t>(reach_mm / step_);
  std::vector<double> low(values_.size()), out(values_.size());
  const auto window = [&](std::ptrdiff_t i) {
    return std::pair(std::max<std::ptrdiff_t>(0, i - reach), std::min(n - 1, i + reach));
  };
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const auto [a, b] = window(i);
    low[static_cast<std::size_t>(i)] = *std::min_element(values_.begin() + a, values_.begin() + b + 1);
  }
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const auto [a, b] = window(i);
    double sum = 0;
    for (auto k = a; k <= b; ++k) sum += low[static_cast<std::size_t>(k)];
    out[static_cast<std::size_t>(i)] = sum / static_cast<double>(b - a + 1);
  }
  return {first_, step_, out};
}

ArcProfile ArcProfile::raised(double reach_mm) const {
  ArcProfile negative = *this;
  for (double& v : negative.values_) v = -v;
  negative = negative.lowered(reach_mm);
  for (double& v : negative.values_) v = -v;
  return negative;
}

struct Clutch::Terms {
  double teeth = kFar, embrasures = kFar, shadow = kFar, maxilla = kFar, below = -kFar;
};

Result<Clutch> Clutch::build(const ClutchScene& scene, const BowParameters& p) {
  Clutch c;
  c.par_ = p;
  c.mandible_ = &scene.mandible;
  const ArchRuler ruler(scene.lower);
  // The incisal edge and the labial gingival margin along the arch.
  double low = kFar, high = -kFar;
  Box teeth;
  for (std::size_t v = 0; v < scene.fdi.size(); ++v) {
    if (!is_clutch_tooth(scene.fdi[v])) continue;
    const double s = ruler.measure(scene.mandible_scan.vertices_mm[v]).s_mm;
    low = std::min(low, s);
    high = std::max(high, s);
    teeth.extend(scene.mandible_scan.vertices_mm[v]);
  }
  if (high - low < 12)
    return bad_input("cannot design a bow", "mandible", "the lower front teeth (43 to 33) are not there");
  c.s_low_ = low + kEnd_mm;
  c.s_high_ = high - kEnd_mm;
  c.find_margins(scene, ruler, low, high);
  // Models of bare crowns have no gingiva that a flange could follow.
  double lowest = kFar;
  for (const Vector3& q : scene.mandible_scan.vertices_mm)
    if (teeth.min_mm.x() < q.x() && q.x() < teeth.max_mm.x() && q.y() < teeth.max_mm.y())
      lowest = std::min(lowest, q.z());
  if (c.bottom_(0) - lowest < p.flange_mm + 3) c.par_.flange_mm = 0;
  c.choose_withdrawal(scene, ruler);
  c.sample(scene, teeth);
  c.limit(ruler);
  c.open_shell();
  c.find_stem(scene);
  return c;
}

/// The incisal edge along the arch, and the labial gingival margin: low in the middle of each tooth, higher
/// at the papillae between them.
void Clutch::find_margins(const ClutchScene& scene, const ArchRuler& ruler, double low, double high) {
  const auto bins = static_cast<std::size_t>((high - low) / kStep_mm) + 2;
  std::vector<double> edge(bins, -kFar);
  struct Tooth {
    double low = kFar, high = -kFar;
    std::vector<std::array<double, 2>> labial;  // s, z
  };
  std::map<int, Tooth> teeth;
  for (std::size_t v = 0; v < scene.fdi.size(); ++v) {
    if (!is_clutch_tooth(scene.fdi[v])) continue;
    const Vector3& q = scene.mandible_scan.vertices_mm[v];
    const ArchCoordinates at = ruler.measure(q);
    const double bin = std::clamp((at.s_mm - low) / kStep_mm + 0.5, 0.0, static_cast<double>(bins - 1));
    edge[static_cast<std::size_t>(bin)] = std::max(edge[static_cast<std::size_t>(bin)], q.z());
    Tooth& tooth = teeth[scene.fdi[v]];
    tooth.low = std::min(tooth.low, at.s_mm);
    tooth.high = std::max(tooth.high, at.s_mm);
    if (at.buccal_mm > 0) tooth.labial.push_back({at.s_mm, q.z()});
  }
  for (std::size_t k = 1; k < bins; ++k)  // empty bins take their neighbours'
    for (std::size_t i = 0; i < bins; ++i) {
      if (edge[i] > -kFar / 2) continue;
      const double neighbour = std::max(edge[i > 0 ? i - 1 : i], edge[i + 1 < bins ? i + 1 : i]);
      if (neighbour > -kFar / 2) edge[i] = neighbour;
    }
  edge_ = ArcProfile(low, kStep_mm, edge).raised(1.0);  // without the dips between teeth

  std::vector<std::array<double, 2>> knots;  // s, z of the margin
  for (auto& [fdi, tooth] : teeth) {
    const double middle = 0.5 * (tooth.low + tooth.high), quarter = 0.25 * (tooth.high - tooth.low);
    std::vector<double> z;
    for (const auto& [s, height] : tooth.labial)
      if (std::abs(s - middle) < quarter) z.push_back(height);
    if (z.empty()) continue;
    const auto rank = z.begin() + static_cast<std::ptrdiff_t>(z.size() / 50);
    std::nth_element(z.begin(), rank, z.end());
    knots.push_back({middle, std::max(*rank, edge_(middle) - kTallest_mm)});
  }
  std::sort(knots.begin(), knots.end());
  std::vector<double> margin(bins);
  for (std::size_t i = 0; i < bins; ++i) {
    const double s = low + kStep_mm * static_cast<double>(i);
    std::size_t k = 0;
    while (k + 1 < knots.size() && knots[k + 1][0] < s) ++k;
    const auto& a = knots[k];
    const auto& b = knots[std::min(k + 1, knots.size() - 1)];
    const double width = b[0] - a[0], t = width > 0 ? std::clamp((s - a[0]) / width, 0.0, 1.0) : 0.0;
    margin[i] = a[1] + t * (b[1] - a[1]) + kPapilla_mm * std::pow(std::sin(t * std::numbers::pi), 2) +
                par_.gingiva_distance_mm;
  }
  bottom_ = ArcProfile(low, kStep_mm, margin).raised(0.5);
  top_ = edge_.lowered(1.0);
  for (double& v : top_.values()) v -= par_.rim_below_edge_mm;
}

/// The mean normal of the labial surfaces, kept in the midsagittal direction.
void Clutch::choose_withdrawal(const ClutchScene& scene, const ArchRuler& ruler) {
  Vector3 sum = Vector3::Zero();
  const TriangleMesh& mesh = scene.mandible_scan;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::uint32_t v = mesh.triangles[t][0];
    if (!is_clutch_tooth(scene.fdi[v])) continue;
    const ArchCoordinates at = ruler.measure(mesh.vertices_mm[v]);
    const double z = mesh.vertices_mm[v].z();
    if (at.buccal_mm < 0.3 || z > top_(at.s_mm) || z < bottom_(at.s_mm)) continue;
    const Vector3 n = face_normal_scaled(mesh, t);
    if (n.y() < -0.3 * n.norm()) sum += n;
  }
  sum.x() = 0;
  if (sum.norm() < 1e-9) return;
  sum.normalize();
  // Beyond 25° of tilt lips and chin are in the way.
  const double tilt = std::clamp(std::atan2(sum.z(), -sum.y()), -0.44, 0.44);
  withdrawal_ = {0, -std::cos(tilt), std::sin(tilt)};
}

void Clutch::sample(const ClutchScene& scene, const Box& teeth) {
  Matrix3 axes;  // columns: grid axes told in the bow's frame
  axes.col(2) = -withdrawal_;
  axes.col(0) = Vector3::UnitX();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  grid_from_bow_ = {axes.transpose(), Vector3::Zero()};
  reach_.extend(teeth.min_mm - Vector3(6, kForward_mm, 6));
  reach_.extend(teeth.max_mm + Vector3(6, 2, 6));
  Box box;
  for (int n = 0; n < 8; ++n)
    box.extend(grid_from_bow_ * Vector3(n & 1 ? reach_.min_mm.x() : reach_.max_mm.x(),
                                        n & 2 ? reach_.min_mm.y() : reach_.max_mm.y(),
                                        n & 4 ? reach_.min_mm.z() : reach_.max_mm.z()));
  GridShape shape;
  shape.spacing_mm = kSpacing_mm;
  shape.origin_mm = box.min_mm;
  shape.nodes = (box.size_mm() / kSpacing_mm).cast<int>() + Eigen::Vector3i::Constant(2);
  const Rigid3 bow_from_grid = grid_from_bow_.inverse();
  teeth_ = sampled_distance(shape, scene.mandible, bow_from_grid, kBand_mm, OutsideEnd::kBottom);
  shadow_ = swept_up(teeth_);
  CoarseGrid thick = teeth_;
  for (float& v : thick.values()) v -= static_cast<float>(par_.bonding_gap_mm + par_.clutch_thickness_mm);
  outer_ = closed(thick, kSmoothing_mm);
  CoarseGrid gap = teeth_;
  for (float& v : gap.values()) v -= static_cast<float>(par_.bonding_gap_mm);
  embrasures_ = closed(gap, kEmbrasure_mm);
  maxilla_ = CoarseGrid(shape, static_cast<float>(kBand_mm));
  for (const Rigid3& motion : scene.jaw_positions) {
    const CoarseGrid one =
        sampled_distance(shape, scene.maxilla, motion * bow_from_grid, kBand_mm, OutsideEnd::kBottom);
    for (std::size_t i = 0; i < one.values().size(); ++i)
      maxilla_.values()[i] = std::min(maxilla_.values()[i], one.values()[i]);
  }
}

/// Lowers the rim where the maxilla comes near the shell, and writes the limits into a grid.
void Clutch::limit(const ArchRuler& ruler) {
  const GridShape& shape = teeth_.shape();
  const Rigid3 bow_from_grid = grid_from_bow_.inverse();
  struct Node {
    float s, buccal, z;
  };
  std::vector<Node> nodes(shape.size());
  parallel_each(shape.nodes.x(), [&](int i) {
    for (int j = 0; j < shape.nodes.y(); ++j)
      for (int k = 0; k < shape.nodes.z(); ++k) {
        const std::size_t n = shape.index(i, j, k);
        const Vector3 p = bow_from_grid * shape.position(i, j, k);
        if (std::abs(outer_.values()[n]) > 3.5f && outer_.values()[n] > 0) {
          nodes[n] = {0, 0, static_cast<float>(kFar)};  // too far to matter
          continue;
        }
        const ArchCoordinates at = ruler.measure(p);
        nodes[n] = {static_cast<float>(at.s_mm), static_cast<float>(at.buccal_mm), static_cast<float>(p.z())};
      }
  });
  const auto in_shell = [&](std::size_t n) {
    return teeth_.values()[n] >= static_cast<float>(par_.bonding_gap_mm) - 0.15f &&
           outer_.values()[n] <= 0.15f && shadow_.values()[n] >= -0.15f && nodes[n].z < kFar / 2 &&
           nodes[n].buccal > -1.5f;
  };
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    if (!in_shell(n) || maxilla_.values()[n] >= static_cast<float>(par_.maxilla_clearance_mm)) continue;
    const double s = nodes[n].s, z = nodes[n].z;
    if (s < s_low_ - 1 || s > s_high_ + 1) continue;
    const auto bin = static_cast<std::size_t>(std::clamp((s - top_.first_mm()) / kStep_mm + 0.5, 0.0,
                                                         static_cast<double>(top_.values().size() - 1)));
    top_.values()[bin] = std::min(top_.values()[bin], z - 0.2);
  }
  top_ = top_.lowered(1.0);
  limits_ = CoarseGrid(shape, static_cast<float>(kFar));
  below_ = CoarseGrid(shape, static_cast<float>(-kFar));
  parallel_each(shape.size(), [&](std::size_t n) {
    if (nodes[n].z > kFar / 2) {
      limits_.values()[n] = 10;
      below_.values()[n] = 0;
      return;
    }
    const double s = nodes[n].s, z = nodes[n].z;
    limits_.values()[n] = static_cast<float>(std::max(
        {z - top_(s), bottom_(s) - par_.flange_mm - z, s - s_high_, s_low_ - s, -1.5 - nodes[n].buccal}));
    below_.values()[n] = static_cast<float>(bottom_(s) - z);
    // The flange keeps its thickness although it stands off the gingiva.
    outer_.values()[n] -= static_cast<float>(kGingivaRelief_mm * std::clamp(bottom_(s) - z, 0.0, 1.0));
  });
  double sum = 0;
  int count = 0;
  for (double s = s_low_; s <= s_high_; s += kStep_mm, ++count) sum += std::max(0.0, top_(s) - bottom_(s));
  height_ = sum / count;
}

/// Knife edges, where limits and teeth cut the shell at an acute angle, go; the other edges are rounded.
void Clutch::open_shell() {
  const GridShape& grid = teeth_.shape();
  const Rigid3 bow_from_grid = grid_from_bow_.inverse();
  CoarseGrid solid(grid, static_cast<float>(kFar));
  parallel_each(grid.nodes.x(), [&](int i) {
    for (int j = 0; j < grid.nodes.y(); ++j)
      for (int k = 0; k < grid.nodes.z(); ++k) {
        const Vector3 p = bow_from_grid * grid.position(i, j, k);
        solid.at(i, j, k) =
            static_cast<float>(std::clamp(std::max(shell_mm(p), room_estimate_mm(p)), -3.0, 3.0));
      }
  });
  opened_ = opened(solid, kKnife_mm);
}

/// Where the stem may leave the clutch: below everything that the maxilla does before the teeth.
void Clutch::find_stem(const ClutchScene& scene) {
  const double mid_z = 0.5 * (top_(0) + bottom_(0));
  const auto hit = scene.mandible.ray({0, reach_.min_mm.y() - 5, mid_z}, Vector3::UnitY(), 0, 60);
  front_y_ = hit ? hit->point_mm.y() : 0;
  stem_top_ = top_(0);
  stem_bottom_ = bottom_(0) - par_.flange_mm;
  for (double s = -0.5 * par_.stem_width_mm; s <= 0.5 * par_.stem_width_mm; s += kStep_mm) {
    stem_top_ = std::min(stem_top_, top_(s) - 0.1);
    stem_bottom_ = std::max(stem_bottom_, bottom_(s) - par_.flange_mm + 0.1);
  }
  const GridShape& shape = maxilla_.shape();
  const Rigid3 bow_from_grid = grid_from_bow_.inverse();
  for (int i = 0; i < shape.nodes.x(); ++i)
    for (int j = 0; j < shape.nodes.y(); ++j)
      for (int k = 0; k < shape.nodes.z(); ++k) {
        if (maxilla_.at(i, j, k) >= static_cast<float>(par_.maxilla_clearance_mm)) continue;
        const Vector3 p = bow_from_grid * shape.position(i, j, k);
        if (std::abs(p.x()) < 0.5 * par_.stem_width_mm + 0.6 && p.y() < front_y_ + 0.5)
          stem_top_ = std::min(stem_top_, p.z() - 0.2);
      }
}

Clutch::Terms Clutch::terms_at(const Vector3& p) const {
  Terms t;
  if (!near(p)) return t;
  const GridCell cell = located(teeth_.shape(), grid_from_bow_ * p);
  t.teeth = teeth_.linear(cell);
  t.embrasures = embrasures_.linear(cell);
  t.shadow = shadow_.linear(cell);
  t.maxilla = maxilla_.linear(cell);
  t.below = below_.linear(cell);
  return t;
}

double Clutch::room_of(const Terms& t) const {
  // Below the clutch, over the gingiva, the gap grows.
  const double gap = par_.bonding_gap_mm + kGingivaRelief_mm * std::clamp(t.below / 1.0, 0.0, 1.0);
  const double engagement = std::max(0.0, par_.engagement_mm - 0.05);  // the grid's own error is kept back
  return std::max({gap - t.teeth, -(t.embrasures + kGridError_mm), -(t.shadow + engagement),
                   par_.maxilla_clearance_mm - t.maxilla});
}

double Clutch::shell_mm(const Vector3& p) const {
  const double apart = (reach_.min_mm - p).cwiseMax(p - reach_.max_mm).cwiseMax(0.0).norm();
  if (apart > 0) return std::max(apart, 1.0);
  const Vector3 g = grid_from_bow_ * p;
  const double shell = shape::meet(outer_.smooth(g), limits_.smooth(g), 0.6);
  return opened_.values().empty() ? shell : std::max(shell, opened_.linear(g) - kGridError_mm);
}

double Clutch::room_estimate_mm(const Vector3& p) const {
  return near(p) ? room_of(terms_at(p)) : -kFar;
}

void Clutch::room_exact_mm(const std::vector<Vector3>& points, std::vector<double>& out) const {
  std::vector<Terms> terms;
  std::vector<SolidGroup::Point> ask;
  std::vector<std::size_t> whose;
  for (std::size_t i = 0; i < points.size(); ++i) {
    terms.push_back(terms_at(points[i]));
    if (terms.back().teeth > 2.0) continue;
    SolidGroup::Point q;
    q.p_mm = points[i];
    q.reach_mm = std::abs(terms.back().teeth) + 0.6;
    ask.push_back(q);
    whose.push_back(i);
  }
  if (!ask.empty()) SolidGroup(*mandible_).measure(ask);
  for (std::size_t n = 0; n < ask.size(); ++n)
    if (ask[n].found) terms[whose[n]].teeth = ask[n].distance.distance_mm;
  out.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) out[i] = near(points[i]) ? room_of(terms[i]) : -kFar;
}

}  // namespace gnathion
