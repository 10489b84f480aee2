// The pictures of jaw-motion analysis: incisal path in three planes, condylar paths, hinge axis, chewing.
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include <fmt/format.h>

#include "core/file.h"
#include "pipeline/motion_analysis.h"
#include "rendering/charts.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using Project = std::function<Point2(const Vector3&)>;  ///< displacement or place to picture coordinates
using Page = std::shared_ptr<const Drawing>;

struct Kind {
  JawMovement movement;
  Color color;
  std::vector<double> dash_pt;
};
/// Told apart by colour and by dash.
const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all = {{JawMovement::kOpening, safe_palette::kBlue, {}},
                                        {JawMovement::kProtrusion, safe_palette::kVermilion, {}},
                                        {JawMovement::kLaterotrusionLeft, safe_palette::kGreen, {5, 2}},
                                        {JawMovement::kLaterotrusionRight, safe_palette::kPurple, {2, 1.5}},
                                        {JawMovement::kChewing, safe_palette::kOrange, {1, 1}}};
  return all;
}

/// A point's path in one segment; a gap in the rows is a gap in the line.
std::vector<Polyline2> path_of(const MotionAnalysis& m, const JawSegment& s, const Vector3& point_mm,
                               const Project& project) {
  std::vector<Polyline2> lines(1);
  const std::vector<Rigid3> mandible = m.recording.mandible();
  double before = -1e9;
  for (std::size_t i = 0; i < mandible.size(); ++i) {
    const double t = m.recording.time_s[i];
    if (t < s.start_s || t > s.end_s) continue;
    if (t - before > 0.1 && !lines.back().empty()) lines.emplace_back();
    before = t;
    lines.back().push_back(project(mandible[i] * point_mm - point_mm));
  }
  return lines;
}

std::vector<ProfileCurve> paths_of(const MotionAnalysis& m, const Vector3& point_mm, const Project& project,
                                   const std::vector<JawMovement>& shown) {
  std::vector<ProfileCurve> curves;
  for (const Kind& kind : kinds()) {
    if (std::find(shown.begin(), shown.end(), kind.movement) == shown.end()) continue;
    for (const JawSegment& s : m.analysis.segments)
      if (s.movement == kind.movement)
        curves.push_back({name_of(kind.movement), stroked(kind.color, 1.0, kind.dash_pt),
                          path_of(m, s, point_mm, project)});
  }
  return curves;
}

/// A window with a margin about all curves; not narrower than `least` half a side.
std::pair<Point2, Point2> window_of(const std::vector<ProfileCurve>& curves, double least) {
  Point2 low(0, 0), high(0, 0);  // MI is always in the picture
  for (const ProfileCurve& c : curves)
    for (const Polyline2& line : c.lines)
      for (const Point2& p : line) low = low.cwiseMin(p), high = high.cwiseMax(p);
  const Point2 half = (0.54 * (high - low)).cwiseMax(Point2(least, least));
  return {0.5 * (low + high), half};
}

Page panel(const std::vector<ProfileCurve>& curves, const std::string& x, const std::string& y,
           const std::string& title, const std::string& note, double least = 2) {
  auto [centre, half] = window_of(curves, least);
  half.y() = std::max(half.y(), 0.5 * half.x());
  half.x() = std::max(half.x(), half.y() / 1.8);
  return std::make_shared<Drawing>(profile_chart(curves, centre, half, x, y, title, note));
}

/// Panels side by side under a title, in rows of `columns`.
Page sheet(const std::vector<Page>& panels, std::size_t columns, const std::string& title,
           const std::string& note = {}) {
  constexpr double kGap = 14, kNoteWidth = 560, kNoteSize = 8;
  const std::vector<std::string> notes =
      note.empty() ? std::vector<std::string>() : text_wrapped(note, kNoteWidth, kNoteSize);
  const double kHead = 24 + 11 * static_cast<double>(notes.size());
  double width = 0, height = kHead;
  for (std::size_t i = 0; i < panels.size(); i += columns) {
    double row_width = 0, row_height = 0;
    for (std::size_t k = i; k < std::min(i + columns, panels.size()); ++k) {
      row_width += panels[k]->width_pt() + kGap;
      row_height = std::max(row_height, panels[k]->height_pt());
    }
    width = std::max(width, row_width);
    height += row_height + kGap;
  }
  auto d = std::make_shared<Drawing>(width + 6, height);
  d->rectangle({0, 0}, {d->width_pt(), d->height_pt()}, filled({1, 1, 1}));
  TextStyle head;
  head.size_pt = 11;
  head.bold = true;
  d->text({4, 15}, title, head);
  TextStyle small;
  small.size_pt = kNoteSize;
  for (std::size_t i = 0; i < notes.size(); ++i)
    d->text({4, 28 + 11 * static_cast<double>(i)}, notes[i], small);
  double y = kHead;
  for (std::size_t i = 0; i < panels.size(); i += columns) {
    double x = 4, tallest = 0;
    for (std::size_t k = i; k < std::min(i + columns, panels.size()); ++k) {
      d->place(panels[k], {x, y});
      x += panels[k]->width_pt() + kGap;
      tallest = std::max(tallest, panels[k]->height_pt());
    }
    y += tallest + kGap;
  }
  return d;
}

