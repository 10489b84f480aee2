#include "calibration/frames_graph.h"
#include "core/angle.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace gnathion {
namespace {

/// Cost (mm²) of an edge whose error is unknown: more than any whose error is known.
constexpr double kUnknownCost_mm2 = 1e9;

double mean_square_mm2(const Matrix6& covariance, const std::vector<Vector3>& points_mm) {
  double sum = 0.0;
  for (const Vector3& p : points_mm) sum += point_covariance(covariance, p).trace();
  return points_mm.empty() ? 0.0 : sum / static_cast<double>(points_mm.size());
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& n : names) text += (text.empty() ? "" : ", ") + n;
  return text;
}

}  // namespace

Status FramesGraph::add(FrameEdge edge) {
  const auto refuse = [&](const std::string& why) {
    return bad_input("cannot add to the frames", edge.name(), why);
  };
  if (edge.to.empty() || edge.from.empty()) return refuse("a frame without a name");
  if (edge.to == edge.from) return refuse("a frame and itself");
  if (edge.covariance) {
    const Matrix6& c = *edge.covariance;
    if (!c.allFinite() || !c.isApprox(c.transpose(), 1e-6)) return refuse("the covariance is not symmetric");
    const double least = Eigen::SelfAdjointEigenSolver<Matrix6>(c, Eigen::EigenvaluesOnly).eigenvalues()[0];
    if (least < -1e-9 * c.trace()) return refuse("the covariance has a negative variance");
  }
  if (edge.estimate.empty()) edge.estimate = edge.name() + " #" + std::to_string(edges_.size());
  edges_.push_back(std::move(edge));
  return {};
}

void FramesGraph::set_cross_covariance(const std::string& a, const std::string& b,
                                       const Matrix6& covariance) {
  cross_[{a, b}] = covariance;
  cross_[{b, a}] = covariance.transpose();
}

std::vector<std::string> FramesGraph::frames() const {
  std::vector<std::string> out;
  const auto add = [&](const std::string& frame) {
    if (std::find(out.begin(), out.end(), frame) == out.end()) out.push_back(frame);
  };
  for (const FrameEdge& e : edges_) {
    add(e.to);
    add(e.from);
  }
  return out;
}

std::vector<FramesGraph::Neighbour> FramesGraph::neighbours(const std::string& frame) const {
  std::vector<Neighbour> out;
  for (std::size_t i = 0; i < edges_.size(); ++i) {
    if (edges_[i].to == frame) out.push_back({i, false, edges_[i].from});
    if (edges_[i].from == frame) out.push_back({i, true, edges_[i].to});
  }
  return out;
}

/// dental_from_frame of every frame that hangs together with "dental", by the edges that are known best:
/// where the teeth are in it.
std::map<std::string, Rigid3> FramesGraph::placed() const {
  constexpr double kLever_mm = 100.0;  // of an angle's error
  const auto size_mm2 = [](const FrameEdge& e) {
    if (!e.covariance) return kUnknownCost_mm2;
    return e.covariance->bottomRightCorner<3, 3>().trace() +
           kLever_mm * kLever_mm * e.covariance->topLeftCorner<3, 3>().trace();
  };
  std::map<std::string, Rigid3> out;
  out["dental"] = Rigid3::identity();
  for (;;) {  // Prim's tree
    const FrameEdge* best = nullptr;
    for (const FrameEdge& e : edges_) {
      if (out.count(e.to) == out.count(e.from)) continue;
      if (best == nullptr || size_mm2(e) < size_mm2(*best)) best = &e;
    }
    if (best == nullptr) return out;
    if (out.count(best->to) != 0) {
      out[best->from] = out.at(best->to) * best->to_from_from;
    } else {
      out[best->to] = out.at(best->from) * best->to_from_from.inverse();
    }
  }
}

std::vector<Vector3> FramesGraph::teeth_in(const std::string& frame) const {
  const auto known = placed();
  const auto at = known.find(frame);
  if (teeth_mm_.empty() || at == known.end()) return {Vector3::Zero()};
  std::vector<Vector3> out;
  for (const Vector3& p : teeth_mm_) out.push_back(at->second.inverse() * p);
  return out;
}

