// The rows of a published table, and what was printed under them.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <set>

#include "evaluation/statistics.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot read rows";

/// Lines of comma-separated fields without quotes; spaces around fields do not count.
struct CsvLine {
  std::size_t number = 0;
  std::vector<std::string> fields;
};

std::string trimmed(std::string_view s) {
  while (!s.empty() && (s.front() == ' ' || s.front() == '\t')) s.remove_prefix(1);
  while (!s.empty() && (s.back() == ' ' || s.back() == '\t' || s.back() == '\r')) s.remove_suffix(1);
  if (s.size() >= 2 && s.front() == '"' && s.back() == '"') s = s.substr(1, s.size() - 2);
  return std::string(s);
}

std::vector<CsvLine> lines_of(std::string_view text) {
  if (text.substr(0, 3) == "\xEF\xBB\xBF") text.remove_prefix(3);  // byte order mark
  std::vector<CsvLine> lines;
  std::size_t number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string line = trimmed(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    ++number;
    if (line.empty() || line.front() == '#') continue;
    CsvLine fields{number, {}};
    std::string_view rest = line;
    for (;;) {
      const std::size_t comma = rest.find(',');
      fields.fields.push_back(trimmed(rest.substr(0, comma)));
      if (comma == std::string_view::npos) break;
      rest.remove_prefix(comma + 1);
    }
    lines.push_back(std::move(fields));
  }
  return lines;
}

class Table {
 public:
  static Result<Table> read(const std::string& csv, const std::string& name,
                            const std::vector<std::string>& required) {
    Table t;
    t.name_ = name;
    t.lines_ = lines_of(csv);
    if (t.lines_.empty()) return bad_input(kWhat, name, "empty");
    for (std::size_t i = 0; i < t.lines_[0].fields.size(); ++i) t.column_[t.lines_[0].fields[i]] = i;
    for (const std::string& column : required)
      if (!t.column_.count(column)) return bad_input(kWhat, name, fmt::format("no column '{}'", column));
    for (const CsvLine& line : t.lines_)
      if (line.fields.size() != t.lines_[0].fields.size())
        return bad_input(kWhat, name,
                         fmt::format("line {}: {} fields, the header has {}", line.number, line.fields.size(),
                                     t.lines_[0].fields.size()));
    t.lines_.erase(t.lines_.begin());
    if (t.lines_.empty()) return bad_input(kWhat, name, "no rows below the header");
    return t;
  }

  const std::vector<CsvLine>& lines() const { return lines_; }
  std::string text(const CsvLine& line, const std::string& column) const {
    const auto found = column_.find(column);
    return found == column_.end() ? std::string() : line.fields[found->second];
  }
  /// Nothing where the field or the column is absent.
  Result<std::optional<double>> number(const CsvLine& line, const std::string& column) const {
    const std::string s = text(line, column);
    if (s.empty()) return std::optional<double>();
    double value = 0.0;
    const char* begin = s.data() + (s.front() == '+' ? 1 : 0);
    const auto [end, ec] = std::from_chars(begin, s.data() + s.size(), value);
    if (ec != std::errc() || end != s.data() + s.size() || !std::isfinite(value))
      return bad_input(kWhat, name_, fmt::format("line {}: {} '{}' is not a number", line.number, column, s));
    return std::optional<double>(value);
  }
  Result<double> needed(const CsvLine& line, const std::string& column) const {
    GNATHION_TRY(const std::optional<double> value, number(line, column));
    if (!value) return bad_input(kWhat, name_, fmt::format("line {}: no {}", line.number, column));
    return *value;
  }

 private:
  std::string name_;
  std::vector<CsvLine> lines_;
  std::map<std::string, std::size_t> column_;
};

Result<SplintRow> row_of(const Table& table, const CsvLine& line, const std::string& name) {
  const auto refuse = [&](const std::string& why) {
    return bad_input(kWhat, name, fmt::format("line {}: {}", line.number, why));
  };
  SplintRow row;
  row.splint = table.text(line, "splint");
  if (row.splint.empty()) return refuse("no splint");
  GNATHION_TRY(const double n, table.needed(line, "n"));
  if (!(n >= 1.0) || n > 1e15 || n != std::floor(n)) return refuse("n is not a positive whole number");
  row.n = static_cast<std::size_t>(n);
  GNATHION_TRY(row.avg_mm, table.needed(line, "avg_mm"));
  GNATHION_TRY(row.std_mm, table.needed(line, "std_mm"));
  if (row.std_mm < 0.0) return refuse("std_mm is negative");
  GNATHION_TRY(row.alpha_deg, table.number(line, "alpha_deg"));
  GNATHION_TRY(row.t_mm, table.number(line, "t_mm"));
  GNATHION_TRY(row.max_tooth_mm, table.number(line, "max_tooth_mm"));
  return row;
}

int decimals_of(const std::string& number) {
  const std::size_t point = number.find('.');
  if (point == std::string::npos) return 0;
  const std::size_t end = number.find_first_not_of("0123456789", point + 1);
  return static_cast<int>(std::min(end, number.size()) - point - 1);
}

}  // namespace

Result<std::vector<ProcedureTable>> parse_rows(const std::string& csv, const std::string& name,
                                               const StatisticsOptions& options) {
  GNATHION_TRY(const Table table, Table::read(csv, name, {"procedure", "splint", "n", "avg_mm", "std_mm"}));
  std::vector<std::string> order;
  std::map<std::string, std::vector<SplintRow>> rows;
  std::set<std::pair<std::string, std::string>> seen;
  for (const CsvLine& line : table.lines()) {
    const std::string procedure = table.text(line, "procedure");
    if (procedure.empty()) return bad_input(kWhat, name, fmt::format("line {}: no procedure", line.number));
    GNATHION_TRY(const SplintRow row, row_of(table, line, name));
    if (!seen.insert({procedure, row.splint}).second)
      return bad_input(
          kWhat, name,
          fmt::format("line {}: splint {} stands twice in {}", line.number, row.splint, procedure));
    if (!rows.count(procedure)) order.push_back(procedure);
    rows[procedure].push_back(row);
  }
  std::vector<ProcedureTable> tables;
  for (const std::string& procedure : order) tables.push_back(tabulate(procedure, rows[procedure], options));
  return tables;
}

Result<std::vector<PrintedTotals>> parse_printed(const std::string& csv, const std::string& name) {
  GNATHION_TRY(const Table table, Table::read(csv, name, {"procedure"}));
  std::vector<PrintedTotals> printed;
  for (const CsvLine& line : table.lines()) {
    PrintedTotals p;
    p.procedure = table.text(line, "procedure");
    GNATHION_TRY(p.weighted_mean_mm, table.number(line, "printed_weighted_mean_mm"));
    GNATHION_TRY(p.pooled_std_mm, table.number(line, "printed_pooled_std_mm"));
    p.mean_decimals = decimals_of(table.text(line, "printed_weighted_mean_mm"));
    p.std_decimals = decimals_of(table.text(line, "printed_pooled_std_mm"));
    printed.push_back(p);
  }
  return printed;
}

}  // namespace gnathion
