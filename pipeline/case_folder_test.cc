#include "pipeline/case_folder.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "core/file.h"
#include "pipeline/case_lock.h"
#include "pipeline/case_path.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTetrahedron =
    "v 0 0 0\nv 40 0 0\nv 0 40 0\nv 0 0 10\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

class CaseFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("gnathion_case_folder_" + std::to_string(::getpid()));
    fs::remove_all(root_);
    fs::create_directories(root_);
    ASSERT_TRUE(write_file(root_ / "Nowak_upper.OBJ", kTetrahedron));
  }
  void TearDown() override { fs::remove_all(root_); }

  NewCase some() const {
    NewCase c;
    c.id = "p-17";
    c.patient = {"Jan \"Johnny\" Nowak\n[scans]", "850101-12345", "1985-01-01", "m", "left-handed\\"};
    c.files = {{"scans.maxilla_mi", root_ / "Nowak_upper.OBJ"}, {"mandible_mi", root_ / "Nowak_upper.OBJ"}};
    return c;
  }
  std::string toml_with(const std::string& line) const {
    return "[case]\nid = \"x\"\n[scans]\nmaxilla_mi = \"Nowak_upper.OBJ\"\nmandible_mi = "
           "\"Nowak_upper.OBJ\"\n" +
           line;
  }
  std::string refusal(const std::string& toml, CaseTrust trust = CaseTrust::kOwner) const {
    EXPECT_TRUE(write_file(root_ / "case.toml", toml));
    const auto c = read_case(root_, trust);
    return c ? "read" : c.error().line();
  }

  fs::path root_;
  ManualClock clock_{HostTime{1'700'000'000'000'000'000}};
};

#define EXPECT_HAS(text, part) EXPECT_NE((text).find(part), std::string::npos) << (text)

TEST_F(CaseFolder, IsMadePrivateAndReadsAsWritten) {
  const auto made = create_case(root_ / "p-17", some(), clock_);
  ASSERT_TRUE(made) << made.error().line();
  const auto c = read_case(root_ / "p-17", CaseTrust::kConfined);
  ASSERT_TRUE(c) << c.error().line();
  EXPECT_EQ(c->id, "p-17");
  EXPECT_EQ(c->created, "2023-11-14T22:13:20Z");
  EXPECT_EQ(c->patient.name, some().patient.name);
  EXPECT_EQ(c->patient.number, some().patient.number);
  EXPECT_EQ(c->patient.born, "1985-01-01");
  EXPECT_EQ(c->patient.remarks, "left-handed\\");
  EXPECT_EQ(c->maxilla_mi, root_ / "p-17/scans/maxilla_mi.obj");
  for (const auto& f : fs::recursive_directory_iterator(root_ / "p-17")) {
    struct stat s {};
    ASSERT_EQ(::stat(f.path().c_str(), &s), 0);
    EXPECT_EQ(s.st_mode & 0777, f.is_directory() ? 0700u : 0600u) << f.path();
    EXPECT_EQ(f.path().string().substr(root_.string().size()).find("Nowak"), std::string::npos);
  }
  const auto again = create_case(root_ / "p-17", some(), clock_);
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, ErrorCode::kUsage);
  const auto all = list_cases(root_);
  ASSERT_TRUE(all);
  ASSERT_EQ(all->size(), 1u);
  EXPECT_EQ(all->front().files.size(), 2u);
}

TEST_F(CaseFolder, OfManyThatMakeItOneWinsAndNothingIsLost) {
  std::vector<std::thread> threads;
  std::atomic<int> won{0};
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      NewCase c;
      c.id = "same";
      c.patient.remarks = std::to_string(t);
      if (create_case(root_ / "same", c, clock_)) ++won;
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(won, 1);
  EXPECT_TRUE(read_unfinished_case(root_ / "same"));
}

