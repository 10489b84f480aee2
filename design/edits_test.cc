#include "design/edits.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace gnathion {
namespace {

constexpr const char* kEdits = R"(
[design]
wall_mm = 1.2
[[design.stroke]]
kind = "add"
path_mm = [[0, 0, 0], [4, 0, 0]]
radius_mm = 2
depth_mm = 0.6
[[design.stroke]]
kind = "remove"
path_mm = [[20, 0, 0]]
radius_mm = 1.0
depth_mm = 0.2
[[design.cutout]]
outline_mm = [[10, 10, 3], [12, 10, 3], [12, 12, 4], [10, 12, 4]]
[[design.contact]]
outline_mm = [[-50, -50, 0], [0, -50, 0], [0, 50, 0], [-50, 50, 0]]
)";

TEST(Edits, AreReadInOrderAndWrittenBack) {
  const auto edits = parse_edits(kEdits, "case.toml");
  ASSERT_TRUE(edits.has_value()) << edits.error().line();
  ASSERT_EQ(edits->strokes.size(), 2u);
  EXPECT_EQ(edits->strokes[0].kind, Stroke::Kind::kAdd);
  EXPECT_EQ(edits->strokes[1].kind, Stroke::Kind::kRemove);
  EXPECT_EQ(edits->strokes[0].path_mm[1], Vector3(4, 0, 0));
  EXPECT_EQ(edits->cutouts.size(), 1u);
  EXPECT_EQ(edits->contacts.size(), 1u);
  const nlohmann::json j = edits_json(*edits);
  EXPECT_EQ(j["stroke"][0]["kind"], "add");
  EXPECT_EQ(j["stroke"][1]["depth_mm"], 0.2);
  EXPECT_EQ(j["cutout"][0]["outline_mm"].size(), 4u);
  EXPECT_TRUE(parse_edits("[design]\nwall_mm = 1\n", "x").value().empty());
}

TEST(Edits, RefusalsNameTheEntry) {
  const std::pair<const char*, const char*> bad[] = {
      {"[[design.stroke]]\nkind = \"carve\"\npath_mm = [[0,0,0]]\n", "design.stroke 1"},
      {"[[design.stroke]]\nkind = \"add\"\n", "path_mm"},
      {"[[design.stroke]]\nkind = \"add\"\npath_mm = []\n", "path_mm"},
      {"[[design.stroke]]\nkind = \"add\"\npath_mm = [[0,0]]\n", "point"},
      {"[[design.stroke]]\nkind = \"add\"\npath_mm = [[0,0,\"a\"]]\n", "number"},
      {"[[design.stroke]]\nkind = \"add\"\npath_mm = [[0,0,0]]\nradius_mm = 1.0\ndepth_mm = 0.9\n", "fold"},
      {"[[design.stroke]]\nkind = \"add\"\npath_mm = [[0,0,0]]\nradius = 1.0\n", "radius"},
      {"[[design.cutout]]\noutline_mm = [[0,0,0],[1,0,0]]\n", "design.cutout 1"},
      {"[design]\ncutout = 3\n", "design.cutout"},
      {"[[design.contact]\n", "edits.toml:1"}};
  for (const auto& [text, part] : bad) {
    const auto edits = parse_edits(text, "edits.toml");
    ASSERT_FALSE(edits.has_value()) << text;
    EXPECT_EQ(edits.error().code, ErrorCode::kInput);
    EXPECT_NE(edits.error().line().find(part), std::string::npos) << edits.error().line();
  }
}

TEST(Edits, FadeFromThePathAndFollowEachOther) {
  const EditField field(parse_edits(kEdits, "x").value(), Rigid3::identity());
  EXPECT_DOUBLE_EQ(field.stroked({2, 0, 0}, 0.1, 0.0), 0.1 - 0.6);
  EXPECT_DOUBLE_EQ(field.stroked({2, 0, 1}, 0.1, 0.0), 0.1 - 0.3);  // half of the radius, half of the depth
  EXPECT_DOUBLE_EQ(field.stroked({2, 0, 2.01}, 0.1, 0.0), 0.1);
  EXPECT_DOUBLE_EQ(field.stroked({20, 0, 0}, 0.1, 0.0), 0.1 + 0.2);
  EXPECT_DOUBLE_EQ(field.cutout_mm({11, 11, -30}), -1.0);  // seen along z, whatever the height
  EXPECT_DOUBLE_EQ(field.cutout_mm({14, 11, 0}), 2.0);
  EXPECT_DOUBLE_EQ(field.without_contact({-3, 0, 0}), 0.0);
  EXPECT_DOUBLE_EQ(field.without_contact({3, 0, 0}), 1.0);
}

TEST(Edits, SmoothingKeepsWhatWasAddedBefore) {
  const EditField field(parse_edits(R"(
[[design.stroke]]
kind = "add"
path_mm = [[0, 0, 0]]
depth_mm = 0.4
[[design.stroke]]
kind = "smooth"
path_mm = [[0, 0, 0]]
depth_mm = 0.2
)",
                                    "x")
                            .value(),
                        Rigid3::identity());
  EXPECT_DOUBLE_EQ(field.stroked({0, 0, 0}, 0.1, 0.15), 0.15 - 0.4);
  EXPECT_DOUBLE_EQ(field.stroked({0, 0, 0}, 0.1, 0.9), 0.3 - 0.4);  // by its depth at most
}

TEST(Edits, GoWithTheirFrame) {
  const Rigid3 place = Rigid3::from_translation({5, 0, 0});
  const EditField field(parse_edits(kEdits, "x").value(), place);
  EXPECT_DOUBLE_EQ(field.cutout_mm({16, 11, 0}), -1.0);
}

}  // namespace
}  // namespace gnathion
