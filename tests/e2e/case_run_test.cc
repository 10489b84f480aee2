// `gnathion run` on a whole case, killed again and again: it goes on and ends with the same bytes.
#include "pipeline/run_case.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "core/random.h"
#include "core/transform_io.h"
#include "occlusion/test_jaws.h"
#include "pipeline/case_folder.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

int number_from(const char* variable, int fallback) {
  const char* text = std::getenv(variable);
  return text != nullptr ? std::atoi(text) : fallback;
}

/// All files of results/, without what is allowed to differ: times and memory of the design, and what hashes
/// them.
std::map<std::string, std::string> comparable(const fs::path& folder) {
  std::map<std::string, std::string> all;
  std::string design_sha, report_sha;
  for (const auto& f : fs::recursive_directory_iterator(folder / "results")) {
    if (!f.is_regular_file()) continue;
    const std::string name = f.path().lexically_relative(folder / "results").generic_string();
    all[name] = *read_file(f.path());
    if (name == "design.json") design_sha = sha256_hex(all[name]);
    if (name == "report.html") report_sha = sha256_hex(all[name]);
  }
  json design = json::parse(all["design.json"]);
  for (const char* key : {"timing_s", "peak_rss_mib"}) design.erase(key);
  all["design.json"] = design.dump();
  for (const char* name : {"report.html", "provenance.json"})
    for (const std::string& sha : {design_sha, report_sha})
      for (std::size_t at = 0; (at = all[name].find(sha)) != std::string::npos;)
        all[name].replace(at, sha.size(), "-");
  return all;
}

class CaseRun : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_case_run_" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    const testing::SimpleJaws jaws = testing::simple_jaws();
    ASSERT_TRUE(write_mesh(folder_ / "u.stl", jaws.maxilla));
    ASSERT_TRUE(write_mesh(folder_ / "l.stl", jaws.mandible));
    const Motion<Dental> th(Rigid3::from_translation({0, 0, -3}));
    ASSERT_TRUE(write_json(folder_ / "t.json", motion_json(th, std::nullopt, {})));
    NewCase c;
    c.id = "p-1";
    c.patient.name = "Zofia Wisniewska";
    c.patient.number = "77010112345";
    c.files = {{"maxilla_mi", folder_ / "u.stl"},
               {"mandible_mi", folder_ / "l.stl"},
               {"position.transform", folder_ / "t.json"}};
    c.more_toml = "\n[design]\nvoxel_mm = 0.3\naperture_limit_mm = 0.6\n";
    ManualClock clock(HostTime{1'700'000'000'000'000'000});
    const auto made = create_case(folder_ / "case", c, clock);
    ASSERT_TRUE(made) << made.error().line();
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// In a process of its own: threads of the design do not outlive a fork.
  static pid_t start(const fs::path& folder, bool force = false) {
    const pid_t pid = ::fork();
    if (pid < 0) std::abort();  // a kill of -1 would be one of everybody
    if (pid != 0) return pid;
    const auto files = read_case(folder);
    if (!files) ::_exit(3);
    ManualClock clock(HostTime{1'700'000'000'000'000'000});
    RunOptions options;
    options.parameters = files->parameters;
    options.force = force;
    options.clock = &clock;
    SilentProgress silent;
    const auto r = run_case(*files, options, silent);
    if (!r) std::fprintf(stderr, "%s\n", r.error().line().c_str());
    int reused = 0;
    if (r)
      for (const StepOutcome& s : r->steps) reused += s.reused ? 1 : 0;
    ::_exit(r ? 100 + reused : 1);
  }
  static int wait(pid_t pid) {
    int status = 0;
    EXPECT_EQ(::waitpid(pid, &status, 0), pid);
    return WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
  }

  fs::path folder_;
};

