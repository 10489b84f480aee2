// Kind "camera" from video files and folders of images, through OpenCV.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "acquisition/device.h"
#include "tests/support/numbered_image.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using test::number_in;
using test::numbered_image;
using ::testing::Contains;
using ::testing::HasSubstr;

class CaptureFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("gnathion_capture_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  DeviceConfig config(std::map<std::string, ConfigValue> settings) const {
    DeviceConfig c;
    c.kind = "camera";
    c.stream = "camera_0";
    c.where = "devices.toml: camera_0";
    c.folder = folder_;
    c.settings = std::move(settings);
    return c;
  }
  std::string refusal(std::map<std::string, ConfigValue> settings) {
    const auto device = open_device(config(std::move(settings)), clock_);
    EXPECT_FALSE(device);
    if (device) return "opened";
    EXPECT_EQ(exit_code(device.error().code), 4);
    const std::string line = device.error().line();
    EXPECT_EQ(line.find('\n'), std::string::npos);
    std::printf("  %s\n", line.c_str());
    return line;
  }
  /// Everything until the end.
  std::vector<Sample> all(std::map<std::string, ConfigValue> settings) {
    std::vector<Sample> samples;
    auto device = open_device(config(std::move(settings)), clock_);
    EXPECT_TRUE(device) << device.error().line();
    if (!device) return samples;
    for (;;) {
      auto sample = (*device)->next();
      EXPECT_TRUE(sample) << sample.error().line();
      if (!sample || !*sample) break;
      samples.push_back(std::move(**sample));
    }
    EXPECT_EQ((*device)->health().state, DeviceState::kStopped);
    description_ = (*device)->description();
    return samples;
  }
  void write_video(const std::string& name, int frames, double rate_hz, const std::string& fourcc = "FFV1") {
    const int code = cv::VideoWriter::fourcc(fourcc[0], fourcc[1], fourcc[2], fourcc[3]);
    cv::VideoWriter writer((folder_ / name).string(), cv::CAP_FFMPEG, code, rate_hz, {320, 240});
    ASSERT_TRUE(writer.isOpened());
    for (int i = 0; i < frames; ++i) {
      cv::Mat colour;
      cv::cvtColor(numbered_image(static_cast<unsigned>(i)), colour, cv::COLOR_GRAY2BGR);
      writer.write(colour);
    }
  }

  fs::path folder_;
  ManualClock clock_;
  DeviceDescription description_;
};

TEST_F(CaptureFiles, AVideoGivesItsFramesAtTheirTimesEveryTime) {
  write_video("film.avi", 90, 30);
  const auto first = all({{"source", std::string("film.avi")}});
  ASSERT_EQ(first.size(), 90u);
  for (unsigned i = 0; i < 90; ++i) {
    const auto* frame = std::get_if<FrameSample>(&first[i]);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->header.sequence, i);
    EXPECT_EQ(number_in(frame->image), i);
    EXPECT_NEAR(1e-9 * static_cast<double>(frame->header.capture.ns), i / 30.0, 1e-6);
    EXPECT_EQ(frame->header.capture, frame->header.arrival);
    EXPECT_EQ(frame->header.device.ns, frame->header.capture.ns);
  }
  clock_.set({1'700'000'000'000'000'000});  // another day
  const auto second = all({{"source", std::string("film.avi")}});
  ASSERT_EQ(second.size(), first.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(header_of(first[i]).capture, header_of(second[i]).capture);
    EXPECT_EQ(std::get<FrameSample>(first[i]).image.pixels, std::get<FrameSample>(second[i]).image.pixels);
  }
}

TEST_F(CaptureFiles, ASlowMotionFileHasItsTrueRate) {
  write_video("slow.avi", 60, 30);
  const auto samples = all({{"source", std::string("slow.avi")}, {"rate_hz", 240.0}});
  ASSERT_EQ(samples.size(), 60u);
  EXPECT_NEAR(1e-9 * static_cast<double>(header_of(samples.back()).capture.ns), 59 / 240.0, 1e-6);
}

