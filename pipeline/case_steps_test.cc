#include "pipeline/case_steps.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/interrupt.h"
#include "core/random.h"
#include "core/transform_io.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// Three steps over two inputs: a reads one, b the other and a, c reads b.
class Steps : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_steps_" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    ASSERT_TRUE(write_file(folder_ / "one", "1"));
    ASSERT_TRUE(write_file(folder_ / "two", "2"));
  }
  void TearDown() override { fs::remove_all(folder_); }

  static Status bulk(const fs::path& path, const std::string& seed) {
    std::string text;
    for (int i = 0; i < 20000; ++i) text += seed + std::to_string(i);
    return write_file(path, text);
  }

  Result<std::vector<StepOutcome>> run(const std::string& parameters = "{}", bool force = false,
                                       int size = 1) {
    ManualClock clock(HostTime{1'700'000'000'000'000'000});
    GNATHION_TRY(CaseSteps steps, CaseSteps::open(folder_, "p-1", force, clock));
    GNATHION_TRY(const fs::path a,
                 steps.run({"a", 1, {{"in.one", folder_ / "one"}}, {}, "{}"},
                           [&](const fs::path& out, StepRecord& r) -> Status {
                             GNATHION_TRY(const std::string one, read_file(folder_ / "one"));
                             r.facts = {"one is " + one};
                             for (int i = 1; i < size; ++i)
                               GNATHION_CHECK_OK(bulk(out / ("bulk" + std::to_string(i)), one));
                             return write_json(out / "a.json", {{"one", one}});
                           }));
    GNATHION_TRY(
        const fs::path b,
        steps.run(
            {"b", 1, {{"in.two", folder_ / "two"}}, {{"a", "a.json"}}, parameters},
            [&](const fs::path& out, StepRecord&) -> Status {
              GNATHION_TRY(const json j, read_json(a / "a.json"));
              GNATHION_TRY(const std::string two, read_file(folder_ / "two"));
              std::error_code ec;
              fs::create_directory(out / "pictures", ec);
              GNATHION_CHECK_OK(write_file(out / "pictures" / "b.png", two));
              return write_json(out / "b.json", {{"sum", j["one"].get<std::string>() + two + parameters}});
            }));
    GNATHION_TRY(
        const fs::path c,
        steps.run({"c", 1, {}, {{"b", "b.json"}}, "{}"}, [&](const fs::path& out, StepRecord&) -> Status {
          GNATHION_TRY(const json j, read_json(b / "b.json"));
          for (int i = 1; i < size; ++i)
            GNATHION_CHECK_OK(bulk(out / ("solid" + std::to_string(i)), j["sum"]));
          return write_file(out / "c.stl", j["sum"].get<std::string>());
        }));
    GNATHION_CHECK_OK(steps.publish());
    return steps.outcomes();
  }

  static std::string told(const Result<std::vector<StepOutcome>>& r) {
    if (!r) return r.error().line();
    std::string text;
    for (const StepOutcome& s : *r) text += s.step + (s.reused ? "=" : "!") + (s.reused ? "" : s.why) + " ";
    return text;
  }

  std::map<std::string, std::string> results() const {
    std::map<std::string, std::string> all;
    for (const auto& f : fs::recursive_directory_iterator(folder_ / "results"))
      if (f.is_regular_file())
        all[f.path().lexically_relative(folder_ / "results").string()] = *read_file(f.path());
    return all;
  }
  std::size_t changed(const std::string& result = "") const {
    const auto tree = trace_provenance(folder_, result);
    EXPECT_TRUE(tree) << tree.error().line();
    return tree ? changed_files(*tree).size() : 99;
  }

  fs::path folder_;
};

TEST_F(Steps, OnlyWhatChangedIsRedoneAndTheReasonIsTold) {
  EXPECT_EQ(told(run()), "a!never ran b!never ran c!never ran ");
  EXPECT_EQ(told(run()), "a= b= c= ");
  ASSERT_TRUE(write_file(folder_ / "two", "22"));
  EXPECT_EQ(told(run()), "a= b!in.two changed c!a step before it was redone ");
  EXPECT_EQ(*read_file(folder_ / "results" / "c.stl"), "122{}");
  EXPECT_EQ(told(run(R"({"wall_mm":1.5})")),
            "a= b!wall_mm: nothing became 1.5 c!a step before it was redone ");
  EXPECT_EQ(told(run(R"({"wall_mm":2.5})")), "a= b!wall_mm: 1.5 became 2.5 c!a step before it was redone ");
  EXPECT_EQ(told(run(R"({"wall_mm":2.5})", true)), "a!--force b!--force c!--force ");
  ASSERT_TRUE(write_file(folder_ / "two", "22"));  // written again, the same: nothing changed
  EXPECT_EQ(told(run(R"({"wall_mm":2.5})")), "a= b= c= ");
}

