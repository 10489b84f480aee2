#include "pipeline/virtual_print_document.h"

#include <fmt/format.h>

#include "pipeline/version.h"
#include "rendering/charts.h"

namespace gnathion {
namespace {

std::string title_of(const std::string& procedure) {
  const auto known = procedure_of(procedure);
  return known ? procedure_title(*known) : procedure;
}

std::string mean_and_range(const PredictedFigure& f, int decimals = 3) {
  return fmt::format("{} ({} … {})", signed_number(f.mean, decimals), signed_number(f.low, decimals),
                     signed_number(f.high, decimals));
}
std::string maybe(const std::optional<PredictedFigure>& f) {
  return f ? mean_and_range(*f) : "–";
}

const PredictedProcedure* find(const VirtualPrint& print, const std::string& procedure) {
  for (const PredictedProcedure& p : print.procedures)
    if (p.table.procedure == procedure) return &p;
  return nullptr;
}

/// Procedures that any design has, in the order of the method.
std::vector<std::string> procedures_of(const std::vector<VirtualPrint>& prints) {
  std::vector<std::string> names;
  for (std::size_t k = 0; k < kProcedureCount; ++k) {
    const std::string name = procedure_name(static_cast<Procedure>(k));
    for (const VirtualPrint& p : prints)
      if (find(p, name)) {
        names.push_back(name);
        break;
      }
  }
  return names;
}

/// One figure of every design, by procedure.
template <class Get>
std::vector<IntervalPanel> panels(const std::vector<VirtualPrint>& prints, const char* x_label,
                                  bool from_zero, const Get& get) {
  std::vector<IntervalPanel> out;
  for (const std::string& name : procedures_of(prints)) {
    IntervalPanel panel{title_of(name), x_label, {}, from_zero};
    for (const VirtualPrint& p : prints)
      if (const PredictedProcedure* of = find(p, name))
        if (const std::optional<PredictedFigure> f = get(*of))
          panel.bars.push_back({p.design, f->mean, f->low, f->high});
    if (!panel.bars.empty()) out.push_back(std::move(panel));
  }
  return out;
}

/// Calls add(procedure's title, design, figures) for every procedure, designs next to one another.
template <class Add>
void for_each_figure(const std::vector<VirtualPrint>& prints, bool core, const Add& add) {
  for (const std::string& name : procedures_of(prints))
    for (const VirtualPrint& print : prints)
      for (const PredictedProcedure& p : core ? print.core : print.procedures)
        if (p.table.procedure == name) add(title_of(name), print.design, p);
}

ReportTable distances_table(const std::vector<VirtualPrint>& prints, bool core) {
  ReportTable t;
  t.caption = core ? "Signed distances without peripheral points" : "Signed distances, all measured points";
  t.columns = {"procedure", "design", "trials", "AVG [mm]", "STD [mm]", "total STD [mm]"};
  t.text_columns = 2;
  for_each_figure(prints, core, [&](const std::string& title, const std::string& design, const auto& p) {
    t.rows.push_back({title, design, std::to_string(p.table.splints.size()), mean_and_range(p.avg_mm),
                      mean_and_range(p.std_mm), fmt::format("{:.3f}", p.table.totals.total_std_mm)});
  });
  return t;
}

ReportTable motions_table(const std::vector<VirtualPrint>& prints) {
  ReportTable t;
  t.caption = "Motions";
  t.columns = {"procedure", "design", "trials", "α [°]", "t [mm]", "largest at teeth [mm]"};
  t.text_columns = 2;
  for_each_figure(prints, false, [&](const std::string& title, const std::string& design, const auto& p) {
    if (p.alpha_deg)
      t.rows.push_back({title, design, std::to_string(p.table.splints.size()), maybe(p.alpha_deg),
                        maybe(p.t_mm), maybe(p.max_tooth_mm)});
  });
  return t;
}

constexpr const char* kReading =
    "A prediction, not a measurement: nothing was printed. Each trial distorts the designed splint as a "
    "printer might, "
    "puts it in and lets the mandible bite with some play, scans all of it with a scanner's errors, and runs "
    "the same "
    "six procedures as on real scans. Figures are means over the trials, with the middle nine tenths in "
    "brackets. "
    "The magnitudes below are assumptions with stated sources; the prediction is worth what they are.";

}  // namespace

std::vector<EvaluationFigure> virtual_print_figures(const std::vector<VirtualPrint>& prints,
                                                    const VirtualPrintOptions& options) {
  std::vector<EvaluationFigure> figures;
  const std::string key =
      fmt::format("mean and middle nine tenths of N = {} trials a design", options.trials);
  const auto add = [&](const char* file, const char* title, const std::vector<IntervalPanel>& of) {
    if (of.empty()) return;
    figures.push_back({file, fmt::format("{}, by design and procedure: {}.", title, key),
                       std::make_shared<Drawing>(interval_chart(of, title, key))});
  };
  using Figure = std::optional<PredictedFigure>;
  add("predicted_std", "Predicted STD",
      panels(prints, "STD [mm]", true, [](const auto& p) -> Figure { return p.std_mm; }));
  add("predicted_avg", "Predicted AVG",
      panels(prints, "AVG [mm]", false, [](const auto& p) -> Figure { return p.avg_mm; }));
  add("predicted_alpha", "Predicted rotation",
      panels(prints, "α [°]", true, [](const auto& p) -> Figure { return p.alpha_deg; }));
  add("predicted_t", "Predicted translation of the arch's centroid",
      panels(prints, "t [mm]", true, [](const auto& p) -> Figure { return p.t_mm; }));
  add("predicted_tooth", "Predicted largest displacement at the teeth",
      panels(prints, "displacement [mm]", true, [](const auto& p) -> Figure { return p.max_tooth_mm; }));
  for (const VirtualPrint& print : prints) {
    std::vector<ProcedureTable> tables;
    for (const PredictedProcedure& p : print.procedures) tables.push_back(p.table);
    for (EvaluationFigure& f : overview_figures(tables)) {
      f.file += "_" + file_part(print.design);
      f.caption = "Design " + print.design + ", trial by trial. " + f.caption;
      figures.push_back(std::move(f));
    }
  }
  return figures;
}

ReportDocument virtual_print_document(const std::vector<VirtualPrint>& prints,
                                      const VirtualPrintOptions& options,
                                      const std::vector<ReportInput>& inputs,
                                      const std::vector<EvaluationFigure>& figures,
                                      const std::string& date_iso) {
  ReportDocument d;
  d.title = "Virtual print of occlusal positioning splints";
  d.subtitle = fmt::format("gnathion {}{}", kVersion, date_iso.empty() ? "" : ", " + date_iso);
  d.blocks.push_back(
      ReportText{"Research use only. This report makes no clinical claim.", ReportText::Kind::kNotice});
  d.blocks.push_back(ReportText{kReading});
  d.blocks.push_back(ReportHeading{"Predicted figures", 2});
  d.blocks.push_back(distances_table(prints, false));
  d.blocks.push_back(motions_table(prints));
  d.blocks.push_back(distances_table(prints, true));
  for (const VirtualPrint& p : prints)
    for (const std::string& text : p.refused)
      d.blocks.push_back(ReportText{"design " + p.design + ", refused: " + text, ReportText::Kind::kWarning});
  for (const EvaluationFigure& f : figures) d.blocks.push_back(ReportFigure{f.drawing, f.caption});

  d.blocks.push_back(ReportHeading{"Magnitudes, inputs, version", 2});
  ReportTable m;
  m.columns = {"magnitude", "value"};
  m.text_columns = 1;
  VirtualPrintOptions copy = options;
  for (const auto& [name, value] : magnitudes(copy)) m.rows.push_back({name, fmt::format("{}", *value)});
  m.rows.push_back({"trials", std::to_string(options.trials)});
  m.rows.push_back({"seed", std::to_string(options.seed)});
  d.blocks.push_back(m);
  ReportTable files;
  files.columns = {"role", "file", "SHA-256"};
  files.text_columns = 3;
  for (const ReportInput& i : inputs) files.rows.push_back({i.role, i.path, i.sha256});
  d.blocks.push_back(files);
  return d;
}

}  // namespace gnathion