TEST_F(CaseFolder, RefusesIdsThatTellWhoItIs) {
  NewCase c = some();
  for (const char* id : {"nowak-1", "x_JOHNNY_x", "850101-12345"}) {
    c.id = id;
    const auto made = create_case(root_ / "x", c, clock_);
    ASSERT_FALSE(made) << id;
    EXPECT_EQ(made.error().line().find("owak"), std::string::npos);
  }
  for (const char* id : {"", ".", "..", ".x", "-x", "a/b", "a b", "a\n", "\xc5\x82"})
    EXPECT_FALSE(check_case_id(id));
  EXPECT_FALSE(check_case_id(std::string(65, 'a')));
  EXPECT_TRUE(check_case_id(std::string(64, 'a')));
  EXPECT_FALSE(fs::exists(root_ / "x"));
}

TEST_F(CaseFolder, LeavesNothingBehindWhenAFileIsBad) {
  NewCase c = some();
  c.files.push_back({"scans.face_mi", root_ / "absent.stl"});
  EXPECT_FALSE(create_case(root_ / "p", c, clock_));
  c.files.back() = {"scans.nose", root_ / "Nowak_upper.OBJ"};
  EXPECT_FALSE(create_case(root_ / "p", c, clock_));
  ASSERT_TRUE(write_file(root_ / "junk.stl", "junk"));
  c.files.back() = {"scans.face_mi", root_ / "junk.stl"};
  EXPECT_FALSE(create_case(root_ / "p", c, clock_));
  int entries = 0;
  for ([[maybe_unused]] const auto& f : fs::directory_iterator(root_)) ++entries;
  EXPECT_EQ(entries, 2) << "the scan and junk.stl alone";
}

TEST_F(CaseFolder, AddsFilesAndKeepsWhatAPersonWrote) {
  ASSERT_TRUE(create_case(root_ / "p", some(), clock_));
  const fs::path toml = root_ / "p" / "case.toml";
  ASSERT_TRUE(write_file(toml, *read_file(toml) + "# by hand\n[design]  # thick\nwall_mm = 1.5\n"));
  ASSERT_TRUE(add_case_files(
      root_ / "p", {{"scans.face_mi", root_ / "Nowak_upper.OBJ"}, {"extra.model", root_ / "Nowak_upper.OBJ"}},
      false));
  const auto c = read_case(root_ / "p");
  ASSERT_TRUE(c) << c.error().line();
  EXPECT_EQ(c->parameters.wall_mm, 1.5);
  EXPECT_FALSE(c->face_mi.empty());
  EXPECT_EQ(c->extra.count("model"), 1u);
  EXPECT_HAS(*read_file(toml), "# by hand\n[design]  # thick\n");
  EXPECT_EQ(add_case_files(root_ / "p", {{"face_mi", root_ / "Nowak_upper.OBJ"}}, false).error().code,
            ErrorCode::kUsage);
  EXPECT_TRUE(add_case_files(root_ / "p", {{"face_mi", root_ / "Nowak_upper.OBJ"}}, true));
  const auto held = CaseLock::take(root_ / "p", "x");
  ASSERT_TRUE(held);
  const auto busy = add_case_files(root_ / "p", {{"face_tp", root_ / "Nowak_upper.OBJ"}}, false);
  ASSERT_FALSE(busy);
  EXPECT_HAS(busy.error().line(), "process " + std::to_string(::getpid()));
}

TEST_F(CaseFolder, BadTomlIsRefusedByLineAndColumn) {
  EXPECT_HAS(refusal("[case]\nid = \"x\"\nkind = =\n"), "line 3, column 8");
  EXPECT_HAS(refusal("[scans]\nmaxila_mi = \"x\"\n"), "unknown key 'maxila_mi' in [scans]");
  EXPECT_HAS(refusal("[skans]\n"), "unknown section 'skans'");
  EXPECT_HAS(refusal("scans = 3\n"), "unknown section 'scans'");
  EXPECT_HAS(refusal("[scans]\nmaxilla_mi = 3\n"), "is not a path");
  EXPECT_HAS(refusal("[scans]\nmaxilla_mi = \"gone.stl\"\n"), "does not exist");
  EXPECT_HAS(refusal("[case]\nid = \"a b\"\n"), "id:");
  EXPECT_HAS(refusal("[case]\nkind = \"dog\"\n"), "neither");
  EXPECT_HAS(refusal("[case]\nkind = 3\n"), "not a text");
  EXPECT_HAS(refusal("[patient]\nnick = \"x\"\n"), "unknown key 'nick'");
  EXPECT_HAS(refusal("[[plane]]\ncentre_mm = [1, 2]\n"), "3 numbers");
  EXPECT_HAS(refusal("[case]\nid = \"x\"\n"), "needs maxilla_mi and mandible_mi");
  EXPECT_HAS(refusal(std::string(100000, '[')), "line 1");
}

