// A report on paper: blocks set one after another on A4 pages.
#include <fmt/format.h>

#include <algorithm>

#include "pipeline/report_document.h"

namespace gnathion {
namespace {

constexpr double kWidth = 595, kHeight = 842, kLeft = 42, kRight = 42, kTop = 44, kBottom = 52;
constexpr double kText = 8.5, kLine = 11.5, kBetween = 14;
constexpr Color kRule = {0.80, 0.83, 0.87}, kMutedText = {0.36, 0.40, 0.46};

TextStyle style(double size_pt, bool bold = false, Anchor anchor = Anchor::kStart) {
  TextStyle s;
  s.size_pt = size_pt;
  s.bold = bold;
  s.anchor = anchor;
  return s;
}

class Setter {
 public:
  Setter() { new_page(); }

  void operator()(const ReportHeading& h) {
    end_row();
    const double size = h.level == 1 ? 16 : h.level == 2 ? 13 : 10.5;
    // A heading does not stand alone at the foot of a page.
    need(size + (h.level == 2 ? 240 : 200));
    y_ += h.level <= 2 ? 14 : 8;
    for (const std::string& line : text_wrapped(h.text, room(), size, true)) {
      y_ += size * 1.25;
      page().text({kLeft, y_}, line, style(size, true));
    }
    y_ += 4;
    if (h.level == 2) page().line({kLeft, y_}, {kWidth - kRight, y_}, stroked(kRule, 0.8));
    y_ += 4;
  }
  void operator()(const ReportText& t) {
    end_row();
    const bool boxed = t.kind != ReportText::Kind::kPlain;
    const double inset = boxed ? 8 : 0;
    const std::vector<std::string> lines = text_wrapped(t.text, room() - 2 * inset, kText);
    if (boxed) {
      const double height = kLine * static_cast<double>(lines.size()) + 8;
      need(height + 4);
      const bool warns = t.kind == ReportText::Kind::kWarning;
      page().rectangle({kLeft, y_}, {room(), height},
                       filled(warns ? Color{0.99, 0.93, 0.93} : Color{1.0, 0.96, 0.87}));
      if (warns) page().rectangle({kLeft, y_}, {2.5, height}, filled({0.70, 0.15, 0.12}));
      y_ += 3;
    }
    for (const std::string& line : lines) {
      need(kLine);
      y_ += kLine;
      page().text({kLeft + inset, y_ - 3}, line, style(kText));
    }
    y_ += boxed ? 9 : 4;
  }
  void operator()(const ReportTable& t) {
    end_row();
    const std::vector<double> widths = column_widths(t);
    // Caption and heading stay with the first row.
    const std::vector<std::string> caption =
        t.caption.empty() ? std::vector<std::string>{} : text_wrapped(t.caption, room(), 8);
    need(kLine * static_cast<double>(caption.size()) + row_height(t, t.columns, widths, true) +
         (t.rows.empty() ? 0 : row_height(t, t.rows.front(), widths, false)));
    if (!caption.empty())
      for (const std::string& line : caption) {
        y_ += kLine;
        TextStyle s = style(8);
        s.color = kMutedText;
        page().text({kLeft, y_ - 2}, line, s);
      }
    set_row(t, t.columns, widths, true);
    for (std::size_t r = 0; r < t.rows.size(); ++r) {
      const bool strong = r < t.emphasised.size() && t.emphasised[r];
      if (row_height(t, t.rows[r], widths, strong) > left_on_page()) {
        new_page();
        set_row(t, t.columns, widths, true);
      }
      set_row(t, t.rows[r], widths, strong);
    }
    y_ += 7;
  }
  void operator()(const ReportFigure& f) {
    // What is a little wider than half a line is set two to a line.
    const double half = (room() - kBetween) / 2;
    double scale = std::min(1.0, room() / f.drawing->width_pt());
    if (f.drawing->width_pt() > half && f.drawing->width_pt() < 1.35 * half)
      scale = half / f.drawing->width_pt();
    const double width = f.drawing->width_pt() * scale, height = f.drawing->height_pt() * scale;
    const std::vector<std::string> caption = text_wrapped(f.caption, std::max(width, 180.0), 7.5);
    const double full = height + 9.5 * static_cast<double>(caption.size()) + 8;
    if (x_ + width > kWidth - kRight + 0.5) end_row();
    if (std::max(row_, full) > left_on_page()) {
      end_row();
      if (full > left_on_page()) new_page();
    }
    page().place(f.drawing, {x_, y_ + 4}, scale);
    TextStyle s = style(7.5);
    s.color = kMutedText;
    for (std::size_t i = 0; i < caption.size(); ++i)
      page().text({x_, y_ + height + 13 + 9.5 * static_cast<double>(i)}, caption[i], s);
    x_ += std::max(width, 180.0) + kBetween;
    row_ = std::max(row_, full + 8);
  }
  void operator()(const ReportHtml& h) {
    for (const ReportFigure& f : h.on_paper) (*this)(f);
  }

  std::vector<std::shared_ptr<const Drawing>> finished(const std::string& footer) {
    std::vector<std::shared_ptr<const Drawing>> out;
    for (std::size_t i = 0; i < pages_.size(); ++i) {
      TextStyle s = style(7.5);
      s.color = kMutedText;
      pages_[i]->line({kLeft, kHeight - 36}, {kWidth - kRight, kHeight - 36}, stroked(kRule, 0.6));
      pages_[i]->text({kLeft, kHeight - 25}, text_fitted(footer, room() - 60, 7.5), s);
      s.anchor = Anchor::kEnd;
      pages_[i]->text({kWidth - kRight, kHeight - 25}, fmt::format("{} / {}", i + 1, pages_.size()), s);
      out.push_back(pages_[i]);
    }
    return out;
  }

