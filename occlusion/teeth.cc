#include "occlusion/teeth.h"

#include <array>

namespace gnathion {

std::vector<std::uint8_t> fdi_order(Arch arch) {
  std::vector<std::uint8_t> out;
  const int right = arch == Arch::kMaxilla ? 10 : 40, left = arch == Arch::kMaxilla ? 20 : 30;
  for (int k = 8; k >= 1; --k) out.push_back(static_cast<std::uint8_t>(right + k));
  for (int k = 1; k <= 8; ++k) out.push_back(static_cast<std::uint8_t>(left + k));
  return out;
}

int fdi_side(std::uint8_t fdi) {
  const int quadrant = fdi / 10;
  return quadrant == 2 || quadrant == 3 ? 1 : (quadrant == 1 || quadrant == 4 ? -1 : 0);
}

int fdi_position(std::uint8_t fdi) {
  return fdi_side(fdi) == 0 ? 0 : fdi % 10;
}

// Ash & Nelson, Wheeler's Dental Anatomy, 8th ed., 2003, table 1-1: mesiodistal crown diameter and
// crown length, central incisor to third molar.
double mean_crown_width_mm(std::uint8_t fdi) {
  static constexpr std::array<double, 9> kUpper{0, 8.5, 6.5, 7.5, 7.0, 7.0, 10.0, 9.0, 8.5};
  static constexpr std::array<double, 9> kLower{0, 5.0, 5.5, 7.0, 7.0, 7.0, 11.0, 10.5, 10.0};
  const auto k = static_cast<std::size_t>(fdi_position(fdi));
  return fdi < 30 ? kUpper[k] : kLower[k];
}

double mean_crown_height_mm(std::uint8_t fdi) {
  static constexpr std::array<double, 9> kUpper{0, 10.5, 9.0, 10.0, 8.5, 8.5, 7.5, 7.0, 6.5};
  static constexpr std::array<double, 9> kLower{0, 9.0, 9.5, 11.0, 8.5, 8.0, 7.5, 7.0, 7.0};
  const auto k = static_cast<std::size_t>(fdi_position(fdi));
  return fdi < 30 ? kUpper[k] : kLower[k];
}

}  // namespace gnathion