TEST_F(CaptureFiles, AFileThatWasCutOffSaysWhatItLost) {
  write_video("whole.avi", 120, 30, "MJPG");
  fs::copy(folder_ / "whole.avi", folder_ / "cut.avi");
  fs::resize_file(folder_ / "cut.avi", fs::file_size(folder_ / "whole.avi") / 2);
  const auto samples = all({{"source", std::string("cut.avi")}});
  ASSERT_GT(samples.size(), 30u);
  std::uint64_t accounted = 0;
  for (const Sample& s : samples) {
    const auto* line = std::get_if<LedgerSample>(&s);
    accounted += line ? line->count : 1;
  }
  EXPECT_EQ(accounted, 120u);
  const auto* line = std::get_if<LedgerSample>(&samples.back());
  ASSERT_TRUE(line);
  EXPECT_EQ(line->fate, LedgerSample::Fate::kMissing);
  EXPECT_THAT(line->reason, HasSubstr("announced by the file"));
}

TEST_F(CaptureFiles, AFolderInNaturalOrderWithItsGapsAndDamage) {
  // Numbers without leading zeros, from 8 on; 12 and 13 are not there; 15 is no image; 17 has another size.
  for (unsigned i = 8; i <= 20; ++i)
    if (i != 12 && i != 13)
      cv::imwrite((folder_ / ("shot_" + std::to_string(i) + ".png")).string(), numbered_image(i));
  std::ofstream(folder_ / "shot_15.png") << "not a picture";
  cv::imwrite((folder_ / "shot_17.png").string(), cv::Mat(100, 100, CV_8UC1, cv::Scalar(7)));
  std::ofstream(folder_ / "notes.txt") << "by the way";
  const auto samples = all({{"source", folder_.string()}, {"rate_hz", 60.0}});
  std::map<std::uint32_t, std::string> fate;
  for (const Sample& s : samples) {
    const SampleHeader& h = header_of(s);
    if (const auto* frame = std::get_if<FrameSample>(&s)) {
      fate[h.sequence] = "frame";
      EXPECT_EQ(number_in(frame->image), h.sequence + 8);
      EXPECT_NEAR(1e-9 * static_cast<double>(h.capture.ns), h.sequence / 60.0, 1e-9);
    } else if (const auto* line = std::get_if<LedgerSample>(&s)) {
      for (std::uint32_t i = 0; i < line->count; ++i) fate[h.sequence + i] = line->reason;
    }
  }
  ASSERT_EQ(fate.size(), 13u);
  EXPECT_EQ(fate[4], "counter gap");
  EXPECT_EQ(fate[5], "counter gap");
  EXPECT_THAT(fate[7], HasSubstr("shot_15.png cannot be decoded"));
  EXPECT_THAT(fate[9], HasSubstr("size 100x100 px instead of 320x240"));
  EXPECT_EQ(std::count_if(fate.begin(), fate.end(), [](const auto& f) { return f.second == "frame"; }), 9);
}

TEST_F(CaptureFiles, NamesWithoutRunningNumbersAreFramesInOrder) {
  for (const char* name : {"b.png", "a.png", "c.PNG"})
    cv::imwrite((folder_ / "x.png").string(), numbered_image(static_cast<unsigned>(name[0]))),
        fs::rename(folder_ / "x.png", folder_ / name);
  const auto samples = all({{"source", folder_.string()}, {"rate_hz", 10.0}});
  ASSERT_EQ(samples.size(), 3u);
  EXPECT_EQ(number_in(std::get<FrameSample>(samples[0]).image), unsigned{'a'});
  EXPECT_EQ(number_in(std::get<FrameSample>(samples[2]).image), unsigned{'c'});
  EXPECT_THAT(description_.settings, Contains(HasSubstr("gaps cannot be seen")));
}

