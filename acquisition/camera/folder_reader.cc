#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>

#include "acquisition/camera/frame_reader.h"
#include "acquisition/camera/mono.h"
#include "acquisition/camera/natural_order.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

bool is_image(const fs::path& path) {
  std::string e = path.extension().string();
  std::transform(e.begin(), e.end(), e.begin(), [](unsigned char c) { return std::tolower(c); });
  static const char* const known[] = {".png",  ".jpg", ".jpeg", ".bmp", ".tif",
                                      ".tiff", ".pgm", ".ppm",  ".webp"};
  return std::any_of(std::begin(known), std::end(known), [&](const char* k) { return e == k; });
}

class FolderReader : public FrameReader {
 public:
  explicit FolderReader(CaptureSettings settings) : s_(std::move(settings)) {}

  Status open(const std::string& where) {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    std::error_code error;
    for (fs::directory_iterator it(s_.source, error), end; !error && it != end; it.increment(error))
      if (is_image(it->path()) && it->path().filename().string().front() != '.')
        names_.push_back(it->path().filename().string());
    if (error) return bad_input("cannot open camera", where, s_.shown + ": " + error.message());
    if (names_.empty()) return bad_input("cannot open camera", where, s_.shown + " holds no image");
    std::sort(names_.begin(), names_.end(), natural_less);
    const auto numbers = frame_numbers(names_);
    if (numbers) numbers_ = *numbers;
    setting_lines.push_back(
        fmt::format("images: {} in natural order, {} to {}", names_.size(), names_.front(), names_.back()));
    setting_lines.push_back(
        numbers ? "counter: the number in the file's name"
                : "counter: position; the names carry no running number, gaps cannot be seen");
    return {};
  }

  double rate_hz() const override { return *s_.rate_hz; }

  Outcome read(Clock&, HostTime*, ReadFrame* frame) override {
    if (next_ >= names_.size()) return Outcome::kEnd;
    const std::string& name = names_[next_];
    const std::uint64_t number = numbers_.empty() ? next_ : numbers_[next_] - numbers_.front();
    if (next_ > 0) frame->skipped = static_cast<std::uint32_t>(number - last_number_ - 1);
    last_number_ = number;
    ++next_;
    frame->device = DeviceTime{std::llround(static_cast<double>(number) / *s_.rate_hz * 1e9)};
    frame->bad = decode(fs::path(s_.source) / name, &frame->image);
    if (!frame->bad.empty()) frame->bad = name + " " + frame->bad;
    return Outcome::kFrame;
  }

 private:
  static std::string decode(const fs::path& path, Image8* out) {
    try {
      const cv::Mat image = cv::imread(path.string(), cv::IMREAD_UNCHANGED);
      if (image.empty()) return "cannot be decoded";
      return to_mono8(image, out);
    } catch (const cv::Exception& e) {
      return "cannot be decoded: " + e.err;
    }
  }

  CaptureSettings s_;
  std::vector<std::string> names_;
  std::vector<std::uint64_t> numbers_;
  std::size_t next_ = 0;
  std::uint64_t last_number_ = 0;
};

}  // namespace

Result<std::unique_ptr<FrameReader>> open_folder(const CaptureSettings& settings, const std::string& where) {
  auto reader = std::make_unique<FolderReader>(settings);
  GNATHION_CHECK_OK(reader->open(where));
  return reader;
}

}  // namespace gnathion