TEST_F(CaseRun, KilledAtAnyMomentItGoesOnAndEndsWithTheSameBytes) {
  const fs::path at = folder_ / "case";
  const auto begun = std::chrono::steady_clock::now();
  ASSERT_EQ(wait(start(at)), 100);
  const double whole_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  const auto reference = comparable(at);
  for (const char* name : {"T_th.json", "displacement.json", "design.json", "feasibility.json", "report.html",
                           "provenance.json"})
    ASSERT_EQ(reference.count(name), 1u) << name;
  ASSERT_EQ(wait(start(at)), 104) << "all four steps are reused";

  Random random(static_cast<std::uint64_t>(number_from("GNATHION_SEED", 17)));
  const int wanted = number_from("GNATHION_KILLS", 4);
  int kills = 0, rounds = 0;
  for (; kills < wanted && rounds < 4 * wanted; ++rounds) {
    fs::remove_all(at / ".steps");
    fs::remove_all(at / "results");
    for (int outcome = -SIGKILL; outcome < 0;) {
      const pid_t pid = start(at);
      // More kills than wanted end with a run that is let go on, however slow the machine has become.
      if (kills < wanted) {
        ::usleep(static_cast<useconds_t>(random.uniform(0, 1.1 * whole_s * 1e6)));
        ::kill(pid, SIGKILL);
      }
      outcome = wait(pid);
      ASSERT_TRUE(outcome == -SIGKILL || outcome >= 100) << outcome;
      kills += outcome == -SIGKILL ? 1 : 0;
      if (!fs::exists(at / "results")) continue;
      const auto tree = trace_provenance(at, "");
      ASSERT_TRUE(tree) << tree.error().line();
      ASSERT_TRUE(changed_files(*tree).empty()) << "results that are there are whole";
    }
    const auto now = comparable(at);
    for (const auto& [name, bytes] : reference) {
      ASSERT_EQ(now.count(name), 1u) << name;
      EXPECT_TRUE(now.at(name) == bytes) << name << " differs after kill " << kills;
    }
    EXPECT_EQ(now.size(), reference.size());
  }
  EXPECT_GE(kills, wanted);
  std::printf("%d kills over %d runs of %.1f s\n", kills, rounds, whole_s);
}

TEST_F(CaseRun, OnlyWhatChangedIsRedoneAndNothingTellsWhoThePatientIs) {
  const fs::path at = folder_ / "case";
  ASSERT_EQ(wait(start(at)), 100);
  for (const auto& f : fs::recursive_directory_iterator(at)) {
    if (!f.is_regular_file() || f.path().filename() == "case.toml") continue;
    const auto bytes = read_file(f.path());
    ASSERT_TRUE(bytes);
    for (const char* secret : {"Wisniewska", "Zofia", "77010112345"})
      EXPECT_EQ(bytes->find(secret), std::string::npos) << f.path();
  }
  const std::string toml = *read_file(at / "case.toml");
  ASSERT_TRUE(write_file(at / "case.toml", "# a comment\n" + toml));
  EXPECT_EQ(wait(start(at)), 104);
  std::string thicker = toml;
  const std::size_t voxel = thicker.find("voxel_mm");
  ASSERT_NE(voxel, std::string::npos);
  thicker.insert(voxel, "wall_mm = 1.2\n");
  ASSERT_TRUE(write_file(at / "case.toml", thicker));
  EXPECT_EQ(wait(start(at)), 102) << "position and displacement stay";
  ASSERT_TRUE(write_file(at / "case.toml", toml));
  EXPECT_EQ(wait(start(at)), 102);
  EXPECT_EQ(wait(start(at, true)), 100);
}

TEST_F(CaseRun, ARunThatFailsLeavesTheOldResults) {
  const fs::path at = folder_ / "case";
  ASSERT_EQ(wait(start(at)), 100);
  const auto before = comparable(at);
  ASSERT_TRUE(write_file(at / "calibrations" / "t_not.json", "{}"));
  std::string toml = *read_file(at / "case.toml");
  const std::size_t name = toml.find("calibrations/transform.json");
  ASSERT_NE(name, std::string::npos);
  toml.replace(name, 27, "calibrations/t_not.json");
  ASSERT_TRUE(write_file(at / "case.toml", toml));
  EXPECT_EQ(wait(start(at)), 1);
  EXPECT_EQ(comparable(at), before);
}

}  // namespace
}  // namespace gnathion
