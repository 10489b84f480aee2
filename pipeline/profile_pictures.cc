#include "pipeline/profile_pictures.h"

#include <algorithm>

#include <fmt/format.h>

#include "core/file.h"
#include "rendering/charts.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kColumns = 4;
constexpr double kGapPt = 14.0, kPixelsPerPoint = 1.5;

std::string note_of(const SplintProfile& p) {
  std::string note = p.wall_min_mm ? fmt::format("wall {:.2f} mm or more", *p.wall_min_mm) : "no wall";
  if (p.gap_min_mm) note += fmt::format(", gap {:.2f} to {:.2f}", *p.gap_min_mm, *p.gap_max_mm);
  if (p.clearance_mm) note += fmt::format(", opposing arch {:.2f}", *p.clearance_mm);
  return note;
}

/// In the method's colours: what belongs to the jaws and surfaces over the splint's own black outline.
Drawing chart_of(const SplintProfile& p, bool upper) {
  std::vector<ProfileCurve> curves = {
      {"splint", stroked(palette::kSplint, 2.4), p.splint},
      {upper ? "maxilla" : "mandible", stroked(upper ? palette::kMaxilla : palette::kMandible, 1.1),
       p.support},
      {upper ? "mandible in TP" : "maxilla in TP",
       stroked(upper ? palette::kMandible : palette::kMaxilla, 1.1), p.opposing},
      {"inner surface", stroked(palette::kInner, 1.0), p.inner},
      {"outer surface", stroked(palette::kOuter, 1.0), p.outer},
      {"occlusal surface in TP (stamp)", stroked(palette::kOcclusalTp, 1.0), p.occlusal}};
  if (p.wall_min_mm)
    curves.push_back({"thinnest wall", stroked({0.95, 0.55, 0.0}, 2.0), {{p.thinnest[0], p.thinnest[1]}}});
  Box box;  // of the splint: what the window is centred on
  for (const Polyline2& line : p.splint)
    for (const Point2& q : line) box.extend({q.x(), q.y(), 0.0});
  const Vector3 centre = box.centre_mm();
  return profile_chart(curves, {centre.x(), centre.y()}, {8.5, 8.5}, "buccal [mm]", "up [mm]", p.cause,
                       note_of(p));
}

/// All charts in rows of four.
Drawing sheet_of(const std::vector<std::shared_ptr<const Drawing>>& charts) {
  double width = 0.0, height = 0.0;
  for (const auto& chart : charts) {
    width = std::max(width, chart->width_pt());
    height = std::max(height, chart->height_pt());
  }
  const std::size_t columns = std::min(kColumns, charts.size());
  const std::size_t rows = (charts.size() + columns - 1) / columns;
  Drawing sheet(static_cast<double>(columns) * (width + kGapPt) + kGapPt,
                static_cast<double>(rows) * (height + kGapPt) + kGapPt);
  sheet.rectangle({0, 0}, {sheet.width_pt(), sheet.height_pt()}, filled({1.0, 1.0, 1.0}));
  for (std::size_t i = 0; i < charts.size(); ++i)
    sheet.place(charts[i], {kGapPt + static_cast<double>(i % columns) * (width + kGapPt),
                            kGapPt + static_cast<double>(i / columns) * (height + kGapPt)});
  return sheet;
}

}  // namespace

Status draw_profiles(const SplintInputs& inputs, const std::vector<SplintProfile>& profiles,
                     const fs::path& folder) {
  if (profiles.empty()) return {};
  std::error_code ec;
  fs::create_directories(folder / "profiles", ec);
  fs::create_directories(folder / "pictures", ec);
  std::vector<std::shared_ptr<const Drawing>> charts;
  for (const SplintProfile& p : profiles) {
    charts.push_back(std::make_shared<Drawing>(chart_of(p, inputs.on_maxilla())));
    GNATHION_CHECK_OK(write_svg(folder / "profiles" / (p.name + ".svg"), *charts.back(),
                                "Profile across the arch, " + p.cause + ": " + note_of(p)));
  }
  GNATHION_TRY(const std::string png, png_bytes(sheet_of(charts), kPixelsPerPoint));
  return write_file(folder / "pictures" / "profiles.png", png);
}

}  // namespace gnathion
