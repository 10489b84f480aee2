#include "rendering/raster.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace gnathion {
namespace {

constexpr int kSub = 2;          // samples per pixel and axis
constexpr int kSteps = 256;      // of a sample: corners snap to them, so that edges are decided exactly
constexpr int kBandRows = 25;    // of pixels, drawn by one task
constexpr double kFarPx = 1e6;   // outside of any picture
constexpr double kFills = 1.45;  // the sphere about a scene's box is larger than what is seen of the scene
constexpr float kNowhere = -std::numeric_limits<float>::infinity();

using Rgb = Eigen::Array3f;

/// A mesh's corner in the picture: in steps of a sample, with its colours seen from either side.
struct Corner {
  std::int64_t x = 0, y = 0;
  float z = 0.0f;
  Rgb front, back;
};

/// A mesh ready to draw: its triangles by the bands that they touch.
struct Ready {
  const std::vector<Triangle>* triangles = nullptr;
  std::vector<Corner> corners;
  std::vector<std::vector<std::uint32_t>> in_band;
  float opacity = 1.0f;
};

/// Key light from the viewer's upper left, a weak fill from the right, so that form shows in relief.
Rgb lit(const Rgb& color, const Vector3& normal, bool flat) {
  static const Vector3 key = Vector3(-0.8, 1.0, 1.0).normalized(),
                       fill = Vector3(1.0, -0.2, 1.0).normalized();
  constexpr double kKey = 0.9, kFill = 0.4, kGloss = 0.2, kPower = 25.0;
  double diffuse = 0.0, gloss = 0.0;
  const auto add = [&](const Vector3& light, double strength) {
    const double facing = normal.dot(light);
    if (facing <= 0.0) return;
    diffuse += strength * facing;
    const double mirrored = 2.0 * facing * normal.z() - light.z();
    if (!flat && mirrored > 0.0) gloss += strength * std::pow(mirrored, kPower);
  };
  add(key, kKey);
  add(fill, kFill);
  const double body = flat ? 0.5 + 0.52 * diffuse : 0.18 + 0.9 * diffuse;
  return (color * static_cast<float>(body) + static_cast<float>(kGloss * gloss)).cwiseMin(1.0f);
}

Rgb vertex_color(const SceneMesh& item, std::size_t v) {
  if (item.use_vertex_colors && item.mesh->colors_rgb.size() == item.mesh->vertices_mm.size()) {
    const auto& c = item.mesh->colors_rgb[v];
    return Rgb(c[0], c[1], c[2]) / 255.0f;
  }
  return Rgb(static_cast<float>(item.color[0]), static_cast<float>(item.color[1]),
             static_cast<float>(item.color[2]));
}

Ready made_ready(const SceneMesh& item, const Projection& projection, int bands) {
  Ready out;
  out.triangles = &item.mesh->triangles;
  out.opacity = static_cast<float>(item.opacity);
  const std::vector<Vector3> normals = vertex_normals(*item.mesh);
  const Matrix3 turn = projection.axes.transpose() * item.pose.rotation;
  out.corners.resize(normals.size());
  tbb::parallel_for(std::size_t{0}, normals.size(), [&](std::size_t v) {
    const Vector3 at = projection.seen(item.pose * item.mesh->vertices_mm[v]);
    Corner& c = out.corners[v];
    if (!(std::abs(at.x()) < kFarPx && std::abs(at.y()) < kFarPx)) {
      c.z = kNowhere;
      return;
    }
    c.x = std::llround(at.x() * kSub * kSteps);
    c.y = std::llround(at.y() * kSub * kSteps);
    c.z = static_cast<float>(at.z());
    const Vector3 n = turn * normals[v];
    const Rgb color = vertex_color(item, v);
    c.front = lit(color, n, item.flat_light);
    c.back = lit(color, -n, item.flat_light);
  });
  out.in_band.resize(static_cast<std::size_t>(bands));
  const std::int64_t band_steps = std::int64_t{kBandRows} * kSub * kSteps;
  for (std::uint32_t t = 0; t < out.triangles->size(); ++t) {
    const Triangle& corner = (*out.triangles)[t];
    const Corner &a = out.corners[corner[0]], &b = out.corners[corner[1]], &c = out.corners[corner[2]];
    if (a.z == kNowhere || b.z == kNowhere || c.z == kNowhere) continue;
    const std::int64_t low = std::min({a.y, b.y, c.y}), high = std::max({a.y, b.y, c.y});
    if (high < 0 || low >= bands * band_steps) continue;
    const std::int64_t last = std::min<std::int64_t>(bands - 1, high / band_steps);
    for (std::int64_t band = std::max<std::int64_t>(0, low / band_steps); band <= last; ++band)
      out.in_band[static_cast<std::size_t>(band)].push_back(t);
  }
  return out;
}

/// One side of a triangle: positive inside; a sample on it belongs to one of the two triangles that share it.
struct Side {
  std::int64_t value = 0, by_x = 0, by_y = 0;
  Side(const Corner& from, const Corner& to, std::int64_t x, std::int64_t y) {
    const std::int64_t dx = to.x - from.x, dy = to.y - from.y;
    value = dx * (y - from.y) - dy * (x - from.x);
    if (!(dy < 0 || (dy == 0 && dx > 0))) --value;  // of the other one
    by_x = -dy * kSteps;
    by_y = dx * kSteps;
  }
};

/// The samples of some rows of the picture.
class Band {
 public:
  Band(int width_px, int first_row, int rows)
      : width_(width_px * kSub),
        first_(first_row * kSub),
        rows_(rows * kSub),
        depth_(static_cast<std::size_t>(width_) * static_cast<std::size_t>(rows_), kNowhere),
        color_(depth_.size(), Rgb::Ones()) {}

