#include "design/parameters.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace gnathion {
namespace {

TEST(Parameters, DefaultsAreAccepted) {
  EXPECT_TRUE(check_parameters({}).has_value());
}

TEST(Parameters, TomlOverridesDefaultsAndKeepsTheRest) {
  const auto p = parse_parameters("[design]\nvoxel_mm = 0.2\nwall_mm = 2\n", "x.toml");
  ASSERT_TRUE(p.has_value()) << p.error().line();
  EXPECT_DOUBLE_EQ(p->voxel_mm, 0.2);
  EXPECT_DOUBLE_EQ(p->wall_mm, 2.0);
  EXPECT_DOUBLE_EQ(p->gap_mm, SplintParameters{}.gap_mm);
}

TEST(Parameters, RefusalsNameTheParameter) {
  for (const char* text :
       {"[design]\nwal_mm = 1\n", "[design]\nwall_mm = \"thick\"\n", "[design]\nwall_mm = 40\n"}) {
    const auto p = parse_parameters(text, "x.toml");
    ASSERT_FALSE(p.has_value()) << text;
    EXPECT_EQ(p.error().code, ErrorCode::kInput);
    EXPECT_NE(p.error().line().find("x.toml"), std::string::npos);
    EXPECT_NE(p.error().line().find("wal"), std::string::npos) << p.error().line();
  }
  const auto broken = parse_parameters("[design\n", "x.toml");
  ASSERT_FALSE(broken.has_value());
  EXPECT_NE(broken.error().line().find("x.toml:1"), std::string::npos) << broken.error().line();
}

TEST(Parameters, SetFromTheCommandLine) {
  SplintParameters p;
  EXPECT_TRUE(set_parameter(p, "design.gap_mm=0.05").has_value());
  EXPECT_DOUBLE_EQ(p.gap_mm, 0.05);
  for (const char* bad : {"gap_mm=0.05", "design.gap_mm", "design.gap=1", "design.gap_mm=a",
                          "design.gap_mm=7", "design.gap_mm=nan", "design.gap_mm="}) {
    const Status status = set_parameter(p, bad);
    ASSERT_FALSE(status.has_value()) << bad;
    EXPECT_EQ(status.error().code, ErrorCode::kUsage);
  }
  EXPECT_DOUBLE_EQ(p.gap_mm, 0.05);
}

TEST(Parameters, ContradictionsAreRefused) {
  SplintParameters p;
  p.aperture_limit_mm = 1.4;
  const Status status = check_parameters(p);
  ASSERT_FALSE(status.has_value());
  EXPECT_NE(status.error().where.find("aperture_limit_mm"), std::string::npos);
}

TEST(Parameters, EveryParameterIsInJsonAndHelp) {
  const nlohmann::json j = parameters_json({});
  EXPECT_EQ(j.size(), parameter_help().size());
  EXPECT_EQ(j.size() * sizeof(double), sizeof(SplintParameters));
  for (const ParameterHelp& help : parameter_help())
    EXPECT_EQ(j.at(help.name).get<double>(), help.default_value);
}

}  // namespace
}  // namespace gnathion