TEST_F(Steps, ResultsThatWereChangedByHandAreMadeAnew) {
  ASSERT_TRUE(run());
  const auto before = results();
  std::ofstream(folder_ / "results" / "c.stl", std::ios::app) << "x";  // in place
  EXPECT_EQ(changed("c.stl"), 1u);
  const auto redone = run();
  EXPECT_EQ(results(), before) << told(redone);
  ASSERT_TRUE(write_file(folder_ / "results" / "c.stl", "by rename"));
  EXPECT_EQ(told(run()), "a= b= c= ");
  EXPECT_EQ(results(), before);
  fs::remove_all(folder_ / "results");
  EXPECT_EQ(told(run()), "a= b= c= ");
  EXPECT_EQ(results(), before);
  fs::remove(folder_ / ".steps" / "b" / "b.json");
  EXPECT_EQ(told(run()), "a= b!its result b.json is gone c= ");
  ASSERT_TRUE(write_file(folder_ / ".steps" / "a" / "step.json", "{"));
  EXPECT_EQ(told(run()), "a!its record cannot be read b= c= ");
}

TEST_F(Steps, WhatAUserPutAmongTheResultsStays) {
  ASSERT_TRUE(run());
  fs::create_directories(folder_ / "results" / "evaluation");
  ASSERT_TRUE(write_file(folder_ / "results" / "evaluation" / "mine.txt", "mine"));
  ASSERT_TRUE(run("{\"x\":1}"));
  EXPECT_EQ(*read_file(folder_ / "results" / "evaluation" / "mine.txt"), "mine");
  fs::remove_all(folder_ / "results");
  fs::remove_all(folder_ / ".steps");
  fs::create_directories(folder_ / "results");
  ASSERT_TRUE(write_file(folder_ / "results" / "design.json", "{}"));
  const auto refused = run();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kUsage);
  EXPECT_EQ(*read_file(folder_ / "results" / "design.json"), "{}");
  EXPECT_TRUE(run("{}", true));
}

TEST_F(Steps, ProvenanceGoesBackToWhatCameFromOutsideAndNamesWhatChanged) {
  ASSERT_TRUE(run());
  const auto tree = trace_provenance(folder_, "c.stl");
  ASSERT_TRUE(tree) << tree.error().line();
  const std::string text = provenance_text(*tree);
  for (const char* part : {"results/c.stl", "results/b.json", "results/a.json", "one", "two", "one is 1",
                           "by c 1 of gnathion", "2023-11-14T22:13:20Z"})
    EXPECT_NE(text.find(part), std::string::npos) << text;
  EXPECT_TRUE(changed_files(*tree).empty());
  const auto j = read_json(folder_ / "results" / "b.json");
  ASSERT_TRUE(j);
  EXPECT_EQ((*j)["provenance"]["inputs"][0]["path"], "two");
  EXPECT_EQ((*j)["provenance"]["inputs"][0]["sha256"], sha256_hex("2"));
  ASSERT_TRUE(write_file(folder_ / "one", "changed"));
  fs::remove(folder_ / "two");
  const auto later = trace_provenance(folder_, "results/c.stl");
  ASSERT_TRUE(later);
  EXPECT_EQ(changed_files(*later), (std::vector<std::string>{"one changed since", "two is gone"}));
  EXPECT_FALSE(trace_provenance(folder_, "nothing.stl"));
  EXPECT_FALSE(trace_provenance(folder_ / "absent", ""));
  auto loop = *read_json(folder_ / "results" / "provenance.json");
  loop["steps"][0]["inputs"].push_back({{"step", "c"}, {"path", "c.stl"}, {"sha256", ""}});
  ASSERT_TRUE(write_json(folder_ / "results" / "provenance.json", loop));
  EXPECT_FALSE(trace_provenance(folder_, "c.stl")) << "a loop is refused";
}

