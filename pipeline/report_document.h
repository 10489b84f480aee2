// What a report says, before it is HTML or PDF: headings, paragraphs, tables and figures in order.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "core/result.h"
#include "rendering/drawing.h"

namespace gnathion {

struct ReportHeading {
  std::string text;
  int level = 2;  ///< 2: part, 3: section within it
  bool folded =
      false;  ///< HTML: what follows, up to the next heading of this level or above, opens on demand
};
struct ReportText {
  enum class Kind { kPlain, kNotice, kWarning };
  std::string text;
  Kind kind = Kind::kPlain;
};
struct ReportTable {
  std::vector<std::string> columns;  ///< with units
  std::vector<std::vector<std::string>> rows;
  std::string caption;
  std::vector<bool> emphasised;  ///< per row: bold; may be shorter
  std::size_t text_columns = 1;  ///< the first ones are text, the others numbers at the right
};
struct ReportFigure {
  std::shared_ptr<const Drawing> drawing;
  std::string caption;  ///< also the figure's accessible name
};
/// Ready HTML with a figure in its place on paper.
struct ReportHtml {
  std::string html;
  std::vector<ReportFigure> on_paper;
};
using ReportBlock = std::variant<ReportHeading, ReportText, ReportTable, ReportFigure, ReportHtml>;

struct ReportDocument {
  std::string title, subtitle;
  std::vector<ReportBlock> blocks;
};

/// One file that needs nothing else.
std::string html_of(const ReportDocument& document);
/// A4 pages with page numbers; `footer` stands on each.
std::vector<std::shared_ptr<const Drawing>> pages_of(const ReportDocument& document,
                                                     const std::string& footer);

}  // namespace gnathion
