#include "pipeline/evaluation_document.h"

#include <fmt/format.h>

#include <cmath>

#include "pipeline/version.h"

namespace gnathion {
namespace {

std::string mm(double value, int decimals = 3) {
  const std::string text = fmt::format("{:.{}f}", value, decimals);
  if (text[0] != '-') return text;
  return text.find_first_of("123456789") == std::string::npos ? text.substr(1) : "−" + text.substr(1);
}
std::string maybe(const std::optional<double>& value, int decimals = 3) {
  return value ? mm(*value, decimals) : "–";
}
std::string title_of(const std::string& procedure) {
  const auto known = procedure_of(procedure);
  return known ? procedure_title(*known) : procedure;
}

ReportTable totals_table(const std::vector<ProcedureTable>& tables, const std::string& caption) {
  ReportTable t;
  t.caption = caption;
  t.columns = {"procedure",      "splints",         "ΣN",         "weighted mean [mm]",
               "total STD [mm]", "within STD [mm]", "mean α [°]", "mean t [mm]"};
  for (const ProcedureTable& p : tables) {
    const Totals& s = p.totals;
    t.rows.push_back({title_of(p.procedure), std::to_string(s.splints), std::to_string(s.n_total),
                      mm(s.weighted_mean_mm, 4), mm(s.total_std_mm), mm(s.within_std_mm),
                      maybe(s.mean_alpha_deg), maybe(s.mean_t_mm)});
    t.emphasised.push_back(false);
    const Totals& w = p.without_outliers;
    if (w.splints == s.splints) continue;
    t.rows.push_back({"… without outliers", std::to_string(w.splints), std::to_string(w.n_total),
                      mm(w.weighted_mean_mm, 4), mm(w.total_std_mm), mm(w.within_std_mm),
                      maybe(w.mean_alpha_deg), maybe(w.mean_t_mm)});
    t.emphasised.push_back(false);
  }
  return t;
}

/// What can be said with splints as the sampling units.
void add_inference(ReportDocument& d, const std::vector<ProcedureTable>& tables) {
  ReportTable intervals;
  intervals.caption =
      "Intervals by resampling splints, never points. Equivalence: both one-sided t tests of the splints' "
      "mean AVG, "
      "and the 90 % interval, within the tolerance.";
  intervals.columns = {
      "procedure", "95 % of weighted mean [mm]", "95 % of total STD [mm]", "tolerance [mm]", "largest p",
      "equivalent"};
  for (const ProcedureTable& p : tables) {
    if (!p.bootstrap && !p.equivalence) continue;
    const auto range = [](const Interval& i) { return mm(i.low) + " … " + mm(i.high); };
    std::vector<std::string> row = {title_of(p.procedure), "–", "–", "–", "–", "–"};
    if (p.bootstrap) {
      row[1] = range(p.bootstrap->weighted_mean95_mm);
      row[2] = range(p.bootstrap->total_std95_mm);
    }
    if (p.equivalence) {
      row[3] = "±" + mm(p.equivalence->tolerance_mm);
      row[4] = mm(std::max(p.equivalence->p_lower, p.equivalence->p_upper), 4);
      row[5] = p.equivalence->equivalent() ? "yes" : "not shown";
    }
    intervals.rows.push_back(row);
  }
  if (!intervals.rows.empty()) d.blocks.push_back(intervals);
}

ReportTable rows_table(const ProcedureTable& p, const ProcedureTable* core) {
  ReportTable t;
  t.caption = title_of(p.procedure);
  t.columns = {"splint", "N", "AVG [mm]", "STD [mm]"};
  bool motion = false, teeth = false;
  for (const SplintRow& r : p.splints) {
    motion |= r.alpha_deg.has_value();
    teeth |= r.max_tooth_mm.has_value();
  }
  if (core) t.columns.insert(t.columns.end(), {"N core", "AVG core [mm]", "STD core [mm]"});
  if (motion) t.columns.insert(t.columns.end(), {"α [°]", "t [mm]"});
  if (teeth) t.columns.push_back("largest at teeth [mm]");
  t.columns.insert(t.columns.end(), {"robust z", "outlier"});
  for (const SplintRow& r : p.splints) {
    std::vector<std::string> row = {r.splint, std::to_string(r.n), mm(r.avg_mm, 4), mm(r.std_mm, 4)};
    if (core) {
      const SplintRow* c = nullptr;
      for (const SplintRow& other : core->splints)
        if (other.splint == r.splint) c = &other;
      row.push_back(c ? std::to_string(c->n) : "–");
      row.push_back(c ? mm(c->avg_mm, 4) : "–");
      row.push_back(c ? mm(c->std_mm, 4) : "–");
    }
    if (motion) {
      row.push_back(maybe(r.alpha_deg));
      row.push_back(maybe(r.t_mm));
    }
    if (teeth) row.push_back(maybe(r.max_tooth_mm));
    row.push_back(mm(r.robust_z, 1));
    row.push_back(r.outlier ? "outlier" : "");
    t.rows.push_back(row);
    t.emphasised.push_back(r.outlier);
  }
  return t;
}

ReportTable fits_table(const SplintEvaluation& s) {
  ReportTable t;
  t.caption = "What was fitted, what was measured, and how well the fit is determined";
  t.columns = {"procedure", "fitted",   "measured", "rms [mm]",   "held out [mm]", "inliers [%]",
               "condition", "boundary", "steep",    "beyond rim", "not measured"};
  t.text_columns = 3;
  for (const ProcedureResult& p : s.procedures) {
    const FitReport* f = p.fit ? &*p.fit : nullptr;
    t.rows.push_back({procedure_title(p.procedure), p.fitted_region, p.measured_region,
                      f ? mm(f->rms_mm) : "–", f ? mm(f->held_out_mm) : "–",
                      f ? mm(100 * f->inlier_fraction, 0) : "–", f ? mm(f->condition, 0) : "–",
                      std::to_string(p.field.boundary), std::to_string(p.field.steep),
                      std::to_string(p.field.beyond_rim), std::to_string(p.field.far + p.field.foreign)});
  }
  return t;
}

void add_weak_directions(ReportDocument& d, const SplintEvaluation& s) {
  for (const ProcedureResult& p : s.procedures)
    if (p.fit)
      for (const std::string& weak : p.fit->weak)
        d.blocks.push_back(
            ReportText{fmt::format("{}: weakly determined: {}", procedure_title(p.procedure), weak),
                       ReportText::Kind::kWarning});
}

std::string spread(const Spread& s) {
  return s.n ? fmt::format("{} / {} / {}", mm(s.min_mm, 2), mm(s.median_mm, 2), mm(s.max_mm, 2)) : "–";
}

ReportTable integrity_table(const Integrity& i) {
  ReportTable t;
  t.caption =
      fmt::format("Integrity: collisions deeper than {} mm; gap and wall as least / median / largest [mm]",
                  mm(i.collision_limit_mm, 2));
  t.columns = {"figure", "planned", "printed"};
  const auto collision = [](const CollisionFigures& c) {
    return fmt::format("{} mm², deepest {} mm", mm(c.area_mm2, 2), mm(c.depth_mm));
  };
  const auto found = [&](const std::optional<CollisionFigures>& c) { return c ? collision(*c) : "–"; };
  t.rows = {{"collision with the maxilla", collision(i.planned_maxilla), found(i.printed_maxilla)},
            {"collision with the mandible", collision(i.planned_mandible), found(i.printed_mandible)},
            {"self-intersections", std::to_string(i.planned_self_intersections),
             i.printed_self_intersections ? std::to_string(*i.printed_self_intersections) : "–"},
            {"gap of the inner surface", spread(i.planned_seat_gap),
             i.printed_seat_gap ? spread(*i.printed_seat_gap) : "–"}};
  for (const ProfileFigures& p : i.profiles) {
    std::string name = p.plane.name;
    for (char& c : name)
      if (c == '_') c = ' ';
    t.rows.push_back({"wall, " + name, spread(p.planned_wall), spread(p.printed_wall)});
    t.rows.push_back({"gap, " + name, spread(p.planned_gap), spread(p.printed_gap)});
  }
  return t;
}

void add_figures(ReportDocument& d, const std::vector<EvaluationFigure>& figures) {
  for (const EvaluationFigure& f : figures) d.blocks.push_back(ReportFigure{f.drawing, f.caption});
}

void add_splint(ReportDocument& d, const SplintEvaluation& s, const SplintFigures& figures, bool folded) {
  d.blocks.push_back(ReportHeading{fmt::format("Splint {} (design {})", s.name, s.planned.name), 3, folded});
  for (const std::string& w : s.warnings) d.blocks.push_back(ReportText{w, ReportText::Kind::kWarning});
  add_figures(d, figures.maps);
  add_figures(d, figures.histograms);
  add_figures(d, figures.profiles);
  d.blocks.push_back(fits_table(s));
  add_weak_directions(d, s);
  d.blocks.push_back(integrity_table(s.integrity));
}

void add_record(ReportDocument& d, const EvaluationReport& r) {
  d.blocks.push_back(ReportHeading{"Inputs, parameters, version", 2});
  if (!r.inputs.empty()) {
    ReportTable t;
    t.columns = {"role", "file", "SHA-256"};
    t.text_columns = 3;
    for (const ReportInput& i : r.inputs) t.rows.push_back({i.role, i.path, i.sha256});
    d.blocks.push_back(t);
  }
  if (!r.parameters.empty()) {
    ReportTable t;
    t.columns = {"parameter", "value"};
    t.text_columns = 2;
    for (const auto& [name, value] : r.parameters) t.rows.push_back({name, value});
    d.blocks.push_back(t);
  }
  d.blocks.push_back(ReportText{fmt::format("gnathion {}", kVersion)});
}

constexpr const char* kReading =
    "Signed distances are positive outside the model. N: points; AVG: mean; STD: standard deviation about "
    "it. Total "
    "STD: of all points about the weighted mean (published with the method as pooled). Within STD: pooled "
    "within "
    "splints. α and t: the motion of an arch, t at the centroid of its crowns. Core: without peripheral "
    "points. A "
    "residual is not an accuracy.";

}  // namespace

ReportDocument evaluation_document(const EvaluationReport& r, const EvaluationFigures& figures,
                                   const std::string& view_html) {
  ReportDocument d;
  d.title = r.title;
  d.subtitle = fmt::format("gnathion {}{}", kVersion, r.date_iso.empty() ? "" : ", " + r.date_iso);
  d.blocks.push_back(
      ReportText{"Research use only. This report makes no clinical claim.", ReportText::Kind::kNotice});
  d.blocks.push_back(ReportHeading{"All procedures", 2});
  d.blocks.push_back(totals_table(r.tables, r.core_tables.empty() ? "" : "All measured points"));
  if (!r.core_tables.empty()) d.blocks.push_back(totals_table(r.core_tables, "Without peripheral points"));
  add_inference(d, r.tables);
  d.blocks.push_back(ReportText{kReading});
  for (const std::string& n : r.notes) d.blocks.push_back(ReportText{n, ReportText::Kind::kWarning});
  add_figures(d, figures.overview);
  if (!view_html.empty()) {
    d.blocks.push_back(ReportHtml{"<h2>Surfaces</h2>\n" + view_html, {}});
  }
  d.blocks.push_back(ReportHeading{"By procedure", 2});
  for (const ProcedureTable& p : r.tables) {
    const ProcedureTable* core = nullptr;
    for (const ProcedureTable& c : r.core_tables)
      if (c.procedure == p.procedure) core = &c;
    d.blocks.push_back(rows_table(p, core));
  }
  if (!r.splints.empty()) d.blocks.push_back(ReportHeading{"By splint", 2});
  for (std::size_t i = 0; i < r.splints.size(); ++i)
    add_splint(d, r.splints[i], figures.splints[i], r.splints.size() > 1);
  add_record(d, r);
  return d;
}

}  // namespace gnathion
