// Statistics over splints (docs/evaluation.md): the rows that the six procedures give, what they sum to, and
// what a reader should know about them. Splints are the sampling units, never points.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"

namespace gnathion {

/// One splint in one procedure.
struct SplintRow {
  std::string splint;
  std::size_t n = 0;
  double avg_mm = 0.0;  ///< signed
  double std_mm = 0.0;
  std::optional<double> alpha_deg, t_mm, max_tooth_mm;  ///< where there is a motion
  bool outlier = false;
  double robust_z = 0.0;  ///< largest over the row's figures
};

struct Totals {
  std::size_t splints = 0, n_total = 0;
  double weighted_mean_mm = 0.0;  ///< m̄ = ΣN·m / ΣN
  double total_std_mm = 0.0;      ///< √(ΣN(s² + (m − m̄)²) / ΣN); published as "pooled"
  double within_std_mm = 0.0;     ///< √(ΣN·s² / ΣN)
  std::optional<double> mean_alpha_deg, mean_t_mm;  ///< plain means over splints
};

/// An interval that holds a figure, by resampling splints.
struct Interval {
  double low = 0.0, high = 0.0;
};
struct BootstrapIntervals {
  std::size_t resamples = 0;
  Interval weighted_mean95_mm, weighted_mean90_mm, total_std95_mm;
};

/// Two one-sided tests of the splints' mean AVG against ±tolerance (Schuirmann 1987).
struct Equivalence {
  double tolerance_mm = 0.0;
  double mean_mm = 0.0, standard_error_mm = 0.0;  ///< of the splints' AVG, each splint counting once
  double p_lower = 1.0, p_upper = 1.0;            ///< Student's t, splints − 1 degrees of freedom
  bool by_t = false;                              ///< both p below 0.05
  bool by_bootstrap = false;  ///< the 90 % bootstrap interval of the weighted mean lies within ±tolerance
  bool equivalent() const { return by_t && by_bootstrap; }
};

struct ProcedureTable {
  std::string procedure;  ///< as in the published table: "splint_vs_model", …
  std::vector<SplintRow> splints;
  Totals totals, without_outliers;
  std::optional<BootstrapIntervals> bootstrap;  ///< three splints or more
  std::optional<Equivalence> equivalence;       ///< a tolerance was given, and two splints or more
};

/// What a table prints for a procedure.
struct PrintedTotals {
  std::string procedure;
  std::optional<double> weighted_mean_mm, pooled_std_mm;
  int mean_decimals = 0, std_decimals = 0;
};

struct StatisticsOptions {
  double outlier_z = 3.5;  ///< Iglewicz & Hoaglin 1993
  /// Spread below which a splint is nobody's outlier, whatever the others do.
  double length_floor_mm = 0.005, angle_floor_deg = 0.02;
  std::size_t resamples = 5000;
  std::uint64_t seed = 1;
  std::optional<double> equivalence_mm;
};

Totals totals_of(const std::vector<SplintRow>& rows);
/// Robust z of each value: |x − median| / (1.4826·b_n·MAD), at least `floor` in the denominator.
/// b_n corrects for few values (Croux & Rousseeuw 1992). All zero for fewer than four values.
std::vector<double> robust_z(const std::vector<double>& values, double floor);
/// Flags outliers and fills in totals, bootstrap and equivalence. Rows keep their order.
ProcedureTable tabulate(std::string procedure, std::vector<SplintRow> rows, const StatisticsOptions& options);
/// Student's t: P(T > t).
double student_t_upper_tail(double t, double degrees_of_freedom);

/// What does not follow from the rows, or looks odd in them: printed signs lost, printed figures that differ,
/// rows so alike that they look like one scan.
std::vector<std::string> notes_on(const std::vector<ProcedureTable>& tables,
                                  const std::vector<PrintedTotals>& printed);

/// `procedure,splint,n,avg_mm,std_mm,alpha_deg,t_mm[,max_tooth_mm]`, in the order of first appearance.
/// Refused with line number: missing columns, not a number, n not positive, std negative, a splint twice.
Result<std::vector<ProcedureTable>> parse_rows(const std::string& csv, const std::string& name,
                                               const StatisticsOptions& options);
/// `procedure,printed_weighted_mean_mm,printed_pooled_std_mm`.
Result<std::vector<PrintedTotals>> parse_printed(const std::string& csv, const std::string& name);

}  // namespace gnathion