  void draw(const Ready& item, std::size_t band) {
    const bool clear = item.opacity < 1.0f;
    if (clear && first_fragment_.empty()) first_fragment_.assign(depth_.size(), kNone);
    for (const std::uint32_t t : item.in_band[band]) {
      const Triangle& corner = (*item.triangles)[t];
      each_sample(item.corners[corner[0]], item.corners[corner[1]], item.corners[corner[2]],
                  [&](std::size_t s, float z, const Rgb& rgb) {
                    if (z <= depth_[s]) return;
                    if (clear) {
                      fragments_.push_back({rgb, z, item.opacity, first_fragment_[s]});
                      first_fragment_[s] = static_cast<std::uint32_t>(fragments_.size() - 1);
                      return;
                    }
                    depth_[s] = z;
                    color_[s] = rgb;
                  });
    }
  }

  void resolve(Pixels& onto) {
    blend();
    for (int row = 0; row * kSub < rows_; ++row)
      for (int column = 0; column * kSub < width_; ++column) {
        Rgb sum = Rgb::Zero();
        for (int i = 0; i < kSub; ++i)
          for (int j = 0; j < kSub; ++j) sum += color_[index(column * kSub + i, row * kSub + j)];
        const Rgb byte = (sum * (255.0f / (kSub * kSub))).cwiseMin(255.0f) + 0.5f;
        onto.rgb[static_cast<std::size_t>(first_ / kSub + row) * static_cast<std::size_t>(onto.width_px) +
                 static_cast<std::size_t>(column)] = (static_cast<std::uint32_t>(byte[0]) << 16) |
                                                     (static_cast<std::uint32_t>(byte[1]) << 8) |
                                                     static_cast<std::uint32_t>(byte[2]);
      }
  }

 private:
  static constexpr std::uint32_t kNone = ~0u;
  struct Fragment {
    Rgb rgb;
    float z, opacity;
    std::uint32_t next;
  };

  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }

  /// Calls body(sample, z, colour) for the samples whose centres lie in the triangle.
  template <class Body>
  void each_sample(const Corner& a, const Corner& b, const Corner& c, const Body& body) const {
    // y runs downwards: what is counter-clockwise in the scene is clockwise here.
    const std::int64_t area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if (area == 0) return;
    const bool front = area < 0;
    const Corner &second = front ? c : b, &third = front ? b : c;
    const auto first = [](std::int64_t low, std::int64_t at_least) {
      return static_cast<int>(std::max(at_least, low / kSteps));
    };
    const auto last = [](std::int64_t high, std::int64_t at_most) {
      return static_cast<int>(std::min(at_most, high / kSteps));
    };
    const int x0 = first(std::min({a.x, b.x, c.x}), 0), x1 = last(std::max({a.x, b.x, c.x}), width_ - 1);
    const int y0 = first(std::min({a.y, b.y, c.y}), first_),
              y1 = last(std::max({a.y, b.y, c.y}), first_ + rows_ - 1);
    if (x0 > x1 || y0 > y1) return;
    const std::int64_t x = std::int64_t{x0} * kSteps + kSteps / 2, y = std::int64_t{y0} * kSteps + kSteps / 2;
    Side of_a(second, third, x, y), of_second(third, a, x, y), of_third(a, second, x, y);
    const float scale = 1.0f / static_cast<float>(front ? -area : area);
    const Rgb &ca = front ? a.front : a.back, &cs = front ? second.front : second.back,
              &ct = front ? third.front : third.back;
    for (int j = y0; j <= y1; ++j) {
      std::int64_t wa = of_a.value, ws = of_second.value, wt = of_third.value;
      for (int i = x0; i <= x1; ++i) {
        if ((wa | ws | wt) >= 0) {
          const float fa = scale * static_cast<float>(wa), fs = scale * static_cast<float>(ws),
                      ft = 1.0f - fa - fs;
          body(index(i, j - first_), fa * a.z + fs * second.z + ft * third.z, fa * ca + fs * cs + ft * ct);
        }
        wa += of_a.by_x;
        ws += of_second.by_x;
        wt += of_third.by_x;
      }
      of_a.value += of_a.by_y;
      of_second.value += of_second.by_y;
      of_third.value += of_third.by_y;
    }
  }

  /// Lays the translucent fragments over what is behind them, the farthest first.
  void blend() {
    std::vector<const Fragment*> here;
    for (std::size_t s = 0; s < first_fragment_.size(); ++s) {
      here.clear();
      for (std::uint32_t n = first_fragment_[s]; n != kNone; n = fragments_[n].next)
        if (fragments_[n].z > depth_[s]) here.push_back(&fragments_[n]);
      std::sort(here.begin(), here.end(),
                [](const Fragment* a, const Fragment* b) { return a->z != b->z ? a->z < b->z : a < b; });
      for (const Fragment* f : here) color_[s] += f->opacity * (f->rgb - color_[s]);
    }
  }

  int width_, first_, rows_;
  std::vector<float> depth_;
  std::vector<Rgb> color_;
  std::vector<std::uint32_t> first_fragment_;
  std::vector<Fragment> fragments_;
};

}  // namespace

Projection::Projection(const std::vector<SceneMesh>& meshes, const SceneView& view, int width, int height)
    : width_px(width), height_px(height) {
  Box box;
  for (const SceneMesh& item : meshes)
    for (const Vector3& v : item.mesh->vertices_mm) box.extend(item.pose * v);
  axes.col(2) = view.towards_viewer.normalized();
  axes.col(0) = view.up.cross(axes.col(2)).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  double radius = 1.0;
  if ((box.size_mm().array() >= 0.0).all()) {
    centre_mm = box.centre_mm();
    radius = std::max(1e-6, 0.5 * box.size_mm().norm());
  }
  px_per_mm = height * kFills * view.zoom / (2.0 * radius);
}

Vector3 Projection::seen(const Vector3& p_mm) const {
  const Vector3 p = axes.transpose() * (p_mm - centre_mm);
  return {0.5 * width_px + px_per_mm * p.x(), 0.5 * height_px - px_per_mm * p.y(), p.z()};
}

Pixels rasterized(const std::vector<SceneMesh>& meshes, const Projection& projection) {
  Pixels out(projection.width_px, projection.height_px);
  const int bands = (projection.height_px + kBandRows - 1) / kBandRows;
  std::vector<Ready> opaque, clear;
  for (const SceneMesh& item : meshes)
    if (!item.mesh->empty())
      (item.opacity < 1.0 ? clear : opaque).push_back(made_ready(item, projection, bands));
  tbb::parallel_for(0, bands, [&](int b) {
    const int first = b * kBandRows;
    Band band(projection.width_px, first, std::min(kBandRows, projection.height_px - first));
    for (const std::vector<Ready>* items : {&opaque, &clear})
      for (const Ready& item : *items) band.draw(item, static_cast<std::size_t>(b));
    band.resolve(out);
  });
  return out;
}

}  // namespace gnathion
