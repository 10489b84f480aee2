// Pictures of the joints: distance over time, the condyles' paths beside fossa and eminence, the map of
// distances.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/mesh_section.h"
#include "pipeline/joint_motion_job.h"
#include "rendering/chart_axes.h"
#include "rendering/charts.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using Page = std::shared_ptr<const Drawing>;

constexpr double kMapMm = 5.0;  // the map's lightest colour
constexpr double kGapS = 0.25;  // rows farther apart than this, and than three usual steps, are not joined

/// Dark blue, teal, green, yellow for 0 … 1; lightness grows evenly, which every eye can read.
Color near_to_far(double t) {
  constexpr double kStops[][3] = {{68, 1, 84}, {59, 82, 139}, {33, 145, 140}, {94, 201, 98}, {253, 231, 37}};
  const double u = std::clamp(t, 0.0, 1.0) * 4.0;
  const int low = std::min(3, static_cast<int>(u));
  Color out{};
  for (std::size_t k = 0; k < 3; ++k)
    out[k] = (kStops[low][k] + (u - low) * (kStops[low + 1][k] - kStops[low][k])) / 255.0;
  return out;
}
constexpr Color kPenetrates = {0.84, 0.10, 0.10};

const JointQuery& query_of(const Patient& patient, Side side) {
  const JointPair& pair = patient.checker.joints();
  return side == Side::kLeft ? *pair.left : *pair.right;
}

/// Rows joined where they follow each other in time.
template <class At>
std::vector<Polyline2> lines_of(const std::vector<JointRow>& rows, At at) {
  std::vector<Polyline2> lines;
  const double step_s =
      rows.size() > 1 ? (rows.back().time_s - rows.front().time_s) / static_cast<double>(rows.size() - 1)
                      : 0.0;
  const double gap_s = std::max(kGapS, 3.0 * step_s);
  double before = -1e9;
  for (const JointRow& r : rows) {
    if (lines.empty() || r.time_s - before > gap_s) lines.emplace_back();
    before = r.time_s;
    lines.back().push_back(at(r));
  }
  return lines;
}

/// Distance over time of both joints.
Page distance_page(const JointMotions& motions) {
  constexpr double kWidth = 520, kHeight = 170;
  double last = 0.0, first = 1e300, low = 0.0, high = motions.joint_space_mm * 1.5;
  for (const JointMotion& joint : motions.joints)
    for (const JointRow& r : joint.rows) {
      first = std::min(first, r.time_s), last = std::max(last, r.time_s);
      low = std::min(low, r.space.min_mm), high = std::max(high, r.space.min_mm);
    }
  auto d = std::make_shared<Drawing>(kWidth + 60, kHeight + 78);
  PlotArea area{{44, 26}, {kWidth, kHeight}, first, std::max(last, first + 1e-3), low - 0.1, high * 1.05};
  TextStyle head;
  head.bold = true;
  d->text({0, 12}, "Smallest distance of condyle and fossa along the recording", head);
  draw_x_axis(*d, area, 10, "time [s]");
  draw_y_axis(*d, area, 6, "distance [mm]");
  std::vector<LegendEntry> legend;
  const auto level = [&](double mm, const std::string& name, const Paint& paint) {
    if (mm < area.y_low || mm > area.y_high) return;
    d->line(area.at(area.x_low, mm), area.at(area.x_high, mm), paint);
    legend.push_back({name, paint});
  };
  level(0.0, "bone on bone", stroked(kPenetrates, 0.8));
  level(motions.joint_space_mm, fmt::format("{:.1f} mm: the disc's room", motions.joint_space_mm),
        stroked(safe_palette::kGrey, 0.8, {4, 2}));
  for (const JointMotion& joint : motions.joints) {
    const bool left = joint.side == Side::kLeft;
    const Paint paint = stroked(left ? safe_palette::kBlue : safe_palette::kOrange, 1.1);
    for (const Polyline2& line :
         lines_of(joint.rows, [](const JointRow& r) { return Point2(r.time_s, r.space.min_mm); })) {
      std::vector<Point2> points;
      for (const Point2& p : line) points.push_back(area.at(p.x(), p.y()));
      d->path(std::move(points), false, paint);
    }
    legend.push_back({std::string(side_name(joint.side)) + " joint", paint});
    if (joint.tp)
      level(joint.tp->space.min_mm,
            fmt::format("{} in TP: {:.2f} mm", side_name(joint.side), joint.tp->space.min_mm),
            stroked(left ? safe_palette::kBlue : safe_palette::kOrange, 0.8, {1.5, 1.5}));
  }
  draw_frame(*d, area);
  draw_legend(d.get(), {44, kHeight + 62}, kWidth, legend);
  return d;
}

std::vector<Polyline2> cross_at(const Point2& p, double size) {
  return {{p - Point2(size, 0), p + Point2(size, 0)}, {p - Point2(0, size), p + Point2(0, size)}};
}