TEST_F(CaseFolder, WhatAClientWritesStaysInTheCase) {
  const fs::path outside = fs::temp_directory_path() / ("gnathion_outside_" + std::to_string(::getpid()));
  ASSERT_TRUE(write_file(outside, kTetrahedron));
  fs::create_symlink(outside, root_ / "link.obj");
  fs::create_directories(root_ / "sub");
  const std::string out = outside.string();
  for (const std::string& line : {"face_mi = \"" + out + "\"\n", std::string("face_mi = \"link.obj\"\n"),
                                  "face_mi = \"../" + outside.filename().string() + "\"\n",
                                  std::string("face_mi = \"sub/../Nowak_upper.OBJ\"\n"),
                                  "[[frame]]\nto=\"a\"\nfrom=\"b\"\nscan=\"" + out + "\"\n",
                                  std::string("[extra]\nx = \"/etc/passwd\"\n")}) {
    EXPECT_EQ(refusal(toml_with(line)), "read") << line;
    EXPECT_NE(refusal(toml_with(line), CaseTrust::kConfined), "read") << line;
  }
  ASSERT_TRUE(write_file(root_ / "rig.toml", "bow = \"../" + outside.filename().string() + "\"\n"));
  EXPECT_NE(refusal(toml_with("[session]\nrig = \"rig.toml\"\n"), CaseTrust::kConfined), "read");
  fs::remove(outside);
}

TEST_F(CaseFolder, ClientPathsNeverLeaveTheRoot) {
  ASSERT_TRUE(create_case(
      root_ / "p-1",
      [] {
        NewCase c;
        c.id = "p-1";
        return c;
      }(),
      clock_));
  fs::create_symlink("/etc", root_ / "p-1" / "etc");
  fs::create_symlink("case.toml", root_ / "p-1" / "inner");
  fs::create_directory_symlink(root_ / "p-1", root_ / "p-2");
  ASSERT_EQ(::mkfifo((root_ / "p-1" / "pipe").c_str(), 0600), 0);
  const auto root = CaseRoot::open(root_);
  ASSERT_TRUE(root);
  const auto good = root->resolve("p-1/case.toml");
  ASSERT_TRUE(good) << good.error().line();
  EXPECT_EQ(*good, fs::canonical(root_) / "p-1/case.toml");
  EXPECT_TRUE(root->resolve(good->string()));
  EXPECT_TRUE(root->resolve("./p-1//case.toml"));
  EXPECT_TRUE(root->resolve("p-1/new.stl", PathUse::kNew));
  EXPECT_TRUE(root->case_folder("p-1"));
  EXPECT_TRUE(root->case_folder("p-9", PathUse::kNew));
  for (const std::string& bad :
       {std::string(".."), std::string("p-1/../p-1/case.toml"), std::string("/etc/passwd"),
        std::string("p-1/etc/passwd"), std::string("p-1/inner"), std::string("p-2/case.toml"),
        std::string("p-1/pipe"), std::string("p-1/absent"), std::string(""), std::string("p-1/a\0b", 7),
        std::string("p-1/a\nb"), root_.string() + "x/y", std::string("p-1/") + std::string(300, 'n'),
        std::string(5000, 'n'), std::string("p-1/case.toml/x")}) {
    const auto r = root->resolve(bad);
    EXPECT_FALSE(r) << bad;
    if (!r) {
      EXPECT_EQ(r.error().code, ErrorCode::kUsage) << bad;
    }
  }
  for (const char* bad : {"p-1/inner", "p-1/etc/x", "p-1/none/x", "p-1/pipe"})
    EXPECT_FALSE(root->resolve(bad, PathUse::kNew)) << bad;
  for (const char* bad : {"p-2", "..", "p-9", "p-1/x"}) EXPECT_FALSE(root->case_folder(bad)) << bad;
  EXPECT_FALSE(CaseRoot::open(root_ / "absent"));
}

}  // namespace
}  // namespace gnathion
