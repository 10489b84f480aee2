#include "pipeline/audit.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "core/file.h"
#include "core/random.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

class Audit : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_audit_" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    trail_ = folder_ / "audit.jsonl";
  }
  void TearDown() override { fs::remove_all(folder_); }

  void write(int lines) {
    auto trail = AuditTrail::open(trail_);
    ASSERT_TRUE(trail) << trail.error().line();
    for (int i = 0; i < lines; ++i) {
      const auto head =
          trail->append({"uid 1000", "case.open", "case-" + std::to_string(i), "detail \"x\" \xff"},
                        HostTime{1'700'000'000'000'000'000 + i});
      ASSERT_TRUE(head) << head.error().line();
    }
  }
  std::vector<std::string> lines() const {
    std::vector<std::string> out;
    std::ifstream in(trail_);
    for (std::string l; std::getline(in, l);) out.push_back(l);
    return out;
  }
  void put(const std::vector<std::string>& all) const {
    std::ofstream out(trail_, std::ios::trunc);
    for (const std::string& l : all) out << l << "\n";
  }
  AuditVerdict verdict(const std::vector<AuditHead>& heads = {}) const {
    const auto v = verify_audit(trail_, heads);
    EXPECT_TRUE(v);
    return v ? *v : AuditVerdict{};
  }

  fs::path folder_, trail_;
};

TEST_F(Audit, AWholeTrailIsGoodAndPrivate) {
  write(20);
  write(5);  // opened again, carried on
  const AuditVerdict v = verdict();
  EXPECT_TRUE(v.good());
  EXPECT_TRUE(v.notes.empty());
  EXPECT_EQ(v.head.lines, 25u);
  for (const char* name : {"audit.jsonl", "audit.jsonl.head"}) {
    struct stat s {};
    ASSERT_EQ(::stat((folder_ / name).c_str(), &s), 0);
    EXPECT_EQ(s.st_mode & 0777, 0600u) << name;
  }
}

TEST_F(Audit, EveryChangedByteIsFoundAndItsLineNamed) {
  write(8);
  const std::vector<std::string> whole = lines();
  Random random(7);
  for (int round = 0; round < 400; ++round) {
    auto changed = whole;
    const auto at = static_cast<std::size_t>(random.uniform(0, 8));
    std::string& line = changed[std::min<std::size_t>(at, 7)];
    char& c = line[std::min(static_cast<std::size_t>(random.uniform(0, static_cast<double>(line.size()))),
                            line.size() - 1)];
    const char was = c;
    c = static_cast<char>(32 + static_cast<int>(random.uniform(0, 95)));
    if (c == was) continue;
    put(changed);
    const AuditVerdict v = verdict();
    ASSERT_FALSE(v.good()) << line;
    EXPECT_EQ(v.faults.front().line, std::min<std::size_t>(at, 7) + 1) << line << "\n"
                                                                       << v.faults.front().why;
  }
}

TEST_F(Audit, RemovedInsertedAndReorderedLinesAreNamed) {
  write(9);
  const std::vector<std::string> whole = lines();
  for (std::size_t i = 0; i + 1 < whole.size(); ++i) {  // removed: the line that now stands there is named
    auto l = whole;
    l.erase(l.begin() + static_cast<long>(i));
    put(l);
    const AuditVerdict v = verdict();
    ASSERT_FALSE(v.good()) << i;
    EXPECT_EQ(v.faults.front().line, i + 1);
    EXPECT_NE(v.faults.front().why.find("number " + std::to_string(i + 1)), std::string::npos)
        << v.faults.front().why;
  }
  for (std::size_t i = 1; i < whole.size(); ++i) {  // a copy of the first line put in
    auto l = whole;
    l.insert(l.begin() + static_cast<long>(i), whole[0]);
    put(l);
    const AuditVerdict v = verdict();
    ASSERT_FALSE(v.good());
    EXPECT_EQ(v.faults.front().line, i + 1) << v.faults.front().why;
  }
  for (std::size_t i = 0; i + 2 < whole.size(); ++i) {
    auto l = whole;
    std::swap(l[i], l[i + 1]);
    put(l);
    const AuditVerdict v = verdict();
    ASSERT_FALSE(v.good());
    EXPECT_EQ(v.faults.front().line, i + 1) << v.faults.front().why;
  }
}

TEST_F(Audit, ALineForgedWithItsHashBreaksTheNext) {
  write(6);
  auto l = lines();
  auto j = nlohmann::json::parse(l[2]);
  j["who"] = "somebody else";
  j.erase("hash");
  j["hash"] = sha256_hex(j.dump());
  l[2] = j.dump();
  put(l);
  const AuditVerdict v = verdict();
  ASSERT_EQ(v.faults.size(), 1u);
  EXPECT_EQ(v.faults.front().line, 3u);
}

TEST_F(Audit, ACutTailIsFoundByTheHeadRecordAndByTheCatalogue) {
  write(6);
  const AuditHead head = verdict().head;
  auto l = lines();
  l.resize(4);
  put(l);
  AuditVerdict v = verdict();
  ASSERT_FALSE(v.good());
  EXPECT_NE(v.faults.front().why.find("2 lines were cut off"), std::string::npos) << v.faults.front().why;
  EXPECT_FALSE(AuditTrail::open(trail_)) << "nothing is added behind a cut";
  // Who cuts the trail may rewrite the record beside it; not what the catalogue knows.
  const auto last = nlohmann::json::parse(l.back());
  ASSERT_TRUE(write_file(folder_ / "audit.jsonl.head",
                         nlohmann::json{{"lines", 4}, {"sha256", last["hash"]}}.dump()));
  EXPECT_TRUE(verdict().good());
  v = verdict({head});
  ASSERT_FALSE(v.good());
  EXPECT_NE(v.faults.front().why.find("the catalogue"), std::string::npos);
  put({});
  EXPECT_FALSE(verdict().good());
}

