// Mailboxes, the jaw, previews, and paths of clients: what has no thread of its own.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <numbers>

#include "core/random.h"
#include "daemon/client_path.h"
#include "daemon/config.h"
#include "daemon/jaw.h"
#include "daemon/jobs/job_work.h"
#include "daemon/mailbox.h"
#include "daemon/preview.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

TEST(Mailbox, ASlowSubscriberGetsTheNewestAndLearnsWhatItMissed) {
  Hub<int> hub;
  const auto fast = hub.subscribe(1), slow = hub.subscribe(1);
  for (int i = 1; i <= 5; ++i) {
    hub.publish(std::make_shared<const int>(i));
    const auto mail = fast->take_within(0ns);
    ASSERT_TRUE(mail);
    EXPECT_EQ(*mail->value, i);
    EXPECT_EQ(mail->missed, 0u);
  }
  const auto mail = slow->take_within(0ns);
  ASSERT_TRUE(mail);
  EXPECT_EQ(*mail->value, 5);
  EXPECT_EQ(mail->missed, 4u);
  EXPECT_FALSE(slow->take_within(0ns));
}

TEST(Mailbox, WhoLeavesIsForgottenAndACloseWakesWhoWaits) {
  Hub<int> hub;
  auto box = hub.subscribe(2);
  box.reset();
  hub.publish(std::make_shared<const int>(1));
  EXPECT_FALSE(hub.has_subscribers());
  const auto waiting = hub.subscribe(1);
  hub.close();
  EXPECT_FALSE(waiting->take_within(10s));
  EXPECT_TRUE(hub.subscribe(1)->closed());
}

BodyPose valid_pose(const Rigid3& camera_from_body, double sigma) {
  BodyPose pose;
  pose.valid = true;
  pose.camera_from_body = camera_from_body;
  pose.covariance = sigma * sigma * Matrix6::Identity();
  return pose;
}

/// The head turns and moves as it likes; the jaw opens by a rotation about the hinge: that rotation, told in
/// the dental frame, must come out, whatever the bow's place on the teeth.
TEST(Jaw, IsTheMandiblesMotionInTheDentalFrame) {
  const Rigid3 bow_from_dental = Rigid3::about_axis({3, 1, 2}, {1, 2, 3}, 0.7);
  const Rigid3 head_from_dental = Rigid3::about_axis({5, -80, 60}, {0, 1, 1}, -0.4);
  const Rigid3 opening = Rigid3::about_axis({0, -70, 30}, {1, 0, 0}, 0.2);  // in the dental frame
  JawFollower follower{Transform<Bow, Dental>(bow_from_dental)};
  const auto row = [&](const Rigid3& camera_from_dental, const Rigid3& mandible) {
    MotionRow r;
    r.head = valid_pose(camera_from_dental * head_from_dental.inverse(), 1e-3);
    r.bow = valid_pose(camera_from_dental * mandible * bow_from_dental.inverse(), 1e-3);
    return r;
  };
  const Rigid3 away = Rigid3::about_axis({10, 20, 700}, {1, 1, 0}, 2.0);
  const Rigid3 turned = away * Rigid3::about_axis({0, 0, 0}, {0, 1, 0}, 0.3);
  follower.mi_begins("mark 0");
  EXPECT_LT(log_se3(follower.next(row(away, Rigid3::identity())).reference_from_body).norm(), 1e-9);
  const LivePose open = follower.next(row(turned, opening));
  EXPECT_EQ(open.reference, "dental");
  EXPECT_EQ(open.mi, "mark 0");
  EXPECT_LT(difference(open.reference_from_body, opening).norm(), 1e-9);
  ASSERT_TRUE(open.covariance);
  EXPECT_GT(open.covariance->determinant(), 0);
  MotionRow lost = row(away, opening);
  lost.bow.valid = false;
  lost.bow.reason = "no tag seen";
  EXPECT_FALSE(follower.next(lost).valid);
  EXPECT_EQ(follower.next(lost).reason, "bow: no tag seen");
}

TEST(Preview, ShrinksByWholePixelsAndKeepsTheMean) {
  Image8 image(10, 4, 100);
  image.at(0, 0) = 200;
  const Image8 small = shrunk(image, 5);
  EXPECT_EQ(small.width_px, 5);
  EXPECT_EQ(small.height_px, 2);
  EXPECT_EQ(small.at(0, 0), 125);
  EXPECT_EQ(small.at(4, 1), 100);
}

class CasePaths : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "case_paths_XXXXXX").string();
    base_ = ::mkdtemp(name.data());
    fs::create_directories(base_ / "cases/a/scans");
    fs::create_directories(base_ / "cases/a/recordings");
    fs::create_directories(base_ / "cases/a/.jobs/job-2");
    fs::create_directories(base_ / "cases/b");
    for (const char* f : {"cases/a/case.toml", "cases/b/case.toml", "cases/a/scans/u.stl",
                          "cases/a/there.json", "cases/b/secret.stl", "outside.stl"})
      std::ofstream(base_ / f) << "[case]\nkind = \"patient\"\n";
    fs::create_symlink(base_ / "outside.stl", base_ / "cases/a/link.stl");
    fs::create_directory_symlink(base_, base_ / "cases/a/up");
    auto root = CaseRoot::open(base_ / "cases");
    ASSERT_TRUE(root) << root.error().line();
    root_ = std::make_unique<CaseRoot>(std::move(*root));
  }
  void TearDown() override { fs::remove_all(base_); }
  ApiCode refusal(const std::string& path, PathUse use = PathUse::kExisting) {
    const auto found = path_in_case(*root_, root_->path() / "a", path, use);
    EXPECT_FALSE(found) << path;
    return found ? ApiCode::kInternal : found.error().code;
  }
  fs::path base_;
  std::unique_ptr<CaseRoot> root_;
};

