#include "daemon/preview.h"

namespace gnathion::daemon {

Image8 shrunk(const Image8& image, int max_width_px) {
  const int n = (image.width_px + max_width_px - 1) / max_width_px;
  if (n <= 1) return image;
  Image8 small(image.width_px / n, image.height_px / n);
  for (int y = 0; y < small.height_px; ++y)
    for (int x = 0; x < small.width_px; ++x) {
      unsigned sum = 0;
      for (int dy = 0; dy < n; ++dy)
        for (int dx = 0; dx < n; ++dx) sum += image.at(n * x + dx, n * y + dy);
      const auto count = static_cast<unsigned>(n * n);
      small.at(x, y) = static_cast<std::uint8_t>((sum + count / 2) / count);
    }
  return small;
}

}  // namespace gnathion::daemon
