#include "rendering/charts.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "core/file.h"
#include "core/random.h"
#include "rendering/decimate.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t n = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++n;
  return n;
}

std::vector<ErrorBarPanel> six_panels() {
  std::vector<ErrorBarPanel> panels;
  Random random(4);
  for (const char* name : {"Splint vs. model", "Maxilla vs. model", "Mandible vs. model",
                           "Maxillary clearance", "Mandibular sliding", "Mandibular transformation"}) {
    ErrorBarPanel p;
    p.title = name;
    for (int i = 0; i < 8; ++i)
      p.bars.push_back({i == 3 ? "a long splint's name" : std::to_string(i + 1), 0.05 * random.normal(),
                        random.uniform(0.1, 0.3), 158432.0 + i, i == 5});
    p.weighted_mean = -0.004;
    p.band = 0.22;
    p.n_total = 1267491;
    panels.push_back(p);
  }
  return panels;
}

/// All figures, into a folder to look at when GNATHION_LOOK names one.
std::vector<std::pair<std::string, Drawing>> figures() {
  std::vector<std::pair<std::string, Drawing>> out;
  out.emplace_back("error_bars",
                   error_bar_chart(six_panels(), "AVG ± STD [mm]", "All procedures, all splints"));
  out.emplace_back(
      "radar", radar_chart({"Splint vs. model", "Maxilla vs. model", "Mandible vs. model",
                            "Maxillary clearance", "Mandibular sliding", "Mandibular transformation"},
                           {{"total STD", {0.123, 0.206, 0.127, 0.27, 0.199, 0.265}, safe_palette::kBlue, {}},
                            {"weighted mean AVG",
                             {0.0119, -0.005, 0.0209, -0.0245, -0.0059, 0.0068},
                             safe_palette::kVermilion,
                             {5, 2}}},
                           "mm", "Weighted means and total deviations"));
  Random random(5);
  std::vector<double> values;
  for (int i = 0; i < 20000; ++i) values.push_back(0.03 + 0.11 * random.normal());
  out.emplace_back("histogram", histogram_chart(histogram_of(values, -0.5, 0.5, 50), 0.3,
                                                "signed distance [mm]", "Splint vs. model, splint 3"));
  Polyline2 ring, big;
  for (int i = 0; i <= 80; ++i) {
    const double a = i * M_PI / 40;
    ring.emplace_back(4 * std::cos(a), 4 * std::sin(a));
    big.emplace_back(9 * std::cos(a), 12 * std::sin(a));
  }
  out.emplace_back("profile",
                   profile_chart({{"splint, planned", stroked(palette::kSplint, 1.6), {ring}},
                                  {"maxilla", stroked(palette::kMaxilla, 1.2, {6, 2}), {big}}},
                                 {0, 0}, {10, 8}, "buccal [mm]", "up [mm]", "Left molar", "N 161"));
  return out;
}

TEST(Charts, EveryFigureComesAsSvgPngAndPdf) {
  const char* look = std::getenv("GNATHION_LOOK");
  const fs::path folder = look ? fs::path(look) : fs::temp_directory_path() / "gnathion_charts_test";
  fs::create_directories(folder);
  std::vector<std::shared_ptr<const Drawing>> pages;
  for (const auto& [name, drawing] : figures()) {
    ASSERT_TRUE(write_svg(folder / (name + ".svg"), drawing, name));
    const auto png = png_bytes(drawing);
    ASSERT_TRUE(png) << png.error().line();
    EXPECT_GT(png->size(), 5000u) << name << " looks empty";
    ASSERT_TRUE(write_file(folder / (name + ".png"), *png));
    pages.push_back(std::make_shared<Drawing>(drawing));
  }
  ASSERT_TRUE(write_pdf(folder / "a.pdf", pages, {"Charts", "gnathion", "2026-01-31T12:00:00Z"}));
  ASSERT_TRUE(write_pdf(folder / "b.pdf", pages, {"Charts", "gnathion", "2026-01-31T12:00:00Z"}));
  EXPECT_EQ(*read_file(folder / "a.pdf"), *read_file(folder / "b.pdf")) << "the same pages, other bytes";
  if (!look) fs::remove_all(folder);
}

TEST(Charts, ErrorBarsStandWhereTheirNumbersSay) {
  ErrorBarPanel p;
  p.title = "One <panel>";
  p.bars = {{"a", -0.5, 0.25, 10, false}, {"b", 0.5, 0.25, 20, true}};
  p.band = 0.6;
  const std::string svg = svg_text(error_bar_chart({p}, "[mm]", "t"), "d");
  EXPECT_NE(svg.find("One &lt;panel&gt;"), std::string::npos);
  // Two bars and their two key samples; a hollow marker for the outlier in each.
  EXPECT_EQ(count(svg, "<circle"), 4u);
  EXPECT_EQ(count(svg, "fill=\"#ffffff\""), 2u);
  const auto x_of = [&](std::size_t which) {
    std::size_t at = svg.find("<circle cx=\"");
    while (which--) at = svg.find("<circle cx=\"", at + 1);
    return std::stod(svg.substr(at + 12));
  };
  // The scale is linear and symmetric: the axis's middle is half way between −0.5 and +0.5.
  EXPECT_NEAR((x_of(0) + x_of(1)) / 2, 58 + (262 - 58 - 50) / 2.0, 0.02);
  EXPECT_NEAR(x_of(1) - x_of(0), (262 - 58 - 50) * 1.0 / (2 * 0.75 * 1.04), 0.02);
}

