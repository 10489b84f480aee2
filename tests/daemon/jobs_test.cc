// Jobs as processes: progress, results, cancelling, and nothing left behind.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cstdio>
#include <fstream>
#include <iterator>
#include <mutex>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "acquisition/recording.h"
#include "core/file.h"
#include "core/mesh.h"
#include "core/mesh_io.h"
#include "core/time.h"
#include "phantom/jaws.h"
#include "tests/daemon/daemon_process.h"

namespace gnathion::testing {
namespace {

namespace fs = std::filesystem;
using client::JobState;
using ::testing::HasSubstr;

/// Hidden files and folders anywhere below: what a job may have left half-made.
std::vector<std::string> hidden_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.path().filename().string().rfind('.', 0) == 0 && entry.path().filename() != ".lock")
      names.push_back(entry.path().string());
  return names;
}

/// Processes that have `folder` in their command line: the jobs of its case. Zombies have no command line.
std::vector<std::string> jobs_at_work_on(const fs::path& folder) {
  std::vector<std::string> lines;
  std::error_code ec;
  for (const auto& entry : fs::directory_iterator("/proc", ec)) {
    if (entry.path().filename().string().find_first_not_of("0123456789") != std::string::npos) continue;
    const auto line = read_file(entry.path() / "cmdline");
    if (line && line->find(folder.string()) != std::string::npos) lines.push_back(*line);
  }
  return lines;
}

std::set<std::string> files_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.path().filename() != ".lock") names.insert(entry.path().string());
  return names;
}

class DaemonJobs : public ::testing::Test {
 protected:
  void SetUp() override {
    daemon_ = std::make_unique<DaemonProcess>(folder_.path());
    ASSERT_TRUE(daemon_->start()) << daemon_->log();
    client_ = daemon_->connect();
    ASSERT_TRUE(client_->create_case("case-1"));
    // A recording of a sensor's poses: `calibrate time` and `track` read it in a moment.
    SmallRecording what;
    what.duration_s = 4;
    write_small_recording(case_folder() / "film.mcap", what);
  }
  fs::path case_folder() const { return daemon_->cases() / "case-1"; }
  client::Job wait_for(const std::string& id) {
    client::Job job;
    EXPECT_TRUE(eventually(
        [&] {
          for (const auto& j : client_->jobs().value_or(std::vector<client::Job>{}))
            if (j.id == id) job = j;
          return job.finished();
        },
        120))
        << job.step;
    return job;
  }
  /// Two arches: seconds of work for `check`, more for `design`.
  void add_jaws() {
    const PhantomJaws jaws = make_phantom_jaws(1);
    ASSERT_TRUE(write_mesh(case_folder() / "maxilla.ply", jaws.maxilla));
    ASSERT_TRUE(write_mesh(case_folder() / "mandible.ply", jaws.mandible_mi));
    std::ofstream(case_folder() / "open.txt") << "1 0 0 0\n0 1 0 0\n0 0 1 -2\n0 0 0 1\n";
    std::ofstream(case_folder() / "through.txt") << "1 0 0 0\n0 1 0 0\n0 0 1 3\n0 0 0 1\n";
  }
  client::JobRequest design(const std::string& transform) const {
    return {"case-1",
            "design",
            {{"maxilla", "maxilla.ply"},
             {"mandible", "mandible.ply"},
             {"transform", transform},
             {"out", "splint"},
             {"no-pictures", "true"}},
            false};
  }
  TemporaryFolder folder_;
  std::unique_ptr<DaemonProcess> daemon_;
  std::unique_ptr<client::DaemonClient> client_;
};

TEST_F(DaemonJobs, AnErrorComesBackAsTheCommandsOneLine) {
  const auto job = client_->submit(
      {"case-1", "track", {{"recording", "film.mcap"}, {"rig", "film.mcap"}, {"out", "m.mcap"}}, false});
  ASSERT_TRUE(job) << job.error().line();
  const client::Job end = wait_for(job->id);
  EXPECT_EQ(end.state, JobState::kFailed);
  EXPECT_EQ(end.exit_code, 4);
  EXPECT_THAT(end.message, HasSubstr("film.mcap"));
  EXPECT_THAT(end.message, ::testing::Not(HasSubstr(folder_.path().string())));  // no path of the machine
  EXPECT_FALSE(fs::exists(case_folder() / "m.mcap"));
  EXPECT_TRUE(hidden_in(case_folder()).empty());
}