/// Section through the condyle's middle, seen from the patient's right: fossa, condyle in MI and TP, path.
Page section_page(const JointMotion& joint, const Patient& patient,
                  const std::optional<Motion<Dental>>& therapeutic) {
  const ArchFrame& arch = patient.checker.arch();
  const JointQuery& query = query_of(patient, joint.side);
  const Vector3 origin = joint.mi.centre_mm;
  const SectionPlane plane{origin, arch.anterior, arch.up};
  const auto flat = [&](const Vector3& p) {
    return Point2((p - origin).dot(arch.anterior), (p - origin).dot(arch.up));
  };
  std::vector<ProfileCurve> curves;
  curves.push_back({"fossa", stroked(safe_palette::kGrey, 1.6), cut_mesh(query.joint().fossa, plane)});
  curves.push_back(
      {"condyle in MI", stroked(safe_palette::kBlue, 1.2), cut_mesh(query.joint().condyle, plane)});
  if (therapeutic)
    curves.push_back({"condyle in TP", stroked(safe_palette::kVermilion, 1.2, {4, 2}),
                      cut_mesh(transformed(therapeutic->rigid, query.joint().condyle), plane)});
  if (!joint.rows.empty())
    curves.push_back({"path of its centre", stroked(safe_palette::kGreen, 0.9),
                      lines_of(joint.rows, [&](const JointRow& r) { return flat(r.centre_mm); })});
  curves.push_back(
      {"centre in MI", stroked(safe_palette::kBlue, 1.4), cross_at(flat(joint.mi.centre_mm), 0.7)});
  if (joint.tp)
    curves.push_back(
        {"centre in TP", stroked(safe_palette::kVermilion, 1.4), cross_at(flat(joint.tp->centre_mm), 0.7)});
  std::string note = fmt::format("{:.2f} mm in MI", joint.mi.space.min_mm);
  if (joint.tp) note += fmt::format(", {:.2f} mm in TP", joint.tp->space.min_mm);
  note += " (nearest places may lie outside this section)";
  return std::make_shared<Drawing>(profile_chart(curves, {3, -1}, {20, 15}, "forward [mm]", "up [mm]",
                                                 fmt::format("{} joint, sagittal section through the condyle",
                                                             joint.side == Side::kLeft ? "Left" : "Right"),
                                                 note));
}

/// Paths of both poles from above.
Page poles_page(const JointMotion& joint, const Patient& patient) {
  const ArchFrame& arch = patient.checker.arch();
  const Vector3 origin = joint.mi.centre_mm;
  const auto flat = [&](const Vector3& p) {
    return Point2(-(p - origin).dot(arch.left), (p - origin).dot(arch.anterior));
  };
  std::vector<ProfileCurve> curves;
  const auto add = [&](const char* name, const Color& color, std::vector<double> dash, auto pole) {
    curves.push_back({name, stroked(color, 1.0, std::move(dash)),
                      lines_of(joint.rows, [&](const JointRow& r) { return flat(pole(r)); })});
    for (auto& line : cross_at(flat(pole(joint.mi)), 0.7)) curves.back().lines.push_back(line);
  };
  add("lateral pole", safe_palette::kBlue, {}, [](const JointRow& r) { return r.lateral_pole_mm; });
  add("medial pole", safe_palette::kVermilion, {4, 2}, [](const JointRow& r) { return r.medial_pole_mm; });
  if (joint.tp)
    for (const Vector3& p : {joint.tp->lateral_pole_mm, joint.tp->medial_pole_mm}) {
      const Point2 at = flat(p);
      curves.push_back({"in TP",
                        stroked(safe_palette::kGreen, 1.4),
                        {{at + Point2(-0.6, -0.6), at + Point2(0.6, 0.6)},
                         {at + Point2(-0.6, 0.6), at + Point2(0.6, -0.6)}}});
    }
  return std::make_shared<Drawing>(profile_chart(
      curves, {0, 3}, {20, 15}, "patient's right [mm]", "forward [mm]",
      fmt::format("{} condyle's poles from above", joint.side == Side::kLeft ? "Left" : "Right"),
      "crosses: MI"));
}

/// The condyle coloured by its distance to the fossa; grey where there is none over it.
TriangleMesh map_of(const JointQuery& query, const Rigid3& motion) {
  TriangleMesh map = transformed(motion, query.joint().condyle);
  map.colors_rgb.clear();
  for (const double mm : query.map_mm(motion)) {
    const Color c = std::isnan(mm) ? kNotMeasured : mm < 0.0 ? kPenetrates : near_to_far(mm / kMapMm);
    map.colors_rgb.push_back({static_cast<std::uint8_t>(std::lround(255 * c[0])),
                              static_cast<std::uint8_t>(std::lround(255 * c[1])),
                              static_cast<std::uint8_t>(std::lround(255 * c[2]))});
  }
  return map;
}

/// Where the map is told: T_th, else the narrowest recorded instant.
std::pair<Rigid3, std::string> map_position(const JointMotion& joint, const Patient& patient,
                                            const std::optional<Motion<Dental>>& therapeutic) {
  if (therapeutic) return {therapeutic->rigid, "in TP"};
  const auto narrowest =
      std::min_element(joint.rows.begin(), joint.rows.end(),
                       [](const auto& a, const auto& b) { return a.space.min_mm < b.space.min_mm; });
  for (const JawMotionRow& row : patient.motion->rows)
    if (row.valid && row.time_s == narrowest->time_s)
      return {row.motion, fmt::format("at {:.2f} s", row.time_s)};
  return {Rigid3::identity(), "in MI"};
}

