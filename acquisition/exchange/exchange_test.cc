// Import and export of recordings.
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <set>
#include <sstream>

#include "acquisition/exchange/exchange_test_support.h"
#include "acquisition/exchange/export_recording.h"
#include "acquisition/exchange/import_recording.h"
#include "acquisition/exchange/plus_sequence.h"
#include "acquisition/pose_recording.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

cv::Mat mat(const Image8& image) {
  return cv::Mat(image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.pixels.data()))
      .clone();
}
std::vector<std::vector<std::string>> table(const fs::path& path) {
  std::ifstream in(path);
  std::vector<std::vector<std::string>> rows;
  for (std::string line; std::getline(in, line);) {
    rows.emplace_back();
    std::istringstream cells(line);
    for (std::string cell; std::getline(cells, cell, ',');) rows.back().push_back(cell);
  }
  return rows;
}

class ImportImages : public ExchangeTest {
 protected:
  fs::path images(const std::string& name, const std::vector<std::pair<std::string, cv::Mat>>& pictures) {
    fs::create_directories(folder_ / name);
    for (const auto& [file, picture] : pictures) cv::imwrite((folder_ / name / file).string(), picture);
    return folder_ / name;
  }
  std::string refusal(const fs::path& path) {
    const auto done = import_images({{"cam", path}}, 30, folder_ / "refused.mcap", progress_);
    EXPECT_FALSE(fs::exists(folder_ / "refused.mcap"));
    for (const auto& entry : fs::directory_iterator(folder_))
      EXPECT_EQ(entry.path().filename().string().find(".refused"), std::string::npos) << entry.path();
    return done ? std::string("taken") : done.error().line();
  }
};

TEST_F(ImportImages, FoldersOfTwoCameras) {
  std::vector<Image8> left, right;
  std::vector<std::pair<std::string, cv::Mat>> l, r;
  for (int i = 0; i < 12; ++i) {
    left.push_back(random_image(40, 30));
    right.push_back(random_image(64, 48));
    l.emplace_back("img" + std::to_string(i < 9 ? i : i + 2) + ".png", mat(left.back()));
    r.emplace_back("f_" + std::to_string(100 - i) + ".png", mat(right.back()));  // the last comes first
  }
  l.pop_back();
  left.pop_back();
  images("left", l);
  images("right", r);
  std::ofstream(folder_ / "left" / "readme.txt") << "not a picture";
  const std::vector<ImageImport> cameras = {{"left", folder_ / "left"}, {"right", folder_ / "right"}};
  const auto done = import_images(cameras, 60, folder_ / "a.mcap", progress_);
  ASSERT_TRUE(done) << done.error().line();
  EXPECT_EQ(done->frames, 23u);
  EXPECT_EQ(done->notes.size(), 3u);  // the text file; numbers 9 and 10; one picture more on the right
  std::size_t n[2] = {0, 0};
  std::uint32_t missing = 0;
  for (const Sample& s : samples_of(folder_ / "a.mcap")) {
    if (const auto* line = std::get_if<LedgerSample>(&s)) {
      EXPECT_EQ(line->fate, LedgerSample::Fate::kMissing);
      EXPECT_EQ(line->header.stream, "left");
      EXPECT_EQ(line->header.sequence, 9u);
      missing += line->count;
      continue;
    }
    const auto& frame = std::get<FrameSample>(s);
    const std::size_t k = frame.header.stream == "right";
    const std::size_t i = n[k]++;
    const std::size_t place = k || i < 9 ? i : i + 2;  // after img8 comes img11
    EXPECT_EQ(frame.header.sequence, place);
    EXPECT_NEAR(static_cast<double>(frame.header.capture.ns), static_cast<double>(place) * 1e9 / 60, 0.51);
    EXPECT_EQ(frame.image.pixels, k ? right[11 - i].pixels : left[i].pixels);
  }
  EXPECT_EQ(missing, 2u);
  EXPECT_EQ(n[0], 11u);
  EXPECT_EQ(n[1], 12u);
  ASSERT_TRUE(import_images(cameras, 60, folder_ / "b.mcap", progress_));
  EXPECT_EQ(*sha256_of_file(folder_ / "a.mcap"), *sha256_of_file(folder_ / "b.mcap"));
}