TEST_F(DaemonJobs, AJobIsFollowedCancelledKilledAndDone) {
  add_jaws();
  ASSERT_FALSE(HasFatalFailure());
  const auto before = files_in(case_folder());
  // Cancelled while it works: its processes are gone, and nothing stays.
  auto job = client_->submit(design("open.txt"));
  ASSERT_TRUE(job) << job.error().line();
  std::mutex mutex;
  std::vector<client::Job> seen;
  const auto follow = client_->job_progress(job->id, [&](const client::Job& j) {
    std::lock_guard lock(mutex);
    seen.push_back(j);
  });
  EXPECT_TRUE(eventually(
      [&] {
        std::lock_guard lock(mutex);
        return !seen.empty() && !seen.back().step.empty() && seen.back().fraction > 0;
      },
      60));
  EXPECT_EQ(jobs_at_work_on(case_folder()).size(), 1u);
  const Stopwatch since_cancel;
  const auto cancelled = client_->cancel(job->id);
  ASSERT_TRUE(cancelled);
  EXPECT_TRUE(eventually([&] { return jobs_at_work_on(case_folder()).empty(); }));
  std::printf("cancelled, and no process left, after %.0f ms\n", 1e3 * since_cancel.seconds());
  EXPECT_EQ(cancelled->state, JobState::kCancelled);
  EXPECT_EQ(files_in(case_folder()), before);
  // The daemon is killed as soon as a job begins: the job dies with it, however far it has come, and the next
  // start clears up.
  job = client_->submit(design("open.txt"));
  ASSERT_TRUE(job);
  ASSERT_TRUE(eventually([&] { return fs::exists(case_folder() / ".jobs" / job->id / "stdout"); }));
  daemon_->kill_and_wait();
  ASSERT_TRUE(daemon_->start()) << daemon_->log();
  client_ = daemon_->connect();
  EXPECT_TRUE(eventually([&] { return jobs_at_work_on(case_folder()).empty(); }));
  EXPECT_EQ(files_in(case_folder()), before);
  // Left alone it ends, with a result whose paths are the case's.
  job = client_->submit({"case-1",
                         "check",
                         {{"maxilla", "maxilla.ply"},
                          {"mandible", "mandible.ply"},
                          {"transform", "open.txt"},
                          {"out", "results/first/check.json"}},
                         false});
  ASSERT_TRUE(job);
  const auto early = client_->job_result(job->id);
  ASSERT_FALSE(early);
  EXPECT_THAT(early.error().line(), HasSubstr("wait for its end"));
  EXPECT_EQ(wait_for(job->id).state, JobState::kDone);
  const auto result = client_->job_result(job->id);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->outputs, std::vector<std::string>{"results/first/check.json"});
  EXPECT_TRUE(nlohmann::json::parse(result->json, nullptr, false).is_object());
  // One whose gate fails leaves its report: what was asked for cannot be, the jaws would go through each
  // other.
  job = client_->submit(design("through.txt"));
  ASSERT_TRUE(job);
  const client::Job end = wait_for(job->id);
  EXPECT_EQ(end.state, JobState::kGateFailed) << end.message;
  EXPECT_EQ(end.exit_code, 3);
  auto expected = before;
  for (const char* name : {"results", "results/first", "results/first/check.json", "splint",
                           "splint/design.json", "splint/feasibility.json"})
    expected.insert((case_folder() / name).string());
  EXPECT_EQ(files_in(case_folder()), expected);
  EXPECT_FALSE(client_->submit(design("open.txt")));  // exists
}

