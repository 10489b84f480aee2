// The Design step: what is measured on a splint and shown on it, and where a gate's figure has its place.
#include "viewer/panels/design_panel.h"

#include <QCheckBox>

#include <cmath>

#include <nlohmann/json.hpp>

#include "rendering/charts.h"
#include "viewer/model/colour_maps.h"

namespace gnathion {

/// The teeth that wear what is shown: the preview, or the design.
Arch DesignPanel::worn() const {
  const Document& d = bench_.document;
  if (!d.is_open()) return Arch::kMaxilla;
  const bool design = report_ && report_->contains("arch") && !preview_->isChecked();
  if (!design) return d.state().arch;
  return (*report_)["arch"] == "mandible" ? Arch::kMandible : Arch::kMaxilla;
}

/// A splint of the lower teeth stays where it is made, on the lower jaw in MI, and the upper jaw comes to it
/// as it does in TP: strokes, margin and maps keep their frame.
void DesignPanel::pose_jaws() {
  LayerModel& layers = document().layers();
  const auto& t = document().state().therapeutic;
  const bool lower = t && worn() == Arch::kMandible;
  layers.set_pose("maxilla", lower ? t->inverse() : Rigid3::identity());
  if (lower == on_lower_) {
    if (maps_ && (maps_arch_ == Arch::kMandible) != lower) show_marks();  // they follow T_th
    return;
  }
  on_lower_ = lower;
  show_marks();
  const char *before = lower ? "mandible_tp" : "mandible_mi", *now = lower ? "mandible_mi" : "mandible_tp";
  if (!layers.shows(before)) return;
  layers.set_visible(before, false);
  layers.set_visible(now, true);
}

/// Inner and outer surface, thickness, undercut, numbers: measured once a splint, in the background.
void DesignPanel::make_maps() {
  const Layer* splint = document().layers().find("splint");
  const CaseContent& c = document().content();
  if (!splint || !c.arch || !document().state().therapeutic) return;
  struct Made {
    SplintMaps maps;
    std::vector<float> undercut;
    std::vector<ToothLabel> teeth;
  };
  auto made = std::make_shared<Made>();
  const bool upper = worn() == Arch::kMaxilla;
  const Rigid3 t = *document().state().therapeutic;
  bench_.jobs.run_latest(
      "maps",
      [mesh = splint->mesh, content = document().shared_content(), upper, t, made](JobContext& context) {
        const TriangleMesh &maxilla = *content->mesh("maxilla_mi"), &mandible = *content->mesh("mandible_mi");
        const Arch worn = upper ? Arch::kMaxilla : Arch::kMandible;
        const TriangleMesh& support = upper ? maxilla : mandible;
        made->maps = splint_maps(*mesh, support,
                                 transformed(upper ? t : t.inverse(), upper ? mandible : maxilla), context);
        made->undercut = undercut_deg(support, content->arch->gingival(worn));
        const Rigid3 maxilla_at = upper ? Rigid3::identity() : t.inverse();
        for (const auto& [mesh_of, arch, at] :
             {std::tuple{&maxilla, Arch::kMaxilla, maxilla_at}, {&mandible, Arch::kMandible, maxilla_at * t}})
          for (ToothLabel l : tooth_labels(*mesh_of, *content->arch, arch)) {
            l.at_mm = at * l.at_mm;
            made->teeth.push_back(l);
          }
      },
      [this, made, upper, mesh = splint->mesh] {
        const Layer* now = document().layers().find("splint");
        if (now && now->mesh == mesh) put_maps(made->maps, made->undercut, made->teeth, upper ? Arch::kMaxilla : Arch::kMandible);
      });
}

void DesignPanel::put_maps(const SplintMaps& maps, const std::vector<float>& undercut,
                           const std::vector<ToothLabel>& teeth, Arch arch) {
  maps_ = std::make_shared<const SplintMaps>(maps);
  maps_arch_ = arch;
  teeth_ = teeth;
  const Layer splint = *document().layers().find("splint");
  const auto put = [&](const char* id, const char* name, SharedMesh mesh, Color color_3d, Color color_2d,
                       std::shared_ptr<const VertexColors> colors, bool in_section) {
    if (!mesh || mesh->empty()) return;
    Layer l;
    l.id = id;
    l.name = name;
    l.group = colors ? "Maps" : "Design";
    l.mesh = std::move(mesh);
    l.color_3d = color_3d;
    l.color_2d = color_2d;
    l.width_2d_px = 2.2;
    l.colors = std::move(colors);
    l.visible = false;
    l.in_section = in_section;
    document().layers().put(std::move(l));
  };
  put("inner", "Inner surface", maps.inner, {0.25, 0.36, 0.66}, palette::kInner, nullptr, true);
  put("outer", "Outer surface", maps.outer, {0.55, 0.76, 0.95}, palette::kOuter, nullptr, true);
  put("stamp", "Stamp (occlusal in TP)", maps.stamp, palette::kOcclusalTp, palette::kOcclusalTp, nullptr,
      true);
  put("thickness", "Thickness", splint.mesh, {0.42, 0.5, 0.47}, {}, ramp_colors(maps.thickness_mm, 0, 4),
      false);
  put("contacts", "Contacts and gap", splint.mesh, {0.7, 0.6, 0.5}, {}, diverging_colors(maps.gap_mm, 0.5),
      false);
  const bool upper = arch == Arch::kMaxilla;
  if (const Layer* support = document().layers().find(upper ? "maxilla" : "mandible_mi"))
    put("undercut", "Undercut", support->mesh, {0.84, 0.5, 0.2}, {}, diverging_colors(undercut, 45), false);
  show_marks();
}

/// The scale of the map that shows, if one does.
void DesignPanel::show_scale() {
  const LayerModel& layers = document().layers();
  if (layers.shows("thickness"))
    bench_.scene.set_colour_scale(ColourScale{"thickness, mm", 0, 4, false});
  else if (layers.shows("contacts"))
    bench_.scene.set_colour_scale(ColourScale{"gap, mm", -0.5, 0.5, true});
  else if (layers.shows("undercut"))
    bench_.scene.set_colour_scale(ColourScale{"undercut, °", -45, 45, true});
  else if (layers.shows("difference"))
    bench_.scene.set_colour_scale(compare_->scale());
  else
    bench_.scene.set_colour_scale(std::nullopt);
}

void DesignPanel::show_marks() {
  Overlay o;
  // What was measured on a splint stays on its own teeth, when the jaws stand as for one of the other arch.
  const auto& t = document().state().therapeutic;
  const bool lower = maps_arch_ == Arch::kMandible;
  const Rigid3 shown = !t || lower == on_lower_ ? Rigid3::identity() : lower ? *t : t->inverse();
  if (isVisible() && numbers_->isChecked())
    for (const ToothLabel& tooth : teeth_)
      o.labels.push_back({shown * tooth.at_mm, std::to_string(tooth.fdi), {0.08, 0.14, 0.3}, 14, true});
  if (isVisible() && margin_->isChecked() && maps_)
    for (std::vector<Vector3> curve : maps_->margin_mm) {
      for (Vector3& p : curve) p = shown * p;
      o.lines.push_back({std::move(curve), safe_palette::kVermilion, 3});
    }
  if (isVisible() && apertures_->isChecked() && report_ && report_->contains("apertures")) {
    for (const auto& a : (*report_)["apertures"]) {
      if (!a.is_object() || !a.contains("centre_mm") || a["centre_mm"].size() != 3) continue;
      const Vector3 at = shown * Vector3(a["centre_mm"][0].get<double>(), a["centre_mm"][1].get<double>(),
                                         a["centre_mm"][2].get<double>());
      o.balls.push_back({at, safe_palette::kPurple, 0.7});
      o.labels.push_back({at,
                          QString("%1 mm²").arg(a.value("area_mm2", 0.0), 0, 'f', 1).toUtf8().toStdString(),
                          {0.3, 0.1, 0.3},
                          14,
                          true});
    }
    if ((*report_)["apertures"].empty()) bench_.status("This design has no apertures.");
  }
  if (o.labels.empty() && o.lines.empty() && o.balls.empty())
    bench_.scene.clear_overlay("marks");
  else
    bench_.scene.set_overlay("marks", std::move(o));
}

/// Where a gate's figure was measured, as far as the surface tells.
Vector3 DesignPanel::place_of(const std::string& gate) const {
  const Layer* splint = bench_.document.layers().find("splint");
  const auto& vertices = splint->mesh->vertices_mm;
  const auto least = [&](const std::vector<float>& values) {
    std::size_t best = 0;
    float low = 1e30f;
    for (std::size_t i = 0; i < values.size(); ++i)
      if (values[i] < low) low = values[i], best = i;
    return vertices[best];
  };
  if (gate.find("wall") != std::string::npos && report_->contains("thickness_mm")) {
    const auto& t = (*report_)["thickness_mm"];
    if (t.contains("where_mm") && t["where_mm"].is_array() && t["where_mm"].size() == 3)
      return Vector3(t["where_mm"][0].get<double>(), t["where_mm"][1].get<double>(),
                     t["where_mm"][2].get<double>());
  }
  if (!maps_) return bounding_box(*splint->mesh).centre_mm();
  if (gate.rfind("maxilla", 0) == 0) return least(maps_->seat_mm);
  if (gate.rfind("contacts_left", 0) == 0 || gate.rfind("contacts_right", 0) == 0) {
    const ArchFrame& arch = *bench_.document.content().arch;
    const double side = gate.find("left") != std::string::npos ? 1 : -1;
    Vector3 sum = Vector3::Zero();
    double n = 0;
    for (std::size_t i = 0; i < vertices.size(); ++i)
      if (std::abs(maps_->gap_mm[i]) < 0.05f && side * arch.left.dot(vertices[i] - arch.origin_mm) > 0)
        sum += vertices[i], n += 1;
    if (n > 0) return sum / n;
  }
  return least(maps_->gap_mm);
}

void DesignPanel::click_gate(int row) {
  if (!document().layers().find("splint")) return;
  const Vector3 at = place_of(gate_names_.at(static_cast<std::size_t>(row)));
  Overlay o;
  o.balls.push_back({at, safe_palette::kVermilion, 0.7});
  bench_.scene.set_overlay("gate", std::move(o));
  bench_.scene.look_at(at, 35);
  bench_.status(QString("%1 at %2, %3, %4 mm")
                    .arg(gates_->item(row, 1)->text())
                    .arg(at.x(), 0, 'f', 1)
                    .arg(at.y(), 0, 'f', 1)
                    .arg(at.z(), 0, 'f', 1));
}

}  // namespace gnathion
