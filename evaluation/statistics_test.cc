// Tables over splints: published figures, outliers, tests that resample splints.
#include "evaluation/statistics.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "core/file.h"
#include "core/random.h"

namespace gnathion {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::optional<std::string> published(const std::string& file) {
  const char* shared = std::getenv("GNATHION_SHARED");
  const std::filesystem::path path =
      std::filesystem::path(shared != nullptr ? shared : "../shared") / "data" / "paper" / file;
  const auto text = read_file(path);
  return text ? std::optional<std::string>(*text) : std::nullopt;
}

const ProcedureTable& table_of(const std::vector<ProcedureTable>& tables, const std::string& name) {
  for (const ProcedureTable& t : tables)
    if (t.procedure == name) return t;
  ADD_FAILURE() << "no " << name;
  return tables.front();
}

class Published : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto rows = published("appendix_b.csv"), printed = published("printed_totals.csv");
    if (!rows || !printed) GTEST_SKIP() << "the published rows are not on this machine";
    tables_ = parse_rows(*rows, "appendix_b.csv", {}).value();
    printed_ = parse_printed(*printed, "printed_totals.csv").value();
  }
  std::vector<ProcedureTable> tables_;
  std::vector<PrintedTotals> printed_;
};

TEST_F(Published, TotalsMeansAndDeviationsToThePrintedDigits) {
  struct Row {
    const char* procedure;
    std::size_t n;
    const char *mean, *std;
  };
  // Appendix B; the two means whose sign was lost stand here as the rows give them.
  for (const Row& r : {Row{"splint_vs_model", 1540464, "0.0119", "0.123"},
                       Row{"maxilla_vs_model", 434879, "-0.0050", "0.206"},
                       Row{"mandible_vs_model", 1267491, "0.0209", "0.127"},
                       Row{"maxillary_clearance", 434879, "-0.0245", "0.270"},
                       Row{"mandibular_sliding", 1267491, "-0.0059", "0.199"},
                       Row{"mandibular_transformation", 1267491, "0.0068", "0.265"}}) {
    const Totals& t = table_of(tables_, r.procedure).totals;
    EXPECT_EQ(t.n_total, r.n) << r.procedure;
    EXPECT_EQ(fmt::format("{:.4f}", t.weighted_mean_mm), r.mean) << r.procedure;
    EXPECT_EQ(fmt::format("{:.3f}", t.total_std_mm), r.std) << r.procedure;
    EXPECT_LE(t.within_std_mm, t.total_std_mm);
  }
}

TEST_F(Published, NotesSayWhatDoesNotFollowFromTheRows) {
  const std::vector<std::string> notes = notes_on(tables_, printed_);
  EXPECT_THAT(notes, Contains(AllOf(HasSubstr("maxilla_vs_model"), HasSubstr("sign is lost"))));
  EXPECT_THAT(notes, Contains(AllOf(HasSubstr("maxillary_clearance"), HasSubstr("sign is lost"))));
  EXPECT_THAT(notes,
              Contains(AllOf(HasSubstr("mandible_vs_model"), HasSubstr("8 of 8"), HasSubstr("158432-158440"),
                             HasSubstr("0.1272-0.1280"), HasSubstr("one scan"))));
  int of_print = 0, of_likeness = 0;
  for (const std::string& n : notes) {
    of_print += n.find("printed") != std::string::npos;
    of_likeness += n.find("one scan") != std::string::npos;
  }
  EXPECT_EQ(of_print, 2);
  EXPECT_EQ(of_likeness, 1);
}

TEST_F(Published, NotesFollowTheRowsAndNotTheNames) {
  std::vector<PrintedTotals> printed = printed_;
  for (PrintedTotals& p : printed) p.weighted_mean_mm = -*p.weighted_mean_mm;
  int lost = 0;
  for (const std::string& n : notes_on(tables_, printed)) lost += n.find("sign is lost") != std::string::npos;
  EXPECT_EQ(lost, 4);  // now the other four

  std::vector<ProcedureTable> spread = tables_;
  for (ProcedureTable& t : spread)
    for (std::size_t i = 0; i < t.splints.size(); ++i) t.splints[i].n += 900 * i;
  for (const std::string& n : notes_on(spread, {})) EXPECT_EQ(n.find("one scan"), std::string::npos) << n;
}

TEST_F(Published, TheThirdSplintIsTheOutlierWhereItIsSaidToBe) {
  for (const ProcedureTable& t : tables_) {
    for (const SplintRow& r : t.splints) {
      const bool wild = t.procedure != "mandible_vs_model" && t.procedure != "mandibular_sliding";
      EXPECT_EQ(r.outlier, wild && r.splint == "3") << t.procedure << " " << r.splint << " z " << r.robust_z;
    }
  }
  const ProcedureTable& whole = table_of(tables_, "mandibular_transformation");
  EXPECT_EQ(whole.without_outliers.splints, 7u);
  EXPECT_LT(whole.without_outliers.total_std_mm, 0.19);
}

TEST(Statistics, TotalDeviationIsThatOfAllPointsTogether) {
  Random random(20261122);
  std::vector<SplintRow> rows;
  std::vector<double> everything;
  for (int s = 0; s < 5; ++s) {
    const std::size_t n = 500 + random.below(2000);
    const double shift = random.normal(), width = random.uniform(0.2, 2.0);
    double sum = 0.0, squares = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const double x = shift + width * random.normal();
      everything.push_back(x);
      sum += x, squares += x * x;
    }
    const double mean = sum / static_cast<double>(n);
    SplintRow r;
    r.splint = std::to_string(s);
    r.n = n;
    r.avg_mm = mean;
    r.std_mm = std::sqrt(squares / static_cast<double>(n) - mean * mean);
    rows.push_back(r);
  }
  double mean = 0.0, variance = 0.0;
  for (double x : everything) mean += x / static_cast<double>(everything.size());
  for (double x : everything) variance += (x - mean) * (x - mean) / static_cast<double>(everything.size());
  const Totals t = totals_of(rows);
  EXPECT_EQ(t.n_total, everything.size());
  EXPECT_NEAR(t.weighted_mean_mm, mean, 1e-12);
  EXPECT_NEAR(t.total_std_mm, std::sqrt(variance), 1e-9);
}

