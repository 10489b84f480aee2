#include "pipeline/html_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include <nlohmann/json.hpp>

#include "core/xml.h"
#include "registration/point_grid.h"
#include "rendering/charts.h"
#include "rendering/decimate.h"

namespace gnathion {
namespace {

using nlohmann::json;

constexpr std::int16_t kNoValue = -32768;

template <class Number>
void put(std::string& to, Number value) {
  for (std::size_t i = 0; i < sizeof value; ++i) to += static_cast<char>(value >> (8 * i) & 0xff);
}

json vector_json(const Vector3& v) {
  return {std::round(v.x() * 1e4) / 1e4, std::round(v.y() * 1e4) / 1e4, std::round(v.z() * 1e4) / 1e4};
}

json pose_json(const Rigid3& pose) {
  json out = json::array();
  const Matrix4 m = pose.matrix();
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) out.push_back(std::round(m(r, c) * 1e7) / 1e7);
  return out;
}

/// Positions as 16 bits an axis of the bounding box: 1 µm on an arch.
json mesh_json(const TriangleMesh& mesh) {
  const Box box = bounding_box(mesh);
  const Vector3 size = box.size_mm().cwiseMax(Vector3::Constant(1e-6));
  std::string positions, indices;
  for (const Vector3& v : mesh.vertices_mm)
    for (int k = 0; k < 3; ++k)
      put(positions, static_cast<std::uint16_t>(std::lround(65535 * (v[k] - box.min_mm[k]) / size[k])));
  const bool wide = mesh.vertices_mm.size() > 65535;
  for (const Triangle& t : mesh.triangles)
    for (const std::uint32_t i : t) {
      if (wide)
        put(indices, i);
      else
        put(indices, static_cast<std::uint16_t>(i));
    }
  return {{"low_mm", vector_json(box.min_mm)},
          {"size_mm", vector_json(size)},
          {"positions", base64(positions)},
          {"indices", base64(indices)},
          {"wide", wide},
          {"triangles", mesh.triangles.size()}};
}

/// Distances of the nearest measured points of the full scan, in µm.
std::string values_json(const TriangleMesh& small, const DistanceField& field, const PointGrid& grid) {
  std::string values;
  for (const Vector3& v : small.vertices_mm) {
    const long i = grid.nearest(v, 2.0);
    std::int16_t value = kNoValue;
    if (i >= 0 && is_measured(field.use[static_cast<std::size_t>(i)]))
      value = static_cast<std::int16_t>(std::lround(
          std::clamp(1000.0 * field.distance_mm[static_cast<std::size_t>(i)], -32000.0, 32000.0)));
    put(values, static_cast<std::uint16_t>(value));
  }
  return base64(values);
}

class Packer {
 public:
  explicit Packer(const HtmlViewOptions& options) : options_(options) {}

  void add(const SplintEvaluation& s, std::size_t index) {
    planned(s.planned.splint, "planned splint", palette::kSplintClear, 0.45, index);
    planned(s.planned.maxilla, "maxilla, model", palette::kToothIvory, 0.4, index);
    planned(s.mandible_tp, "mandible in TP, model", palette::kMandibleIvory, 0.4, index);
    // One mesh for all procedures that measured the same scan: only pose and distances differ.
    std::map<const TriangleMesh*, std::vector<const ProcedureResult*>> scans;
    std::vector<const TriangleMesh*> order;
    for (const ProcedureResult& p : s.procedures) {
      auto& of = scans[p.field.scan.get()];
      if (of.empty()) order.push_back(p.field.scan.get());
      of.push_back(&p);
    }
    for (const TriangleMesh* scan : order) scanned(*scan, scans[scan], index);
  }
  json meshes = json::array();

