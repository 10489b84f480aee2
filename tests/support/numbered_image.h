// Images that carry a number which survives compression: 16 grey fields, one a bit.
#pragma once

#include <opencv2/core.hpp>

#include "core/image.h"

namespace gnathion::test {

inline cv::Mat numbered_image(unsigned number) {
  cv::Mat image(240, 320, CV_8UC1, cv::Scalar(60));
  for (int bit = 0; bit < 16; ++bit)
    image(cv::Rect(20 * bit, 80, 20, 80)).setTo((number >> bit) & 1u ? 220 : 20);
  return image;
}

inline unsigned number_in(const Image8& image) {
  unsigned number = 0;
  for (int bit = 0; bit < 16; ++bit)
    if (image.at(20 * bit + 10, 120) > 120) number |= 1u << bit;
  return number;
}

}  // namespace gnathion::test
