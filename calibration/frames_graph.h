// The patient's frames and the registrations between them: one graph, the method's "unified coordinate
// system".
//
// A frame belongs to a body at one position of the jaw: the bow in MI and the bow in TP are two frames. An
// edge is one registration. Edges that rest on one estimate (T_D seats the bow on the mandible in MI and in
// TP alike) name it, and their errors are then one error.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/result.h"
#include "core/rigid.h"

namespace gnathion {

/// p_to = to_from_from · p_from, both in millimetres.
struct FrameEdge {
  std::string to, from;
  Rigid3 to_from_from;
  std::optional<Matrix6> covariance;  ///< of the left perturbation, in `to`; nothing: unknown
  std::string date;                   ///< ISO 8601, UTC; empty: unknown
  std::string source;                 ///< what it was registered from, in words
  /// Edges with the same estimate share its error. Empty: this edge's own.
  std::string estimate;
  bool by_hand = false;  ///< from case.toml

  std::string name() const { return to + " <- " + from; }
};

/// A product of edges.
struct FramePath {
  struct Step {
    std::size_t edge = 0;
    bool inverse = false;  ///< walked against its direction
  };
  std::string to, from;
  std::vector<Step> steps;  ///< from left to right of the product
  Rigid3 to_from_from;
  std::optional<Matrix6> covariance;  ///< nothing where an edge's is unknown
  std::optional<double> at_teeth_mm;  ///< RMS error that the covariance forecasts at the teeth
};

/// A closed way through the graph: its product should be the identity.
struct FrameLoop {
  std::vector<FramePath::Step> steps;
  std::vector<std::string> frames;  ///< in the order of the steps, the first one not repeated
  double angle_deg = 0.0;
  double at_teeth_mm = 0.0;  ///< largest distance over the teeth by which it does not close
  /// Nothing where an edge's covariance is unknown.
  std::optional<double> mahalanobis, p_value;
  bool consistent() const { return !p_value || *p_value >= 0.003; }
};

/// An edge that contradicts the others.
struct FrameSuspect {
  std::size_t edge = 0;
  std::size_t open_without = 0;  ///< loops that would still not close if this edge were left out
  bool certain = false;          ///< without it, and it alone, all loops close
};

class FramesGraph {
 public:
  /// The teeth, in the frame named "dental": where errors are told. Without them a frame's own origin serves.
  explicit FramesGraph(std::vector<Vector3> teeth_in_dental_mm = {})
      : teeth_mm_(std::move(teeth_in_dental_mm)) {}

  /// Refuses (kInput) an edge from a frame to itself, without names, or with a covariance that is none.
  Status add(FrameEdge edge);
  /// Cov(ξ_a, ξ_b) of two estimates' left perturbations.
  void set_cross_covariance(const std::string& a, const std::string& b, const Matrix6& covariance);

  const std::vector<FrameEdge>& edges() const { return edges_; }
  const std::vector<Vector3>& teeth_mm() const { return teeth_mm_; }
  /// By pair of estimates, both orders.
  const std::map<std::pair<std::string, std::string>, Matrix6>& cross_covariances() const { return cross_; }
  std::vector<std::string> frames() const;  ///< in order of first mention

  /// The path with the least forecast error at the teeth; edges without covariance are used only where there
  /// is no other way. Errors (kInput): an unknown frame (the known ones are listed), no way.
  Result<FramePath> path(const std::string& to, const std::string& from) const;
  /// The shortest loop over each edge, each loop once.
  std::vector<FrameLoop> loops() const;
  /// Edges of open loops without which the fewest loops stay open; where several do equally well, all.
  std::vector<FrameSuspect> suspects(const std::vector<FrameLoop>& loops) const;

 private:
  struct Neighbour {
    std::size_t edge;
    bool inverse;
    std::string frame;
  };
  std::vector<Neighbour> neighbours(const std::string& frame) const;
  FramesGraph without(std::size_t edge) const;
  std::map<std::string, Rigid3> placed() const;
  double edge_cost(const FrameEdge& edge, const std::map<std::string, Rigid3>& dental_from) const;
  FramePath composed(const std::string& to, const std::string& from,
                     std::vector<FramePath::Step> steps) const;
  std::optional<Matrix6> covariance_of(const std::vector<FramePath::Step>& steps) const;
  std::vector<Vector3> teeth_in(const std::string& frame) const;
  std::optional<std::vector<FramePath::Step>> cheapest(const std::string& to, const std::string& from,
                                                       std::optional<std::size_t> without) const;

  std::vector<Vector3> teeth_mm_;
  std::vector<FrameEdge> edges_;
  std::map<std::pair<std::string, std::string>, Matrix6> cross_;
};

}  // namespace gnathion
