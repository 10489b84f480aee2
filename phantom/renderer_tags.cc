#include <algorithm>
#include <array>
#include <cmath>

#include "phantom/renderer_layers.h"

namespace gnathion::render {

double covered_share(double a, double b, double d) {
  // a·x + b·y is the sum of two uniform variables of widths |a| and |b|: a trapezoid, integrated.
  const double wide = std::max(std::abs(a), std::abs(b)), narrow = std::min(std::abs(a), std::abs(b));
  const double reach = 0.5 * (wide + narrow), flat = 0.5 * (wide - narrow);
  if (d >= reach) return 1;
  if (d <= -reach) return 0;
  if (std::abs(d) <= flat) return 0.5 + d / wide;
  const double left = reach - std::abs(d);
  const double tail = 0.5 * left * left / (wide * narrow);
  return d > 0 ? 1 - tail : tail;
}

TagPlane::TagPlane(TagImage pattern, const BodyTag& tag) : image(std::move(pattern)) {
  const auto& [lower_left, lower_right, upper_right, upper_left] = tag.corners_in_body_mm;
  const double n = image.square_modules();
  right_mm = ((upper_right - upper_left) + (lower_right - lower_left)) / (2 * n);
  down_mm = ((lower_left - upper_left) + (lower_right - upper_right)) / (2 * n);
  const Vector3 centre = 0.25 * (lower_left + lower_right + upper_right + upper_left);
  origin_mm = centre - 0.5 * n * (right_mm + down_mm);
}

namespace {

/// Opacity, and grey level times opacity.
struct Paint {
  double alpha = 0, level = 0;
  Paint& operator+=(const Paint& p) {
    alpha += p.alpha, level += p.level;
    return *this;
  }
};
Paint operator*(double share, const Paint& p) {
  return {share * p.alpha, share * p.level};
}

/// The print as an endless grid of unit cells with the black square's upper left corner at (0, 0).
class Print {
 public:
  Print(const TagImage& image, const Ink& ink) : image_(image), ink_(ink) {}

  /// 0 black, 1 white, 2 nothing.
  int kind(int column, int row) const {
    const int c = column + image_.border_modules, r = row + image_.border_modules;
    if (c < 0 || r < 0 || c >= image_.modules || r >= image_.modules) return 2;
    return image_.white[static_cast<std::size_t>(r * image_.modules + c)] ? 1 : 0;
  }
  Paint paint_of(int kind) const {
    if (kind == 2) return {};
    return {1, kind ? ink_.white : ink_.black};
  }