TEST_F(ImportImages, EverySecondPictureKeptIsNoLoss) {
  images("s", {{"f10.png", mat(random_image(8, 6))},
               {"f12.png", mat(random_image(8, 6))},
               {"f14.png", mat(random_image(8, 6))}});
  const auto done = import_images({{"cam", folder_ / "s"}}, 10, folder_ / "s.mcap", progress_);
  ASSERT_TRUE(done) << done.error().line();
  EXPECT_TRUE(done->notes.empty());
  const auto samples = samples_of(folder_ / "s.mcap");
  ASSERT_EQ(samples.size(), 3u);
  EXPECT_EQ(header_of(samples[2]).capture.ns, 200'000'000);
}

TEST_F(ImportImages, ColourBecomesGrey) {
  cv::Mat colour(5, 7, CV_8UC3);
  for (int i = 0; i < 105; ++i) colour.data[i] = static_cast<std::uint8_t>(random_.below(256));
  images("c", {{"a.png", colour}});
  ASSERT_TRUE(import_images({{"cam", folder_ / "c"}}, 10, folder_ / "c.mcap", progress_));
  const auto samples = samples_of(folder_ / "c.mcap");
  ASSERT_EQ(samples.size(), 1u);
  const Image8& grey = std::get<FrameSample>(samples[0]).image;
  for (int i = 0; i < 35; ++i) {
    const std::uint8_t* bgr = colour.data + 3 * i;
    EXPECT_NEAR(grey.pixels[static_cast<std::size_t>(i)], 0.114 * bgr[0] + 0.587 * bgr[1] + 0.299 * bgr[2],
                0.6);
  }
}

TEST_F(ImportImages, WhatDoesNotFitIsRefusedByName) {
  images("sizes", {{"1.png", cv::Mat::zeros(4, 4, CV_8U)}, {"2.png", cv::Mat::zeros(4, 5, CV_8U)}});
  EXPECT_NE(refusal(folder_ / "sizes").find("2.png: has 5×4 pixels"), std::string::npos);
  images("deep", {{"1.png", cv::Mat::zeros(4, 4, CV_16U)}});
  EXPECT_NE(refusal(folder_ / "deep").find("1.png: has more than 8 bits"), std::string::npos);
  images("broken", {{"1.png", cv::Mat::zeros(4, 4, CV_8U)}});
  std::ofstream(folder_ / "broken" / "2.png") << "no picture";
  EXPECT_NE(refusal(folder_ / "broken").find("2.png: is no image"), std::string::npos);
  fs::create_directories(folder_ / "empty");
  EXPECT_NE(refusal(folder_ / "empty").find("holds no images"), std::string::npos);
  file("x.avi", "no video");
  EXPECT_NE(refusal(folder_ / "x.avi").find("is no video"), std::string::npos);
  EXPECT_NE(refusal(folder_ / "nothing").find("neither a folder nor a file"), std::string::npos);
  images("good", {{"1.png", cv::Mat::zeros(4, 4, CV_8U)}});
  const auto no_rate =
      import_images({{"cam", folder_ / "good"}}, std::nullopt, folder_ / "r.mcap", progress_);
  ASSERT_FALSE(no_rate);
  EXPECT_EQ(no_rate.error().code, ErrorCode::kUsage);
}