Project frontal_of(const ReferencePlane& p) {
  return [p](const Vector3& d) { return Point2(p.leftward(d), -p.downward(d)); };
}
Project sagittal_of(const ReferencePlane& p) {
  return [p](const Vector3& d) { return Point2(p.forward(d), -p.downward(d)); };
}
Project horizontal_of(const ReferencePlane& p) {
  return [p](const Vector3& d) { return Point2(-p.leftward(d), p.forward(d)); };
}

std::string told(const JawAnalysis& a, const std::string& name, const std::string& side,
                 const std::string& label) {
  const JawNumber* n = a.find(name, side);
  if (n == nullptr || !n->determined) return label + " not determined";
  return fmt::format("{} {:.2f} ± {:.2f} {}", label, n->value, n->sigma, n->unit);
}

Page incisal_sheet(const MotionAnalysis& m) {
  const ReferencePlane& p = m.analysis.landmarks.plane;
  const Vector3& point = m.analysis.landmarks.incisal_mm;
  std::vector<JawMovement> all;
  for (const Kind& k : kinds()) all.push_back(k.movement);
  const JawAnalysis& a = m.analysis;
  return sheet(
      {panel(paths_of(m, point, frontal_of(p), all), "patient's left [mm]", "up [mm]",
             "Frontal plane, seen from the front", told(a, "opening", "", "opening")),
       panel(paths_of(m, point, sagittal_of(p), all), "forward [mm]", "up [mm]",
             "Sagittal plane, seen from the right", told(a, "protrusion", "", "protrusion")),
       panel(paths_of(m, point, horizontal_of(p), all), "patient's right [mm]", "forward [mm]",
             "Horizontal plane, seen from above",
             told(a, "laterotrusion", "left", "left") + ", " + told(a, "laterotrusion", "right", "right"))},
      3, "Path of the lower incisal point from MI (Posselt's envelope as recorded)");
}

Page condyle_sheet(const MotionAnalysis& m) {
  const JawAnalysis& a = m.analysis;
  const ReferencePlane& p = a.landmarks.plane;
  std::vector<Page> panels;
  for (const bool left : {false, true}) {
    const Vector3& condyle = left ? *a.landmarks.condyle_left_mm : *a.landmarks.condyle_right_mm;
    const std::string side = left ? "left" : "right";
    const JawMovement balancing = left ? JawMovement::kLaterotrusionRight : JawMovement::kLaterotrusionLeft;
    std::vector<ProfileCurve> curves =
        paths_of(m, condyle, sagittal_of(p), {JawMovement::kOpening, JawMovement::kProtrusion, balancing});
    if (const JawNumber* n = a.find("sagittal_condylar_inclination_5mm", side);
        n != nullptr && n->determined) {
      const double angle = n->value * M_PI / 180;
      curves.push_back({"chord at 5 mm",
                        stroked(safe_palette::kGrey, 0.7, {3, 3}),
                        {{{0, 0}, {7 * std::cos(angle), -7 * std::sin(angle)}}}});
    }
    panels.push_back(panel(curves, "forward [mm]", "up [mm]", "Condyle, " + side + ", sagittal",
                           told(a, "sagittal_condylar_inclination_5mm", side, "inclination at 5 mm") +
                               " to the " + p.name + " plane",
                           4));
  }
  for (const bool left : {false, true}) {
    const Vector3& condyle = left ? *a.landmarks.condyle_left_mm : *a.landmarks.condyle_right_mm;
    const std::string side = left ? "left" : "right";
    std::vector<ProfileCurve> curves = paths_of(
        m, condyle, horizontal_of(p),
        {JawMovement::kProtrusion, JawMovement::kLaterotrusionLeft, JawMovement::kLaterotrusionRight});
    if (const JawNumber* n = a.find("bennett_angle_5mm", side); n != nullptr && n->determined) {
      const double angle = n->value * M_PI / 180, inward = left ? 1 : -1;
      curves.push_back({"chord at 5 mm",
                        stroked(safe_palette::kGrey, 0.7, {3, 3}),
                        {{{0, 0}, {7 * inward * std::sin(angle), 7 * std::cos(angle)}}}});
    }
    panels.push_back(panel(curves, "patient's right [mm]", "forward [mm]",
                           "Condyle, " + side + ", from above",
                           told(a, "bennett_angle_5mm", side, "Bennett angle at 5 mm"), 4));
  }
  return sheet(panels, 2, "Paths of the condyles (" + a.condyles_from + ")");
}