double FramesGraph::edge_cost(const FrameEdge& edge, const std::map<std::string, Rigid3>& dental_from) const {
  if (!edge.covariance) return kUnknownCost_mm2;
  const auto at = dental_from.find(edge.to);
  std::vector<Vector3> points = {Vector3::Zero()};
  if (!teeth_mm_.empty() && at != dental_from.end()) {
    points.clear();
    for (const Vector3& p : teeth_mm_) points.push_back(at->second.inverse() * p);
  }
  return mean_square_mm2(*edge.covariance, points);
}

/// Dijkstra over mean squared errors at the teeth, which add up along a path of independent edges.
std::optional<std::vector<FramePath::Step>> FramesGraph::cheapest(const std::string& to,
                                                                  const std::string& from,
                                                                  std::optional<std::size_t> without) const {
  const std::map<std::string, Rigid3> dental_from = placed();
  std::map<std::string, double> cost;
  std::map<std::string, FramePath::Step> arrived_by;
  std::map<std::string, std::string> came_from;
  std::set<std::string> done;
  cost[to] = 0.0;
  for (;;) {
    std::optional<std::string> next;
    for (const auto& [frame, c] : cost)
      if (done.count(frame) == 0 && (!next || c < cost.at(*next))) next = frame;
    if (!next) return std::nullopt;
    if (*next == from) break;
    done.insert(*next);
    for (const Neighbour& n : neighbours(*next)) {
      if (without && n.edge == *without) continue;
      // A tiny price for each edge: of equally good ways the shorter.
      const double c = cost.at(*next) + edge_cost(edges_[n.edge], dental_from) + 1e-12;
      const auto known = cost.find(n.frame);
      if (known != cost.end() && known->second <= c) continue;
      cost[n.frame] = c;
      arrived_by[n.frame] = {n.edge, n.inverse};
      came_from[n.frame] = *next;
    }
  }
  std::vector<FramePath::Step> steps;
  for (std::string frame = from; frame != to; frame = came_from.at(frame))
    steps.push_back(arrived_by.at(frame));
  std::reverse(steps.begin(), steps.end());
  return steps;
}

/// exp(ξ)·X after a prefix P moves the product by Ad_P ξ; X⁻¹ with X perturbed is X⁻¹·exp(−ξ), which moves it
/// by −Ad_{P·X⁻¹} ξ. Edges of one estimate add up before they are squared.
std::optional<Matrix6> FramesGraph::covariance_of(const std::vector<FramePath::Step>& steps) const {
  std::map<std::string, Matrix6> by_estimate, covariances;
  Rigid3 prefix;
  for (const FramePath::Step& step : steps) {
    const FrameEdge& e = edges_[step.edge];
    if (!e.covariance) return std::nullopt;
    const auto known = by_estimate.try_emplace(e.estimate, Matrix6::Zero()).first;
    if (!step.inverse) known->second += adjoint(prefix);
    prefix = prefix * (step.inverse ? e.to_from_from.inverse() : e.to_from_from);
    if (step.inverse) known->second -= adjoint(prefix);
    covariances[e.estimate] = *e.covariance;
  }
  Matrix6 sum = Matrix6::Zero();
  for (const auto& [a, by_a] : by_estimate) {
    for (const auto& [b, by_b] : by_estimate) {
      if (a == b) {
        sum += by_a * covariances.at(a) * by_a.transpose();
        continue;
      }
      const auto cross = cross_.find({a, b});
      if (cross != cross_.end()) sum += by_a * cross->second * by_b.transpose();
    }
  }
  return Matrix6(0.5 * (sum + sum.transpose()));
}