TEST_F(ImportImages, AVideoWithItsRate) {
  const std::string path = (folder_ / "v.avi").string();
  std::vector<int> greys;
  {
    cv::VideoWriter video(path, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 25, cv::Size(64, 48), true);
    if (!video.isOpened()) GTEST_SKIP() << "OpenCV writes no videos here";
    for (int i = 0; i < 20; ++i) {
      greys.push_back(20 + 10 * i);
      video.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(greys.back())));
    }
  }
  const auto own = import_images({{"cam", path}}, std::nullopt, folder_ / "own.mcap", progress_);
  ASSERT_TRUE(own) << own.error().line();
  const auto samples = samples_of(folder_ / "own.mcap");
  ASSERT_EQ(samples.size(), 20u);
  for (std::size_t i = 0; i < 20; ++i) {
    const auto& frame = std::get<FrameSample>(samples[i]);
    EXPECT_EQ(frame.header.capture.ns, static_cast<std::int64_t>(i) * 40'000'000);
    EXPECT_NEAR(frame.image.at(30, 20), greys[i], 3);  // JPEG
  }
  const auto other = import_images({{"cam", path}}, 50, folder_ / "other.mcap", progress_);
  ASSERT_TRUE(other);
  ASSERT_EQ(other->notes.size(), 1u);
  EXPECT_NE(other->notes[0].find("the video says 25 Hz; 50 Hz was asked for"), std::string::npos);
  EXPECT_EQ(header_of(samples_of(folder_ / "other.mcap")[1]).capture.ns, 20'000'000);

  // Two frames in the middle are destroyed: the file still announces 20.
  std::string bytes = *read_file(path);
  std::size_t at = 0;
  for (int i = 0; i < 12; ++i) {
    at = bytes.find("00dc", at + 1);
    ASSERT_NE(at, std::string::npos);
    if (i >= 10) std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at) + 8, 200, '\0');
  }
  const auto hurt =
      import_images({{"cam", file("hurt.avi", bytes)}}, std::nullopt, folder_ / "hurt.mcap", progress_);
  ASSERT_TRUE(hurt) << hurt.error().line();
  std::size_t frames = 0, missing = 0;
  for (const Sample& s : samples_of(folder_ / "hurt.mcap")) {
    if (const auto* line = std::get_if<LedgerSample>(&s); line && line->fate == LedgerSample::Fate::kMissing)
      missing += line->count;
    frames += std::holds_alternative<FrameSample>(s);
  }
  EXPECT_LT(frames, 20u);
  EXPECT_EQ(frames + missing, 20u);
  const auto source = RecordingSource::open(folder_ / "hurt.mcap");
  ASSERT_TRUE(source);
  const auto origin = (*source)->attachment("import.json");
  ASSERT_TRUE(origin);
  EXPECT_NE(origin->find("the video announces 20 frames, "), std::string::npos) << *origin;
}

class Exchange : public ExchangeTest {
 protected:
  /// A session of two cameras, two trackers and a pedal, with what went wrong.
  std::vector<Sample> session() {
    std::vector<Sample> samples;
    const std::int64_t start_ns = 1'700'000'000'123'456'789;
    for (std::uint32_t i = 0; i < 60; ++i) {
      const std::int64_t ns = start_ns + i * 16'666'667LL;
      const auto header = [&](const std::string& stream, std::int64_t late_ns) {
        return SampleHeader{stream, i, {ns}, {ns + late_ns}, {1000 + i * 16'666'000LL}};
      };
      if (i == 20)
        samples.push_back(
            LedgerSample{header("camera_0", 5), LedgerSample::Fate::kRejected, 1, "short, \"read\""});
      else
        samples.push_back(FrameSample{header("camera_0", 9'000'000), random_image(32, 24)});
      PoseSample bow{header("em/bow", 9'100'000), "transmitter", "bow", i % 9 != 4, "", random_pose()};
      if (!bow.valid) bow.reason = "out of range";
      samples.push_back(bow);
      PoseSample head{header("em/head", 9'200'000), "transmitter", "head_frame", true, "", random_pose()};
      head.header.capture.ns += i % 3 ? 0 : 5'000'000;  // sometimes an instant of its own
      samples.push_back(head);
      if (i == 30)
        samples.push_back(EventSample{header("pedal", 9'300'000), "TP", true, "first, \"good\"\nrest"});
    }
    return samples;
  }
  fs::path recorded(const std::vector<Sample>& samples) {
    auto writer = RecordingWriter::create(folder_ / "session.mcap");
    EXPECT_TRUE(writer);
    for (const Sample& s : samples) EXPECT_TRUE(writer->write(s));
    EXPECT_TRUE(writer->finish());
    return folder_ / "session.mcap";
  }
  fs::path out() {
    fs::create_directories(folder_ / "out");
    return folder_ / "out";
  }
};

