#include <cmath>

#include "tracking/synthetic_tags.h"

namespace gnathion::testing {
namespace {

/// Reflectance of the world along a ray: the nearest tag's print, or the background.
double radiance(const TagFamily& family, const std::vector<SceneTag>& tags,
                const std::vector<Rigid3>& tag_from_camera, const SceneLook& look, const Vector3& ray) {
  double nearest = 1e300, grey = look.background_grey;
  for (std::size_t i = 0; i < tags.size(); ++i) {
    const Rigid3& inverse = tag_from_camera[i];
    const Vector3 direction = inverse.rotation * ray;
    if (direction.z() >= -1e-9) continue;  // seen from behind
    const double t = -inverse.translation_mm.z() / direction.z();
    if (t <= 0 || t >= nearest) continue;
    const Vector3 p = inverse.translation_mm + t * direction;
    const int n = family.square_cells();
    const double cell = tags[i].side_mm / n;
    const double cx = p.x() / cell + 0.5 * n, cy = 0.5 * n - p.y() / cell;
    if (cx < -1 || cy < -1 || cx > n + 1 || cy > n + 1) continue;
    nearest = t;
    const bool white =
        family.white(tags[i].id, static_cast<int>(std::floor(cx)), static_cast<int>(std::floor(cy)));
    grey = white ? look.white_grey : look.black_grey;
  }
  return grey;
}

std::vector<double> gaussian(double sigma, int radius) {
  std::vector<double> weights;
  double sum = 0;
  for (int i = -radius; i <= radius; ++i) {
    weights.push_back(sigma > 0 ? std::exp(-0.5 * i * i / (sigma * sigma)) : (i == 0));
    sum += weights.back();
  }
  for (double& w : weights) w /= sum;
  return weights;
}

}  // namespace

Image8 render_tags(const CameraModel& camera, const TagFamily& family, const std::vector<SceneTag>& tags,
                   const SceneLook& look, Random& random) {
  Image8 image(camera.width_px, camera.height_px);
  std::vector<double> light(image.pixels.size(), look.background_grey);
  std::vector<Rigid3> inverses;
  for (const SceneTag& tag : tags) inverses.push_back(tag.camera_from_tag.inverse());
  const int s = look.oversampling;
  for (const SceneTag& tag : tags) {
    // A box of pixels around the tag, sampled s×s a pixel, blurred on the fine grid, then boxed down.
    double x0 = 1e9, x1 = -1e9, y0 = 1e9, y1 = -1e9;
    SceneTag larger = tag;
    larger.side_mm *= 1.5;
    for (const auto& c : true_corners(camera, larger)) {
      x0 = std::min(x0, c.x()), x1 = std::max(x1, c.x()), y0 = std::min(y0, c.y()), y1 = std::max(y1, c.y());
    }
    const int pad = 4 + static_cast<int>(std::ceil(look.motion_px.norm()));
    const int left = std::max(0, static_cast<int>(x0) - pad),
              right = std::min(camera.width_px, static_cast<int>(x1) + pad);
    const int top = std::max(0, static_cast<int>(y0) - pad),
              bottom = std::min(camera.height_px, static_cast<int>(y1) + pad);
    if (left >= right || top >= bottom) continue;
    const int border = (4 + static_cast<int>(std::ceil(look.motion_px.norm()))) * s;
    const int w = (right - left) * s + 2 * border, h = (bottom - top) * s + 2 * border;
    std::vector<double> fine(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
    // Rays from a table at every quarter pixel, linear in between: off by less than 1e-6 px.
    const double fine_left = left - 0.5 - static_cast<double>(border) / s;
    const double fine_top = top - 0.5 - static_cast<double>(border) / s;
    const int table_w = 4 * w / s + 8, table_h = 4 * h / s + 8;
    std::vector<Eigen::Vector2d> table;
    for (int y = 0; y < table_h; ++y) {
      for (int x = 0; x < table_w; ++x) {
        table.push_back(camera.undistorted(Eigen::Vector2d(fine_left + 0.25 * x, fine_top + 0.25 * y)));
      }
    }
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        // Samples are shifted within their cells, row by row and column by column, so that an edge along the
        // grid does not fall between all samples of a row at once.
        const double jitter_x = std::fmod(0.6180339887 * y, 1.0), jitter_y = std::fmod(0.6180339887 * x, 1.0);
        const double tx = 4 * (x + jitter_x) / s, ty = 4 * (y + jitter_y) / s;
        const int ix = static_cast<int>(tx), iy = static_cast<int>(ty);
        const Eigen::Vector2d* cell = &table[static_cast<std::size_t>(iy * table_w + ix)];
        const Eigen::Vector2d ray =
            (1 - (ty - iy)) * ((1 - (tx - ix)) * cell[0] + (tx - ix) * cell[1]) +
            (ty - iy) * ((1 - (tx - ix)) * cell[table_w] + (tx - ix) * cell[table_w + 1]);
        fine[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)] =
            radiance(family, tags, inverses, look, Vector3(ray.x(), ray.y(), 1));
      }
    }
    const auto kernel = gaussian(look.psf_px * s, static_cast<int>(std::ceil(3.5 * look.psf_px * s)));
    const int radius = static_cast<int>(kernel.size() / 2);
    const int smear = std::max(1, static_cast<int>(std::ceil(look.motion_px.norm() * s)));
    const auto blurred = [&](std::vector<double> in, int dx, int dy) {
      std::vector<double> out(in.size(), look.background_grey);
      for (int y = radius * dy; y < h - radius * dy; ++y) {
        for (int x = radius * dx; x < w - radius * dx; ++x) {
          double sum = 0;
          for (int k = -radius; k <= radius; ++k) {
            sum += kernel[static_cast<std::size_t>(k + radius)] *
                   in[static_cast<std::size_t>(y + k * dy) * static_cast<std::size_t>(w) +
                      static_cast<std::size_t>(x + k * dx)];
          }
          out[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)] = sum;
        }
      }
      return out;
    };
    fine = blurred(blurred(std::move(fine), 1, 0), 0, 1);
    for (int y = top; y < bottom; ++y) {
      for (int x = left; x < right; ++x) {
        double sum = 0;
        for (int m = 0; m < smear; ++m) {
          const double f = smear > 1 ? (m + 0.5) / smear - 0.5 : 0.0;
          const int ox = static_cast<int>(std::lround(f * look.motion_px.x() * s));
          const int oy = static_cast<int>(std::lround(f * look.motion_px.y() * s));
          for (int j = 0; j < s; ++j) {
            for (int i = 0; i < s; ++i) {
              sum += fine[static_cast<std::size_t>((y - top) * s + border + j - oy) *
                              static_cast<std::size_t>(w) +
                          static_cast<std::size_t>((x - left) * s + border + i - ox)];
            }
          }
        }
        light[static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width_px) +
              static_cast<std::size_t>(x)] = sum / (s * s * smear);
      }
    }
  }
  const double corner2 = camera.cx_px * camera.cx_px + camera.cy_px * camera.cy_px;
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width_px) +
                            static_cast<std::size_t>(x);
      const double r2 = (std::pow(x - camera.cx_px, 2) + std::pow(y - camera.cy_px, 2)) / corner2;
      const double grey = light[i] * (1 - look.vignetting * r2) + look.noise_grey * random.normal();
      image.pixels[i] = static_cast<std::uint8_t>(std::clamp(std::lround(grey), 0L, 255L));
    }
  }
  return image;
}

Rigid3 random_tag_pose(const CameraModel& camera, double distance_mm, double tilt_rad, double image_margin_px,
                       Random& random) {
  const Eigen::Vector2d pixel(random.uniform(image_margin_px, camera.width_px - image_margin_px),
                              random.uniform(image_margin_px, camera.height_px - image_margin_px));
  const Eigen::Vector2d n = camera.undistorted(pixel);
  const Vector3 sight = Vector3(n.x(), n.y(), 1).normalized();
  const Vector3 across = sight.cross(random.unit_vector()).normalized();
  const Vector3 normal = exp_so3(tilt_rad * across) * Vector3(-sight);
  Matrix3 rotation;
  rotation.col(2) = normal;
  rotation.col(0) = normal.cross(random.unit_vector()).normalized();
  rotation.col(1) = normal.cross(Vector3(rotation.col(0)));
  return {rotation, distance_mm * sight};
}

}  // namespace gnathion::testing
