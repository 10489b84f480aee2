#include "rendering/tag_sheet.h"

#include <fmt/format.h>

#include <algorithm>

namespace gnathion {
namespace {

constexpr double kPageWidth_mm = 210, kPageHeight_mm = 297;
constexpr double kMargin_mm = 15;
constexpr double kHead_mm = 42;  // title and ruler
constexpr double kGap_mm = 13;   // between stickers: cut marks and id
constexpr double kMark_mm = 4;   // length of a cut mark
constexpr double kRuler_mm = 100;

Point2 pt(double x_mm, double y_mm) {
  return kPointsPerMm * Point2(x_mm, y_mm);
}

/// Black square first, white cells over it; runs along rows and along columns overlap, so that no hairline
/// of black is left between white neighbours.
void draw_tag(Drawing& page, const SheetTag& tag, double x_mm, double y_mm, double side_mm) {
  const int n = tag.square_cells;
  const double cell = side_mm / n;
  const auto white = [&](int x, int y) { return tag.white[static_cast<std::size_t>(y * n + x)] != 0; };
  page.rectangle(pt(x_mm, y_mm), pt(side_mm, side_mm), filled({0, 0, 0}));
  for (const bool rows : {true, false})
    for (int a = 0; a < n; ++a)
      for (int b = 0; b < n;) {
        const auto is_white = [&](int k) { return rows ? white(k, a) : white(a, k); };
        int end = b;
        while (end < n && is_white(end)) ++end;
        if (end > b) {
          const Point2 corner = rows ? Point2(b, a) : Point2(a, b),
                       size = rows ? Point2(end - b, 1) : Point2(1, end - b);
          page.rectangle(pt(x_mm + cell * corner.x(), y_mm + cell * corner.y()), kPointsPerMm * cell * size,
                         filled({1, 1, 1}));
        }
        b = std::max(end, b + 1);
      }
}

void cut_marks(Drawing& page, double x_mm, double y_mm, double side_mm) {
  const Paint hair = stroked({0.45, 0.45, 0.45}, 0.3);
  for (const double x : {x_mm, x_mm + side_mm})
    for (const double y : {y_mm, y_mm + side_mm}) {
      const double dx = x == x_mm ? -1 : 1, dy = y == y_mm ? -1 : 1;
      page.line(pt(x + 0.8 * dx, y), pt(x + (0.8 + kMark_mm) * dx, y), hair);
      page.line(pt(x, y + 0.8 * dy), pt(x, y + (0.8 + kMark_mm) * dy), hair);
    }
}

void ruler(Drawing& page, double x_mm, double y_mm) {
  const Paint line = stroked({0, 0, 0}, 0.5);
  page.line(pt(x_mm, y_mm), pt(x_mm + kRuler_mm, y_mm), line);
  for (int mm = 0; mm <= static_cast<int>(kRuler_mm); ++mm)
    page.line(pt(x_mm + mm, y_mm),
              pt(x_mm + mm, y_mm - (mm % 10 == 0  ? 4
                                    : mm % 5 == 0 ? 2.6
                                                  : 1.6)),
              mm % 10 == 0 ? line : stroked({0, 0, 0}, 0.25));
  for (int mm = 0; mm <= static_cast<int>(kRuler_mm); mm += 50)
    page.text(pt(x_mm + mm, y_mm + 3.6), fmt::format("{}", mm), {7, {0, 0, 0}, Anchor::kMiddle});
  page.text(pt(x_mm + kRuler_mm + 6, y_mm), "100 mm: measure it on the print", {8});
}

std::shared_ptr<Drawing> page_with_head(const std::string& body, double side_mm) {
  auto page = std::make_shared<Drawing>(kPageWidth_mm * kPointsPerMm, kPageHeight_mm * kPointsPerMm);
  TextStyle title{13};
  title.bold = true;
  page->text(pt(kMargin_mm, kMargin_mm + 4), fmt::format("Tags of the {}", body), title);
  page->text(pt(kMargin_mm, kMargin_mm + 10),
             fmt::format("Print at 100 % (no fitting to the page) on matt, flat paper. Black squares: {:.2f} "
                         "mm. Cut at the marks: {:.2f} mm.",
                         side_mm, 1.25 * side_mm),
             {8});
  ruler(*page, kMargin_mm, kMargin_mm + 19);
  return page;
}

}  // namespace

std::vector<std::shared_ptr<const Drawing>> tag_sheets(const std::vector<SheetTag>& tags, double side_mm,
                                                       const std::string& body) {
  std::vector<std::shared_ptr<const Drawing>> pages;
  std::shared_ptr<Drawing> page;
  double x = 0, y = 0;
  for (const SheetTag& tag : tags) {
    const double cell = side_mm / tag.square_cells, sticker = side_mm + 2 * cell, pitch = sticker + kGap_mm;
    if (page && x + sticker > kPageWidth_mm - kMargin_mm) x = kMargin_mm + 3, y += pitch;
    if (!page || y + sticker > kPageHeight_mm - kMargin_mm) {
      page = page_with_head(body, side_mm);
      pages.push_back(page);
      x = kMargin_mm + 3;
      y = kMargin_mm + kHead_mm - 10;
    }
    draw_tag(*page, tag, x + cell, y + cell, side_mm);
    cut_marks(*page, x, y, sticker);
    page->text(pt(x + 0.5 * sticker, y + sticker + 6.8), fmt::format("{} {}  (this side down)", body, tag.id),
               {6.5, {0.2, 0.2, 0.2}, Anchor::kMiddle});
    x += pitch;
  }
  return pages;
}

std::shared_ptr<const Drawing> tag_placement_page(
    const std::vector<std::pair<std::string, std::vector<PlacedTag>>>& bodies) {
  auto page = std::make_shared<Drawing>(kPageWidth_mm * kPointsPerMm, kPageHeight_mm * kPointsPerMm);
  TextStyle title{13};
  title.bold = true;
  page->text(pt(kMargin_mm, kMargin_mm + 4), "Where each tag goes", title);
  page->text(
      pt(kMargin_mm, kMargin_mm + 10),
      "Seen from the front: the patient's left is on the right. The thick side is the tag's lower one.", {8});
  double y = kMargin_mm + 22;
  for (const auto& [name, tags] : bodies) {
    Point2 low(1e9, 1e9), high(-1e9, -1e9);
    for (const PlacedTag& tag : tags)
      for (const Point2& c : tag.corners_mm) low = low.cwiseMin(c), high = high.cwiseMax(c);
    page->text(pt(kMargin_mm, y), name, {10});
    y += 6;
    const double left = 0.5 * (kPageWidth_mm - (high - low).x());
    const auto at = [&](const Point2& p) { return pt(left + p.x() - low.x(), y + high.y() - p.y()); };
    for (const PlacedTag& tag : tags) {
      std::vector<Point2> outline;
      Point2 middle = Point2::Zero();
      for (const Point2& c : tag.corners_mm) outline.push_back(at(c)), middle += 0.25 * c;
      page->path(outline, true, stroked({0, 0, 0}, 0.8));
      page->line(outline[0], outline[1], stroked({0, 0, 0}, 2.4));
      page->text(at(middle) + Point2(0, 6), fmt::format("{}", tag.id), {16, {0, 0, 0}, Anchor::kMiddle});
    }
    y += (high - low).y() + 18;
  }
  return page;
}

}  // namespace gnathion