TEST_F(Steps, TwoRunsAtOnceAreToldApart) {
  ManualClock clock;
  const auto first = CaseSteps::open(folder_, "p-1", false, clock);
  ASSERT_TRUE(first);
  const auto second = run();
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kUsage);
  EXPECT_NE(second.error().line().find("another run (process " + std::to_string(::getpid())),
            std::string::npos);
}

TEST_F(Steps, AFullDiskLeavesTheOldResults) {
  ASSERT_TRUE(run("{}", false, 3));
  const auto before = results();
  ASSERT_TRUE(write_file(folder_ / "one", "other"));
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{50'000, 50'000};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const auto r = run("{}", false, 3);
    ::_exit(!r && r.error().line().find('\n') == std::string::npos ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(pid, &status, 0), pid);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(results(), before);
  EXPECT_FALSE(fs::exists(folder_ / ".steps" / ".a.part"));
  EXPECT_TRUE(run("{}", false, 3));
}

TEST_F(Steps, EverythingIsPrivate) {
  ASSERT_TRUE(run());
  for (const char* top : {"results", ".steps"})
    for (const auto& f : fs::recursive_directory_iterator(folder_ / top)) {
      struct stat s {};
      ASSERT_EQ(::stat(f.path().c_str(), &s), 0);
      EXPECT_EQ(s.st_mode & 0777, f.is_directory() ? 0700u : 0600u) << f.path();
    }
}

TEST_F(Steps, KilledAtAnyMomentItEndsWithTheSameBytes) {
  const char* seed = std::getenv("GNATHION_SEED");
  Random random(seed != nullptr ? std::strtoull(seed, nullptr, 10) : 5);
  ASSERT_TRUE(run("{}", false, 4));
  const auto reference = results();
  const auto begun = std::chrono::steady_clock::now();
  ASSERT_TRUE(run("{\"old\":1}", true, 4));
  const double whole_us =
      std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begun).count();
  const auto old = results();
  int kills = 0;
  const char* rounds = std::getenv("GNATHION_KILL_ROUNDS");
  for (int round = 0; round < (rounds != nullptr ? std::atoi(rounds) : 6); ++round) {
    fs::remove_all(folder_ / ".steps");
    for (bool done = false; !done;) {
      const pid_t pid = ::fork();
      ASSERT_GE(pid, 0);
      if (pid == 0) {
        const auto r = run("{}", false, 4);
        if (!r) std::fprintf(stderr, "%s\n", r.error().line().c_str());
        ::_exit(r ? 0 : 1);
      }
      ::usleep(static_cast<useconds_t>(random.uniform(0, 1.2 * whole_us)));
      ::kill(pid, SIGKILL);
      int status = 0;
      ASSERT_EQ(::waitpid(pid, &status, 0), pid);
      ASSERT_TRUE(WIFSIGNALED(status) || WEXITSTATUS(status) == 0);
      done = !WIFSIGNALED(status);
      kills += done ? 0 : 1;
      const auto now = results();
      ASSERT_TRUE(now == old || now == reference)
          << "after kill " << kills << " results are neither old nor new";
      ASSERT_EQ(changed(), 0u);
    }
    ASSERT_EQ(results(), reference) << "round " << round;
    ASSERT_FALSE(fs::exists(folder_ / ".results.part"));
    ASSERT_TRUE(run("{\"old\":1}", true, 4));
    ASSERT_EQ(results(), old);
  }
  EXPECT_GT(kills, 5);
  std::printf("%d kills\n", kills);
}