TEST(Charts, TextFitsItsMeasure) {
  const std::string name = "Überlange Bezeichnung der Schiene α ±";
  for (const double width : {30.0, 60.0, 90.0}) {
    EXPECT_LE(text_width_pt(text_fitted(name, width, 8), 8), width);
    for (const std::string& line : text_wrapped(name, width, 8)) EXPECT_LE(text_width_pt(line, 8), width);
  }
  std::string joined;
  for (const std::string& line : text_wrapped(name, 60, 8)) joined += line;
  std::string without;
  for (const char c : name)
    if (c != ' ') without += c;
  std::string joined_without;
  for (const char c : joined)
    if (c != ' ') joined_without += c;
  EXPECT_EQ(joined_without, without) << "wrapping loses or doubles text";
}

TEST(Charts, NamesThatAreNotUtf8SpoilNothing) {
  const double before = text_width_pt("abc", 8);
  EXPECT_GT(text_width_pt("a\xff"
                          "c",
                          8),
            0);
  EXPECT_EQ(text_width_pt("abc", 8), before);
  Drawing d(50, 20);
  d.text({2, 12}, "\xc3\x28", {});
  EXPECT_TRUE(png_bytes(d));
  EXPECT_EQ(svg_text(d, "\xfe").find('\xfe'), std::string::npos);
}

TEST(Charts, TicksAreRoundAndCoverTheRange) {
  EXPECT_EQ(axis_ticks(-0.3, 0.3, 6).size(), 7u);
  EXPECT_EQ(tick_text(-0.1, 0.1), "−0.1");
  EXPECT_EQ(tick_text(-1e-17, 0.1), "0.0");
  EXPECT_TRUE(axis_ticks(1, 1, 5).empty());
}

TEST(Charts, HistogramCountsEachValueOnce) {
  const Histogram h = histogram_of({-2, -0.5, 0, 0.49999, 0.5, 3}, -1, 0.5, 3);
  EXPECT_EQ(h.below, 1);
  EXPECT_EQ(h.above, 2);
  EXPECT_EQ(h.counts, (std::vector<double>{0, 1, 2}));
  EXPECT_NEAR(h.avg, 1.49999 / 6, 1e-12);
}

TEST(Charts, ColoursDivergeAndKeepTheirDarkness) {
  const auto lightness = [](const Color& c) { return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; };
  for (double v = 0; v < 0.99; v += 0.05) {
    EXPECT_GT(lightness(diverging_color(v)), lightness(diverging_color(v + 0.05)) - 1e-9);
    EXPECT_GT(lightness(diverging_color(-v)), lightness(diverging_color(-v - 0.05)) - 1e-9);
    // Blue against red even for a reader without green receptors.
    if (v <= 0.2) continue;
    EXPECT_GT(diverging_color(v)[0] - diverging_color(v)[2], 0.15);
    EXPECT_GT(diverging_color(-v)[2] - diverging_color(-v)[0], 0.15);
  }
  EXPECT_EQ(diverging_color(7), diverging_color(1));
}

TEST(Decimate, KeepsTheShapeWithFewTriangles) {
  // A ball of radius 10 on a lattice of longitude and latitude.
  TriangleMesh ball;
  constexpr int kLong = 200, kLat = 100;
  for (int j = 0; j <= kLat; ++j)
    for (int i = 0; i < kLong; ++i) {
      const double u = 2 * M_PI * i / kLong, v = M_PI * j / kLat;
      ball.vertices_mm.push_back(10 *
                                 Vector3(std::sin(v) * std::cos(u), std::sin(v) * std::sin(u), std::cos(v)));
    }
  for (int j = 0; j < kLat; ++j)
    for (int i = 0; i < kLong; ++i) {
      const auto id = [&](int a, int b) { return static_cast<std::uint32_t>(b * kLong + a % kLong); };
      ball.triangles.push_back({id(i, j), id(i, j + 1), id(i + 1, j)});
      ball.triangles.push_back({id(i + 1, j), id(i, j + 1), id(i + 1, j + 1)});
    }
  const TriangleMesh small = decimated(ball, 4000);
  EXPECT_LE(small.triangles.size(), 4000u);
  EXPECT_GT(small.triangles.size(), 1000u);
  for (const Vector3& v : small.vertices_mm) EXPECT_NEAR(v.norm(), 10, 0.2);
  EXPECT_NEAR(surface_area_mm2(small), 4 * M_PI * 100, 0.02 * 4 * M_PI * 100);
  EXPECT_GT(signed_volume_mm3(small), 0.95 * 4.0 / 3 * M_PI * 1000) << "turned inside out, or full of holes";
  EXPECT_EQ(decimated(small, 100000).triangles.size(), small.triangles.size());
}

}  // namespace
}  // namespace gnathion
