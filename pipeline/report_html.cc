#include <fmt/format.h>

#include "core/xml.h"
#include "pipeline/report_document.h"

namespace gnathion {
namespace {

constexpr const char* kStyle = R"css(
body{font:15px/1.45 'DejaVu Sans',Verdana,system-ui,sans-serif;color:#1c2430;background:#fff;max-width:1120px;margin:2em auto;padding:0 1em}
h1{font-size:1.5em;margin-bottom:.1em}h2{font-size:1.2em;margin-top:1.8em;border-bottom:1px solid #ccd}h3{font-size:1.02em;margin:1.3em 0 .3em}
summary{cursor:pointer;font-weight:600;padding:.35em 0}
.notice{background:#fff6df;border:1px solid #e6d08c;padding:.5em .8em}.warning{background:#fdeeee;border-left:4px solid #b3261e;padding:.35em .8em;margin:.4em 0}
.wide{overflow-x:auto}table{border-collapse:collapse;margin:.4em 0;font-size:.86em}caption{text-align:left;color:#4a5361;padding:.2em 0}
td,th{padding:.22em .9em .22em 0;text-align:left;border-bottom:1px solid #e4e7ee;vertical-align:top}th{font-weight:600;color:#3a4350}
.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}.strong td{font-weight:600}td.long{overflow-wrap:anywhere}
.figures{display:flex;flex-wrap:wrap;gap:18px;align-items:flex-start}figure{margin:0;max-width:100%}figure svg{max-width:100%;height:auto}
figcaption{font-size:.82em;color:#4a5361;max-width:60em}
#view{border:1px solid #ccd;border-radius:4px;overflow:hidden;margin:.6em 0}.bar{display:flex;flex-wrap:wrap;gap:.5em 1.1em;align-items:center;padding:.5em .7em;background:#f4f6fa;font-size:.86em}
.bar select,.bar button{font:inherit;padding:.15em .5em}#view-stage{position:relative}#view-canvas{display:block;width:100%;height:min(66vh,620px);touch-action:none;cursor:grab;outline-offset:-2px}
#view-legend{position:absolute;left:12px;bottom:10px;background:#ffffffd9;padding:.3em .6em;font-size:.78em;border-radius:3px;pointer-events:none}
#view-bar{width:200px;height:11px;border:1px solid #667}.ends{display:flex;justify-content:space-between}#view-scale{position:absolute;right:16px;bottom:12px;border:2px solid #1c2430;border-top:0;text-align:center;font-size:.78em;pointer-events:none}
#view-reading{position:absolute;left:12px;top:10px;background:#ffffffd9;padding:.2em .6em;font-size:.86em;border-radius:3px;pointer-events:none}#view-reading:empty{display:none}
#view-layers{display:flex;flex-wrap:wrap;gap:.2em 1.1em}.swatch{display:inline-block;width:.8em;height:.8em;border:1px solid #667;margin:0 .35em;vertical-align:-.05em}
@media print{#view{display:none}details>*{display:block}}
)css";

class Writer {
 public:
  void operator()(const ReportHeading& h) {
    end_figures();
    while (!open_.empty() && open_.back() >= h.level) {
      html += "</details>\n";
      open_.pop_back();
    }
    if (h.folded) {
      html += fmt::format("<details><summary>{}</summary>\n", xml_escaped(h.text));
      open_.push_back(h.level);
    } else {
      html += fmt::format("<h{0}>{1}</h{0}>\n", h.level, xml_escaped(h.text));
    }
  }
  void operator()(const ReportText& t) {
    end_figures();
    static const char* const classes[] = {"", " class=notice", " class=warning"};
    html += fmt::format("<p{}>{}</p>\n", classes[static_cast<int>(t.kind)], xml_escaped(t.text));
  }
  void operator()(const ReportTable& t) {
    end_figures();
    html += "<div class=wide><table>";
    if (!t.caption.empty()) html += "<caption>" + xml_escaped(t.caption) + "</caption>";
    html += "<thead><tr>";
    for (std::size_t c = 0; c < t.columns.size(); ++c)
      html += fmt::format("<th{}>{}</th>", c < t.text_columns ? "" : " class=n", xml_escaped(t.columns[c]));
    html += "</tr></thead><tbody>\n";
    for (std::size_t r = 0; r < t.rows.size(); ++r) {
      html += r < t.emphasised.size() && t.emphasised[r] ? "<tr class=strong>" : "<tr>";
      for (std::size_t c = 0; c < t.rows[r].size(); ++c)
        html +=
            fmt::format("<td class={}>{}</td>", c < t.text_columns ? "long" : "n", xml_escaped(t.rows[r][c]));
      html += "</tr>\n";
    }
    html += "</tbody></table></div>\n";
  }
  void operator()(const ReportFigure& f) {
    if (!in_figures_) html += "<div class=figures>\n";
    in_figures_ = true;
    html += fmt::format("<figure>{}<figcaption>{}</figcaption></figure>\n", svg_text(*f.drawing, f.caption),
                        xml_escaped(f.caption));
  }
  void operator()(const ReportHtml& h) {
    end_figures();
    html += h.html;
  }
  void finish() {
    end_figures();
    for (; !open_.empty(); open_.pop_back()) html += "</details>\n";
  }
  std::string html;

 private:
  void end_figures() {
    if (in_figures_) html += "</div>\n";
    in_figures_ = false;
  }
  bool in_figures_ = false;
  std::vector<int> open_;  ///< levels of the folded parts that are open
};

}  // namespace

std::string html_of(const ReportDocument& document) {
  Writer writer;
  for (const ReportBlock& block : document.blocks) std::visit(writer, block);
  writer.finish();
  return fmt::format(
      "<!doctype html>\n<html lang=en><head><meta charset=utf-8>"
      "<meta name=viewport "
      "content=\"width=device-width,initial-scale=1\"><title>{0}</title><style>{1}</style>"
      "</head><body>\n<h1>{0}</h1>\n<p>{2}</p>\n{3}</body></html>\n",
      xml_escaped(document.title), kStyle, xml_escaped(document.subtitle), writer.html);
}

}  // namespace gnathion
