// What a reader should know about a table: figures that do not follow from its rows, rows that look copied.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "evaluation/statistics.h"

namespace gnathion {
namespace {

/// The rows are rounded themselves: a tenth of the last digit on top.
bool prints_as(double value, double printed, int decimals) {
  return std::abs(value - printed) <= 0.6 * std::pow(10.0, -decimals);
}

std::optional<std::string> note_on_mean(const ProcedureTable& table, const PrintedTotals& printed) {
  if (!printed.weighted_mean_mm) return std::nullopt;
  const double mean = table.totals.weighted_mean_mm, shown = *printed.weighted_mean_mm;
  if (prints_as(mean, shown, printed.mean_decimals)) return std::nullopt;
  if (prints_as(mean, -shown, printed.mean_decimals))
    return fmt::format(
        "{}: the rows give a weighted mean of {:+.{}f} mm, {:+.{}f} is printed: its sign is lost",
        table.procedure, mean, printed.mean_decimals, shown, printed.mean_decimals);
  return fmt::format("{}: the rows give a weighted mean of {:+.{}f} mm, {:+.{}f} is printed", table.procedure,
                     mean, printed.mean_decimals, shown, printed.mean_decimals);
}

std::optional<std::string> note_on_deviation(const ProcedureTable& table, const PrintedTotals& printed) {
  if (!printed.pooled_std_mm) return std::nullopt;
  const Totals& t = table.totals;
  const double shown = *printed.pooled_std_mm;
  if (prints_as(t.total_std_mm, shown, printed.std_decimals)) return std::nullopt;
  if (prints_as(t.within_std_mm, shown, printed.std_decimals))
    return fmt::format(
        "{}: {:.{}f} mm is printed as standard deviation: that is the within-splint one; the total is "
        "{:.{}f}",
        table.procedure, shown, printed.std_decimals, t.total_std_mm, printed.std_decimals);
  return fmt::format("{}: the rows give a total standard deviation of {:.{}f} mm, {:.{}f} is printed",
                     table.procedure, t.total_std_mm, printed.std_decimals, shown, printed.std_decimals);
}

/// Rows that differ less than scans of different prints can. Each scan has its own number of points and its
/// own noise: repeated scans differ by percents, the same one evaluated again by digits.
struct Likeness {
  static constexpr double kPoints = 5e-4;  ///< relative difference of n
  static constexpr double kStd = 0.01;     ///< relative difference of std
  static bool alike(const SplintRow& a, const SplintRow& b) {
    const double n = static_cast<double>(std::max(a.n, b.n));
    const double apart = std::abs(static_cast<double>(a.n) - static_cast<double>(b.n));
    return apart <= kPoints * n && std::abs(a.std_mm - b.std_mm) <= kStd * std::max(a.std_mm, b.std_mm);
  }
};

/// The largest set of rows about one of them.
std::vector<const SplintRow*> most_alike(const std::vector<SplintRow>& rows) {
  std::vector<const SplintRow*> best;
  for (const SplintRow& centre : rows) {
    std::vector<const SplintRow*> group;
    for (const SplintRow& r : rows)
      if (Likeness::alike(centre, r)) group.push_back(&r);
    if (group.size() > best.size()) best = group;
  }
  return best;
}

double relative_spread(const std::vector<const SplintRow*>& rows) {
  double low = 1e300, high = 0.0;
  for (const SplintRow* r : rows) {
    low = std::min(low, r->std_mm);
    high = std::max(high, r->std_mm);
  }
  return high > 0.0 ? (high - low) / high : 0.0;
}

/// Median over the other procedures of how much their STD spreads; nothing without any.
std::optional<double> spread_elsewhere(const std::vector<ProcedureTable>& tables, const ProcedureTable& but) {
  std::vector<double> spreads;
  for (const ProcedureTable& t : tables) {
    if (&t == &but || t.splints.size() < 3) continue;
    std::vector<const SplintRow*> rows;
    for (const SplintRow& r : t.splints) rows.push_back(&r);
    spreads.push_back(relative_spread(rows));
  }
  if (spreads.empty()) return std::nullopt;
  std::sort(spreads.begin(), spreads.end());
  return spreads[spreads.size() / 2];
}

std::optional<std::string> note_on_likeness(const std::vector<ProcedureTable>& tables,
                                            const ProcedureTable& table) {
  const std::vector<const SplintRow*> group = most_alike(table.splints);
  if (group.size() < 3) return std::nullopt;
  const double spread = relative_spread(group);
  const std::optional<double> elsewhere = spread_elsewhere(tables, table);
  if (elsewhere && spread > 0.2 * *elsewhere) return std::nullopt;
  const auto by_n = [](const SplintRow* a, const SplintRow* b) { return a->n < b->n; };
  const auto by_std = [](const SplintRow* a, const SplintRow* b) { return a->std_mm < b->std_mm; };
  const auto [n_low, n_high] = std::minmax_element(group.begin(), group.end(), by_n);
  const auto [s_low, s_high] = std::minmax_element(group.begin(), group.end(), by_std);
  std::string beside;
  if (elsewhere) beside = fmt::format("; elsewhere STD spreads by {:.0f} %", 100.0 * *elsewhere);
  return fmt::format(
      "{}: {} of {} rows are so alike (N {}-{}, STD {:.4f}-{:.4f} mm) that they look like one scan{}",
      table.procedure, group.size(), table.splints.size(), (*n_low)->n, (*n_high)->n, (*s_low)->std_mm,
      (*s_high)->std_mm, beside);
}

}  // namespace

std::vector<std::string> notes_on(const std::vector<ProcedureTable>& tables,
                                  const std::vector<PrintedTotals>& printed) {
  std::vector<std::string> notes;
  const auto add = [&](const std::optional<std::string>& note) {
    if (note) notes.push_back(*note);
  };
  for (const PrintedTotals& p : printed) {
    const auto table = std::find_if(tables.begin(), tables.end(),
                                    [&](const ProcedureTable& t) { return t.procedure == p.procedure; });
    if (table == tables.end()) {
      notes.push_back(fmt::format("{}: totals are printed, but there are no rows", p.procedure));
      continue;
    }
    add(note_on_mean(*table, p));
    add(note_on_deviation(*table, p));
  }
  for (const ProcedureTable& t : tables) add(note_on_likeness(tables, t));
  for (const ProcedureTable& t : tables) {
    std::string names;
    for (const SplintRow& r : t.splints)
      if (r.outlier)
        names += fmt::format("{}{} (robust z {:.1f})", names.empty() ? "" : ", ", r.splint, r.robust_z);
    if (!names.empty()) notes.push_back(fmt::format("{}: outlying splint {}", t.procedure, names));
  }
  return notes;
}

}  // namespace gnathion
