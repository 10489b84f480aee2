// evaluation.toml and rows as they are read, and what is refused of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/transform_io.h"
#include "pipeline/evaluate_job.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class EvaluateFile : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::remove_all(root_);
    fs::create_directories(root_ / "d1");
    fs::create_directories(root_ / "out");
    std::ofstream(root_ / "s.ply") << "ply";
  }
  void TearDown() override { fs::remove_all(root_); }
  Result<EvaluateJob> read(const std::string& toml) {
    std::ofstream(root_ / "evaluation.toml") << toml;
    return read_evaluation_file(root_ / "evaluation.toml");
  }
  std::string refusal(const std::string& toml) {
    const auto job = read(toml);
    return job ? std::string("accepted") : job.error().line();
  }
  const fs::path root_ = fs::path(testing::TempDir()) / "evaluate_file_test";
  const std::string splint_ = "[[splint]]\ndesign = 'd1'\nscan_splint = 's.ply'\n";
};

TEST_F(EvaluateFile, KeysArriveWhereTheyBelong) {
  const auto job = read(splint_ +
                        "name = 7\nmandible_pose = 'tp'\n[evaluation]\nseat_region = 'crowns'\nrim_mm = 0.7\n"
                        "[statistics]\nresamples = 200\n[tolerance]\nt_mm = 0.3\nequivalence_mm = 0.1\n");
  ASSERT_TRUE(job.has_value()) << job.error().line();
  ASSERT_EQ(job->splints.size(), 1u);
  EXPECT_EQ(job->splints[0].name, "7");
  EXPECT_TRUE(job->splints[0].mandible_is_in_tp);
  EXPECT_EQ(job->splints[0].scan_splint, root_ / "s.ply");
  EXPECT_EQ(job->options.seat_region, SeatRegion::kCrowns);
  EXPECT_EQ(job->options.rim_mm, 0.7);
  EXPECT_EQ(job->statistics.resamples, 200u);
  EXPECT_EQ(job->tolerance.t_mm, 0.3);
  EXPECT_FALSE(job->tolerance.avg_mm);
}

TEST_F(EvaluateFile, WhatIsWrongIsNamed) {
  EXPECT_THAT(refusal("= 3"), HasSubstr("line 1"));
  EXPECT_THAT(refusal(""), HasSubstr("no [[splint]]"));
  EXPECT_THAT(refusal("[[splint]]\nscan_splint = 's.ply'\n"), HasSubstr("without design"));
  EXPECT_THAT(refusal("[[splint]]\ndesign = 'd1'\n"), HasSubstr("without scan_splint"));
  EXPECT_THAT(refusal("[[splint]]\ndesign = 'd2'\n"), HasSubstr("d2 does not exist"));
  EXPECT_THAT(refusal(splint_ + "scan_upper = 's.ply'\n"), HasSubstr("unknown key 'scan_upper'"));
  EXPECT_THAT(refusal(splint_ + "[evaluation]\nreach_mm = 100\n"), HasSubstr("0.5 to 10"));
  EXPECT_THAT(refusal(splint_ + "[evaluation]\nseat_region = 'gums'\n"), HasSubstr("palate"));
  EXPECT_THAT(refusal(splint_ + "[tolerance]\nt_mm = 'much'\n"), HasSubstr("not a number"));
}

TEST_F(EvaluateFile, RowsGiveTablesNotesAndAVerdict) {
  const auto write_rows = [&](const char* last) {
    std::ofstream(root_ / "rows.csv") << "procedure,splint,n,avg_mm,std_mm,alpha_deg,t_mm\n"
                                         "mandibular_sliding,1,1000,0.01,0.10,0.2,0.1\n"
                                         "mandibular_sliding,2,3000,-0.02,0.12,0.3,0.2\n"
                                      << last;
  };
  write_rows("");
  std::ofstream(root_ / "printed_totals.csv")
      << "procedure,printed_weighted_mean_mm,printed_pooled_std_mm\nmandibular_sliding,0.0125,0.116\n";
  EvaluateJob job;
  job.rows = root_ / "rows.csv";
  job.tolerance.t_mm = 0.15;
  SilentProgress silent;
  const auto outcome = run_evaluation(job, root_ / "out", silent);
  ASSERT_TRUE(outcome.has_value()) << outcome.error().line();
  ASSERT_EQ(outcome->violated.size(), 1u);
  EXPECT_THAT(outcome->violated[0], HasSubstr("splint 2: mandibular_sliding t_mm"));
  ASSERT_EQ(outcome->notes.size(), 1u);  // −0.0125 by the rows; the deviation agrees
  EXPECT_THAT(outcome->notes[0], HasSubstr("sign is lost"));
  const nlohmann::json j = read_json(root_ / "out" / "evaluation.json").value();
  EXPECT_EQ(j["procedures"][0]["n_total"], 4000);
  EXPECT_NEAR(j["procedures"][0]["weighted_mean_mm"].get<double>(), -0.0125, 1e-12);
  EXPECT_TRUE(j["procedures"][0]["splints"][0]["max_tooth_mm"].is_null());
  write_rows("mandibular_sliding,1,5,0,0,,\n");
  EXPECT_THAT(run_evaluation(job, root_ / "out", silent).error().line(), HasSubstr("twice"));
}

}  // namespace
}  // namespace gnathion
