#include "acquisition/camera/mono.h"

#include <fmt/format.h>

#include <cstring>
#include <opencv2/imgproc.hpp>

namespace gnathion {

std::string to_mono8(const cv::Mat& image, Image8* out) {
  if (image.empty() || image.dims != 2) return "no image";
  cv::Mat eight = image;
  if (image.depth() == CV_16U)
    image.convertTo(eight, CV_8U, 1.0 / 256, -0.5);  // convertTo rounds: this keeps the upper byte
  else if (image.depth() != CV_8U)
    return fmt::format("pixels of OpenCV depth {}", image.depth());
  out->width_px = image.cols;
  out->height_px = image.rows;
  out->pixels.resize(image.total());
  cv::Mat grey(image.rows, image.cols, CV_8UC1, out->pixels.data());
  switch (eight.channels()) {
    case 1:
      eight.copyTo(grey);
      return "";
    case 2:
      cv::cvtColor(eight, grey, cv::COLOR_YUV2GRAY_YUY2);
      return "";
    case 3:
      cv::cvtColor(eight, grey, cv::COLOR_BGR2GRAY);
      return "";
    case 4:
      cv::cvtColor(eight, grey, cv::COLOR_BGRA2GRAY);
      return "";
    default:
      return fmt::format("{} channels", eight.channels());
  }
}

}  // namespace gnathion