/// Places, not displacements: the axis, the condyles and the teeth from the side and from above.
Page hinge_sheet(const MotionAnalysis& m) {
  const JawAnalysis& a = m.analysis;
  const JawLandmarks& l = a.landmarks;
  const auto from_incisal = [&](const Project& project, const Vector3& at) {
    return project(at - l.incisal_mm);
  };
  const auto cross = [](const Point2& at, double size) {
    return std::vector<Polyline2>{{at - Point2(size, 0), at + Point2(size, 0)},
                                  {at - Point2(0, size), at + Point2(0, size)}};
  };
  const JawNumber* behind = a.find("hinge_axis_behind_incisal");
  const JawNumber* above = a.find("hinge_axis_above_incisal");
  std::vector<Page> panels;
  for (const bool side_view : {true, false}) {
    const Project project = side_view ? sagittal_of(l.plane) : horizontal_of(l.plane);
    std::vector<ProfileCurve> curves;
    curves.push_back({"incisal point, molars", stroked(safe_palette::kBlue, 1.2), {}});
    for (const Vector3& tooth : {l.molar_left_mm, l.incisal_mm, l.molar_right_mm})
      for (auto& line : cross(from_incisal(project, tooth), 2)) curves.back().lines.push_back(line);
    curves.push_back({"condyles", stroked(safe_palette::kGreen, 1.2), {}});
    for (const auto& condyle : {l.condyle_left_mm, l.condyle_right_mm})
      if (condyle)
        for (auto& line : cross(from_incisal(project, *condyle), 2.5)) curves.back().lines.push_back(line);
    if (a.hinge) {
      const Vector3 end = 65 * a.hinge->direction;
      ProfileCurve axis{"hinge axis", stroked(safe_palette::kVermilion, 1.6), {}};
      if (side_view) {
        axis.lines = cross(from_incisal(project, a.hinge->point_mm), 4);
      } else {
        axis.lines = {
            {from_incisal(project, a.hinge->point_mm - end), from_incisal(project, a.hinge->point_mm + end)}};
      }
      curves.push_back(axis);
    }
    const std::string note =
        a.hinge ? fmt::format("{:.1f} ± {:.1f} mm behind, {:.1f} ± {:.1f} mm above the incisal point",
                              behind->value, behind->sigma, above->value, above->sigma)
                : "not determined";
    panels.push_back(panel(curves, side_view ? "forward [mm]" : "patient's right [mm]",
                           side_view ? "up [mm]" : "forward [mm]",
                           side_view ? "Seen from the right" : "Seen from above", note, 30));
  }
  return sheet(panels, 2, "Terminal hinge axis", a.hinge ? "" : "Not determined: " + a.hinge_reason + ".");
}

Page chewing_sheet(const MotionAnalysis& m) {
  const ReferencePlane& p = m.analysis.landmarks.plane;
  const Vector3& point = m.analysis.landmarks.incisal_mm;
  std::vector<ProfileCurve> frontal, sagittal;
  for (const JawSegment& s : m.analysis.segments) {
    if (s.movement != JawMovement::kChewing) continue;
    JawSegment opening = s, closing = s;
    opening.end_s = closing.start_s = s.turn_s;
    for (const auto& [part, name, paint] :
         {std::tuple(opening, "opening", stroked(safe_palette::kBlue, 0.9)),
          std::tuple(closing, "closing", stroked(safe_palette::kVermilion, 0.9, {3, 1.5}))}) {
      frontal.push_back({name, paint, path_of(m, part, point, frontal_of(p))});
      sagittal.push_back({name, paint, path_of(m, part, point, sagittal_of(p))});
    }
  }
  const std::string note = fmt::format("{} cycles, {}", m.analysis.cycles.size(),
                                       told(m.analysis, "chewing_period", "", "period"));
  return sheet({panel(frontal, "patient's left [mm]", "up [mm]", "Frontal plane, seen from the front", note),
                panel(sagittal, "forward [mm]", "up [mm]", "Sagittal plane, seen from the right",
                      told(m.analysis, "chewing_width", "", "width"))},
               2, "Chewing cycles at the incisal point");
}

}  // namespace

Status draw_motion_analysis(const MotionAnalysis& m, const fs::path& folder) {
  struct Picture {
    const char* file;
    const char* caption;
    Page page;
  };
  std::vector<Picture> pictures = {{"incisal", "path of the incisal point in three planes", incisal_sheet(m)},
                                   {"hinge_axis", "hinge axis, condyles and teeth", hinge_sheet(m)}};
  if (m.analysis.landmarks.condyle_left_mm)
    pictures.push_back({"condyles", "paths of both condyles", condyle_sheet(m)});
  if (!m.analysis.cycles.empty()) pictures.push_back({"chewing", "chewing cycles", chewing_sheet(m)});
  std::vector<Page> pages;
  for (const Picture& p : pictures) {
    pages.push_back(p.page);
    GNATHION_TRY(const std::string png, png_bytes(*p.page, 2.0));
    GNATHION_CHECK_OK(write_file(folder / (std::string(p.file) + ".png"), png));
    GNATHION_CHECK_OK(write_svg(folder / (std::string(p.file) + ".svg"), *p.page, p.caption));
  }
  return write_pdf(folder / "jaw-motion.pdf", pages, {"Jaw motion", "gnathion", ""});
}

}  // namespace gnathion
