// What the tests of exchange share.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "acquisition/recording.h"
#include "core/file.h"
#include "core/random.h"

namespace gnathion {

class ExchangeTest : public ::testing::Test {
 protected:
  ExchangeTest()
      : seed_(static_cast<std::uint64_t>(std::chrono::steady_clock::now().time_since_epoch().count())),
        random_(seed_) {
    RecordProperty("seed", std::to_string(seed_));
  }
  void SetUp() override {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::temp_directory_path() /
              ("gnathion_exchange_" + std::to_string(::getpid()) + "_" + test->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  Rigid3 random_pose() { return {random_.rotation(), 300 * random_.normal3()}; }
  Image8 random_image(int width, int height) {
    Image8 image(width, height);
    for (auto& p : image.pixels) p = static_cast<std::uint8_t>(random_.below(256));
    return image;
  }
  std::filesystem::path file(const std::string& name, const std::string& bytes) {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }
  static std::vector<Sample> samples_of(const std::filesystem::path& recording) {
    std::vector<Sample> samples;
    auto source = RecordingSource::open(recording);
    EXPECT_TRUE(source) << source.error().line();
    while (source) {
      auto next = (*source)->next();
      EXPECT_TRUE(next) << next.error().line();
      if (!next || !*next) break;
      samples.push_back(std::move(**next));
    }
    return samples;
  }
  /// The files of PLUS's own test data; nothing where they are not here.
  static std::filesystem::path plus_data() {
    const char* shared = std::getenv("GNATHION_SHARED");
    const std::filesystem::path root = shared ? shared : "../shared";
    const std::filesystem::path folder = root / "data" / "motion" / "plus";
    return std::filesystem::is_directory(folder) ? folder : std::filesystem::path();
  }

  const std::uint64_t seed_;
  Random random_;
  std::filesystem::path folder_;
  SilentProgress progress_;
};

}  // namespace gnathion