/// A process in the middle of a step; ends by itself only when nobody ends it.
pid_t in_the_middle_of_a_step(const fs::path& folder, bool cleans_up) {
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  if (cleans_up) clean_up_when_interrupted();
  ManualClock clock(HostTime{1});
  auto steps = CaseSteps::open(folder, "p-1", false, clock);
  if (steps)
    (void)steps->run({"slow", 1, {}, {}, "{}"}, [&](const fs::path& out, StepRecord&) -> Status {
      GNATHION_CHECK_OK(write_file(out / "half.json", "{"));
      GNATHION_CHECK_OK(write_file(folder / "begun", ""));
      for (int i = 0; i < 6000; ++i) ::usleep(10'000);
      return {};
    });
  ::_exit(1);
}

int ended_by(pid_t pid, int signal) {
  ::kill(pid, signal);
  int status = 0;
  ::waitpid(pid, &status, 0);
  return WIFSIGNALED(status) ? WTERMSIG(status) : 0;
}

bool comes(const fs::path& path) {
  for (int i = 0; i < 3000 && !fs::exists(path); ++i) ::usleep(10'000);
  return fs::exists(path);
}

TEST_F(Steps, ARunThatIsInterruptedLeavesNothingHalfMade) {
  ASSERT_TRUE(run());
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) {
    fs::remove(folder_ / "begun");
    const pid_t pid = in_the_middle_of_a_step(folder_, true);
    ASSERT_TRUE(comes(folder_ / "begun"));
    ASSERT_TRUE(fs::exists(folder_ / ".steps/.slow.part/half.json"));
    EXPECT_EQ(ended_by(pid, signal), signal);  // as who sent it expects
    EXPECT_FALSE(fs::exists(folder_ / ".steps/.slow.part")) << signal;
  }
  // Killed, it can clean nothing: who comes next does, and touches no run that is at work.
  fs::remove(folder_ / "begun");
  const pid_t pid = in_the_middle_of_a_step(folder_, true);
  ASSERT_TRUE(comes(folder_ / "begun"));
  EXPECT_FALSE(clean_interrupted_run(folder_));
  EXPECT_TRUE(fs::exists(folder_ / ".steps/.slow.part"));
  EXPECT_EQ(ended_by(pid, SIGKILL), SIGKILL);
  fs::create_directory(folder_ / ".results.part");
  EXPECT_TRUE(clean_interrupted_run(folder_));
  EXPECT_FALSE(fs::exists(folder_ / ".steps/.slow.part"));
  EXPECT_FALSE(fs::exists(folder_ / ".results.part"));
  EXPECT_FALSE(clean_interrupted_run(folder_));
  EXPECT_EQ(told(run()), "a= b= c= ");  // what was done before stays
}

TEST_F(Steps, AnInputThatChangesWhileItIsReadEndsTheRun) {
  ManualClock clock(HostTime{1});
  auto steps = CaseSteps::open(folder_, "p-1", false, clock);
  ASSERT_TRUE(steps);
  ASSERT_TRUE(steps->know(folder_ / "two"));
  const auto ran = steps->run({"x", 1, {{"in.one", folder_ / "one"}}, {}, "{}"},
                              [&](const fs::path& out, StepRecord&) -> Status {
                                GNATHION_CHECK_OK(write_file(folder_ / "two", "another"));
                                return write_file(out / "x", "x");
                              });
  ASSERT_FALSE(ran);
  EXPECT_NE(ran.error().line().find("was changed while the case was run"), std::string::npos);
  EXPECT_FALSE(fs::exists(folder_ / ".steps/x"));
}

TEST_F(Steps, AFileOutsideTheCaseIsNamedWithoutItsPlace) {
  const fs::path outside = fs::temp_directory_path() / ("gnathion_elsewhere_" + std::to_string(::getpid()));
  ASSERT_TRUE(write_file(outside, "x"));
  {
    ManualClock clock(HostTime{1});
    auto steps = CaseSteps::open(folder_, "p-1", false, clock);
    ASSERT_TRUE(steps);
    ASSERT_TRUE(steps->run({"x", 1, {{"in.x", outside}}, {}, "{}"}, [](const fs::path& out, StepRecord&) {
      return write_json(out / "x.json", {{"a", 1}});
    }));
    ASSERT_TRUE(steps->publish());
  }
  for (const char* file : {"provenance.json", "x.json"}) {
    const std::string text = *read_file(folder_ / "results" / file);
    EXPECT_EQ(text.find(outside.parent_path().string() + "/"), std::string::npos) << text;
    EXPECT_NE(text.find(outside.filename().string()), std::string::npos);
  }
  EXPECT_EQ(changed(), 0u);
  const auto tree = trace_provenance(folder_, "x.json");
  ASSERT_TRUE(tree);
  EXPECT_NE(provenance_text(*tree).find("not compared"), std::string::npos);
  fs::remove(outside);
}

TEST_F(Steps, AnotherBuildOfTheSameVersionRedoes) {
  ASSERT_TRUE(run());
  const fs::path record = folder_ / ".steps/a/step.json";
  json j = *read_json(record);
  EXPECT_EQ(j["build"].get<std::string>().size(), 16u);
  j["build"] = "0123456789abcdef";
  j["key"] = "of that build";
  ASSERT_TRUE(write_json(record, j));
  EXPECT_EQ(told(run()).substr(0, 36), "a!made by another build of gnathion ");
}

}  // namespace
}  // namespace gnathion