TEST_F(Exchange, TablesHoldEveryNumber) {
  const auto samples = session();
  const auto done = export_recording(recorded(samples), {true, false, "", "", false}, out(), progress_);
  ASSERT_TRUE(done) << done.error().line();
  EXPECT_EQ(done->samples, samples.size());
  const auto bow = table(out() / "em.bow.csv");
  const std::vector<std::string> columns = {
      "sequence", "capture_s", "capture_ns", "arrival_ns", "device_ns", "valid", "reason", "reference",
      "body",     "x_mm",      "y_mm",       "z_mm",       "qw",        "qx",    "qy",     "qz"};
  ASSERT_EQ(bow.size(), 61u);
  EXPECT_EQ(bow[0], columns);
  std::size_t row = 0;
  for (const Sample& s : samples) {
    const auto* pose = std::get_if<PoseSample>(&s);
    if (!pose || pose->body != "bow") continue;
    const auto& cells = bow[++row];
    ASSERT_EQ(cells.size(), columns.size());
    EXPECT_EQ(cells[2], std::to_string(pose->header.capture.ns));
    EXPECT_EQ(cells[5], pose->valid ? "1" : "0");
    EXPECT_EQ(cells[6], pose->reason);
    for (int k = 0; k < 3; ++k)
      EXPECT_EQ(std::stod(cells[static_cast<std::size_t>(9 + k)]),
                pose->reference_from_body.translation_mm(k));
    const Eigen::Quaterniond q(std::stod(cells[12]), std::stod(cells[13]), std::stod(cells[14]),
                               std::stod(cells[15]));
    EXPECT_GE(q.w(), 0);
    EXPECT_LT((q.toRotationMatrix() - pose->reference_from_body.rotation).norm(), 1e-14);
  }
  EXPECT_EQ(*read_file(out() / "ledger.csv"),
            "stream,fate,count,reason,sequence,capture_s,capture_ns,arrival_ns,device_ns\n"
            "camera_0,rejected,1,\"short, "
            "\"\"read\"\"\",20,0.333333340,1700000000456790129,1700000000456790134,333321000\n");
  EXPECT_NE(read_file(out() / "pedal.csv")->find(",TP,1,\"first, \"\"good\"\"\nrest\"\n"), std::string::npos);
  EXPECT_EQ(table(out() / "camera_0.csv").size(), 60u);  // times of 59 frames
}

TEST_F(Exchange, NamesOfStreamsNeverLeadOutOfTheFolder) {
  std::vector<Sample> samples;
  for (const char* stream : {"..", "/..", "../../x", "ledger", "a/b", "a.b", "a%2Eb"})
    samples.push_back(FrameSample{{stream, 0, {5}, {6}, {7}}, random_image(4, 4)});
  std::set<std::string> before, after;
  const fs::path recording = recorded(samples);
  for (const auto& entry : fs::directory_iterator(folder_)) before.insert(entry.path().filename());
  out();
  const auto done = export_recording(recording, {true, true, "", "", false}, out(), progress_);
  ASSERT_TRUE(done) << done.error().line();
  for (const auto& entry : fs::directory_iterator(folder_)) after.insert(entry.path().filename());
  before.insert("out");
  EXPECT_EQ(after, before);
  std::size_t pictures = 0;
  for (const auto& entry : fs::recursive_directory_iterator(out()))
    pictures += entry.path().extension() == ".png";
  EXPECT_EQ(pictures, samples.size());  // none over another
}

TEST_F(Exchange, ImageFoldersComeBackAsTheyWere) {
  const auto samples = session();
  const auto done = export_recording(recorded(samples), {false, true, "", "", false}, out(), progress_);
  ASSERT_TRUE(done) << done.error().line();
  const auto times = table(out() / "camera_0" / "timestamps.csv");
  ASSERT_EQ(times.size(), 60u);
  ASSERT_TRUE(import_images({{"camera_0", out() / "camera_0"}}, 60, folder_ / "back.mcap", progress_));
  const auto back = samples_of(folder_ / "back.mcap");
  std::size_t i = 0;
  for (const Sample& s : samples) {
    const auto* frame = std::get_if<FrameSample>(&s);
    if (!frame) continue;
    EXPECT_EQ(std::get<FrameSample>(back.at(i)).image.pixels, frame->image.pixels);
    EXPECT_EQ(times[i + 1][1], std::to_string(frame->header.sequence));
    EXPECT_EQ(times[i + 1][2], std::to_string(frame->header.capture.ns));
    ++i;
  }
  EXPECT_EQ(i, back.size());
}

