#include "evaluation/statistics.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check.h"
#include "core/random.h"

namespace gnathion {
namespace {

double median_of(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const std::size_t half = values.size() / 2;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(half), values.end());
  const double upper = values[half];
  if (values.size() % 2 == 1) return upper;
  return 0.5 *
         (upper + *std::max_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(half)));
}

/// Makes 1.4826·MAD unbiased for a normal sample of n (Croux & Rousseeuw 1992).
double small_sample_factor(std::size_t n) {
  constexpr std::array<double, 10> kTable = {1.0,   1.0,   1.196, 1.495, 1.363,
                                             1.206, 1.200, 1.140, 1.129, 1.107};
  if (n < kTable.size()) return kTable[n];
  const auto count = static_cast<double>(n);
  return count / (count - 0.8);
}

std::optional<double> mean_of(const std::vector<SplintRow>& rows, std::optional<double> SplintRow::*figure) {
  double sum = 0.0;
  std::size_t n = 0;
  for (const SplintRow& r : rows)
    if (r.*figure) sum += *(r.*figure), ++n;
  if (n == 0) return std::nullopt;
  return sum / static_cast<double>(n);
}

/// Value below which the fraction q of the sorted values lies, interpolated.
double quantile(const std::vector<double>& sorted, double q) {
  const double at = q * static_cast<double>(sorted.size() - 1);
  const auto low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, sorted.size() - 1);
  return sorted[low] + (at - static_cast<double>(low)) * (sorted[high] - sorted[low]);
}

BootstrapIntervals bootstrap(const std::vector<SplintRow>& rows, const StatisticsOptions& options) {
  Random random(options.seed, 0x5eedull);
  std::vector<double> means, deviations;
  std::vector<SplintRow> drawn(rows.size());
  for (std::size_t b = 0; b < options.resamples; ++b) {
    for (SplintRow& r : drawn) r = rows[random.below(static_cast<std::uint32_t>(rows.size()))];
    const Totals t = totals_of(drawn);
    means.push_back(t.weighted_mean_mm);
    deviations.push_back(t.total_std_mm);
  }
  std::sort(means.begin(), means.end());
  std::sort(deviations.begin(), deviations.end());
  return {options.resamples,
          {quantile(means, 0.025), quantile(means, 0.975)},
          {quantile(means, 0.05), quantile(means, 0.95)},
          {quantile(deviations, 0.025), quantile(deviations, 0.975)}};
}

Equivalence test_equivalence(const std::vector<SplintRow>& rows, double tolerance_mm,
                             const std::optional<BootstrapIntervals>& intervals) {
  Equivalence e;
  e.tolerance_mm = tolerance_mm;
  const auto n = static_cast<double>(rows.size());
  for (const SplintRow& r : rows) e.mean_mm += r.avg_mm / n;
  double squares = 0.0;
  for (const SplintRow& r : rows) squares += (r.avg_mm - e.mean_mm) * (r.avg_mm - e.mean_mm);
  e.standard_error_mm = std::sqrt(squares / (n - 1.0) / n);
  if (e.standard_error_mm > 0.0) {
    e.p_lower = student_t_upper_tail((e.mean_mm + tolerance_mm) / e.standard_error_mm, n - 1.0);
    e.p_upper = student_t_upper_tail((tolerance_mm - e.mean_mm) / e.standard_error_mm, n - 1.0);
  } else {
    e.p_lower = e.mean_mm > -tolerance_mm ? 0.0 : 1.0;
    e.p_upper = e.mean_mm < tolerance_mm ? 0.0 : 1.0;
  }
  e.by_t = e.p_lower < 0.05 && e.p_upper < 0.05;
  e.by_bootstrap = intervals && intervals->weighted_mean90_mm.low > -tolerance_mm &&
                   intervals->weighted_mean90_mm.high < tolerance_mm;
  return e;
}

void flag_outliers(std::vector<SplintRow>& rows, const StatisticsOptions& options) {
  const auto take = [&](const std::vector<std::size_t>& which, const std::vector<double>& values,
                        double floor) {
    const std::vector<double> z = robust_z(values, floor);
    for (std::size_t i = 0; i < which.size(); ++i)
      rows[which[i]].robust_z = std::max(rows[which[i]].robust_z, z[i]);
  };
  const auto take_optional = [&](std::optional<double> SplintRow::*figure, double floor) {
    std::vector<std::size_t> which;
    std::vector<double> values;
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (rows[i].*figure) which.push_back(i), values.push_back(*(rows[i].*figure));
    take(which, values, floor);
  };
  std::vector<std::size_t> all(rows.size());
  std::vector<double> avg, std;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    all[i] = i;
    rows[i].robust_z = 0.0;
    avg.push_back(rows[i].avg_mm);
    std.push_back(rows[i].std_mm);
  }
  take(all, avg, options.length_floor_mm);
  take(all, std, options.length_floor_mm);
  take_optional(&SplintRow::alpha_deg, options.angle_floor_deg);
  take_optional(&SplintRow::t_mm, options.length_floor_mm);
  take_optional(&SplintRow::max_tooth_mm, options.length_floor_mm);
  for (SplintRow& r : rows) r.outlier = r.robust_z > options.outlier_z;
}