TEST_F(Audit, ATornLineIsTakenOffAndToldAbout) {
  write(3);
  const std::string whole = *read_file(trail_);
  const std::string last = lines().back();
  for (const std::size_t kept : {std::size_t{1}, last.size() / 2, last.size()}) {
    std::ofstream(trail_, std::ios::trunc) << whole << last.substr(0, kept);  // no newline
    const AuditVerdict torn = verdict();
    EXPECT_TRUE(torn.good());
    ASSERT_EQ(torn.notes.size(), 1u);
    EXPECT_NE(torn.notes[0].find("torn"), std::string::npos);
    write(1);
    const AuditVerdict after = verdict();
    EXPECT_TRUE(after.good()) << after.faults.front().why;
    EXPECT_EQ(after.head.lines, 5u);
    EXPECT_NE(lines()[3].find("audit.recovered"), std::string::npos);
    ASSERT_TRUE(write_file(trail_, whole));
    const auto third = nlohmann::json::parse(last);
    ASSERT_TRUE(write_file(folder_ / "audit.jsonl.head",
                           nlohmann::json{{"lines", 3}, {"sha256", third["hash"]}}.dump()));
  }
}

TEST_F(Audit, ProcessesAndThreadsAppendToOneTrail) {
  constexpr int kProcesses = 3, kThreads = 2, kEach = 15;
  std::vector<pid_t> children;
  for (int p = 0; p < kProcesses; ++p) {
    const pid_t pid = ::fork();
    ASSERT_GE(pid, 0);
    if (pid == 0) {
      auto trail = AuditTrail::open(trail_);
      if (!trail) ::_exit(1);
      std::atomic<int> failed{0};
      std::vector<std::thread> threads;
      for (int t = 0; t < kThreads; ++t)
        threads.emplace_back([&] {
          for (int i = 0; i < kEach; ++i)
            if (!trail->append({"uid", "what", "case", "x"}, HostTime{i})) ++failed;
        });
      for (auto& t : threads) t.join();
      ::_exit(failed == 0 ? 0 : 1);
    }
    children.push_back(pid);
  }
  for (const pid_t pid : children) {
    int status = 0;
    ASSERT_EQ(::waitpid(pid, &status, 0), pid);
    EXPECT_EQ(status, 0);
  }
  const AuditVerdict v = verdict();
  EXPECT_TRUE(v.good()) << v.faults.front().why;
  EXPECT_EQ(v.head.lines, static_cast<std::uint64_t>(kProcesses * kThreads * kEach));
}

TEST_F(Audit, AWriterThatIsKilledLeavesATrailThatGoesOn) {
  Random random(11);
  std::uint64_t before = 0;
  for (int round = 0; round < 40; ++round) {
    int ready[2];
    ASSERT_EQ(::pipe(ready), 0);
    const pid_t pid = ::fork();
    ASSERT_GE(pid, 0);
    if (pid == 0) {
      auto trail = AuditTrail::open(trail_);
      if (!trail || ::write(ready[1], "x", 1) != 1) ::_exit(1);
      for (int i = 0;; ++i)
        if (!trail->append({"uid", "what", "case", std::string(2000, 'd')}, HostTime{i})) ::_exit(1);
    }
    char x = 0;
    ASSERT_EQ(::read(ready[0], &x, 1), 1);
    ::usleep(static_cast<useconds_t>(random.uniform(0, 3000)));
    ::kill(pid, SIGKILL);
    int status = 0;
    ::waitpid(pid, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status)) << "the writer gave up by itself in round " << round;
    ::close(ready[0]);
    ::close(ready[1]);
    const AuditVerdict v = verdict();
    ASSERT_TRUE(v.good()) << v.faults.front().why;
    ASSERT_GE(v.head.lines, before);
    before = v.head.lines;
  }
}

TEST_F(Audit, AVerifierSeesWhatStoodThereAndKeepsNobodyWaiting) {
  auto trail = AuditTrail::open(trail_);
  ASSERT_TRUE(trail);
  for (int i = 0; i < 300; ++i) ASSERT_TRUE(trail->append({"uid", "what", "case", "x"}, HostTime{i}));
  std::atomic<bool> over{false};
  std::atomic<int> good{0}, bad{0};
  std::thread verifier([&] {
    while (!over) ++(verdict().good() ? good : bad);
  });
  while (good + bad == 0) std::this_thread::yield();
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(trail->append({"uid", "what", "case", "x"}, HostTime{i}));
  over = true;
  verifier.join();
  EXPECT_EQ(bad, 0);  // lines that came while it hashed are not held against it
  EXPECT_EQ(verdict().head.lines, 400u);
}

TEST_F(Audit, WhatIsNoTrailIsRefused) {
  ASSERT_TRUE(write_file(trail_, "hello\nworld\n"));
  EXPECT_FALSE(AuditTrail::open(trail_));
  EXPECT_FALSE(verdict().good());
  EXPECT_FALSE(verify_audit(folder_ / "absent"));
  EXPECT_FALSE(verify_audit(folder_));
  EXPECT_FALSE(AuditTrail::open(folder_));
  fs::create_symlink(trail_, folder_ / "link");
  EXPECT_FALSE(AuditTrail::open(folder_ / "link"));
}

}  // namespace
}  // namespace gnathion
