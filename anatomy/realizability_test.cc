#include "anatomy/realizability.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "core/mesh_io.h"
#include "core/random.h"
#include "core/transform_io.h"
#include "occlusion/test_jaws.h"

namespace gnathion {
namespace {

constexpr double kDeg = 3.14159265358979323846 / 180.0;

std::filesystem::path shared() {
  const char* set = std::getenv("GNATHION_SHARED");
  return set ? std::filesystem::path(set) : std::filesystem::path("../shared");
}

/// The last word of a transformation's story: 90 and above are impossible; the close ones need apertures.
Verdict expected_verdict(const std::string& pair, int number) {
  static const std::map<std::string, std::set<int>> kClose = {{"cast", {2, 4, 6, 7}}, {"crowns", {3, 6}}};
  if (number >= 90) return Verdict::kNotRealizable;
  return kClose.at(pair).count(number) ? Verdict::kRealizableWithApertures : Verdict::kRealizable;
}

struct RealCase {
  std::string name;
  int number = 0;
  Motion<Dental> motion;
};

class RealPair : public ::testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    const auto folder = shared() / "data/jaws" / GetParam();
    if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no real jaws at " << folder;
    auto upper = read_jaw(folder / "maxilla.stl"), lower = read_jaw(folder / "mandible_mi.stl");
    ASSERT_TRUE(upper && lower);
    maxilla = *upper;
    mandible = *lower;
    for (const auto& entry : std::filesystem::directory_iterator(folder / "transforms")) {
      const auto read = read_motion(entry.path());
      ASSERT_TRUE(read) << read.error().line();
      const std::string name = entry.path().stem().string();
      cases.push_back({name, std::stoi(name.substr(0, 2)), read->motion});
    }
    std::sort(cases.begin(), cases.end(),
              [](const RealCase& a, const RealCase& b) { return a.number < b.number; });
    ASSERT_EQ(cases.size(), 11u);
  }
  TriangleMesh maxilla, mandible;
  std::vector<RealCase> cases;
};

TEST_P(RealPair, EveryTransformationGetsItsVerdict) {
  const auto checker = RealizabilityChecker::create(maxilla, mandible);
  ASSERT_TRUE(checker) << checker.error().line();
  for (const auto& c : cases) {
    const Feasibility feasibility = checker->check(c.motion);
    EXPECT_STREQ(verdict_name(feasibility.verdict), verdict_name(expected_verdict(GetParam(), c.number)))
        << GetParam() << " " << c.name;
    const auto violated = feasibility.violated();
    auto names = [&](const char* name) { return std::count(violated.begin(), violated.end(), name) > 0; };
    if (c.number == 90 || c.number == 91) {
      EXPECT_TRUE(names("no_intersection")) << c.name;
    }
    if (c.number == 92) {
      EXPECT_TRUE(names("vertical_opening")) << c.name;
      EXPECT_FALSE(names("no_intersection")) << c.name;
    }
  }
}

TEST_P(RealPair, TheVerdictDoesNotFeelWhereTheJawsLie) {
  Random random(2026);
  const Rigid3 x{random.rotation(), 150.0 * random.normal3()};
  const auto checker = RealizabilityChecker::create(transformed(x, maxilla), transformed(x, mandible));
  ASSERT_TRUE(checker) << checker.error().line();
  for (const auto& c : cases) {
    const Feasibility feasibility = checker->check(Motion<Dental>(x * c.motion.rigid * x.inverse()));
    EXPECT_STREQ(verdict_name(feasibility.verdict), verdict_name(expected_verdict(GetParam(), c.number)))
        << GetParam() << " " << c.name;
  }
}

INSTANTIATE_TEST_SUITE_P(Real, RealPair, ::testing::Values("cast", "crowns"),
                         [](const auto& pair) { return std::string(pair.param); });

/// Checks on simple arches; the tables are flat and 0.02 mm apart in MI.
class SimplePair : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(checker) << checker.error().line(); }
  Feasibility check(const Rigid3& motion) { return checker->check(Motion<Dental>(motion)); }
  static const Constraint& named(const Feasibility& f, const std::string& name) {
    const auto it = std::find_if(f.constraints.begin(), f.constraints.end(),
                                 [&](const auto& c) { return c.name == name; });
    EXPECT_NE(it, f.constraints.end()) << name;
    return *it;
  }
  static Rigid3 shift(double left, double posterior, double up) {
    return Rigid3::from_translation({left, posterior, up});
  }
  testing::SimpleJaws jaws = testing::simple_jaws();
  Result<RealizabilityChecker> checker = RealizabilityChecker::create(jaws.maxilla, jaws.mandible);
};

TEST_F(SimplePair, ClearanceIsToldInMillimetres) {
  const auto open = check(shift(0, 0, -2.0));
  EXPECT_EQ(open.verdict, Verdict::kRealizable);
  EXPECT_TRUE(open.violated().empty());
  EXPECT_NEAR(named(open, "interocclusal_clearance").value, 2.02, 0.03);
  EXPECT_TRUE(named(open, "wall_room").pass);

  const auto thin = check(shift(0, 0, -0.7));
  EXPECT_EQ(thin.verdict, Verdict::kRealizable);
  EXPECT_FALSE(named(thin, "wall_room").pass);
  EXPECT_TRUE(thin.violated().empty()) << "a thin wall informs";

  const auto close = check(shift(0, 0, -0.3));
  EXPECT_EQ(close.verdict, Verdict::kRealizableWithApertures);
  EXPECT_EQ(close.violated(), std::vector<std::string>{"interocclusal_clearance"});
  EXPECT_GE(named(close, "interocclusal_clearance").teeth.size(), 10u);
}