 private:
  /// The same model of several splints is packed once and referred to.
  void planned(const SharedMesh& mesh, const char* layer, const Color& color, double opacity,
               std::size_t index) {
    if (!mesh || mesh->empty()) return;
    json j;
    if (const auto known = packed_.find(mesh.get()); known != packed_.end()) {
      const json& first = meshes[known->second];
      j = {{"same_as", known->second}, {"low_mm", first["low_mm"]}, {"size_mm", first["size_mm"]}};
    } else {
      j = mesh_json(decimated(*mesh, options_.triangles));
      packed_[mesh.get()] = meshes.size();
    }
    j.update({{"layer", layer},
              {"splint", index},
              {"planned", true},
              {"color", color},
              {"opacity", opacity},
              {"fields", json::array()}});
    meshes.push_back(std::move(j));
  }
  void scanned(const TriangleMesh& scan, const std::vector<const ProcedureResult*>& results,
               std::size_t index) {
    static const char* const names[] = {"scanned splint",  "scanned maxilla",  "scanned mandible",
                                        "scanned maxilla", "scanned mandible", "scanned mandible"};
    static const Color colors[] = {{0.55, 0.70, 0.82}, {0.88, 0.76, 0.72}, {0.74, 0.82, 0.72}};
    static const std::size_t body[] = {0, 1, 2, 1, 2, 2};  // of each procedure's scan
    const auto first = static_cast<std::size_t>(results.front()->procedure);
    const TriangleMesh small = decimated(scan, options_.triangles);
    const double spacing =
        std::sqrt(surface_area_mm2(scan) / static_cast<double>(scan.vertices_mm.size() + 1));
    const PointGrid grid(scan.vertices_mm, std::max(0.2, 2 * spacing));
    json j = mesh_json(small);
    j.update({{"layer", names[body[first]]},
              {"splint", index},
              {"planned", false},
              {"color", colors[body[first]]},
              {"opacity", 1.0},
              {"pose", pose_json(results.front()->field.dental_from_scan)},
              {"fields", json::array()}});
    for (const ProcedureResult* r : results)
      j["fields"].push_back({{"procedure", procedure_name(r->procedure)},
                             {"pose", pose_json(r->field.dental_from_scan)},
                             {"values_um", values_json(small, r->field, grid)}});
    meshes.push_back(std::move(j));
  }
  HtmlViewOptions options_;
  std::map<const TriangleMesh*, std::size_t> packed_;  ///< place in `meshes`
};

std::string facts_of(const ProcedureResult& p) {
  std::string text = fmt::format("N {}, AVG {} mm, STD {:.3f} mm", p.field.all.n,
                                 signed_number(p.field.all.avg_mm, 3, true), p.field.all.std_mm);
  if (p.motion)
    text += fmt::format("; α {:.3f}°, t {:.3f} mm, largest at the teeth {:.3f} mm", p.motion->alpha_deg,
                        p.motion->t_mm, p.motion->max_tooth_mm);
  return text;
}

json procedures_json(const std::vector<SplintEvaluation>& splints) {
  json out = json::array();
  for (std::size_t k = 0; k < kProcedureCount; ++k) {
    const auto procedure = static_cast<Procedure>(k);
    json facts = json::array();
    bool any = false;
    for (const SplintEvaluation& s : splints) {
      const ProcedureResult* p = s.find(procedure);
      any |= p != nullptr;
      facts.push_back(p ? json(facts_of(*p)) : json());
    }
    if (any)
      out.push_back(
          {{"name", procedure_name(procedure)}, {"title", procedure_title(procedure)}, {"facts", facts}});
  }
  return out;
}

/// Right, up and towards-viewer axes of each view.
json views_json(const ArchFrame& f) {
  const auto view = [](const Vector3& right, const Vector3& up) {
    return json::array({vector_json(right), vector_json(up), vector_json(right.cross(up))});
  };
  // Named so that the order of the buttons is the order of the file.
  return json::array({{{"name", "from below"}, {"axes", view(f.left, f.anterior)}},
                      {{"name", "from above"}, {"axes", view(-f.left, f.anterior)}},
                      {{"name", "front"}, {"axes", view(f.left, f.up)}},
                      {{"name", "patient's right"}, {"axes", view(f.anterior, f.up)}},
                      {{"name", "patient's left"}, {"axes", view(-f.anterior, f.up)}}});
}

std::string colour_map() {
  std::string text;
  for (int i = 0; i < 256; ++i)
    for (const double c : diverging_color(2 * i / 255.0 - 1))
      text += fmt::format("{:02x}", static_cast<int>(std::lround(255 * c)));
  return text;
}

constexpr const char* kControls = R"html(<div id=view>
<div class=bar><label>splint <select id=view-splint></select></label><label>distances of <select id=view-procedure></select></label><label>range <input id=view-range type=range min=0.05 max=1 step=0.01></label><span id=view-buttons></span></div>
<div id=view-stage><canvas id=view-canvas tabindex=0 aria-label="3D view of the scanned and planned surfaces"></canvas><div id=view-reading></div>
<div id=view-legend><div id=view-bar></div><div class=ends><span id=view-low></span><span>0</span><span id=view-high></span></div>+ outside the model; grey: not measured</div><div id=view-scale></div></div>
<div class=bar><span id=view-layers></span></div><div class=bar><span id=view-facts></span></div>
<div class=bar>Drag to turn, shift-drag or two fingers to move, wheel or pinch to zoom, click to read the distance; arrow keys, + and − work too. <span id=view-status role=status>the 3D view needs JavaScript and WebGL</span></div></div>
)html";

}  // namespace

std::string html_view(const std::vector<SplintEvaluation>& splints, const HtmlViewOptions& options) {
  Packer packer(options);
  json names = json::array();
  for (std::size_t i = 0; i < splints.size(); ++i) {
    names.push_back(splints[i].name);
    packer.add(splints[i], i);
  }
  const json data = {{"splints", names},
                     {"procedures", procedures_json(splints)},
                     {"views", views_json(splints.front().arch)},
                     {"range_mm", options.range_mm},
                     {"colour_map", colour_map()},
                     {"not_measured", kNotMeasured},
                     {"meshes", std::move(packer.meshes)}};
  // A name may hold "</script>": inside JSON, < can always be written as an escape.
  std::string text;
  for (const char c : data.dump(-1, ' ', false, json::error_handler_t::replace)) {
    if (c == '<')
      text += "\\u003c";
    else
      text += c;
  }
  return fmt::format("{}<script type=\"application/json\" id=view-data>{}</script>\n<script>\n{}</script>\n",
                     kControls, text, kHtmlViewScript);
}

}  // namespace gnathion