 private:
  static double room() { return kWidth - kLeft - kRight; }
  Drawing& page() { return *pages_.back(); }
  double left_on_page() const { return kHeight - kBottom - y_; }
  void new_page() {
    pages_.push_back(std::make_shared<Drawing>(kWidth, kHeight));
    y_ = kTop;
    x_ = kLeft;
    row_ = 0;
  }
  void need(double height) {
    if (height > left_on_page()) new_page();
  }
  /// Figures stand side by side until something else comes.
  void end_row() {
    y_ += row_;
    row_ = 0;
    x_ = kLeft;
  }

  static constexpr double kCell = 7.2, kPad = 8;
  static double longest_word(const std::string& text, bool bold) {
    double longest = 0;
    for (std::size_t from = 0, to = 0; from <= text.size(); from = to + 1) {
      to = std::min(text.find(' ', from), text.size());
      longest = std::max(longest, text_width_pt(text.substr(from, to - from), kCell, bold));
    }
    return longest;
  }
  /// Columns first..last give way, as far as `least` allows, until all of them fit the page.
  static void narrow(std::vector<double>& widths, const std::vector<double>& least, std::size_t first,
                     std::size_t last) {
    double total = 0, play = 0;
    for (const double w : widths) total += w;
    for (std::size_t c = first; c < last; ++c) play += std::max(0.0, widths[c] - least[c]);
    const double share = std::clamp((total - room()) / std::max(1e-6, play), 0.0, 1.0);
    for (std::size_t c = first; c < last; ++c) widths[c] -= share * std::max(0.0, widths[c] - least[c]);
  }
  /// Numbers have what they need; text columns share the rest.
  static std::vector<double> column_widths(const ReportTable& t) {
    std::vector<double> widths(t.columns.size(), 0);
    for (std::size_t c = 0; c < t.columns.size(); ++c) {
      // Headings of number columns may break at spaces; their longest word must stand.
      if (c < t.text_columns) {
        widths[c] = text_width_pt(t.columns[c], kCell, true);
      } else {
        widths[c] = longest_word(t.columns[c], true);
      }
      for (const auto& row : t.rows)
        if (c < row.size()) widths[c] = std::max(widths[c], text_width_pt(row[c], kCell, true));
      widths[c] += kPad;
    }
    // Where there is room, headings stand on one line.
    std::vector<double> full = widths;
    double whole = 0;
    for (std::size_t c = 0; c < widths.size(); ++c) {
      full[c] = std::max(full[c], text_width_pt(t.columns[c], kCell, true) + kPad);
      whole += full[c];
    }
    if (whole <= room()) return full;
    // Else text columns give way first, down to their longest word, then columns of numbers.
    std::vector<double> least(widths.size(), 0);
    for (std::size_t c = 0; c < widths.size(); ++c) {
      least[c] = longest_word(t.columns[c], true);
      for (const auto& row : t.rows)
        if (c < row.size()) least[c] = std::max(least[c], longest_word(row[c], true));
      least[c] = std::min(least[c], 0.45 * room()) + kPad;
    }
    narrow(widths, least, 0, std::min(t.text_columns, widths.size()));
    narrow(widths, least, t.text_columns, widths.size());
    return widths;
  }
  static std::vector<std::vector<std::string>> cells(const std::vector<std::string>& row,
                                                     const std::vector<double>& widths, bool bold) {
    std::vector<std::vector<std::string>> out;
    for (std::size_t c = 0; c < row.size() && c < widths.size(); ++c)
      out.push_back(text_wrapped(row[c], widths[c] - kPad + 0.5, kCell, bold));
    return out;
  }
  static double row_height(const ReportTable&, const std::vector<std::string>& row,
                           const std::vector<double>& widths, bool bold) {
    std::size_t lines = 1;
    for (const auto& cell : cells(row, widths, bold)) lines = std::max(lines, cell.size());
    return 9.2 * static_cast<double>(lines) + 4;
  }
  void set_row(const ReportTable& t, const std::vector<std::string>& row, const std::vector<double>& widths,
               bool bold) {
    const double height = row_height(t, row, widths, bold);
    need(height);
    const auto texts = cells(row, widths, bold);
    double x = kLeft;
    for (std::size_t c = 0; c < texts.size(); ++c) {
      const bool number = c >= t.text_columns;
      const double at = number ? x + widths[c] - kPad : x;
      for (std::size_t i = 0; i < texts[c].size(); ++i)
        page().text({at, y_ + 8.4 + 9.2 * static_cast<double>(i)}, texts[c][i],
                    style(kCell, bold, number ? Anchor::kEnd : Anchor::kStart));
      x += widths[c];
    }
    y_ += height;
    page().line({kLeft, y_ - 1}, {std::min(x, kWidth - kRight), y_ - 1}, stroked(kRule, 0.4));
  }

  std::vector<std::shared_ptr<Drawing>> pages_;
  double x_ = kLeft, y_ = kTop, row_ = 0;
};

}  // namespace

std::vector<std::shared_ptr<const Drawing>> pages_of(const ReportDocument& document,
                                                     const std::string& footer) {
  Setter setter;
  setter(ReportHeading{document.title, 1});
  setter(ReportText{document.subtitle});
  for (const ReportBlock& block : document.blocks) std::visit(setter, block);
  return setter.finished(footer);
}

}  // namespace gnathion