TEST_F(Exchange, SequencesThereAndBack) {
  const auto samples = session();
  const fs::path recording = recorded(samples);
  for (const char* name : {"s.igs.mha", "s.igs.nrrd"})
    for (const bool images : {false, true}) {
      ExportOptions options;
      options.plus = name;
      options.plus_images = images ? "camera_0" : "";
      options.plus_compressed = images;
      const auto done = export_recording(recording, options, out(), progress_);
      ASSERT_TRUE(done) << done.error().line();
      fs::remove(folder_ / "back.mcap");
      const auto back =
          import_plus_sequence(out() / name, "camera_0", std::nullopt, folder_ / "back.mcap", progress_);
      ASSERT_TRUE(back) << back.error().line();
      EXPECT_EQ(back->poses, 120u);
      EXPECT_EQ(back->frames, images ? 59u : 0u);
      EXPECT_EQ(back->rejected, 0u);
      std::map<std::pair<std::string, std::int64_t>, Sample> by_time;
      for (const Sample& s : samples_of(folder_ / "back.mcap"))
        if (!std::holds_alternative<LedgerSample>(s))
          by_time[{header_of(s).stream, header_of(s).capture.ns}] = s;
      for (const Sample& s : samples) {
        const SampleHeader& h = header_of(s);
        if (const auto* pose = std::get_if<PoseSample>(&s)) {
          const std::string stream = pose->body == "bow" ? "BowToTransmitter" : "HeadFrameToTransmitter";
          ASSERT_TRUE(by_time.count({stream, h.capture.ns}));
          const auto& got = std::get<PoseSample>(by_time[{stream, h.capture.ns}]);
          EXPECT_EQ(got.valid, pose->valid);
          EXPECT_EQ(got.reason, pose->reason);
          EXPECT_EQ(got.reference_from_body.matrix(), pose->reference_from_body.matrix());  // bit for bit
          EXPECT_EQ(got.header.sequence, h.sequence);
        } else if (const auto* frame = std::get_if<FrameSample>(&s); frame && images) {
          ASSERT_TRUE(by_time.count({"camera_0", h.capture.ns}));
          const auto& got = std::get<FrameSample>(by_time[{"camera_0", h.capture.ns}]);
          EXPECT_EQ(got.image.pixels, frame->image.pixels);
          EXPECT_EQ(got.header.arrival, h.arrival);
        }
      }
    }
  ExportOptions none;
  none.plus = "t.igs.mha";
  none.plus_images = "camera_9";
  const auto refused = export_recording(recording, none, out(), progress_);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().why.find("camera_9"), std::string::npos);
}

TEST_F(Exchange, PosesOverTime) {
  PoseRecording poses;
  for (std::uint32_t i = 0; i < 30; ++i)
    for (const char* body : {"bow", "head_frame"}) {
      PoseRecord r;
      r.sequence = i;
      r.capture.ns = i * 16'666'667LL;
      r.valid = i != 7;
      r.reason = r.valid ? "" : "no tag seen";
      r.camera_from_body = r.valid ? random_pose() : Rigid3();
      poses.bodies[body].push_back(r);
    }
  ASSERT_TRUE(write_poses(folder_ / "motion.mcap", poses, {}));
  ExportOptions options;
  options.csv = true;
  options.plus = "motion.igs.nrrd";
  const auto done = export_recording(folder_ / "motion.mcap", options, out(), progress_);
  ASSERT_TRUE(done) << done.error().line();
  EXPECT_EQ(table(out() / "bow.csv").size(), 31u);
  const auto reader = PlusReader::open(out() / "motion.igs.nrrd");
  ASSERT_TRUE(reader) << reader.error().line();
  ASSERT_EQ(reader->sequence().frames.size(), 30u);
  for (std::size_t i = 0; i < 30; ++i) {
    const PlusFrame& f = reader->sequence().frames[i];
    EXPECT_EQ(f.timestamp_ns, static_cast<std::int64_t>(i) * 16'666'667);
    const PlusTransform& bow = f.transforms.at("BowToCamera");
    EXPECT_EQ(bow.valid, i != 7);
    const Matrix4 truth = poses.bodies["bow"][i].camera_from_body.matrix();
    EXPECT_LT((bow.matrix - truth).cwiseAbs().maxCoeff(), 1e-12);  // through the quaternion of the file
  }
}

