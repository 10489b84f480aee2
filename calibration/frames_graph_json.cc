#include "calibration/frames_graph_json.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/angle.h"
#include "core/transform_io.h"

namespace gnathion {
namespace {

using nlohmann::json;

constexpr const char* kCannotReadFrames = "cannot read frames";

json steps_json(const FramesGraph& graph, const std::vector<FramePath::Step>& steps) {
  json out = json::array();
  for (const FramePath::Step& s : steps)
    out.push_back({{"edge", graph.edges()[s.edge].name()}, {"index", s.edge}, {"inverse", s.inverse}});
  return out;
}

template <class T>
json optional_json(const std::optional<T>& value) {
  return value ? json(*value) : json();
}

std::string text_or(const json& j, const char* key) {
  return j.contains(key) && j[key].is_string() ? j[key].get<std::string>() : std::string();
}

Result<FrameEdge> edge_from_json(const json& j, const std::string& where) {
  if (!j.is_object()) return bad_input(kCannotReadFrames, where, "an edge is not an object");
  FrameEdge e;
  e.to = text_or(j, "to");
  e.from = text_or(j, "from");
  e.date = text_or(j, "date");
  e.source = text_or(j, "source");
  e.estimate = text_or(j, "estimate");
  e.by_hand = j.contains("by_hand") && j["by_hand"] == true;
  const std::string name = where + ": " + e.name();
  if (!j.contains("matrix")) return bad_input(kCannotReadFrames, name, "no 'matrix'");
  GNATHION_TRY(const Matrix4 m, matrix_from_json(j["matrix"], name));
  if (!rigidity_deviation(m).is_rigid())
    return bad_input(kCannotReadFrames, name, "the matrix is not a rigid motion");
  e.to_from_from = nearest_rigid(m);
  if (j.contains("covariance") && !j["covariance"].is_null()) {
    GNATHION_TRY(e.covariance, covariance_from_json(j["covariance"], name));
  }
  return e;
}

/// Cross covariances are not symmetric: no check but for numbers.
Result<Matrix6> block_from_json(const json& j, const std::string& where) {
  Matrix6 m;
  const auto bad = [&] {
    return bad_input(kCannotReadFrames, where, "a cross covariance is not 6x6 numbers");
  };
  if (!j.is_array() || j.size() != 6) return bad();
  for (std::size_t r = 0; r < 6; ++r) {
    if (!j[r].is_array() || j[r].size() != 6) return bad();
    for (std::size_t c = 0; c < 6; ++c) {
      if (!j[r][c].is_number() || !std::isfinite(j[r][c].get<double>())) return bad();
      m(static_cast<long>(r), static_cast<long>(c)) = j[r][c].get<double>();
    }
  }
  return m;
}

std::string sigma_text(const FrameEdge& e) {
  if (!e.covariance) return "unknown";
  const Matrix6& c = *e.covariance;
  return fmt::format("{:.3f} mm {:.3f} deg", std::sqrt(c.bottomRightCorner<3, 3>().trace()),
                     std::sqrt(c.topLeftCorner<3, 3>().trace()) * kDegPerRad);
}

}  // namespace

json frames_json(const FramesGraph& graph) {
  json teeth = json::array(), edges = json::array(), cross = json::array(), loops = json::array(),
       suspects = json::array();
  for (const Vector3& p : graph.teeth_mm()) teeth.push_back({p.x(), p.y(), p.z()});
  for (const FrameEdge& e : graph.edges())
    edges.push_back({{"to", e.to},
                     {"from", e.from},
                     {"matrix", matrix_json(e.to_from_from.matrix())},
                     {"covariance", e.covariance ? covariance_json(*e.covariance) : json()},
                     {"date", e.date.empty() ? json() : json(e.date)},
                     {"source", e.source},
                     {"estimate", e.estimate},
                     {"by_hand", e.by_hand}});
  for (const auto& [pair, block] : graph.cross_covariances())
    if (pair.first < pair.second)
      cross.push_back({{"a", pair.first}, {"b", pair.second}, {"covariance", covariance_json(block)}});
  const std::vector<FrameLoop> found = graph.loops();
  for (const FrameLoop& loop : found)
    loops.push_back({{"frames", loop.frames},
                     {"steps", steps_json(graph, loop.steps)},
                     {"at_teeth_mm", loop.at_teeth_mm},
                     {"angle_deg", loop.angle_deg},
                     {"mahalanobis", optional_json(loop.mahalanobis)},
                     {"p_value", optional_json(loop.p_value)},
                     {"consistent", loop.p_value ? json(loop.consistent()) : json()}});
  for (const FrameSuspect& s : graph.suspects(found))
    suspects.push_back({{"edge", graph.edges()[s.edge].name()},
                        {"index", s.edge},
                        {"open_without", s.open_without},
                        {"certain", s.certain}});
  return {{"kind", "frames"}, {"unit", "mm"},   {"frames", graph.frames()}, {"teeth_mm", teeth},
          {"edges", edges},   {"loops", loops}, {"suspects", suspects},     {"cross_covariances", cross}};
}

json path_json(const FramesGraph& graph, const FramePath& path) {
  return {{"kind", "pose"},
          {"to", path.to},
          {"from", path.from},
          {"unit", "mm"},
          {"matrix", matrix_json(path.to_from_from.matrix())},
          {"covariance", path.covariance ? covariance_json(*path.covariance) : json()},
          {"at_teeth_mm", optional_json(path.at_teeth_mm)},
          {"steps", steps_json(graph, path.steps)}};
}

Result<FramesGraph> frames_from_json(const json& j, const std::string& where) {
  if (!j.is_object() || j.value("kind", json()) != "frames")
    return bad_input(kCannotReadFrames, where, "not a file of kind 'frames'");
  if (j.contains("unit") && j["unit"] != "mm") return bad_input(kCannotReadFrames, where, "unit is not mm");
  std::vector<Vector3> teeth_mm;
  if (j.contains("teeth_mm") && j["teeth_mm"].is_array()) {
    for (const json& p : j["teeth_mm"]) {
      if (!p.is_array() || p.size() != 3 || !p[0].is_number() || !p[1].is_number() || !p[2].is_number())
        return bad_input(kCannotReadFrames, where, "'teeth_mm' holds a point that is none");
      teeth_mm.emplace_back(p[0].get<double>(), p[1].get<double>(), p[2].get<double>());
    }
  }
  FramesGraph graph(std::move(teeth_mm));
  if (!j.contains("edges") || !j["edges"].is_array())
    return bad_input(kCannotReadFrames, where, "no 'edges'");
  for (const json& e : j["edges"]) {
    GNATHION_TRY(FrameEdge edge, edge_from_json(e, where));
    GNATHION_CHECK_OK(graph.add(std::move(edge)));
  }
  if (j.contains("cross_covariances") && j["cross_covariances"].is_array()) {
    for (const json& c : j["cross_covariances"]) {
      if (!c.is_object() || !c.contains("covariance"))
        return bad_input(kCannotReadFrames, where, "a cross covariance is empty");
      GNATHION_TRY(const Matrix6 block, block_from_json(c["covariance"], where));
      graph.set_cross_covariance(text_or(c, "a"), text_or(c, "b"), block);
    }
  }
  return graph;
}

std::string frames_text(const FramesGraph& graph) {
  std::string text = fmt::format("{:<16} {:<16} {:<26} {:<20} {}\n", "to", "from", "1 sigma at its origin",
                                 "date", "source");
  for (const FrameEdge& e : graph.edges())
    text += fmt::format("{:<16} {:<16} {:<26} {:<20} {}{}\n", e.to, e.from, sigma_text(e),
                        e.date.empty() ? "unknown" : e.date, e.source, e.by_hand ? " (by hand)" : "");
  const std::vector<FrameLoop> loops = graph.loops();
  if (loops.empty()) text += "no closed loops: nothing checks these registrations against each other\n";
  for (const FrameLoop& loop : loops) {
    text += "loop ";
    for (const std::string& f : loop.frames) text += f + " - ";
    text += loop.frames.front() +
            fmt::format(": open by {:.3f} mm at the teeth, {:.3f} deg", loop.at_teeth_mm, loop.angle_deg);
    text += !loop.p_value ? ", an edge's covariance is unknown: not judged\n"
            : loop.consistent()
                ? fmt::format(", within the stated errors (p = {:.3f})\n", *loop.p_value)
                : fmt::format(", MORE than the stated errors allow (p = {:.2g})\n", *loop.p_value);
  }
  for (const FrameSuspect& s : graph.suspects(loops))
    text += fmt::format("{} {}: without it {}\n", s.certain ? "inconsistent" : "perhaps inconsistent",
                        graph.edges()[s.edge].name(),
                        s.open_without == 0 ? std::string("all loops close")
                                            : fmt::format("{} loop(s) stay open", s.open_without));
  return text;
}

std::string path_text(const FramesGraph& graph, const FramePath& path) {
  std::string text = fmt::format("{} <- {}", path.to, path.from);
  text += path.steps.empty() ? ": the same frame\n" : ", by\n";
  for (const FramePath::Step& s : path.steps) {
    const FrameEdge& e = graph.edges()[s.edge];
    text += fmt::format("  {}{}: {}\n", e.name(), s.inverse ? ", inverse" : "", e.source);
  }
  const Matrix4 m = path.to_from_from.matrix();
  for (int r = 0; r < 4; ++r)
    text += fmt::format("{:12.6f} {:12.6f} {:12.6f} {:12.6f}\n", m(r, 0), m(r, 1), m(r, 2), m(r, 3));
  return text + (path.at_teeth_mm
                     ? fmt::format("forecast error at the teeth: {:.3f} mm RMS\n", *path.at_teeth_mm)
                     : std::string("error unknown: an edge on the way has no covariance\n"));
}

}  // namespace gnathion