TEST_F(CasePaths, NoPathLeavesTheCase) {
  EXPECT_TRUE(path_in_case(*root_, root_->path() / "a", "scans/u.stl", PathUse::kExisting));
  for (const char* path :
       {"../b/secret.stl", "scans/../../b/secret.stl", "/etc/passwd", "link.stl", "up/outside.stl", ".."})
    EXPECT_EQ(refusal(path), ApiCode::kPermissionDenied) << path;
  EXPECT_EQ(refusal("scans/none.stl"), ApiCode::kNotFound);
  EXPECT_EQ(refusal(""), ApiCode::kInvalidArgument);
  EXPECT_EQ(refusal("up/new.stl", PathUse::kNew), ApiCode::kPermissionDenied);
  EXPECT_EQ(refusal(std::string("scans/a\0b", 9)), ApiCode::kInvalidArgument);
}

TEST_F(CasePaths, JobsAreCheckedBeforeTheyRun) {
  const auto code = [&](JobOrder order) {
    const auto plan = plan_job(*root_, order, "job-1");
    return plan ? std::string("planned") : plan.error().message;
  };
  JobOrder order;
  order.case_id = "a";
  order.kind = "check";
  order.values = {{"maxilla", "scans/u.stl"},
                  {"mandible", "scans/u.stl"},
                  {"transform", "scans/u.stl"},
                  {"out", "f.json"}};
  EXPECT_EQ(code(order), "planned");
  JobOrder wrong = order;
  wrong.kind = "rm";
  EXPECT_NE(code(wrong).find("there is no job 'rm'; there are calibrate camera"), std::string::npos)
      << code(wrong);
  wrong = order;
  wrong.values.emplace_back("exec", "x");
  EXPECT_NE(code(wrong).find("it has no option 'exec'"), std::string::npos);
  wrong = order;
  wrong.values.pop_back();
  EXPECT_NE(code(wrong).find("'out' is missing"), std::string::npos);
  wrong = order;
  wrong.values[3].second = "case.toml";
  wrong.force = true;
  EXPECT_NE(code(wrong).find("is no name for an output"), std::string::npos);
  wrong = order;
  for (const char* kept :
       {"scans/u.stl", "recordings", "recordings/new.mcap", ".jobs/job-2/x", ".", "case.toml~"}) {
    wrong.values[3].second = kept;
    EXPECT_NE(code(wrong).find("is no name for an output"), std::string::npos) << kept << ": " << code(wrong);
  }
  wrong = order;
  wrong.values[3].second = "there.json";
  EXPECT_NE(code(wrong).find("exists; force replaces it"), std::string::npos);
  wrong = order;
  wrong.case_id = "../b";
  EXPECT_NE(code(wrong), "planned");
  const auto plan = plan_job(*root_, order, "job-1");
  for (const std::string& argument : plan->arguments)
    if (argument.rfind("--out=", 0) == 0) {
      EXPECT_NE(argument.find("/.jobs/job-1/"), std::string::npos);
    }
}

TEST_F(CasePaths, WhatACrashLeftIsRemovedOrPutBack) {
  const fs::path a = root_->path() / "a";
  fs::create_directories(a / ".jobs/job-1/out");
  fs::create_directories(a / ".results.staging.999999");
  fs::create_directories(a / ".design.old.999999");  // was being replaced when it happened
  std::ofstream(a / ".design.old.999999/design.json") << "{}";
  EXPECT_EQ(clean_after_crash(*root_).size(), 1u);
  EXPECT_FALSE(fs::exists(a / ".jobs"));
  EXPECT_FALSE(fs::exists(a / ".results.staging.999999"));
  EXPECT_TRUE(fs::exists(a / "design/design.json"));
  EXPECT_TRUE(clean_after_crash(*root_).empty());
}

TEST_F(CasePaths, TheConfigurationIsRefusedWithTheKeyThatIsMeant) {
  const fs::path file = base_ / "gnathiond.toml";
  const auto error = [&](const std::string& text) {
    std::ofstream(file, std::ios::trunc) << text;
    const auto config = read_daemon_config(file);
    return config ? std::string("good") : config.error().line();
  };
  EXPECT_EQ(error("[daemon]\ncase_root = \"cases\"\n"), "good");
  EXPECT_NE(error("[daemon]\ncase_rot = \"cases\"\n").find("unknown key 'case_rot'; 'case_root' is meant?"),
            std::string::npos);
  EXPECT_NE(error("[deamon]\n").find("unknown section 'deamon'"), std::string::npos);
  EXPECT_NE(error("[openigtlink]\nport = 99999\n").find("within 0 to 65535"), std::string::npos);
  EXPECT_NE(error("[daemon\n").find("line 1"), std::string::npos);
  EXPECT_NE(
      error("[daemon]\nsocket = \"/" + std::string(120, 'x') + "\"\n").find("longer than the 107 bytes"),
      std::string::npos);
  const auto good = read_daemon_config("packaging/gnathiond.toml");
  ASSERT_TRUE(good) << good.error().line();
  EXPECT_EQ(good->igtl.address, "127.0.0.1");
}

}  // namespace
}  // namespace gnathion::daemon