TEST_F(Exchange, PlusFilesBecomeRecordings) {
  if (plus_data().empty()) GTEST_SKIP() << "PLUS's sequences are not here (GNATHION_SHARED)";
  const auto done =
      import_plus_sequence(plus_data() / "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha", "image",
                           std::nullopt, folder_ / "e.mcap", progress_);
  ASSERT_TRUE(done) << done.error().line();
  EXPECT_EQ(done->poses, 2000u);
  EXPECT_EQ(done->rejected, 0u);  // its rotations deviate by up to 5e-4
  const auto samples = samples_of(folder_ / "e.mcap");
  const auto& first = std::get<PoseSample>(samples.at(1));
  EXPECT_EQ(first.header.stream, "StylusToTracker");
  EXPECT_EQ(first.body, "Stylus");
  EXPECT_EQ(first.reference, "Tracker");
  EXPECT_EQ(first.header.capture.ns, 280'461'142'857);
  EXPECT_NEAR(first.reference_from_body.translation_mm.x(), 315.55283203125, 1e-12);
  EXPECT_NEAR(first.reference_from_body.rotation(2, 1), -0.8617411412031651, 5e-4);
  EXPECT_LT(rigidity_deviation(first.reference_from_body.matrix()).orthogonality, 1e-14);

  const auto refused =
      import_plus_sequence(plus_data() / "NrrdSample.igs.nrrd", "image", 10, folder_ / "n.mcap", progress_);
  ASSERT_FALSE(refused);  // 16-bit pixels and no poses
  EXPECT_NE(refused.error().why.find("not unsigned 8-bit"), std::string::npos);
  EXPECT_FALSE(fs::exists(folder_ / "n.mcap"));
}

TEST_F(Exchange, TimesBeyondNanosecondsAreRefused) {
  for (const char* timestamp : {"9.0e9", "-9.0e9", "5"}) {
    const std::string start = timestamp[0] == '-' ? "-9.0e9" : "9.0e9";
    file("s.igs.mha", "NDims = 3\nDimSize = 0 0 1\nRecordingStartTimestamp = " + start +
                          "\nSeq_Frame0000_AToBTransform = 1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1\n"
                          "Seq_Frame0000_Timestamp = " +
                          timestamp + "\nElementDataFile = LOCAL\n");
    const auto done =
        import_plus_sequence(folder_ / "s.igs.mha", "image", std::nullopt, folder_ / "s.mcap", progress_);
    if (timestamp[0] == '5') {
      ASSERT_TRUE(done) << done.error().line();
      EXPECT_EQ(header_of(samples_of(folder_ / "s.mcap").at(0)).capture.ns, 9'000'000'005'000'000'000);
      continue;
    }
    ASSERT_FALSE(done) << timestamp;
    EXPECT_NE(done.error().line().find("frame 0: is before time 0, or after"), std::string::npos)
        << done.error().line();
  }
}

TEST_F(Exchange, WhatIsNoRigidMotionStandsInTheLedger) {
  file("s.igs.mha",
       "NDims = 3\nDimSize = 0 0 3\nSeq_Frame0000_AToBTransform = 2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1\n"
       "Seq_Frame0000_Timestamp = 1\nSeq_Frame0001_AToBTransform = 1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1\n"
       "Seq_Frame0001_Timestamp = 1.5\nSeq_Frame0002_AToBTransform = 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0\n"
       "Seq_Frame0002_AToBTransformStatus = OUT_OF_VIEW\nSeq_Frame0002_Timestamp = 2\nElementDataFile = "
       "LOCAL\n");
  const auto done =
      import_plus_sequence(folder_ / "s.igs.mha", "image", std::nullopt, folder_ / "s.mcap", progress_);
  ASSERT_TRUE(done) << done.error().line();
  const auto samples = samples_of(folder_ / "s.mcap");
  ASSERT_EQ(samples.size(), 3u);
  EXPECT_EQ(std::get<LedgerSample>(samples[0]).reason, "not a rotation");
  EXPECT_EQ(std::get<PoseSample>(samples[1]).reference_from_body.translation_mm.x(), 5);
  EXPECT_FALSE(std::get<PoseSample>(samples[2]).valid);
  EXPECT_EQ(std::get<PoseSample>(samples[2]).reason, "OUT_OF_VIEW");
}

}  // namespace
}  // namespace gnathion
