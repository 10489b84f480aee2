#include "pipeline/range_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "rendering/chart_axes.h"
#include "rendering/charts.h"

namespace gnathion {
namespace {

using nlohmann::json;

constexpr std::array<RangeVerdict, 6> kVerdicts = {RangeVerdict::kRealizable, RangeVerdict::kThinWall,
                                                   RangeVerdict::kApertures,  RangeVerdict::kMovement,
                                                   RangeVerdict::kTeeth,      RangeVerdict::kJoints};

/// Lightness falls from what can be held to what cannot; the sign says the same without any colour.
struct Look {
  Color fill;
  const char* text;
};
Look look_of(RangeVerdict verdict) {
  switch (verdict) {
    case RangeVerdict::kRealizable:
      return {{0.66, 0.87, 0.96}, "a splint with a full wall"};
    case RangeVerdict::kThinWall:
      return {{0.36, 0.68, 0.86}, "a splint, the wall thin in places"};
    case RangeVerdict::kApertures:
      return {{0.96, 0.84, 0.40}, "a splint with apertures"};
    case RangeVerdict::kMovement:
      return {{0.72, 0.72, 0.74}, "farther than mandibles go"};
    case RangeVerdict::kTeeth:
      return {{0.42, 0.42, 0.46}, "the teeth would pass through each other"};
    case RangeVerdict::kJoints:
      break;
  }
  return {{0.72, 0.27, 0.05}, "the joints forbid it"};
}

void draw_sign(Drawing& d, RangeVerdict verdict, const Point2& c, double r) {
  const Paint ink = stroked({0.12, 0.12, 0.14}, 0.6), pale = stroked({1, 1, 1}, 0.8);
  switch (verdict) {
    case RangeVerdict::kRealizable:
      break;
    case RangeVerdict::kThinWall:
      d.line(c - Point2(r, 0), c + Point2(r, 0), ink);
      break;
    case RangeVerdict::kApertures:
      d.circle(c, 0.75 * r, ink);
      break;
    case RangeVerdict::kMovement:
      d.circle(c, 0.25 * r, filled({0.12, 0.12, 0.14}));
      break;
    case RangeVerdict::kTeeth:
      d.line(c + Point2(-r, r), c + Point2(r, -r), pale);
      break;
    case RangeVerdict::kJoints:
      d.line(c + Point2(-r, r), c + Point2(r, -r), pale);
      d.line(c + Point2(-r, -r), c + Point2(r, r), pale);
      break;
  }
}

/// Lines where a value on the grid passes a level: marching squares, linear along the edges.
template <class Value>
std::vector<Polyline2> level_lines(const RealizableRange& range, double level, Value value) {
  std::vector<Polyline2> lines;
  const RangeAxis &ax = range.options.x, &ay = range.options.y;
  for (int iy = 0; iy + 1 < ay.cells; ++iy)
    for (int ix = 0; ix + 1 < ax.cells; ++ix) {
      const int corner[4][2] = {{ix, iy}, {ix + 1, iy}, {ix + 1, iy + 1}, {ix, iy + 1}};
      std::vector<Point2> crossings;
      for (int k = 0; k < 4; ++k) {
        const int* a = corner[k];
        const int* b = corner[(k + 1) % 4];
        const double va = value(range.at(a[0], a[1])) - level, vb = value(range.at(b[0], b[1])) - level;
        if (!std::isfinite(va) || !std::isfinite(vb) || (va < 0.0) == (vb < 0.0)) continue;
        const double t = va / (va - vb);
        crossings.emplace_back(ax.at(a[0]) + t * (ax.at(b[0]) - ax.at(a[0])),
                               ay.at(a[1]) + t * (ay.at(b[1]) - ay.at(a[1])));
      }
      for (std::size_t k = 0; k + 1 < crossings.size(); k += 2)
        lines.push_back({crossings[k], crossings[k + 1]});
    }
  return lines;
}

std::string axis_label(JawAxis axis) {
  static const std::map<JawAxis, std::string> kMore = {
      {JawAxis::kProtrusion, "forwards"},  {JawAxis::kLaterotrusion, "to the patient's left"},
      {JawAxis::kLowering, "downwards"},   {JawAxis::kOpening, "about the condyles' axis"},
      {JawAxis::kYaw, "chin to the left"}, {JawAxis::kRoll, "left side down"}};
  return fmt::format("{}, {} [{}]", jaw_axis_name(axis), kMore.at(axis), jaw_axis_unit(axis));
}

std::string held_text(const RangeOutcome& o) {
  std::string text;
  for (int a = 0; a < kJawAxes; ++a) {
    const JawAxis axis = static_cast<JawAxis>(a);
    if (axis == o.range.options.x.axis || axis == o.range.options.y.axis) continue;
    text += fmt::format("{}{} {} {}", text.empty() ? "" : ", ", jaw_axis_name(axis),
                        signed_number(o.range.options.through[axis], 2), jaw_axis_unit(axis));
  }
  if (o.range.options.condylar_slope_deg != 0.0)
    text += fmt::format("; condyles lowered along {:.0f}° as they go forwards",
                        o.range.options.condylar_slope_deg);
  return text;
}

void mark(Drawing& d, const PlotArea& area, const Eigen::Vector2d& at, const std::string& name) {
  if (at.x() < area.x_low || at.x() > area.x_high || at.y() < area.y_low || at.y() > area.y_high) return;
  const Point2 p = area.at(at.x(), at.y());
  d.circle(p, 5.0, {{1, 1, 1}, 2.6, {}, {}, 1.0});
  d.circle(p, 5.0, {{0, 0, 0}, 1.3, {}, {}, 1.0});
  d.circle(p, 1.3, filled({0, 0, 0}));
  TextStyle text;
  text.bold = true;
  const double width = text_width_pt(name, text.size_pt, true);
  const bool to_left = p.x() + 12 + width > area.corner.x() + area.size.x();
  const double x = to_left ? p.x() - 11 - width : p.x() + 9;
  d.rectangle({x - 2, p.y() - 11}, {width + 4, 12}, filled({1, 1, 1}, 0.85));
  d.text({x, p.y() - 2}, name, text);
}

}  // namespace

Result<RangeOutcome> run_range(const Patient& patient, RangeOptions options,
                               const std::optional<Motion<Dental>>& therapeutic, const HeldAxes& held,
                               Progress& progress, const std::atomic<bool>* cancel) {
  const RealizabilityChecker& checker = patient.checker;
  RangeOutcome out;
  out.notes = patient.notes;
  out.condyle_middle_mm = 0.5 * (checker.condyle_mm(Side::kLeft) + checker.condyle_mm(Side::kRight));
  for (const auto& [axis, value] : held) options.through[axis] = value;
  if (therapeutic) {
    out.tp_coordinates = coordinates_of(therapeutic->rigid, checker.arch(), out.condyle_middle_mm);
    options.through = out.tp_coordinates;
    // The slope lowers what goes forwards; T_th's own lowering stays what it is at T_th.
    if (options.y.axis != JawAxis::kLowering && options.x.axis != JawAxis::kLowering)
      options.through[JawAxis::kLowering] -= std::max(0.0, out.tp_coordinates[JawAxis::kProtrusion]) *
                                             std::tan(options.condylar_slope_deg * M_PI / 180.0);
    for (const auto& [axis, value] : held) options.through[axis] = value;
    out.tp = range_place(options, out.tp_coordinates);
    const Rigid3 on_plane = range_motion(options, checker, out.tp->x(), out.tp->y());
    const Vector6 off = difference(on_plane, therapeutic->rigid);
    out.tp_on_plane = off.norm() < 1e-6 * (1.0 + out.condyle_middle_mm.norm());
  }
  progress.begin_step("asking every position", 0.9);
  GNATHION_TRY(out.range, realizable_range(checker, options, progress, cancel));
  if (!out.range.joints_checked) out.notes.push_back("joints not checked: no CBCT");
  return out;
}

json range_json(const RangeOutcome& o) {
  const auto axis = [](const RangeAxis& a) {
    return json{{"name", jaw_axis_name(a.axis)},
                {"unit", jaw_axis_unit(a.axis)},
                {"low", a.low},
                {"high", a.high},
                {"cells", a.cells}};
  };
  const auto coordinates = [](const JawCoordinates& c) {
    json j;
    for (int a = 0; a < kJawAxes; ++a)
      j[fmt::format("{}_{}", jaw_axis_name(static_cast<JawAxis>(a)),
                    jaw_axis_unit(static_cast<JawAxis>(a)))] = c[static_cast<JawAxis>(a)];
    return j;
  };
  json cells = json::array();
  for (const RangeCell& c : o.range.cells)
    cells.push_back({{"verdict", range_verdict_name(c.verdict)},
                     {"clearance_mm", c.clearance_mm},
                     {"joint_mm", c.joint_mm ? json(*c.joint_mm) : json(nullptr)},
                     {"violated", c.violated}});
  json j = {
      {"kind", "realizable range"},
      {"x", axis(o.range.options.x)},
      {"y", axis(o.range.options.y)},
      {"through", coordinates(o.range.options.through)},
      {"condylar_slope_deg", o.range.options.condylar_slope_deg},
      {"condyle_middle_mm", {o.condyle_middle_mm.x(), o.condyle_middle_mm.y(), o.condyle_middle_mm.z()}},
      {"joints_checked", o.range.joints_checked},
      {"realizable_share", o.range.realizable_share()},
      {"t_th", o.tp ? coordinates(o.tp_coordinates) : json(nullptr)},
      {"t_th_on_map", o.tp ? json(o.tp_on_plane) : json(nullptr)},
      {"cells", cells},
      {"notes", o.notes}};
  return j;
}

std::string range_text(const RangeOutcome& o) {
  std::map<RangeVerdict, std::size_t> count;
  for (const RangeCell& c : o.range.cells) ++count[c.verdict];
  std::string text = fmt::format("{:.0f} % of {} positions can be held\n", 100.0 * o.range.realizable_share(),
                                 o.range.cells.size());
  for (const RangeVerdict v : kVerdicts)
    if (count[v] > 0) text += fmt::format("  {:<44} {}\n", look_of(v).text, count[v]);
  for (const std::string& note : o.notes) text += "  note: " + note + "\n";
  return text;
}

Status draw_range(const RangeOutcome& o, const std::filesystem::path& png) {
  const RealizableRange& range = o.range;
  const RangeAxis &ax = range.options.x, &ay = range.options.y;
  constexpr double kWidth = 430, kHigh = 360, kLeft = 48, kTop = 52, kKey = 236;
  const double half_x = 0.5 * (ax.high - ax.low) / (ax.cells - 1),
               half_y = 0.5 * (ay.high - ay.low) / (ay.cells - 1);
  Drawing d(kLeft + kWidth + kKey + 24, kTop + kHigh + 44);
  d.rectangle({0, 0}, {d.width_pt(), d.height_pt()}, filled({1, 1, 1}));
  const PlotArea area{{kLeft, kTop},    {kWidth, kHigh}, ax.low - half_x,
                      ax.high + half_x, ay.low - half_y, ay.high + half_y};
  TextStyle head, small;
  head.bold = true;
  head.size_pt = 11;
  small.size_pt = 8;
  d.text({6, 16},
         fmt::format("What a splint can hold: {} against {}", jaw_axis_name(ay.axis), jaw_axis_name(ax.axis)),
         head);
  const std::vector<std::string> held =
      text_wrapped("Held: " + held_text(o), d.width_pt() - 12, small.size_pt);
  for (std::size_t i = 0; i < std::min<std::size_t>(2, held.size()); ++i)
    d.text({6, 30 + 11 * static_cast<double>(i)}, held[i], small);
  const Point2 cell(kWidth / ax.cells, kHigh / ay.cells);
  draw_x_axis(d, area, 8, axis_label(ax.axis), 8);
  draw_y_axis(d, area, 8, axis_label(ay.axis), 8);
  const double sign = std::min({0.22 * cell.x(), 0.22 * cell.y(), 3.2});
  for (int iy = 0; iy < ay.cells; ++iy)
    for (int ix = 0; ix < ax.cells; ++ix) {
      const Point2 middle = area.at(ax.at(ix), ay.at(iy));
      const RangeVerdict verdict = range.at(ix, iy).verdict;
      d.rectangle(middle - 0.5 * cell - Point2(0.15, 0.15), cell + Point2(0.3, 0.3),
                  filled(look_of(verdict).fill));
    }
  for (int iy = 0; iy < ay.cells; ++iy)
    for (int ix = 0; ix < ax.cells; ++ix)
      draw_sign(d, range.at(ix, iy).verdict, area.at(ax.at(ix), ay.at(iy)), sign);
  const auto contour = [&](double level, const Paint& paint, auto value) {
    for (const Polyline2& line : level_lines(range, level, value))
      d.line(area.at(line[0].x(), line[0].y()), area.at(line[1].x(), line[1].y()), paint);
  };
  const Paint full = stroked({0.0, 0.20, 0.45}, 1.5), joint = stroked({0.50, 0.10, 0.0}, 1.5, {4, 2});
  contour(1.0, full, [](const RangeCell& c) { return c.clearance_mm; });
  if (range.joints_checked) contour(1.0, joint, [](const RangeCell& c) { return c.joint_mm.value_or(NAN); });
  draw_frame(d, area);
  const Eigen::Vector2d mi = range_place(range.options, JawCoordinates{});
  mark(d, area, mi, "MI");
  if (o.tp) mark(d, area, *o.tp, o.tp_on_plane ? "T_th" : "T_th (projected)");

  double y = kTop + 4;
  const double x = kLeft + kWidth + 18;
  for (const RangeVerdict v : kVerdicts) {
    d.rectangle({x, y}, {22, 15}, {{0.3, 0.3, 0.3}, 0.5, {}, look_of(v).fill, 1.0});
    draw_sign(d, v, {x + 11, y + 7.5}, 3.2);
    d.text({x + 28, y + 11}, look_of(v).text, small);
    y += 21;
  }
  y += 6;
  d.line({x, y + 4}, {x + 22, y + 4}, full);
  d.text({x + 28, y + 7}, "1 mm between the teeth", small);
  if (range.joints_checked) {
    y += 17;
    d.line({x, y + 4}, {x + 22, y + 4}, joint);
    d.text({x + 28, y + 7}, "1 mm between condyle and fossa", small);
  }
  y += 26;
  std::vector<std::string> notes = o.notes;
  if (mi.norm() == 0.0 && !range.options.through.value.empty()) {
    const bool mi_on_plane =
        std::all_of(range.options.through.value.begin(), range.options.through.value.end(),
                    [](double v) { return std::abs(v) < 1e-9; });
    if (!mi_on_plane)
      notes.push_back("MI is shown by its two coordinates; its other four are not those held here");
  }
  for (const std::string& note : notes)
    for (const std::string& line : text_wrapped(note, kKey, small.size_pt)) {
      if (y > kTop + kHigh) break;
      d.text({x, y}, line, small);
      y += 11;
    }
  GNATHION_TRY(const std::string bytes, png_bytes(d, 2.0));
  return write_file(png, bytes);
}

}  // namespace gnathion