void draw_key(Drawing& d, double x, double y) {
  constexpr int kSteps = 40;
  constexpr double kWidth = 220, kHigh = 9;
  TextStyle text;
  text.size_pt = 7.5;
  for (int i = 0; i < kSteps; ++i)
    d.rectangle({x + kWidth * i / kSteps, y}, {kWidth / kSteps + 0.3, kHigh},
                filled(near_to_far((i + 0.5) / kSteps)));
  for (int mm = 0; mm <= static_cast<int>(kMapMm); ++mm) {
    text.anchor = Anchor::kMiddle;
    d.text({x + kWidth * mm / kMapMm, y + kHigh + 9}, std::to_string(mm), text);
  }
  text.anchor = Anchor::kStart;
  d.text({x + kWidth + 8, y + 8}, "mm to the fossa", text);
  d.rectangle({x + kWidth + 90, y}, {12, kHigh}, filled(kPenetrates));
  d.text({x + kWidth + 106, y + 8}, "inside bone", text);
  d.rectangle({x + kWidth + 160, y}, {12, kHigh}, filled(kNotMeasured));
  d.text({x + kWidth + 176, y + 8}, "no fossa over it", text);
}

Status draw_maps(const JointMotions& motions, const Patient& patient,
                 const std::optional<Motion<Dental>>& therapeutic, const fs::path& folder) {
  const ArchFrame& arch = patient.checker.arch();
  constexpr double kSide = 250;
  Drawing d(2 * kSide + 20, 2 * (kSide * 0.8) + 80);
  d.rectangle({0, 0}, {d.width_pt(), d.height_pt()}, filled({1, 1, 1}));
  TextStyle head;
  head.bold = true;
  double x = 8;
  for (const JointMotion& joint : motions.joints) {
    const JointQuery& query = query_of(patient, joint.side);
    const auto [motion, when] = map_position(joint, patient, therapeutic);
    const TriangleMesh map = map_of(query, motion);
    GNATHION_CHECK_OK(write_mesh(folder / fmt::format("map_{}.ply", side_name(joint.side)), map));
    SceneMesh shown;
    shown.mesh = &map;
    shown.use_vertex_colors = true;
    shown.flat_light = true;
    PictureOptions options;
    options.width_px = 750;
    options.height_px = 600;
    d.text({x, 14},
           fmt::format("{} condyle {}: {:.2f} mm", joint.side == Side::kLeft ? "Left" : "Right", when,
                       query.at(motion).min_mm),
           head);
    TextStyle small;
    small.size_pt = 7.5;
    const std::pair<const char*, SceneView> views[] = {
        {"from above, forward is up", {arch.up, arch.anterior, 1.0}},
        {"from in front", {arch.anterior, arch.up, 0.7}}};
    double y = 24;
    for (const auto& [name, view] : views) {
      GNATHION_TRY(const RenderedView picture, render_view({shown}, {}, view, options));
      d.image({x, y}, {kSide, kSide * 0.8}, picture.png);
      d.text({x + 2, y + 9}, name, small);
      y += kSide * 0.8 + 4;
    }
    x += kSide + 6;
  }
  draw_key(d, 60, d.height_pt() - 34);
  GNATHION_TRY(const std::string png, png_bytes(d, 2.0));
  return write_file(folder / "pictures" / "distance_map.png", png);
}

}  // namespace

Status draw_joint_motions(const JointMotions& motions, const Patient& patient,
                          const std::optional<Motion<Dental>>& therapeutic, const fs::path& folder) {
  std::error_code ec;
  fs::create_directories(folder / "pictures", ec);
  GNATHION_CHECK_OK(draw_maps(motions, patient, therapeutic, folder));
  std::vector<Page> rows;
  double height = 10;
  const bool recorded = !motions.joints.front().rows.empty();
  std::vector<std::vector<Page>> grid;
  if (recorded) grid.push_back({distance_page(motions)});
  for (const JointMotion& joint : motions.joints) {
    grid.push_back({section_page(joint, patient, therapeutic)});
    if (recorded || joint.tp) grid.back().push_back(poles_page(joint, patient));
  }
  for (const auto& row : grid) {
    double tallest = 0;
    for (const Page& p : row) tallest = std::max(tallest, p->height_pt());
    height += tallest + 12;
  }
  Drawing sheet(620, height);
  sheet.rectangle({0, 0}, {sheet.width_pt(), sheet.height_pt()}, filled({1, 1, 1}));
  double y = 8;
  for (const auto& row : grid) {
    double x = 8, tallest = 0;
    for (const Page& p : row) {
      sheet.place(p, {x, y});
      x += p->width_pt() + 16;
      tallest = std::max(tallest, p->height_pt());
    }
    y += tallest + 12;
  }
  GNATHION_TRY(const std::string png, png_bytes(sheet, 2.0));
  return write_file(folder / "pictures" / "joints.png", png);
}

}  // namespace gnathion
