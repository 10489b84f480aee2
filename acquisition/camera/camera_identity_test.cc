#include "acquisition/camera/camera_identity.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace gnathion {
namespace {

using ::testing::HasSubstr;

DeviceConfig config(const std::string& kind, const std::string& stream, const std::string& key,
                    ConfigValue value) {
  DeviceConfig c;
  c.kind = kind;
  c.stream = stream;
  c.where = "devices.toml: " + stream;
  c.settings[key] = std::move(value);
  return c;
}

TEST(CameraIdentity, TheSecondNameOfOneCameraIsRefused) {
  const auto errors = cameras_named_twice({
      config("aravis", "camera_0", "serial", std::string("A1")),
      config("aravis", "camera_1", "serial", std::string("A2")),
      config("aravis", "camera_2", "serial", std::string("A1")),
      config("aravis", "camera_3", "ip", std::string("A1")),  // an address is not a serial
      config("pedal", "pedal", "serial", std::string("A1")),
      config("aravis", "camera_4", "serial", std::string("A1")),
  });
  ASSERT_EQ(errors.size(), 6u);
  for (const std::size_t i : {0u, 1u, 3u, 4u}) EXPECT_FALSE(errors[i]) << i;
  ASSERT_TRUE(errors[2] && errors[5]);
  EXPECT_THAT(errors[2]->line(), HasSubstr("devices.toml: camera_2: serial A1 is already camera 'camera_0'"));
  EXPECT_THAT(errors[5]->line(), HasSubstr("is already camera 'camera_0'"));
  EXPECT_EQ(exit_code(errors[2]->code), 4);
}

TEST(CameraIdentity, NumberAndPathAndLinkAreOneDevice) {
  EXPECT_TRUE(cameras_named_twice({config("camera", "a", "source", std::int64_t{3}),
                                   config("camera", "b", "source", std::string("/dev/video3"))})[1]);
  EXPECT_TRUE(cameras_named_twice({config("camera", "a", "source", std::string("3")),
                                   config("camera", "b", "source", std::int64_t{3})})[1]);
  EXPECT_FALSE(cameras_named_twice({config("camera", "a", "source", std::int64_t{3}),
                                    config("camera", "b", "source", std::int64_t{4})})[1]);
  // Two ways to one node, as by-id links are.
  EXPECT_TRUE(cameras_named_twice({config("camera", "a", "source", std::string("/dev/null")),
                                   config("camera", "b", "source", std::string("/dev/../dev/null"))})[1]);
  // One film may be read twice.
  EXPECT_FALSE(cameras_named_twice({config("camera", "a", "source", std::string("film.avi")),
                                    config("camera", "b", "source", std::string("film.avi"))})[1]);
}

TEST(CameraIdentity, SerialsAreComparedWithinAModel) {
  DeviceDescription first, second;
  first.kind = second.kind = "aravis";
  first.stream = "camera_0";
  second.stream = "camera_1";
  first.vendor = second.vendor = "Maker";
  EXPECT_FALSE(same_serial(second, {first}));  // cameras that do not tell a serial
  first.serial = second.serial = "7";
  ASSERT_TRUE(same_serial(second, {first}));
  EXPECT_THAT(same_serial(second, {first})->line(), HasSubstr("with serial 7 is already 'camera_0'"));
  second.model = "Other";
  EXPECT_FALSE(same_serial(second, {first}));
}

}  // namespace
}  // namespace gnathion
