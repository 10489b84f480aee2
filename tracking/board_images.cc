#include "tracking/board_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cctype>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <thread>

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kCannotReadImages = "cannot read images";

bool is_image(const fs::path& path) {
  std::string e = path.extension().string();
  for (char& c : e) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  constexpr std::array<const char*, 10> kKnown = {".png",  ".jpg", ".jpeg", ".bmp", ".tif",
                                                  ".tiff", ".pgm", ".ppm",  ".pnm", ".webp"};
  return std::find(kKnown.begin(), kKnown.end(), e) != kKnown.end();
}

}  // namespace

Result<std::vector<fs::path>> list_images(const fs::path& folder) {
  std::error_code ec;
  std::vector<fs::path> files;
  fs::directory_iterator it(folder, ec);
  if (ec) return bad_input(kCannotReadImages, folder.string(), "is no folder that can be read");
  for (const fs::directory_entry& entry : it)
    if (entry.is_regular_file(ec) && is_image(entry.path())) files.push_back(entry.path());
  if (files.empty())
    return bad_input(kCannotReadImages, folder.string(), "holds no images (png, jpg, bmp, tif, pgm, webp)");
  std::sort(files.begin(), files.end());
  return files;
}

Result<Image8> read_grey_image(const fs::path& path) {
  cv::Mat grey;
  try {
    grey = cv::imread(path.string(), cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& e) {
    return bad_input(kCannotReadImages, path.string(), e.what());
  }
  if (grey.empty()) return bad_input(kCannotReadImages, path.string(), "is no image that can be read");
  Image8 out;
  out.width_px = grey.cols;
  out.height_px = grey.rows;
  out.pixels.reserve(grey.total());
  for (int y = 0; y < grey.rows; ++y)
    out.pixels.insert(out.pixels.end(), grey.ptr(y), grey.ptr(y) + grey.cols);
  return out;
}

Result<BoardDetections> detect_boards(const CalibrationBoard& board, std::size_t count,
                                      const ImageLoader& load,
                                      const std::function<std::string(std::size_t)>& name,
                                      const CameraModel& camera, Progress& progress) {
  struct Size {
    int width = 0, height = 0;
  };
  std::vector<Size> sizes(count);
  std::vector<std::optional<Error>> errors(count);
  BoardDetections out;
  out.images.resize(count);
  std::vector<std::unique_ptr<BoardDetector>> detectors;
  const unsigned threads = std::clamp(std::thread::hardware_concurrency(), 1u, 4u);
  for (unsigned t = 0; t < threads; ++t) {
    GNATHION_TRY(auto detector, BoardDetector::create(board));
    detectors.push_back(std::move(detector));
  }
  std::atomic<std::size_t> next{0}, done{0};
  const auto work = [&](unsigned t) {
    for (std::size_t i = next++; i < count; i = next++) {
      auto image = load(i);
      if (image) {
        sizes[i] = {image->width_px, image->height_px};
        out.images[i] = detectors[t]->detect(*image, camera);
        out.images[i].view.name = name(i);
      } else {
        errors[i] = image.error();
      }
      ++done;
      if (t == 0) progress.update(static_cast<double>(done) / static_cast<double>(count));
    }
  };
  std::vector<std::thread> others;
  for (unsigned t = 1; t < threads; ++t) others.emplace_back(work, t);
  work(0);
  for (std::thread& t : others) t.join();
  for (std::size_t i = 0; i < count; ++i) {
    if (errors[i]) return tl::unexpected<Error>(*errors[i]);
    if (sizes[i].width != sizes[0].width || sizes[i].height != sizes[0].height)
      return bad_input(
          "cannot calibrate camera", name(i),
          fmt::format("has {}x{} pixels, {} has {}x{}: images of one camera have one size", sizes[i].width,
                      sizes[i].height, name(0), sizes[0].width, sizes[0].height));
  }
  if (count > 0) out.width_px = sizes[0].width, out.height_px = sizes[0].height;
  return out;
}

}  // namespace gnathion
