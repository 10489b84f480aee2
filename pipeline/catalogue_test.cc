#include "pipeline/catalogue.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>

#include "core/file.h"
#include "core/random.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

class CatalogueTest : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("gnathion_catalogue_" + std::to_string(::getpid()));
    fs::remove_all(root_);
    fs::create_directories(root_);
    file_ = root_ / "catalogue.sqlite";
  }
  void TearDown() override { fs::remove_all(root_); }

  void make(const std::string& id, const std::string& patient = "Anna Kowalska") {
    ManualClock clock(HostTime{1'700'000'000'000'000'000});
    NewCase c;
    c.id = id;
    c.patient.name = patient;
    const auto made = create_case(root_ / id, c, clock);
    ASSERT_TRUE(made) << made.error().line();
  }
  std::vector<std::string> ids(const Catalogue& c, const CatalogueQuery& q = {}) const {
    std::vector<std::string> out;
    const auto all = c.query(q);
    EXPECT_TRUE(all);
    if (all)
      for (const auto& e : *all) out.push_back(e.id);
    return out;
  }

  fs::path root_, file_;
};

using Ids = std::vector<std::string>;

TEST_F(CatalogueTest, IsMadeFromTheFoldersAndHoldsNoIdentity) {
  make("b-2");
  make("a-1");
  ASSERT_TRUE(write_file(root_ / "b-2" / "case.toml", "[case\n"));  // a case with a fault is listed with it
  fs::create_directories(root_ / "no-case");
  fs::create_directory_symlink(root_ / "a-1", root_ / "link");
  const auto made = Catalogue::rebuild(file_, root_);
  ASSERT_TRUE(made) << made.error().line();
  EXPECT_EQ(made->cases, 2);
  EXPECT_EQ(made->with_problems, 1);
  auto c = Catalogue::open(file_);
  ASSERT_TRUE(c);
  EXPECT_EQ(ids(*c), (Ids{"a-1", "b-2"}));
  EXPECT_EQ(ids(*c, {"a-", "", ""}), (Ids{"a-1"}));
  EXPECT_EQ(ids(*c, {"", "phantom", ""}), Ids{});
  EXPECT_EQ(ids(*c, {"", "", "", 1, 1}), (Ids{"b-2"}));
  const auto broken = c->find("b-2");
  ASSERT_TRUE(broken && *broken);
  EXPECT_NE((*broken)->problem.find("line 1, column"), std::string::npos) << (*broken)->problem;
  for (const auto& f : fs::directory_iterator(root_)) {
    if (!f.is_regular_file()) continue;
    EXPECT_EQ(read_file(f.path())->find("Kowalska"), std::string::npos) << f.path();
    struct stat s {};
    ASSERT_EQ(::stat(f.path().c_str(), &s), 0);
    EXPECT_EQ(s.st_mode & 0777, 0600u) << f.path();
  }
}

TEST_F(CatalogueTest, FollowsWhatChangesAndIsMadeAnewWhenDamaged) {
  make("a");
  make("b");
  ASSERT_TRUE(Catalogue::rebuild(file_, root_));
  {
    auto c = Catalogue::open(file_);
    ASSERT_TRUE(c);
    ASSERT_TRUE(c->set_audit_head("audit.jsonl", {7, std::string(64, 'a')}));
    ASSERT_TRUE(c->set_audit_head("audit.jsonl", {5, std::string(64, 'b')}));  // comes late, is older
    EXPECT_EQ((*c->audit_head("audit.jsonl"))->lines, 7u);
    fs::remove_all(root_ / "a");
    make("c");
    ASSERT_TRUE(c->refresh("a", root_));
    ASSERT_TRUE(c->refresh("c", root_));
    EXPECT_EQ(ids(*c), (Ids{"b", "c"}));
    EXPECT_FALSE(c->refresh("../x", root_));
  }
  fs::remove_all(root_ / "b");
  const auto again = Catalogue::rebuild(file_, root_);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->removed, 1);
  auto c = Catalogue::open(file_);
  ASSERT_TRUE(c);
  EXPECT_EQ((*c->audit_head("audit.jsonl"))->lines, 7u) << "rebuilding forgets no head record";

  for (const std::string& damage : {std::string("not a database, not at all, for sixteen bytes and more"),
                                    std::string("SQLite format 3\0", 16) + std::string(5000, 'x')}) {
    for (const char* suffix : {"", "-wal", "-shm"}) fs::remove(file_.string() + suffix);
    std::ofstream(file_, std::ios::binary) << damage;
    const auto refused = Catalogue::open(file_);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().line().find("--rebuild"), std::string::npos) << refused.error().line();
    const auto mended = Catalogue::rebuild(file_, root_);
    ASSERT_TRUE(mended) << mended.error().line();
    auto now = Catalogue::open(file_);
    ASSERT_TRUE(now);
    EXPECT_EQ(ids(*now), (Ids{"c"}));
  }
}

TEST_F(CatalogueTest, RefusesOthersDatabases) {
  fs::create_directories(root_ / "folder");
  EXPECT_FALSE(Catalogue::open(root_ / "folder"));
  EXPECT_FALSE(Catalogue::open(root_ / "absent" / "c.sqlite"));
  EXPECT_FALSE(Catalogue::rebuild(file_, root_ / "absent"));
}

TEST_F(CatalogueTest, WritersThatAreKilledLeaveItWhole) {
  make("a");
  make("b");
  ASSERT_TRUE(Catalogue::rebuild(file_, root_));
  Random random(3);
  for (int round = 0; round < 25; ++round) {
    int ready[2];
    ASSERT_EQ(::pipe(ready), 0);
    const pid_t pid = ::fork();
    ASSERT_GE(pid, 0);
    if (pid == 0) {
      if (::write(ready[1], "x", 1) != 1) ::_exit(1);
      for (;;)
        if (!Catalogue::rebuild(file_, root_)) ::_exit(1);
    }
    char x = 0;
    ASSERT_EQ(::read(ready[0], &x, 1), 1);
    ::usleep(static_cast<useconds_t>(random.uniform(0, 20000)));
    ::kill(pid, SIGKILL);
    int status = 0;
    ::waitpid(pid, &status, 0);
    ::close(ready[0]);
    ::close(ready[1]);
    ASSERT_TRUE(WIFSIGNALED(status)) << round;
    auto c = Catalogue::open(file_);
    ASSERT_TRUE(c) << c.error().line();
    ASSERT_EQ(ids(*c), (Ids{"a", "b"})) << "killed within a rebuild: the old or the new, never between";
  }
}

}  // namespace
}  // namespace gnathion
