// Any image of OpenCV to 8-bit grey. Only for the .cc files of this folder.
#pragma once

#include <string>

#include "core/image.h"

namespace cv {
class Mat;
}

namespace gnathion {

/// Colour is weighted as in ITU-R BT.601; of 16 bits the upper 8 are kept. Returns why not, or nothing.
std::string to_mono8(const cv::Mat& image, Image8* out);

}  // namespace gnathion