TEST_F(CaptureFiles, SixteenBitsAndColourBecomeGrey) {
  cv::imwrite((folder_ / "f0.png").string(), cv::Mat(4, 4, CV_16UC1, cv::Scalar(0x80ff)));
  cv::imwrite((folder_ / "f1.png").string(), cv::Mat(4, 4, CV_8UC3, cv::Scalar(0, 0, 255)));  // red
  const auto samples = all({{"source", folder_.string()}, {"rate_hz", 1.0}});
  ASSERT_EQ(samples.size(), 2u);
  EXPECT_EQ(std::get<FrameSample>(samples[0]).image.at(2, 2), 0x80);
  EXPECT_NEAR(std::get<FrameSample>(samples[1]).image.at(2, 2), 0.299 * 255, 1);
}

TEST_F(CaptureFiles, AFileWaitsForASlowReaderAndStopsAtOnce) {
  write_video("long.avi", 300, 30);
  auto device = open_device(config({{"source", std::string("long.avi")}, {"queue_frames", 2.0}}), clock_);
  ASSERT_TRUE(device);
  for (std::uint32_t i = 0; i < 20; ++i) {
    auto sample = (*device)->next();
    ASSERT_TRUE(sample && *sample);
    EXPECT_EQ(header_of(**sample).sequence, i);
  }
  EXPECT_LE((*device)->health().received, 23u);  // the queue's two, and one on its way
  EXPECT_EQ((*device)->health().rejected, 0u);
  (*device)->stop();
  int left = 0;
  for (auto sample = (*device)->next(); sample && *sample; sample = (*device)->next()) ++left;
  EXPECT_LE(left, 4);
}

TEST_F(CaptureFiles, RefusesInOneLineWhatCannotBe) {
  write_video("film.avi", 5, 30);
  std::ofstream(folder_ / "text.avi") << "this is not a film";
  fs::create_directories(folder_ / "empty");
  const std::string film = "film.avi";
  EXPECT_THAT(refusal({}), HasSubstr("'source' is not given"));
  EXPECT_THAT(refusal({{"source", std::string("gone.avi")}}), HasSubstr("gone.avi: No such file"));
  EXPECT_THAT(refusal({{"source", std::string("text.avi")}}),
              HasSubstr("is not a video that FFmpeg can read"));
  EXPECT_THAT(refusal({{"source", std::string("empty")}, {"rate_hz", 5.0}}), HasSubstr("holds no image"));
  EXPECT_THAT(refusal({{"source", std::string("empty")}}), HasSubstr("'rate_hz' is not given: a folder"));
  EXPECT_THAT(refusal({{"source", film}, {"gain", 2.0}}),
              HasSubstr("'gain' cannot be set: the source is a recording"));
  EXPECT_THAT(refusal({{"source", film}, {"rate_hz", 1e9}}), HasSubstr("'rate_hz' is 1000000000"));
  EXPECT_THAT(refusal({{"source", film}, {"rate_hz", 100.0}, {"exposure_us", 20000.0}}),
              HasSubstr("an exposure of 20000 us allows 50.0 at most"));
  EXPECT_THAT(refusal({{"source", film}, {"autofocus", true}}), HasSubstr("'autofocus' is refused"));
  EXPECT_THAT(refusal({{"source", film}, {"exposure", 3.0}}), HasSubstr("unknown key 'exposure'"));
  EXPECT_THAT(refusal({{"source", film}, {"shutter", std::string("slow")}}),
              HasSubstr("must be one of rolling, global"));
  EXPECT_THAT(refusal({{"source", film}, {"line_time_us", 15.0}}), HasSubstr("is of a rolling shutter"));
  EXPECT_THAT(refusal({{"source", std::int64_t{77}}}), HasSubstr("/dev/video77: No such file or directory"));
  EXPECT_THAT(refusal({{"source", std::string("/dev/null")}}), HasSubstr("/dev/null is not a camera"));
}

}  // namespace
}  // namespace gnathion