FramePath FramesGraph::composed(const std::string& to, const std::string& from,
                                std::vector<FramePath::Step> steps) const {
  FramePath path{to, from, std::move(steps), {}, {}, {}};
  for (const FramePath::Step& step : path.steps) {
    const Rigid3& x = edges_[step.edge].to_from_from;
    path.to_from_from = path.to_from_from * (step.inverse ? x.inverse() : x);
  }
  path.covariance = covariance_of(path.steps);
  if (path.covariance)
    path.at_teeth_mm = std::sqrt(std::max(0.0, mean_square_mm2(*path.covariance, teeth_in(to))));
  return path;
}

Result<FramePath> FramesGraph::path(const std::string& to, const std::string& from) const {
  const std::vector<std::string> known = frames();
  for (const std::string& name : {to, from})
    if (std::find(known.begin(), known.end(), name) == known.end())
      return bad_input("cannot compose frames", name, "no such frame; there are " + joined(known));
  const auto steps = cheapest(to, from, std::nullopt);
  if (!steps) return bad_input("cannot compose frames", to + " <- " + from, "no registration links them");
  return composed(to, from, *steps);
}

std::vector<FrameLoop> FramesGraph::loops() const {
  std::vector<FrameLoop> out;
  std::set<std::vector<std::size_t>> seen;
  for (std::size_t i = 0; i < edges_.size(); ++i) {
    const auto back = cheapest(edges_[i].from, edges_[i].to, i);
    if (!back) continue;
    FrameLoop loop;
    loop.steps.push_back({i, false});
    loop.steps.insert(loop.steps.end(), back->begin(), back->end());
    std::vector<std::size_t> members;
    for (const auto& step : loop.steps) members.push_back(step.edge);
    std::sort(members.begin(), members.end());
    if (!seen.insert(members).second) continue;
    for (const auto& step : loop.steps)
      loop.frames.push_back(step.inverse ? edges_[step.edge].from : edges_[step.edge].to);
    const FramePath around = composed(loop.frames.front(), loop.frames.front(), loop.steps);
    loop.angle_deg = around.to_from_from.angle_rad() * kDegPerRad;
    for (const Vector3& p : teeth_in(loop.frames.front()))
      loop.at_teeth_mm = std::max(loop.at_teeth_mm, (around.to_from_from * p - p).norm());
    if (around.covariance) {
      const Vector6 xi = log_se3(around.to_from_from);
      // Edges that claim to be exact leave nothing to weigh by: any opening contradicts them.
      const Eigen::LLT<Matrix6> factor(*around.covariance);
      const double open = xi.norm() > 1e-9 ? 1e9 : 0.0;
      const double chi2 = factor.info() == Eigen::Success ? std::min(1e9, xi.dot(factor.solve(xi))) : open;
      loop.mahalanobis = std::sqrt(chi2);
      // Survival function of χ² with 6 degrees of freedom, in closed form.
      loop.p_value = std::exp(-0.5 * chi2) * (1.0 + 0.5 * chi2 + 0.125 * chi2 * chi2);
    }
    out.push_back(std::move(loop));
  }
  return out;
}

FramesGraph FramesGraph::without(std::size_t edge) const {
  FramesGraph rest = *this;
  rest.edges_.erase(rest.edges_.begin() + static_cast<std::ptrdiff_t>(edge));
  return rest;
}

std::vector<FrameSuspect> FramesGraph::suspects(const std::vector<FrameLoop>& loops) const {
  std::set<std::size_t> in_open;
  for (const FrameLoop& loop : loops)
    if (!loop.consistent())
      for (const auto& step : loop.steps) in_open.insert(step.edge);
  std::vector<FrameSuspect> all;
  for (const std::size_t edge : in_open) {
    FrameSuspect s;
    s.edge = edge;
    for (const FrameLoop& loop : without(edge).loops()) s.open_without += loop.consistent() ? 0 : 1;
    all.push_back(s);
  }
  std::size_t least = std::numeric_limits<std::size_t>::max();
  for (const FrameSuspect& s : all) least = std::min(least, s.open_without);
  std::vector<FrameSuspect> out;
  for (const FrameSuspect& s : all)
    if (s.open_without == least) out.push_back(s);
  if (out.size() == 1 && least == 0) out.front().certain = true;
  return out;
}

}  // namespace gnathion