TEST(Statistics, StudentsTailsAreThoseOfTheTables) {
  // Critical values of any statistics table.
  EXPECT_NEAR(student_t_upper_tail(1.894579, 7), 0.05, 1e-6);
  EXPECT_NEAR(student_t_upper_tail(2.364624, 7), 0.025, 1e-6);
  EXPECT_NEAR(student_t_upper_tail(63.656741, 1), 0.005, 1e-6);
  EXPECT_NEAR(student_t_upper_tail(1.644854, 1e7), 0.05, 1e-6);
  EXPECT_NEAR(student_t_upper_tail(0.0, 3), 0.5, 1e-12);
  EXPECT_NEAR(student_t_upper_tail(-1.894579, 7), 0.95, 1e-6);
}

std::vector<SplintRow> drawn_splints(Random& random, std::size_t count, double mean, double sigma,
                                     std::size_t n) {
  std::vector<SplintRow> rows(count);
  for (std::size_t i = 0; i < count; ++i) {
    rows[i].splint = std::to_string(i);
    rows[i].n = n;
    rows[i].avg_mm = mean + sigma * random.normal();
    rows[i].std_mm = 0.1;
  }
  return rows;
}

TEST(Statistics, MorePointsMakeNoEvidenceMoreSplintsDo) {
  Random random(4451);
  StatisticsOptions options;
  options.equivalence_mm = 0.05;
  const std::vector<SplintRow> rows = drawn_splints(random, 8, 0.01, 0.03, 1000);
  std::vector<SplintRow> dense = rows;
  for (SplintRow& r : dense) r.n *= 1000;
  const ProcedureTable a = tabulate("x", rows, options), b = tabulate("x", dense, options);
  ASSERT_TRUE(a.bootstrap && a.equivalence);
  EXPECT_EQ(a.bootstrap->weighted_mean95_mm.low, b.bootstrap->weighted_mean95_mm.low);
  EXPECT_EQ(a.equivalence->p_upper, b.equivalence->p_upper);
  const ProcedureTable c = tabulate("x", drawn_splints(random, 200, 0.01, 0.03, 1000), options);
  EXPECT_LT(c.equivalence->standard_error_mm, 0.5 * a.equivalence->standard_error_mm);
}

/// Equivalence of splints whose true mean stands on the margin is claimed at most about 5 % of the time.
TEST(Statistics, EquivalenceIsSeldomClaimedOnTheMargin) {
  Random random(90210);
  StatisticsOptions options;
  options.equivalence_mm = 0.05;
  options.resamples = 400;
  int claimed = 0, found = 0;
  constexpr int kTrials = 400;
  for (int i = 0; i < kTrials; ++i) {
    claimed += tabulate("x", drawn_splints(random, 8, 0.05, 0.02, 1000), options).equivalence->equivalent();
    found += tabulate("x", drawn_splints(random, 8, 0.0, 0.02, 1000), options).equivalence->equivalent();
  }
  EXPECT_LT(claimed, 0.085 * kTrials);  // 5 % and three standard errors
  EXPECT_GT(found, 0.9 * kTrials);
}

TEST(Statistics, FewSplintsHaveNoOutliers) {
  EXPECT_THAT(robust_z({1.0, 1.0, 90.0}, 0.005), testing::Each(0.0));
  const std::vector<double> z = robust_z({0.1, 0.1, 0.1, 0.1002, 0.1}, 0.005);  // alike to the resolution
  EXPECT_LT(*std::max_element(z.begin(), z.end()), 0.1);
}

TEST(Statistics, BadRowsAreRefusedWithTheirLine) {
  const std::string head = "procedure,splint,n,avg_mm,std_mm,alpha_deg,t_mm\n";
  const auto why = [&](const std::string& csv) {
    const auto r = parse_rows(csv, "rows.csv", {});
    return r ? std::string("accepted") : r.error().line();
  };
  EXPECT_THAT(why(""), HasSubstr("empty"));
  EXPECT_THAT(why(head), HasSubstr("no rows"));
  EXPECT_THAT(why("a,b\n1,2\n"), HasSubstr("no column 'procedure'"));
  EXPECT_THAT(why(head + "x,1,10,0.1,0.1,,\nx,2,ten,0.1,0.1,,\n"), HasSubstr("line 3"));
  EXPECT_THAT(why(head + "x,1,10,0.1,-0.1,,\n"), HasSubstr("negative"));
  EXPECT_THAT(why(head + "x,1,0,0.1,0.1,,\n"), HasSubstr("positive"));
  EXPECT_THAT(why(head + "x,1,10,nan,0.1,,\n"), HasSubstr("avg_mm"));
  EXPECT_THAT(why(head + "x,1,10,0.1\n"), HasSubstr("4 fields"));
  EXPECT_THAT(why(head + "x,1,10,0,0.1,,\nx,1,10,0,0.1,,\n"), HasSubstr("twice"));
  EXPECT_EQ(why(head + "# remark\r\nx, 1 ,10,+0.1,0.1,,\r\n"), "accepted");
}

}  // namespace
}  // namespace gnathion
