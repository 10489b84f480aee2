#include "acquisition/device_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "core/file.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class DeviceConfigTest : public ::testing::Test {
 protected:
  Result<std::vector<DeviceConfig>> read(const std::string& toml) {
    EXPECT_TRUE(write_file(path_, toml));
    return read_device_configs(path_);
  }
  void TearDown() override { fs::remove(path_); }
  const fs::path path_ =
      fs::temp_directory_path() / ("gnathion_devices_" + std::to_string(::getpid()) + ".toml");
};

TEST_F(DeviceConfigTest, ReadsEveryTypeOfValue) {
  const auto configs = read(R"(
[[device]]
kind = "camera"
name = "camera_0"
exposure_us = 8000
gain = 1.5
on = true
path = "film.avi"
list = [1, 2.5]
names = ["a", "b"]
)");
  ASSERT_TRUE(configs) << configs.error().line();
  ASSERT_EQ(configs->size(), 1u);
  SettingsReader reader(configs->front());
  EXPECT_EQ(reader.number("exposure_us"), 8000.0);
  EXPECT_EQ(reader.number_in("gain", 0, 2, 1), 1.5);
  EXPECT_EQ(reader.flag("on"), true);
  EXPECT_EQ(reader.path("path"), path_.parent_path() / "film.avi");
  EXPECT_EQ(reader.numbers("list"), (std::vector<double>{1, 2.5}));
  EXPECT_EQ(reader.texts("names"), (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(reader.number_in("absent", 0, 2, 0.25), 0.25);
  EXPECT_TRUE(reader.finish());
}

TEST_F(DeviceConfigTest, NamesTheKeyThatWasMeant) {
  const auto configs = read("[[device]]\nkind='camera'\nname='c'\nexposure_ms=3\n");
  ASSERT_TRUE(configs);
  SettingsReader reader(configs->front());
  reader.number("exposure_us");
  const Status status = reader.finish();
  ASSERT_FALSE(status);
  EXPECT_EQ(exit_code(status.error().code), 4);
  EXPECT_THAT(status.error().line(), HasSubstr("unknown key 'exposure_ms'; 'exposure_us' is meant?"));
}

TEST_F(DeviceConfigTest, RefusesWrongTypesAndRanges) {
  const auto configs = read("[[device]]\nkind='camera'\nname='c'\nrate_hz=-5\nmode='odd'\n");
  ASSERT_TRUE(configs);
  SettingsReader range(configs->front());
  range.number_in("rate_hz", 1, 1000, 60);
  range.choice("mode", {"even"}, "even");
  EXPECT_THAT(range.finish().error().line(), HasSubstr("'rate_hz' is -5; it must be within 1 to 1000"));
  SettingsReader type(configs->front());
  type.flag("rate_hz");
  EXPECT_THAT(type.finish().error().line(), HasSubstr("'rate_hz' must be true or false"));
}

TEST_F(DeviceConfigTest, RefusesFilesThatNameNoDevice) {
  EXPECT_THAT(read("").error().line(), HasSubstr("names no [[device]]"));
  EXPECT_THAT(read("x = 1").error().line(), HasSubstr("unknown key 'x'"));
  EXPECT_THAT(read("[[device]]\nname='a'").error().line(), HasSubstr("has no 'kind'"));
  EXPECT_THAT(read("[[device]]\nkind='pedal'\nname='a/b'").error().line(), HasSubstr("needs a 'name'"));
  EXPECT_THAT(read("[[device]]\nkind='pedal'\nname='a'\n[[device]]\nkind='pedal'\nname='a'").error().line(),
              HasSubstr("two devices are named 'a'"));
  EXPECT_THAT(read("[[device").error().line(), HasSubstr("line 1"));
}

}  // namespace
}  // namespace gnathion
