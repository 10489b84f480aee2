#include "acquisition/exchange/picture_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "acquisition/camera/natural_order.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot import images";

/// OpenCV's grey is BT.601 in fixed point, the same on every machine.
Result<Image8> grey_from(const cv::Mat& picture, const std::string& name) {
  if (picture.depth() != CV_8U)
    return bad_input(kWhat, name,
                     "has more than 8 bits a channel; convert it, so that the scale is your choice");
  cv::Mat grey;
  switch (picture.channels()) {
    case 1:
      grey = picture;
      break;
    case 3:
      cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
      break;
    case 4:
      cv::cvtColor(picture, grey, cv::COLOR_BGRA2GRAY);
      break;
    default:
      return bad_input(kWhat, name, fmt::format("has {} channels", picture.channels()));
  }
  Image8 out;
  out.width_px = grey.cols;
  out.height_px = grey.rows;
  out.pixels.reserve(grey.total());
  for (int y = 0; y < grey.rows; ++y)
    out.pixels.insert(out.pixels.end(), grey.ptr(y), grey.ptr(y) + grey.cols);
  return out;
}

/// All pictures of one size.
class OneSize {
 public:
  Status check(const Image8& image, const std::string& name) {
    if (width_px_ == 0) {
      width_px_ = image.width_px;
      height_px_ = image.height_px;
      first_ = name;
    }
    if (image.width_px == width_px_ && image.height_px == height_px_) return {};
    return bad_input(kWhat, name,
                     fmt::format("has {}×{} pixels, {} has {}×{}", image.width_px, image.height_px, first_,
                                 width_px_, height_px_));
  }

 private:
  int width_px_ = 0, height_px_ = 0;
  std::string first_;
};

bool is_picture(const fs::path& path) {
  std::string e = path.extension().string();
  for (char& c : e) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  constexpr std::array<const char*, 10> kKnown = {".png",  ".jpg", ".jpeg", ".bmp", ".tif",
                                                  ".tiff", ".pgm", ".ppm",  ".pnm", ".webp"};
  return std::find(kKnown.begin(), kKnown.end(), e) != kKnown.end();
}

/// The place of each file in its series, from 0: by its number, where the names carry one, else one after the
/// other. A step that all share (every second picture kept) counts as one.
std::vector<std::uint32_t> places_of(const std::vector<fs::path>& files) {
  std::vector<std::string> names;
  for (const fs::path& file : files) names.push_back(file.filename().string());
  const auto numbers = frame_numbers(names);
  std::vector<std::uint32_t> places(files.size());
  std::uint64_t step = 0;
  for (std::size_t i = 0; i < places.size(); ++i)
    if (numbers) step = std::gcd(step, (*numbers)[i] - numbers->front());
  for (std::size_t i = 0; i < places.size(); ++i)
    places[i] =
        static_cast<std::uint32_t>(numbers && step > 0 ? ((*numbers)[i] - numbers->front()) / step : i);
  return places;
}

class FolderReader : public PictureReader {
 public:
  FolderReader(std::vector<fs::path> files, std::size_t others)
      : files_(std::move(files)), places_(places_of(files_)), others_(others) {}
  Result<std::optional<Picture>> next() override {
    if (next_ == files_.size()) return std::optional<Picture>();
    const std::uint32_t place = places_[next_];
    const fs::path& file = files_[next_++];
    cv::Mat picture;
    try {
      picture = cv::imread(file.string(), cv::IMREAD_UNCHANGED);
    } catch (const cv::Exception& e) {
      return bad_input(kWhat, file.string(), e.what());
    }
    if (picture.empty()) return bad_input(kWhat, file.string(), "is no image that can be read");
    GNATHION_TRY(Image8 image, grey_from(picture, file.string()));
    GNATHION_CHECK_OK(size_.check(image, file.string()));
    return std::optional<Picture>(Picture{place, std::move(image)});
  }
  std::size_t expected() const override { return std::size_t{places_.back()} + 1; }
  std::optional<double> own_rate_hz() const override { return std::nullopt; }
  std::vector<std::string> notes() const override {
    std::vector<std::string> out;
    if (others_ > 0) out.push_back(fmt::format("{} files that are no images were passed over", others_));
    if (expected() > files_.size())
      out.push_back(fmt::format("the files' numbers leave out {}: missing in the ledger, their time is kept",
                                expected() - files_.size()));
    return out;
  }

 private:
  std::vector<fs::path> files_;
  std::vector<std::uint32_t> places_;
  std::size_t others_, next_ = 0;
  OneSize size_;
};

class VideoReader : public PictureReader {
 public:
  VideoReader(cv::VideoCapture video, std::string path) : video_(std::move(video)), path_(std::move(path)) {
    const double n = video_.get(cv::CAP_PROP_FRAME_COUNT);
    announced_ = n > 0 && n < 1e9 ? static_cast<std::size_t>(std::llround(n)) : 0;
  }
  Result<std::optional<Picture>> next() override {
    cv::Mat picture;
    try {
      if (!video_.read(picture) || picture.empty()) return std::optional<Picture>();
    } catch (const cv::Exception& e) {
      return bad_input(kWhat, path_, e.what());
    }
    const std::uint32_t number = read_++;
    const std::string name = fmt::format("{}: frame {}", path_, number);
    GNATHION_TRY(Image8 image, grey_from(picture, name));
    GNATHION_CHECK_OK(size_.check(image, name));
    return std::optional<Picture>(Picture{number, std::move(image)});
  }
  std::size_t expected() const override { return announced_; }
  std::optional<double> own_rate_hz() const override {
    const double rate = video_.get(cv::CAP_PROP_FPS);
    if (rate > 0 && rate < 1e5) return rate;
    return std::nullopt;
  }
  std::vector<std::string> notes() const override {
    if (announced_ == read_ || announced_ == 0) return {};
    return {fmt::format("the video announces {} frames, {} could be decoded", announced_, read_)};
  }

 private:
  mutable cv::VideoCapture video_;
  std::string path_;
  std::size_t announced_ = 0;
  std::uint32_t read_ = 0;
  OneSize size_;
};

}  // namespace

Result<std::unique_ptr<PictureReader>> PictureReader::open(const fs::path& path) {
  std::error_code ec;
  if (fs::is_directory(path, ec)) {
    std::vector<fs::path> files;
    std::size_t others = 0;
    for (const auto& entry : fs::directory_iterator(path, ec)) {
      if (!entry.is_regular_file() || entry.path().filename().string().front() == '.') continue;
      if (is_picture(entry.path()))
        files.push_back(entry.path());
      else
        ++others;
    }
    if (ec) return bad_input(kWhat, path.string(), ec.message());
    if (files.empty()) return bad_input(kWhat, path.string(), "holds no images");
    std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
      return natural_less(a.filename().string(), b.filename().string());
    });
    return std::unique_ptr<PictureReader>(std::make_unique<FolderReader>(std::move(files), others));
  }
  if (!fs::is_regular_file(path, ec))
    return bad_input(kWhat, path.string(), "is neither a folder nor a file");
  cv::VideoCapture video;
  try {
    video.open(path.string(), cv::CAP_FFMPEG);  // others try every way, noisily, and disagree about time
  } catch (const cv::Exception& e) {
    return bad_input(kWhat, path.string(), e.what());
  }
  if (!video.isOpened()) return bad_input(kWhat, path.string(), "is no video that can be read");
  return std::unique_ptr<PictureReader>(std::make_unique<VideoReader>(std::move(video), path.string()));
}

}  // namespace gnathion