TEST_F(SimplePair, IntersectionIsHeldAgainstMi) {
  const auto slight = check(shift(0, 0, 0.09));  // 0.07 mm deep: within what is accepted beyond MI
  EXPECT_NE(slight.verdict, Verdict::kNotRealizable);
  const auto deep = check(shift(0, 0, 0.22));
  EXPECT_EQ(deep.verdict, Verdict::kNotRealizable);
  const Constraint& c = named(deep, "no_intersection");
  EXPECT_FALSE(c.pass);
  EXPECT_NEAR(c.value, 0.20, 0.02);
  EXPECT_NEAR(c.limit, 0.10, 0.02);
  EXPECT_FALSE(c.teeth.empty());
  EXPECT_LT(std::abs(c.where_mm.z()), 0.5);

  // The same overlap present in MI is no violation.
  const TriangleMesh sunk = transformed(shift(0, 0, 0.22), jaws.mandible);
  const auto in_mi = check_realizability(jaws.maxilla, sunk, Motion<Dental>());
  ASSERT_TRUE(in_mi) << in_mi.error().line();
  EXPECT_NE(in_mi->verdict, Verdict::kNotRealizable);
}

TEST_F(SimplePair, AMandibleAboveTheMaxillaIsRefused) {
  const auto above = check(shift(0, 0, 14.0));  // clear of it: the arches are 6 mm high, open sheets
  EXPECT_EQ(above.verdict, Verdict::kNotRealizable);
  EXPECT_FALSE(named(above, "mandible_below_maxilla").pass);
  EXPECT_LT(named(above, "mandible_below_maxilla").value, -5.0);
  const auto beside = check(shift(90, 0, -3.0));
  EXPECT_EQ(beside.verdict, Verdict::kNotRealizable);
  EXPECT_FALSE(named(beside, "mandible_below_maxilla").pass) << "nothing over any tooth";
}

TEST_F(SimplePair, WhatJointsCannotReachIsRefusedByName) {
  // Hinge of the estimated condyles; the incisal point of the simple arches is near the origin.
  const Vector3 hinge(0, 88, 35);
  auto violated = [&](const Rigid3& motion) {
    const auto names = check(motion).violated();
    return std::set<std::string>(names.begin(), names.end());
  };
  EXPECT_TRUE(violated(Rigid3::about_axis(hinge, Vector3::UnitX(), 6.0 * kDeg)).empty()) << "opening";
  EXPECT_TRUE(violated(Rigid3::about_axis(hinge, Vector3::UnitX(), 12.0 * kDeg)).empty()) << "wide opening";
  EXPECT_TRUE(violated(Rigid3::about_axis(hinge, Vector3::UnitX(), 20.0 * kDeg)).count("vertical_opening"));
  EXPECT_TRUE(violated(shift(0, -5, -3)).empty()) << "5 mm of protrusion";
  EXPECT_TRUE(violated(shift(0, 3, -3)).count("condyle_back")) << "3 mm of retrusion";
  EXPECT_TRUE(violated(shift(0, -14, -3)).count("protrusion"));
  EXPECT_TRUE(violated(shift(5, 0, -3)).count("condyle_lateral"));
  // Laterotrusion to the left about the left condyle, 3 mm open: the right condyle comes forward.
  const Rigid3 lateral = shift(0, 0, -3) * Rigid3::about_axis({52, 88, 35}, Vector3::UnitZ(), 4.0 * kDeg);
  EXPECT_TRUE(violated(lateral).empty()) << *violated(lateral).begin();
  // The same turn about the arch's middle presses a condyle back.
  const Rigid3 yaw = shift(0, 0, -3) * Rigid3::about_axis({0, 15, 0}, Vector3::UnitZ(), 7.0 * kDeg);
  EXPECT_TRUE(violated(yaw).count("condyle_back"));
  const Rigid3 roll = shift(0, 0, -6) * Rigid3::about_axis({0, 15, 0}, Vector3::UnitY(), 7.0 * kDeg);
  EXPECT_TRUE(violated(roll).count("roll"));
}

TEST_F(SimplePair, JsonHasEveryField) {
  const auto j = feasibility_json(check(shift(0, 0, -0.3)));
  EXPECT_EQ(j.at("verdict"), "realizable_with_apertures");
  EXPECT_EQ(j.at("violated"), nlohmann::json::array({"interocclusal_clearance"}));
  std::set<std::string> names;
  for (const auto& c : j.at("constraints")) {
    names.insert(c.at("name").get<std::string>());
    EXPECT_TRUE(c.at("pass").is_boolean());
    EXPECT_TRUE(c.at("unit").is_string());
    EXPECT_EQ(c.at("where_mm").size(), 3u);
    for (const auto& fdi : c.at("teeth")) EXPECT_GE(fdi.get<int>(), 11);
    EXPECT_FALSE(c.at("consequence").get<std::string>().empty());
    if (c.at("name") == "condyle_fossa") {
      EXPECT_TRUE(c.at("value").is_null());
      EXPECT_EQ(c.at("consequence"), "joints not checked: no CBCT");
    } else if (c.at("name") == "support_polygon") {
      EXPECT_TRUE(c.at("value").is_null()) << "no contact is left";
      EXPECT_FALSE(c.at("pass").get<bool>());
    } else {
      EXPECT_TRUE(c.at("value").is_number() && c.at("limit").is_number()) << c.dump();
    }
  }
  EXPECT_EQ(names.size(), j.at("constraints").size()) << "names are unique";
}

TEST_F(SimplePair, JawsOfDifferentFramesAreRefusedAsInput) {
  const auto result =
      check_realizability(jaws.maxilla, transformed(shift(0, 0, -60), jaws.mandible), Motion<Dental>());
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kInput);
  EXPECT_NE(result.error().line().find("different frames"), std::string::npos);
}

}  // namespace
}  // namespace gnathion
