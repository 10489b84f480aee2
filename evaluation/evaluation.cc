#include "evaluation/evaluation.h"

#include <algorithm>

namespace gnathion {
namespace {

struct ProcedureWords {
  const char *name, *title;
};
constexpr std::array<ProcedureWords, kProcedureCount> kWords = {{
    {"splint_vs_model", "Splint vs. model"},
    {"maxilla_vs_model", "Maxilla vs. model"},
    {"mandible_vs_model", "Mandible vs. model"},
    {"maxillary_clearance", "Maxillary clearance"},
    {"mandibular_sliding", "Mandibular sliding"},
    {"mandibular_transformation", "Mandibular transformation"},
}};

std::vector<ProcedureTable> tables(const std::vector<SplintEvaluation>& splints,
                                   const StatisticsOptions& options, bool core) {
  std::vector<ProcedureTable> result;
  for (std::size_t p = 0; p < kProcedureCount; ++p) {
    const auto procedure = static_cast<Procedure>(p);
    std::vector<SplintRow> rows;
    for (const SplintEvaluation& s : splints) {
      const ProcedureResult* r = s.find(procedure);
      if (r == nullptr) continue;
      const PointStatistics& points = core ? r->field.core : r->field.all;
      SplintRow row;
      row.splint = s.name;
      row.n = points.n;
      row.avg_mm = points.avg_mm;
      row.std_mm = points.std_mm;
      if (r->motion) {
        row.alpha_deg = r->motion->alpha_deg;
        row.t_mm = r->motion->t_mm;
        row.max_tooth_mm = r->motion->max_tooth_mm;
      }
      rows.push_back(row);
    }
    if (!rows.empty()) result.push_back(tabulate(procedure_name(procedure), std::move(rows), options));
  }
  return result;
}

}  // namespace

const char* procedure_name(Procedure procedure) {
  return kWords[static_cast<std::size_t>(procedure)].name;
}

const char* procedure_title(Procedure procedure) {
  return kWords[static_cast<std::size_t>(procedure)].title;
}

std::optional<Procedure> procedure_of(const std::string& name) {
  for (std::size_t i = 0; i < kWords.size(); ++i)
    if (name == kWords[i].name) return static_cast<Procedure>(i);
  return std::nullopt;
}

const ProcedureResult* SplintEvaluation::find(Procedure procedure) const {
  const auto found = std::find_if(procedures.begin(), procedures.end(),
                                  [&](const ProcedureResult& r) { return r.procedure == procedure; });
  return found == procedures.end() ? nullptr : &*found;
}

std::vector<ProcedureTable> tables_of(const std::vector<SplintEvaluation>& splints,
                                      const StatisticsOptions& options) {
  return tables(splints, options, false);
}

std::vector<ProcedureTable> core_tables_of(const std::vector<SplintEvaluation>& splints,
                                           const StatisticsOptions& options) {
  return tables(splints, options, true);
}

}  // namespace gnathion
