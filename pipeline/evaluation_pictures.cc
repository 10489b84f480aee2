#include "pipeline/evaluation_pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "rendering/charts.h"
#include "rendering/scene.h"

namespace gnathion {
namespace {

std::string title_of(const ProcedureResult& p, const SplintEvaluation& s) {
  return fmt::format("{}, splint {}", procedure_title(p.procedure), s.name);
}

std::string statistics_text(const PointStatistics& p) {
  return fmt::format("N {}, AVG {} mm, STD {:.3f} mm", p.n, signed_number(p.avg_mm, 3, true), p.std_mm);
}

/// The scan where it was measured, coloured by its distances.
TriangleMesh coloured(const DistanceField& field, double range_mm) {
  TriangleMesh mesh = transformed(field.dental_from_scan, *field.scan);
  mesh.colors_rgb.resize(mesh.vertices_mm.size());
  for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
    const Color c =
        is_measured(field.use[v]) ? diverging_color(field.distance_mm[v] / range_mm) : kNotMeasured;
    for (std::size_t k = 0; k < 3; ++k)
      mesh.colors_rgb[v][k] = static_cast<std::uint8_t>(std::lround(255 * c[k]));
  }
  return mesh;
}

/// Directions to the viewer from which a procedure's surface is seen whole.
std::vector<Vector3> looks(Procedure procedure, const ArchFrame& f) {
  switch (procedure) {
    case Procedure::kSplintVsModel:
      return {-f.up, f.up};
    case Procedure::kMaxillaVsModel:
    case Procedure::kMaxillaryClearance:
      return {-f.up};
    default:
      return {f.up};
  }
}

Result<EvaluationFigure> distance_map(const ProcedureResult& p, const SplintEvaluation& s, double range_mm) {
  const TriangleMesh mesh = coloured(p.field, range_mm);
  SceneMesh item;
  item.mesh = &mesh;
  item.use_vertex_colors = item.flat_light = true;
  PictureOptions options;
  options.width_px = 560;
  options.height_px = 480;
  options.scale_bar = false;
  std::vector<DistanceMapView> views;
  for (const Vector3& towards : looks(p.procedure, s.arch)) {
    GNATHION_TRY(RenderedView view, render_view({item}, {}, {towards, s.arch.anterior, 0.95}, options));
    views.push_back(
        {std::move(view.png), std::move(view.jpeg), view.width_px, view.height_px, view.px_per_mm});
  }
  const DistanceField& f = p.field;
  std::vector<std::string> facts = {"All points: " + statistics_text(f.all) + ".",
                                    "Without peripheral points: " + statistics_text(f.core) + "."};
  if (p.motion)
    facts.push_back(fmt::format("Motion: α {:.3f}°, t {:.3f} mm, largest at the teeth {:.3f} mm.",
                                p.motion->alpha_deg, p.motion->t_mm, p.motion->max_tooth_mm));
  EvaluationFigure figure;
  figure.file = fmt::format("map_{}_{}", file_part(s.name), procedure_name(p.procedure));
  figure.caption = fmt::format("Signed distance map: {}. Measured: {}. {}", title_of(p, s), p.measured_region,
                               views.size() > 1 ? "Seen from below and from above." : "");
  figure.drawing = std::make_shared<Drawing>(
      distance_map_figure(views, range_mm, title_of(p, s), facts, f.far + f.foreign > 0));
  figure.is_map = true;
  return figure;
}

/// What sections are cut from, once for all planes of a splint.
struct ProfileBodies {
  TriangleMesh maxilla_scan, mandible_scan, splint_scan;  ///< in Dental; empty where there is none
  TriangleMesh inner, outer;                              ///< of the planned splint
  TriangleMesh occlusal_tp;
};

TriangleMesh scan_in_dental(const SplintEvaluation& s, Procedure procedure) {
  const ProcedureResult* p = s.find(procedure);
  return p && p->field.scan ? transformed(p->field.dental_from_scan, *p->field.scan) : TriangleMesh{};
}

/// The planned splint's surface parted: inner is what faces the maxilla within 1.5 mm.
void part_splint(const SplintEvaluation& s, ProfileBodies& bodies) {
  const TriangleMesh& splint = *s.planned.splint;
  const MeshQuery maxilla(*s.planned.maxilla);
  std::vector<bool> faces(splint.triangles.size());
  for (std::size_t t = 0; t < splint.triangles.size(); ++t) {
    const Vector3 centre = (splint.corner(t, 0) + splint.corner(t, 1) + splint.corner(t, 2)) / 3;
    const auto near = maxilla.closest(centre, 1.5);
    faces[t] = near && face_normal_scaled(splint, t).normalized().dot(near->normal.normalized()) < -0.2;
  }
  bodies.inner = submesh(splint, faces);
  faces.flip();
  bodies.outer = submesh(splint, faces);
}

/// The maxilla's crown tops, carried to TP: what the splint's imprint is taken from.
TriangleMesh occlusal_surface_tp(const SplintEvaluation& s) {
  constexpr double kHeight_mm = 3.5, kHalfWidth_mm = 8;  // as the design's stamp (docs/design.md)
  const TriangleMesh& maxilla = *s.planned.maxilla;
  const ArchRuler ruler(s.arch);
  std::vector<bool> keep(maxilla.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t) {
    const ArchCoordinates at =
        ruler.measure((maxilla.corner(t, 0) + maxilla.corner(t, 1) + maxilla.corner(t, 2)) / 3);
    keep[t] = at.height_mm < kHeight_mm && std::abs(at.buccal_mm) < kHalfWidth_mm;
  }
  return transformed(s.planned.therapeutic.rigid, submesh(maxilla, keep));
}

std::string plane_title(const std::string& name) {
  std::string text = name;
  std::replace(text.begin(), text.end(), '_', ' ');
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

std::string spread_text(const char* what, const Spread& planned, const Spread& printed) {
  std::string text = fmt::format("{} planned {:.2f}–{:.2f}", what, planned.min_mm, planned.max_mm);
  if (printed.n > 0) text += fmt::format(", printed {:.2f}–{:.2f}", printed.min_mm, printed.max_mm);
  return text + " mm";
}

EvaluationFigure profile_figure(const SplintEvaluation& s, const ProfileFigures& profile,
                                const ProfileBodies& bodies) {
  const ProfilePlane& plane = profile.plane;
  const Vector3 normal = plane.normal.normalized();
  SectionPlane section;
  section.origin_mm = plane.point_mm;
  section.y_axis = (plane.up - plane.up.dot(normal) * normal).normalized();
  section.x_axis = section.y_axis.cross(normal);
  const bool palate = plane.name.find("palate") != std::string::npos;
  const Vector3 right = palate ? s.arch.left : Vector3(plane.point_mm - s.arch.origin_mm);
  if (section.x_axis.dot(right) < 0) section.x_axis = -section.x_axis;

  std::vector<ProfileCurve> curves;
  const auto add = [&](const char* name, const Paint& paint, const TriangleMesh* mesh) {
    if (mesh && !mesh->empty()) curves.push_back({name, paint, cut_mesh(*mesh, section)});
  };
  const bool printed = !bodies.splint_scan.empty();
  add("maxilla, model", stroked(palette::kMaxilla, 1.1), s.planned.maxilla.get());
  add("maxilla, scanned", stroked(palette::kMaxilla, 0.9, {4, 2}), &bodies.maxilla_scan);
  add("mandible in TP, model", stroked(palette::kMandible, 1.1, {7, 1.5, 1.5, 1.5}), s.mandible_tp.get());
  add("mandible, scanned", stroked(palette::kMandible, 0.9, {2, 2}), &bodies.mandible_scan);
  add("occlusal surface in TP", stroked(palette::kOcclusalTp, 1.0, {1.2, 1.2}), &bodies.occlusal_tp);
  add("inner surface, planned", stroked(palette::kInner, 2.2), &bodies.inner);
  add("outer surface, planned", stroked(palette::kOuter, 2.2), &bodies.outer);
  if (printed) add("splint, printed", stroked(palette::kSplint, 0.9), &bodies.splint_scan);

  const Point2 half = palate ? Point2(33, 20) : Point2(11, 10);
  EvaluationFigure figure;
  figure.file = fmt::format("profile_{}_{}", file_part(s.name), file_part(plane.name));
  figure.caption =
      fmt::format("Cross-section {}, splint {}: wall {}; gap to the maxilla {}.", plane_title(plane.name),
                  s.name, spread_text("", profile.planned_wall, profile.printed_wall).substr(1),
                  spread_text("", profile.planned_gap, profile.printed_gap).substr(1));
  const std::string note =
      profile.planned_wall.n == 0
          ? "no inner surface in this plane"
          : fmt::format("{}; N {}", spread_text("wall", profile.planned_wall, profile.printed_wall),
                        profile.planned_wall.n);
  figure.drawing = std::make_shared<Drawing>(
      profile_chart(curves, {0, 0}, half, palate ? "patient's left [mm]" : "buccal [mm]",
                    "up, towards the maxilla [mm]", plane_title(plane.name) + ", splint " + s.name, note));
  return figure;
}

std::vector<double> measured(const DistanceField& field) {
  std::vector<double> values;
  values.reserve(field.distance_mm.size());
  for (std::size_t v = 0; v < field.distance_mm.size(); ++v)
    if (is_measured(field.use[v])) values.push_back(field.distance_mm[v]);
  return values;
}

/// A round range that holds all but the tails.
double histogram_range_mm(const PointStatistics& s) {
  const double wanted = std::abs(s.avg_mm) + 3.2 * s.std_mm;
  for (const double range : {0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0})
    if (range >= wanted) return range;
  return 3.0;
}

ErrorBarPanel panel_of(const ProcedureTable& table, const std::string& title) {
  ErrorBarPanel panel;
  panel.title = title;
  for (const SplintRow& r : table.splints)
    panel.bars.push_back({r.splint, r.avg_mm, r.std_mm, static_cast<double>(r.n), r.outlier});
  panel.weighted_mean = table.totals.weighted_mean_mm;
  panel.band = table.totals.total_std_mm;
  panel.n_total = static_cast<double>(table.totals.n_total);
  return panel;
}

}  // namespace

std::string file_part(const std::string& name) {
  std::string out;
  for (const char c : name)
    out += std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' ? c : '_';
  return out.empty() ? "_" : out;
}

double map_range_mm(const std::vector<SplintEvaluation>& splints) {
  std::vector<double> stds;
  for (const SplintEvaluation& s : splints)
    for (const ProcedureResult& p : s.procedures) stds.push_back(p.field.all.std_mm);
  if (stds.empty()) return 0.3;
  std::nth_element(stds.begin(), stds.begin() + static_cast<std::ptrdiff_t>(stds.size() / 2), stds.end());
  for (const double range : {0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.8})
    if (range >= 2.5 * stds[stds.size() / 2]) return range;
  return 1.0;
}

std::vector<EvaluationFigure> overview_figures(const std::vector<ProcedureTable>& tables) {
  std::vector<EvaluationFigure> figures;
  if (tables.empty()) return figures;
  std::vector<ErrorBarPanel> panels;
  std::vector<std::string> names;
  std::vector<double> means, totals, within;
  for (const ProcedureTable& t : tables) {
    const auto procedure = procedure_of(t.procedure);
    names.push_back(procedure ? procedure_title(*procedure) : t.procedure);
    panels.push_back(panel_of(t, names.back()));
    means.push_back(t.totals.weighted_mean_mm);
    totals.push_back(t.totals.total_std_mm);
    within.push_back(t.totals.within_std_mm);
  }
  figures.push_back(
      {"error_bars",
       "Mean signed error of each splint with one standard deviation to each side; the band is the "
       "weighted mean with one total standard deviation.",
       std::make_shared<Drawing>(
           error_bar_chart(panels, "AVG ± 1 STD [mm]", "Signed errors of all splints, by procedure"))});
  if (tables.size() >= 3)
    figures.push_back({"radar", "Weighted means and standard deviations over the procedures.",
                       std::make_shared<Drawing>(
                           radar_chart(names,
                                       {{"total STD", totals, safe_palette::kBlue, {}},
                                        {"within-splint STD", within, safe_palette::kGreen, {2, 2}},
                                        {"weighted mean AVG", means, safe_palette::kVermilion, {6, 2}}},
                                       "mm", "Accuracy over the procedures"))});
  return figures;
}

Result<std::vector<EvaluationFigure>> distance_maps(const SplintEvaluation& splint, double range_mm) {
  std::vector<EvaluationFigure> figures;
  for (const ProcedureResult& p : splint.procedures) {
    GNATHION_TRY(EvaluationFigure figure, distance_map(p, splint, range_mm));
    figures.push_back(std::move(figure));
  }
  return figures;
}

std::vector<EvaluationFigure> distance_histograms(const SplintEvaluation& splint, double color_range_mm) {
  std::vector<EvaluationFigure> figures;
  for (const ProcedureResult& p : splint.procedures) {
    const double range = histogram_range_mm(p.field.all);
    const Histogram histogram = histogram_of(measured(p.field), -range, range, 48);
    figures.push_back({fmt::format("histogram_{}_{}", file_part(splint.name), procedure_name(p.procedure)),
                       fmt::format("Histogram of signed distances: {}.", title_of(p, splint)),
                       std::make_shared<Drawing>(histogram_chart(
                           histogram, color_range_mm, "signed distance [mm]", title_of(p, splint)))});
  }
  return figures;
}

std::vector<EvaluationFigure> profile_figures(const SplintEvaluation& splint) {
  std::vector<EvaluationFigure> figures;
  if (splint.integrity.profiles.empty()) return figures;
  ProfileBodies bodies;
  bodies.splint_scan = scan_in_dental(splint, Procedure::kSplintVsModel);
  bodies.maxilla_scan = scan_in_dental(splint, Procedure::kMaxillaVsModel);
  bodies.mandible_scan = scan_in_dental(splint, Procedure::kMandibularSliding);
  part_splint(splint, bodies);
  bodies.occlusal_tp = occlusal_surface_tp(splint);
  for (const ProfileFigures& p : splint.integrity.profiles)
    figures.push_back(profile_figure(splint, p, bodies));
  return figures;
}

}  // namespace gnathion
