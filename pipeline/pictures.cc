#include "pipeline/pictures.h"

#include <fmt/format.h>

namespace gnathion {
namespace fs = std::filesystem;
namespace {

SceneView view_from(const Vector3& direction, const Vector3& up, double zoom = 1.0) {
  return {direction.normalized(), up, zoom};
}

Status draw_scenes(const SplintInputs& in, const SplintDesign& d, const fs::path& folder) {
  const ArchFrame& f = d.arch;
  const auto item = [](const TriangleMesh& mesh, const Color& color) {
    SceneMesh m;
    m.mesh = &mesh;
    m.color = color;
    return m;
  };
  const bool upper = in.on_maxilla();
  const SceneMesh support = item(in.support(), upper ? palette::kToothIvory : palette::kMandibleIvory);
  const SceneMesh opposing = item(d.opposing_tp, upper ? palette::kMandibleIvory : palette::kToothIvory);
  const SceneMesh splint = item(d.splint, palette::kSplintClear);
  SceneMesh clear = splint;
  clear.opacity = 0.55;
  const Vector3 gingival = f.gingival(in.arch);
  const Vector3 oblique = f.anterior + 0.75 * f.left - 0.35 * gingival;
  PictureOptions o;
  const std::string jaw = upper ? "maxilla" : "mandible";
  o.title = "Splint on the " + jaw + ", from the occlusal side";
  GNATHION_CHECK_OK(render_scene(folder / ("splint_on_" + jaw + ".png"), {support, splint}, {},
                                 view_from(-gingival, f.anterior), o));
  o.title = "Splint, its cavity side";
  GNATHION_CHECK_OK(
      render_scene(folder / "splint_cavity.png", {splint}, {}, view_from(gingival, f.anterior), o));
  o.title = "Jaws in the therapeutic position with the splint, from the left front";
  GNATHION_CHECK_OK(
      render_scene(folder / "jaws_in_tp.png", {support, opposing, clear}, {}, view_from(oblique, f.up), o));
  o.title = "Jaws in the therapeutic position with the splint, from the right";
  return render_scene(folder / "jaws_in_tp_right.png", {support, opposing, clear}, {},
                      view_from(-f.left, f.up), o);
}

PlotCurve curve_of(const char* name, const Color& color, double width_px, const TriangleMesh& mesh,
                   const SectionPlane& plane) {
  return {name, color, width_px, cut_mesh(mesh, plane)};
}

Status draw_section(const SplintInputs& in, const SplintDesign& d, double s_mm, const std::string& name,
                    const std::string& title, const fs::path& folder) {
  const SectionPlane plane = arch_section(d.arch, s_mm);
  const bool upper = in.on_maxilla();
  const std::vector<PlotCurve> curves = {
      curve_of("splint", palette::kSplint, 5.0, d.splint, plane),
      curve_of(upper ? "maxilla" : "maxilla in TP", palette::kMaxilla, 2.0,
               upper ? in.maxilla : d.opposing_tp, plane),
      curve_of(upper ? "mandible in TP" : "mandible", palette::kMandible, 2.0,
               upper ? d.opposing_tp : in.mandible_mi, plane),
      curve_of("inner surface", palette::kInner, 1.5, d.cavity, plane),
      curve_of("outer surface", palette::kOuter, 1.5, d.outer, plane),
      curve_of("occlusal surface in TP", palette::kOcclusalTp, 1.5, d.occlusal_surface_tp, plane)};
  PlotOptions o;
  o.title = title;
  o.x_label = "buccal [mm]";
  o.y_label = "up, towards the maxilla [mm]";
  o.equal_axes = true;
  o.x_range = {-11.0, 9.0};
  o.y_range = {-11.0, 9.0};
  return plot_curves(folder / name, curves, o);
}

}  // namespace

SectionPlane arch_section(const ArchFrame& frame, double s_mm) {
  const ArchRuler ruler(frame);
  return {ruler.at(s_mm), ruler.outward(s_mm), frame.up};
}

Status draw_design(const SplintInputs& inputs, const SplintDesign& design, const fs::path& folder) {
  std::error_code ec;
  fs::create_directories(folder, ec);
  GNATHION_CHECK_OK(draw_scenes(inputs, design, folder));
  // Mean distances of tooth centres from the midline along the arch (Wheeler's widths summed).
  GNATHION_CHECK_OK(draw_section(inputs, design, 40.0, "section_molar.png",
                                 "Cross-section at the left first molar", folder));
  GNATHION_CHECK_OK(draw_section(inputs, design, 26.0, "section_premolar.png",
                                 "Cross-section at the left first premolar", folder));
  return draw_section(inputs, design, 4.5, "section_incisor.png", "Cross-section at the left central incisor",
                      folder);
}

Status draw_jaw_path(const JawMotion& motion, const Vector3& incisal_point_mm, const ArchFrame& frame,
                     const fs::path& folder) {
  std::error_code ec;
  fs::create_directories(folder, ec);
  PlotCurve sagittal{"seen from the left", palette::kMaxilla, 1.5, {{}}};
  PlotCurve frontal{"seen from the front", palette::kMandible, 1.5, {{}}};
  PlotCurve opening{"opening", palette::kInner, 1.5, {{}}},
      forward{"protrusion", palette::kMandible, 1.5, {{}}},
      left{"to the left", palette::kOcclusalTp, 1.5, {{}}};
  bool gap = false;
  for (const JawMotionRow& row : motion.rows) {
    if (!row.valid) {
      gap = true;
      continue;
    }
    if (gap)  // a gap stays a gap
      for (PlotCurve* c : {&sagittal, &frontal, &opening, &forward, &left}) c->lines.emplace_back();
    gap = false;
    const Vector3 d = row.motion * incisal_point_mm - incisal_point_mm;
    const double up = d.dot(frame.up), ahead = d.dot(frame.anterior), aside = d.dot(frame.left);
    sagittal.lines.back().emplace_back(-ahead, up);
    frontal.lines.back().emplace_back(aside, up);
    opening.lines.back().emplace_back(row.time_s, -up);
    forward.lines.back().emplace_back(row.time_s, ahead);
    left.lines.back().emplace_back(row.time_s, aside);
  }
  PlotOptions o;
  o.equal_axes = true;
  o.title = "Path of the lower incisal point, relative to MI";
  o.x_label = "posterior (sagittal), patient's left (frontal) [mm]";
  o.y_label = "up [mm]";
  GNATHION_CHECK_OK(plot_curves(folder / "jaw_path.png", {sagittal, frontal}, o));
  PlotOptions t;
  t.title = "Lower incisal point over time, relative to MI";
  t.x_label = "time [s]";
  t.y_label = "displacement [mm]";
  return plot_curves(folder / "jaw_motion.png", {opening, forward, left}, t);
}

}  // namespace gnathion