 private:
  const TagImage& image_;
  const Ink ink_;
};

int floor_int(double v) {
  return static_cast<int>(std::floor(v));
}

/// The tag's coordinates over one pixel: (u, v) at its centre and how they change across it.
struct Footprint {
  double u, v, du_dx, du_dy, dv_dx, dv_dy;
};

/// Mean over a pixel that several edges cross (a tag nearly edge-on): 89 points of a Fibonacci lattice.
Paint sampled(const Print& print, const Footprint& f) {
  constexpr int kPoints = 89, kStep = 55;
  Paint sum;
  for (int i = 0; i < kPoints; ++i) {
    const double x = (i + 0.5) / kPoints - 0.5, y = ((i * kStep) % kPoints + 0.5) / kPoints - 0.5;
    const Paint p = print.paint_of(
        print.kind(floor_int(f.u + f.du_dx * x + f.du_dy * y), floor_int(f.v + f.dv_dx * x + f.dv_dy * y)));
    sum += {p.alpha / kPoints, p.level / kPoints};
  }
  return sum;
}

/// Share of the pixel where u > line_u and v > line_v: its square clipped twice.
double share_beyond_both(const Footprint& f, double line_u, double line_v) {
  struct Point {
    double x, y;
  };
  std::array<Point, 8> polygon{{{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}};
  std::size_t count = 4;
  const auto clip = [&](double a, double b, double d) {
    std::array<Point, 8> kept;
    std::size_t n = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Point p = polygon[i], q = polygon[(i + 1) % count];
      const double at_p = a * p.x + b * p.y + d, at_q = a * q.x + b * q.y + d;
      if (at_p > 0) kept[n++] = p;
      if ((at_p > 0) == (at_q > 0)) continue;
      const double s = at_p / (at_p - at_q);
      kept[n++] = {p.x + s * (q.x - p.x), p.y + s * (q.y - p.y)};
    }
    polygon = kept;
    count = n;
  };
  clip(f.du_dx, f.du_dy, f.u - line_u);
  clip(f.dv_dx, f.dv_dy, f.v - line_v);
  double twice = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Point p = polygon[i], q = polygon[(i + 1) % count];
    twice += p.x * q.y - p.y * q.x;
  }
  return 0.5 * std::abs(twice);
}

/// Mean of the print over one pixel.
Paint integrated(const Print& print, const Footprint& f) {
  const double reach_u = 0.5 * (std::abs(f.du_dx) + std::abs(f.du_dy));
  const double reach_v = 0.5 * (std::abs(f.dv_dx) + std::abs(f.dv_dy));
  const int c0 = floor_int(f.u - reach_u), c1 = floor_int(f.u + reach_u);
  const int r0 = floor_int(f.v - reach_v), r1 = floor_int(f.v + reach_v);
  if (c1 > c0 + 1 || r1 > r0 + 1) return sampled(print, f);
  const Paint upper_left = print.paint_of(print.kind(c0, r0));
  const double right = c1 > c0 ? covered_share(f.du_dx, f.du_dy, f.u - c1) : 0;
  const double lower = r1 > r0 ? covered_share(f.dv_dx, f.dv_dy, f.v - r1) : 0;
  if (right == 0 && lower == 0) return upper_left;
  const double both = right > 0 && lower > 0 ? share_beyond_both(f, c1, r1) : 0;
  Paint sum;
  sum += (1 - right - lower + both) * upper_left;
  if (right > 0) sum += (right - both) * print.paint_of(print.kind(c1, r0));
  if (lower > 0) sum += (lower - both) * print.paint_of(print.kind(c0, r1));
  if (both > 0) sum += both * print.paint_of(print.kind(c1, r1));
  return sum;
}

/// A tag in one pose: (u, v, 1)/z = from_ray · (ray, 1).
struct PlacedTag {
  Matrix3 from_ray;
  Window window;
  bool visible = false;
};

PlacedTag place(const TagPlane& tag, const Rigid3& camera_from_body, const CameraModel& camera,
                const Canvas& canvas) {
  PlacedTag placed;
  Matrix3 to_ray;
  to_ray.col(0) = camera_from_body.rotation * tag.right_mm;
  to_ray.col(1) = camera_from_body.rotation * tag.down_mm;
  to_ray.col(2) = camera_from_body * tag.origin_mm;
  // right × down points into the tag; facing the camera it points away from it.
  const double centre = 0.5 * tag.image.square_modules();
  const Vector3 middle = to_ray * Vector3(centre, centre, 1);
  const Vector3 inward = to_ray.col(0).cross(to_ray.col(1));
  if (inward.dot(middle) <= 0.05 * inward.norm() * middle.norm()) return placed;  // beyond 87°
  for (const double u : {0, 1})
    for (const double v : {0, 1}) {
      const double border = tag.image.border_modules, side = tag.image.modules;
      const Vector3 corner = to_ray * Vector3(u * side - border, v * side - border, 1);
      if (corner.z() < 1) return placed;
      const Eigen::Vector2d pixel = *camera.project(corner);
      const Eigen::Vector2d p = pixel.cwiseMax(-1e6).cwiseMin(1e6);
      const int x = floor_int(p.x()) + kPad, y = floor_int(p.y()) + kPad;
      placed.window.extend({x, y, x + 1, y + 1});
    }
  placed.window.grow(3);  // half a pixel of footprint, and the lens bends the sides outwards
  placed.window.clip(canvas.width, canvas.height);
  placed.from_ray = to_ray.inverse();
  placed.visible = !placed.window.empty();
  return placed;
}

double shade(const TagPlane& tag, const Rigid3& camera_from_body) {
  const Vector3 outward = camera_from_body.rotation * tag.down_mm.cross(tag.right_mm).normalized();
  return 0.72 + 0.28 * std::max(0.0, outward.dot(lamp()));
}

Footprint footprint(const Matrix3& m, const Eigen::Vector2f* above, const Eigen::Vector2f* here,
                    const Eigen::Vector2f* below, int x, int width, double* inverse_depth) {
  const int left = std::max(x - 1, 0), right = std::min(x + 1, width - 1);
  const Vector3 h = m * Vector3(here[x].x(), here[x].y(), 1);
  const Eigen::Vector2d ray_dx = (here[right] - here[left]).cast<double>() / (right - left);
  const Eigen::Vector2d ray_dy = (below[x] - above[x]).cast<double>() * 0.5;
  const Vector3 h_dx = m.leftCols<2>() * ray_dx, h_dy = m.leftCols<2>() * ray_dy;
  const double z = 1 / h.z(), u = h.x() * z, v = h.y() * z;
  *inverse_depth = h.z();
  return {u,
          v,
          (h_dx.x() - u * h_dx.z()) * z,
          (h_dy.x() - u * h_dy.z()) * z,
          (h_dx.y() - v * h_dx.z()) * z,
          (h_dy.y() - v * h_dy.z()) * z};
}

/// Adds one sub-exposure of the tag to `layer` (alpha and level of each pixel of `window`).
void expose(const TagPlane& tag, const Print& print, const PlacedTag& placed, double weight,
            const RayMap& rays, const Canvas& surfaces, const Window& window, std::vector<Paint>& layer) {
  constexpr double kHiddenBehindMm = 1.5;
  const double low = -tag.image.border_modules, high = low + tag.image.modules;
  const int rows = surfaces.height;
  for (int y = placed.window.y0; y < placed.window.y1; ++y) {
    const Eigen::Vector2f* here = rays.row(y);
    const Eigen::Vector2f* above = rays.row(std::max(y - 1, 0));
    const Eigen::Vector2f* below = rays.row(std::min(y + 1, rows - 1));
    const float* depth = surfaces.row(y);
    Paint* out = layer.data() + size_t(y - window.y0) * size_t(window.x1 - window.x0);
    for (int x = placed.window.x0; x < placed.window.x1; ++x) {
      double inverse_depth = 0;
      const Footprint f = footprint(placed.from_ray, above, here, below, x, rays.width, &inverse_depth);
      if (inverse_depth <= 0) continue;
      const double reach = std::abs(f.du_dx) + std::abs(f.du_dy) + std::abs(f.dv_dx) + std::abs(f.dv_dy);
      if (f.u < low - reach || f.u > high + reach || f.v < low - reach || f.v > high + reach) continue;
      if (depth[x] * (1 / inverse_depth - kHiddenBehindMm) > 1) continue;
      const Paint p = integrated(print, f);
      out[x - window.x0] += weight * p;
    }
  }
}

}  // namespace

void draw_tag(const TagPlane& tag, const std::vector<Rigid3>& path, const CameraModel& camera,
              const RayMap& rays, const Ink& ink, Scratch& out) {
  std::vector<PlacedTag> placed;
  Window window;
  for (const Rigid3& pose : path) {
    placed.push_back(place(tag, pose, camera, out.light));
    if (!placed.back().visible) return;
    window.extend(placed.back().window);
  }
  const double light = shade(tag, path[path.size() / 2]);
  const Print print(tag.image, {ink.white * light, ink.black * light});
  std::vector<Paint> layer(size_t(window.x1 - window.x0) * size_t(window.y1 - window.y0));
  const double weight = 1.0 / static_cast<double>(path.size());
  for (const PlacedTag& p : placed) expose(tag, print, p, weight, rays, out.inverse_depth, window, layer);
  const Paint* paint = layer.data();
  for (int y = window.y0; y < window.y1; ++y)
    for (int x = window.x0; x < window.x1; ++x, ++paint) {
      float& value = out.light.row(y)[x];
      value = static_cast<float>((1 - paint->alpha) * value + paint->level);
    }
  out.touched.extend(window);
}

}  // namespace gnathion::render
