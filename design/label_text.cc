#include "design/label_text.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include <vtkCellArray.h>
#include <vtkNew.h>
#include <vtkPolyData.h>
#include <vtkVectorText.h>

#include <Eigen/Core>

#include "design/parallel.h"

namespace gnathion {
namespace {

using Eigen::Vector2d;
using Segment = std::array<Vector2d, 2>;

constexpr double kStepMm = 0.05;
constexpr double kMarginMm = 0.7;
constexpr double kBolderMm = 0.06;  // on each side: strokes of 2 mm letters become about 0.35 mm wide

/// The text's outlines in VTK's built-in font: edges that one polygon alone has.
std::vector<Segment> outlines_of(const std::string& text) {
  vtkNew<vtkVectorText> source;
  source->SetText(text.c_str());
  source->Update();
  vtkPolyData* polygons = source->GetOutput();
  using Key = std::array<double, 4>;
  std::map<Key, int> count;
  const auto point = [&](vtkIdType id) {
    double p[3];
    polygons->GetPoint(id, p);
    return Vector2d(p[0], p[1]);
  };
  const auto key = [](const Vector2d& a, const Vector2d& b) { return Key{a.x(), a.y(), b.x(), b.y()}; };
  std::vector<Segment> edges;
  vtkCellArray* cells = polygons->GetPolys();
  vtkIdType n = 0;
  const vtkIdType* ids = nullptr;
  for (cells->InitTraversal(); cells->GetNextCell(n, ids) != 0;)
    for (vtkIdType k = 0; k < n; ++k) {
      const Vector2d a = point(ids[k]), b = point(ids[(k + 1) % n]);
      edges.push_back({a, b});
      ++count[key(a, b)];
      ++count[key(b, a)];
    }
  std::vector<Segment> out;
  for (const Segment& e : edges)
    if (count[key(e[0], e[1])] == 1) out.push_back(e);
  return out;
}

}  // namespace

LabelText::LabelText(const std::string& text, double height_mm) : height_mm_(height_mm) {
  std::vector<Segment> outline = outlines_of(text);
  if (outline.empty()) return;
  Vector2d low = Vector2d::Constant(1e300), high = -low;
  for (const Segment& s : outline)
    for (const Vector2d& p : s) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  const double scale = (height_mm - 2.0 * kBolderMm) / (high.y() - low.y());
  for (Segment& s : outline)
    for (Vector2d& p : s) p = scale * (p - low) + Vector2d::Constant(kBolderMm);
  width_mm_ = scale * (high.x() - low.x()) + 2.0 * kBolderMm;
  nx_ = static_cast<int>(std::ceil((width_mm_ + 2.0 * kMarginMm) / kStepMm)) + 1;
  ny_ = static_cast<int>(std::ceil((height_mm_ + 2.0 * kMarginMm) / kStepMm)) + 1;
  values_.resize(static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_));
  parallel_each(nx_, [&](int i) {
    for (int j = 0; j < ny_; ++j) {
      const Vector2d p(i * kStepMm - kMarginMm, j * kStepMm - kMarginMm);
      double least = 1e300;
      bool inside = false;
      for (const Segment& s : outline) {
        const Vector2d along = s[1] - s[0];
        const double t = std::clamp((p - s[0]).dot(along) / std::max(1e-18, along.squaredNorm()), 0.0, 1.0);
        least = std::min(least, (p - s[0] - t * along).norm());
        if ((s[0].y() > p.y()) != (s[1].y() > p.y()) &&
            p.x() < s[0].x() + (p.y() - s[0].y()) / along.y() * along.x())
          inside = !inside;
      }
      values_[static_cast<std::size_t>(i) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(j)] =
          static_cast<float>((inside ? -least : least) - kBolderMm);
    }
  });
}

double LabelText::distance_mm(double x, double y) const {
  if (nx_ < 2 || ny_ < 2) return 1e9;
  const double u = (x + kMarginMm) / kStepMm, v = (y + kMarginMm) / kStepMm;
  const double cu = std::clamp(u, 0.0, nx_ - 1.001), cv = std::clamp(v, 0.0, ny_ - 1.001);
  const double beyond = kStepMm * std::hypot(u - cu, v - cv);
  const int i = static_cast<int>(cu), j = static_cast<int>(cv);
  const double fu = cu - i, fv = cv - j;
  const auto at = [&](int a, int b) {
    return static_cast<double>(
        values_[static_cast<std::size_t>(a) * static_cast<std::size_t>(ny_) + static_cast<std::size_t>(b)]);
  };
  return (1 - fu) * ((1 - fv) * at(i, j) + fv * at(i, j + 1)) +
         fu * ((1 - fv) * at(i + 1, j) + fv * at(i + 1, j + 1)) + beyond;
}

}  // namespace gnathion