/// "--maxilla" of a command's help, but for what the daemon itself gives or cannot let a client give.
std::set<std::string> options_of(const std::string& command, std::vector<std::string> words) {
  words.insert(words.begin(), DaemonProcess::program());
  words.push_back("--help");
  std::string help;
  EXPECT_EQ(run_program(words, &help), 0) << command;
  std::set<std::string> names;
  const std::regex option(R"((?:^|\n)  (?:-[a-z],)?--([a-z0-9-]+))");
  for (std::sregex_iterator it(help.begin(), help.end(), option), end; it != end; ++it)
    names.insert((*it)[1]);
  for (const char* given : {"help", "json", "quiet", "force"}) names.erase(given);
  // These name files in other ways than as one path, which the case cannot hold.
  if (command == "calibrate rig")
    names.erase("camera");  // NAME=FOLDER; a daemon's cameras come as a recording
  if (command == "evaluate") names.erase("config"), names.erase("rows"), names.erase("printed");
  if (command == "calibrate camera" || command == "calibrate rig")
    names.erase("bow"), names.erase("head-frame");
  return names;
}

TEST_F(DaemonJobs, WhatTheCommandsCanDoCanBeAsked) {
  const auto kinds = client_->job_kinds();
  ASSERT_TRUE(kinds) << kinds.error().line();
  for (const client::JobKind& kind : *kinds) {
    std::istringstream name(kind.name == "report" ? "run" : kind.name);
    const std::vector<std::string> words{std::istream_iterator<std::string>(name), {}};
    std::set<std::string> asked;
    for (const client::JobOption& option : kind.options) asked.insert(option.name);
    EXPECT_EQ(asked, options_of(kind.name, words)) << kind.name;
  }
}

TEST_F(DaemonJobs, WhatCannotBeAskedIsRefusedByName) {
  const auto refusal = [&](const char* name, const char* value) {
    client::JobRequest request = design("open.txt");
    std::ofstream(case_folder() / "open.txt") << "1 0 0 0\n0 1 0 0\n0 0 1 -2\n0 0 0 1\n";
    for (const char* arch : {"maxilla.ply", "mandible.ply"}) std::ofstream(case_folder() / arch) << "ply\n";
    request.values.emplace_back(name, value);
    const auto job = client_->submit(request);
    return job ? "accepted" : job.error().line();
  };
  EXPECT_THAT(refusal("condyle-left", "1 two 3"), HasSubstr("'condyle-left' must be numbers"));
  EXPECT_THAT(refusal("bone-level", "high"), HasSubstr("'bone-level' must be a number"));
  EXPECT_THAT(refusal("margin", "../other/margin.txt"), HasSubstr("leads out of the case"));
  EXPECT_THAT(refusal("cbct", "volume.nrrd"), HasSubstr("volume.nrrd"));
  EXPECT_THAT(refusal("voxel", "0.2"), HasSubstr("it has no option 'voxel'"));
  const auto out = [&](const char* place) {
    client::JobRequest request{"case-1", "track", {{"recording", "film.mcap"}, {"out", place}}, false};
    const auto job = client_->submit(request);
    return job ? "accepted" : job.error().line();
  };
  EXPECT_THAT(out("new/../../m.mcap"), HasSubstr("leads out of the case"));
  EXPECT_THAT(out("film.mcap/m.mcap"), HasSubstr("'film.mcap' is no folder"));
  EXPECT_THAT(out("new/.hidden/m.mcap"), HasSubstr("is no name for an output"));
  EXPECT_THAT(out("recordings/new/m.mcap"), HasSubstr("is no name for an output"));
  EXPECT_FALSE(fs::exists(case_folder() / "new"));
}

TEST_F(DaemonJobs, TheQueueIsBoundedAndAQueuedJobIsCancelledAtOnce) {
  client::JobRequest order{
      "case-1", "track", {{"recording", "film.mcap"}, {"rig", "film.mcap"}, {"out", "m.mcap"}}, false};
  std::vector<std::string> ids;
  bool refused = false;
  for (int i = 0; i < 300 && !refused; ++i) {
    const auto job = client_->submit(order);
    refused = !job && job.error().line().find("are waiting already") != std::string::npos;
    if (job) ids.push_back(job->id);
  }
  EXPECT_TRUE(refused);
  for (auto id = ids.rbegin(); id != ids.rend(); ++id) ASSERT_TRUE(client_->cancel(*id));
  for (const auto& job : client_->jobs().value_or(std::vector<client::Job>{})) EXPECT_TRUE(job.finished());
  EXPECT_TRUE(hidden_in(case_folder()).empty());
}

}  // namespace
}  // namespace gnathion::testing
