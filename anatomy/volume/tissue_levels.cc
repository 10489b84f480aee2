// Otsu's criterion with three classes (Otsu 1979; Liao, Chen & Chung 2001): the two levels that part air,
// soft tissue and bone with the largest variance between the classes.
#include <algorithm>
#include <numeric>

#include "anatomy/volume/iso_surface.h"

namespace gnathion {
namespace {

constexpr int kBins = 256;

/// What a scanner writes where it has not measured (corners of a round field): one value, often, far below all
/// others. Returns how many of the sorted values are such.
std::size_t padding_in(const std::vector<float>& sorted) {
  constexpr float kFar = 100.0F;
  const auto next = std::upper_bound(sorted.begin(), sorted.end(), sorted.front());
  const auto same = static_cast<std::size_t>(next - sorted.begin());
  return next != sorted.end() && same > sorted.size() / 200 && *next - sorted.front() > kFar ? same : 0;
}

/// Counts between the 0.1 and the 99.9 percentile, padding left out: metal does not stretch it.
struct Histogram {
  double low = 0.0, width = 1.0;
  std::vector<double> counts = std::vector<double>(kBins, 0.0);
  double centre(int bin) const { return low + (bin + 0.5) * width; }
};

Histogram histogram_of(const Volume& volume) {
  const std::size_t count = volume.grid.count(), step = count / 4000000 + 1;
  std::vector<float> values;
  values.reserve(count / step + 1);
  for (std::size_t i = 0; i < count; i += step) values.push_back(static_cast<float>(volume.value(i)));
  std::sort(values.begin(), values.end());
  values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(padding_in(values)));
  Histogram h;
  const std::size_t cut = values.size() / 1000;
  h.low = static_cast<double>(values[cut]);
  h.width = std::max(1e-6, (static_cast<double>(values[values.size() - 1 - cut]) - h.low) / kBins);
  for (const float v : values)
    h.counts[static_cast<std::size_t>(
        std::clamp((static_cast<double>(v) - h.low) / h.width, 0.0, kBins - 1.0))] += 1.0;
  return h;
}

/// Σ counts and Σ counts·value of bins [a, b).
struct Sums {
  std::vector<double> n = std::vector<double>(kBins + 1, 0.0), nv = std::vector<double>(kBins + 1, 0.0);
  explicit Sums(const Histogram& h) {
    for (int i = 0; i < kBins; ++i) {
      const auto k = static_cast<std::size_t>(i);
      n[k + 1] = n[k] + h.counts[k];
      nv[k + 1] = nv[k] + h.counts[k] * h.centre(i);
    }
  }
  double between(int a, int b) const {
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    const double w = n[j] - n[i], s = nv[j] - nv[i];
    return w > 0.0 ? s * s / w : 0.0;
  }
  double mean(int a, int b) const {
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    return n[j] > n[i] ? (nv[j] - nv[i]) / (n[j] - n[i]) : 0.0;
  }
};

/// Bins where the second and the third class begin.
struct Cuts {
  int first = 1, second = 2;
};
Cuts three_classes(const Sums& sums) {
  Cuts cuts;
  double best = -1.0;
  for (int a = 1; a < kBins - 1; ++a)
    for (int b = a + 1; b < kBins; ++b) {
      const double v = sums.between(0, a) + sums.between(a, b) + sums.between(b, kBins);
      if (v > best) best = v, cuts = {a, b};
    }
  return cuts;
}
int two_classes(const Sums& sums) {
  int cut = 1;
  double best = -1.0;
  for (int a = 1; a < kBins; ++a) {
    const double v = sums.between(0, a) + sums.between(a, kBins);
    if (v > best) best = v, cut = a;
  }
  return cut;
}

/// Hounsfield units tell air by its value. Scanners without them: the middle class of three is soft tissue
/// only if it is a fair part of the volume and more than the third; without air it would be bone.
bool holds_air(const Histogram& h, const Sums& sums, const Cuts& cuts) {
  constexpr double kAirHu = -300.0;
  const double all = sums.n.back();
  double below = 0.0;
  for (int i = 0; i < kBins; ++i)
    if (h.centre(i) < kAirHu) below += h.counts[static_cast<std::size_t>(i)];
  if (below > 0.02 * all) return true;
  const double middle =
      sums.n[static_cast<std::size_t>(cuts.second)] - sums.n[static_cast<std::size_t>(cuts.first)];
  const double dense = all - sums.n[static_cast<std::size_t>(cuts.second)];
  return h.low > kAirHu && middle > 0.2 * all && middle > dense;
}

}  // namespace

TissueLevels tissue_levels(const Volume& volume) {
  TissueLevels levels;
  if (volume.empty()) return levels;
  const Histogram h = histogram_of(volume);
  const Sums sums(h);
  Cuts cuts = three_classes(sums);
  if (holds_air(h, sums, cuts)) {
    levels.skin = h.low + cuts.first * h.width;
    levels.soft = sums.mean(cuts.first, cuts.second);
    levels.air = sums.mean(0, cuts.first);
  } else {
    cuts.second = two_classes(sums);
    levels.soft = sums.mean(0, cuts.second);
    levels.skin = h.low;  // nothing is below
  }
  levels.bone = h.low + cuts.second * h.width;
  // Enamel is the densest tissue: what the densest hundredth of the bony voxels exceeds.
  double bony = 0.0, passed = 0.0;
  for (int i = cuts.second; i < kBins; ++i) bony += h.counts[static_cast<std::size_t>(i)];
  int top = kBins - 1;
  while (top > cuts.second && (passed += h.counts[static_cast<std::size_t>(top)]) < 0.01 * bony) --top;
  levels.crown = 0.5 * (levels.soft + h.centre(top));
  return levels;
}

}  // namespace gnathion