/// Continued fraction of the incomplete beta function (Lentz's method; Abramowitz & Stegun 26.5.8).
double beta_fraction(double a, double b, double x) {
  constexpr double kTiny = 1e-300;
  const auto guarded = [](double v) { return std::abs(v) < kTiny ? kTiny : v; };
  double c = 1.0, d = 1.0 / guarded(1.0 - (a + b) * x / (a + 1.0)), h = d;
  for (int m = 1; m <= 500; ++m) {
    const double even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
    d = 1.0 / guarded(1.0 + even * d);
    c = guarded(1.0 + even / c);
    h *= d * c;
    const double odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
    d = 1.0 / guarded(1.0 + odd * d);
    c = guarded(1.0 + odd / c);
    h *= d * c;
    if (std::abs(d * c - 1.0) < 1e-15) break;
  }
  return h;
}

/// Regularised incomplete beta function I_x(a, b).
double incomplete_beta(double a, double b, double x) {
  if (x <= 0.0) return 0.0;
  if (x >= 1.0) return 1.0;
  const double front =
      std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x));
  if (x < (a + 1.0) / (a + b + 2.0)) return front * beta_fraction(a, b, x) / a;
  return 1.0 - front * beta_fraction(b, a, 1.0 - x) / b;
}

}  // namespace

double student_t_upper_tail(double t, double degrees_of_freedom) {
  const double tail =
      0.5 * incomplete_beta(0.5 * degrees_of_freedom, 0.5, degrees_of_freedom / (degrees_of_freedom + t * t));
  return t >= 0.0 ? tail : 1.0 - tail;
}

std::vector<double> robust_z(const std::vector<double>& values, double floor) {
  std::vector<double> z(values.size(), 0.0);
  if (values.size() < 4) return z;
  const double middle = median_of(values);
  std::vector<double> apart;
  for (double v : values) apart.push_back(std::abs(v - middle));
  const double scale = std::max(floor, 1.4826 * small_sample_factor(values.size()) * median_of(apart));
  for (std::size_t i = 0; i < z.size(); ++i) z[i] = apart[i] / scale;
  return z;
}

Totals totals_of(const std::vector<SplintRow>& rows) {
  Totals t;
  t.splints = rows.size();
  double sum = 0.0, within = 0.0, total = 0.0;
  for (const SplintRow& r : rows) {
    t.n_total += r.n;
    sum += static_cast<double>(r.n) * r.avg_mm;
  }
  if (t.n_total == 0) return t;
  const auto n = static_cast<double>(t.n_total);
  t.weighted_mean_mm = sum / n;
  for (const SplintRow& r : rows) {
    const double apart = r.avg_mm - t.weighted_mean_mm, weight = static_cast<double>(r.n) / n;
    within += weight * r.std_mm * r.std_mm;
    total += weight * (r.std_mm * r.std_mm + apart * apart);
  }
  t.within_std_mm = std::sqrt(within);
  t.total_std_mm = std::sqrt(total);
  t.mean_alpha_deg = mean_of(rows, &SplintRow::alpha_deg);
  t.mean_t_mm = mean_of(rows, &SplintRow::t_mm);
  return t;
}

ProcedureTable tabulate(std::string procedure, std::vector<SplintRow> rows,
                        const StatisticsOptions& options) {
  ProcedureTable table;
  table.procedure = std::move(procedure);
  table.splints = std::move(rows);
  flag_outliers(table.splints, options);
  std::vector<SplintRow> kept;
  for (const SplintRow& r : table.splints)
    if (!r.outlier) kept.push_back(r);
  table.totals = totals_of(table.splints);
  table.without_outliers = totals_of(kept);
  if (table.splints.size() >= 3 && options.resamples >= 100)
    table.bootstrap = bootstrap(table.splints, options);
  if (options.equivalence_mm && table.splints.size() >= 2)
    table.equivalence = test_equivalence(table.splints, *options.equivalence_mm, table.bootstrap);
  return table;
}

}  // namespace gnathion
