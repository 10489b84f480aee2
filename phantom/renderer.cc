#include "phantom/renderer.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/random.h"
#include "phantom/renderer_layers.h"

namespace gnathion {
namespace render {

void Window::extend(const Window& w) {
  x0 = std::min(x0, w.x0), y0 = std::min(y0, w.y0), x1 = std::max(x1, w.x1), y1 = std::max(y1, w.y1);
}

void Window::clip(int width, int height) {
  x0 = std::max(x0, 0), y0 = std::max(y0, 0), x1 = std::min(x1, width), y1 = std::min(y1, height);
}

RayMap::RayMap(const CameraModel& camera) : width(camera.width_px + 2 * kPad) {
  const int height = camera.height_px + 2 * kPad;
  rays.resize(size_t(width) * size_t(height));
  tbb::parallel_for(0, height, [&](int y) {
    for (int x = 0; x < width; ++x)
      rays[size_t(y) * size_t(width) + size_t(x)] =
          camera.undistorted(Eigen::Vector2d(x - kPad, y - kPad)).cast<float>();
  });
}

Blur::Blur(double sigma_px) {
  const int radius = sigma_px > 0 ? std::min(kPad, static_cast<int>(std::ceil(4 * sigma_px))) : 0;
  double sum = 0;
  for (int k = 0; k <= radius; ++k) {
    kernel.push_back(static_cast<float>(k ? std::exp(-0.5 * k * k / (sigma_px * sigma_px)) : 1.0));
    sum += (k ? 2 : 1) * kernel.back();
  }
  for (float& weight : kernel) weight = static_cast<float>(weight / sum);
}

using Row = Eigen::Map<Eigen::ArrayXf>;
using ConstRow = Eigen::Map<const Eigen::ArrayXf>;

void Blur::horizontally(const Canvas& in, const Window& w, Canvas& out) const {
  const int n = w.x1 - w.x0;
  for (int y = w.y0; y < w.y1; ++y) {
    const float* from = in.row(y) + w.x0;
    Row to(out.row(y) + w.x0, n);
    to = kernel[0] * ConstRow(from, n);
    for (int k = 1; k <= radius(); ++k)
      to += kernel[size_t(k)] * (ConstRow(from - k, n) + ConstRow(from + k, n));
  }
}

void Blur::vertically(const Canvas& in, int y, int x0, int x1, float* out) const {
  const int n = x1 - x0;
  Row to(out, n);
  to = kernel[0] * ConstRow(in.row(y) + x0, n);
  for (int k = 1; k <= radius(); ++k)
    to += kernel[size_t(k)] * (ConstRow(in.row(y - k) + x0, n) + ConstRow(in.row(y + k) + x0, n));
}

}  // namespace render

namespace {

using namespace render;

/// Gaussian noise from a table, entered at a place that only seed, frame and row decide: as good as
/// fresh numbers to any detector, at the price of an addition.
class NoiseTable {
 public:
  NoiseTable(std::uint64_t seed, double sigma, int width) : seed_(seed) {
    if (sigma <= 0) return;
    Random random(seed, 0x6e6f697365);
    values_.resize(kSize + size_t(width));
    for (std::size_t i = 0; i < kSize; ++i) values_[i] = static_cast<float>(sigma * random.normal());
    std::copy_n(values_.begin(), width, values_.begin() + kSize);
  }
  bool silent() const { return values_.empty(); }
  const float* row(std::uint32_t frame, int y) const {
    std::uint64_t h = seed_ ^ (std::uint64_t(frame) << 20) ^ std::uint64_t(y);  // splitmix64 (Steele 2014)
    h += 0x9e3779b97f4a7c15ULL;
    h = (h ^ (h >> 30)) * 0xbf58476d1ce4e5b9ULL;
    h = (h ^ (h >> 27)) * 0x94d049bb133111ebULL;
    return values_.data() + ((h ^ (h >> 31)) & (kSize - 1));
  }

 private:
  static constexpr std::size_t kSize = std::size_t{1} << 18;
  std::uint64_t seed_;
  std::vector<float> values_;
};

/// Share of the light that reaches each pixel: 1 in the centre.
std::vector<float> vignette(const CameraModel& camera, double loss) {
  std::vector<float> share(size_t(camera.width_px) * size_t(camera.height_px));
  const double cx = 0.5 * (camera.width_px - 1), cy = 0.5 * (camera.height_px - 1);
  for (int y = 0; y < camera.height_px; ++y)
    for (int x = 0; x < camera.width_px; ++x) {
      const double r2 = ((x - cx) * (x - cx) + (y - cy) * (y - cy)) / (cx * cx + cy * cy);
      share[size_t(y) * size_t(camera.width_px) + size_t(x)] = static_cast<float>(1 - loss * r2);
    }
  return share;
}

struct Body {
  std::vector<TagPlane> tags;
  Surface surface;
};

/// What one thread needs to draw a frame.
struct Workspace {
  Scratch scratch;
  Canvas half_blurred;
  std::vector<float> line;
};

std::uint8_t to_byte(float grey) {
  return static_cast<std::uint8_t>(std::clamp(grey, 0.0f, 255.0f) + 0.5f);
}

}  // namespace

struct CameraRenderer::Impl {
  CameraModel camera;
  RenderOptions options;
  std::vector<Body> bodies;
  RayMap rays;
  Blur blur;
  Canvas background, blurred_background;
  std::vector<float> vignetting;
  NoiseTable noise;
  mutable tbb::enumerable_thread_specific<Workspace> workspaces;

  Impl(const CameraModel& model, const RenderOptions& render_options)
      : camera(model),
        options(render_options),
        rays(model),
        blur(render_options.blur_sigma_px),
        vignetting(vignette(model, render_options.vignetting)),
        noise(render_options.seed, render_options.noise_sigma, model.width_px) {
    const int width = rays.width, height = camera.height_px + 2 * kPad;
    background = options.clutter ? clutter(width, height, options.seed) : Canvas(width, height, 110.0f);
    blurred_background = background;
    Canvas half(width, height);
    const Window inner{kPad, 0, width - kPad, height};
    blur.horizontally(background, inner, half);
    for (int y = kPad; y < height - kPad; ++y)
      blur.vertically(half, y, kPad, width - kPad, blurred_background.row(y) + kPad);
  }

  void draw(const std::vector<BodyExposure>& exposures, Workspace& w) const;
  void draw_tags(const std::vector<BodyExposure>& exposures, Scratch& scratch) const;
  /// Calls row(y, light of its pixels) for each image row after lens blur and vignetting.
  template <class UseRow>
  void develop(Workspace& w, const UseRow& row) const;
};

void CameraRenderer::Impl::draw(const std::vector<BodyExposure>& exposures, Workspace& w) const {
  GNATHION_CHECK(exposures.size() == bodies.size());
  w.scratch.light = background;
  w.scratch.touched = Window{};
  w.scratch.inverse_depth.width = background.width;
  w.scratch.inverse_depth.height = background.height;
  w.scratch.inverse_depth.values.assign(background.values.size(), 0.0f);
  for (std::size_t b = 0; b < bodies.size(); ++b)
    draw_surface(bodies[b].surface, exposures[b].camera_from_body, camera, w.scratch);
  draw_tags(exposures, w.scratch);
}

void CameraRenderer::Impl::draw_tags(const std::vector<BodyExposure>& exposures, Scratch& scratch) const {
  struct Job {
    double distance_mm;
    const TagPlane* tag;
    std::vector<Rigid3> path;
  };
  std::vector<Job> jobs;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const BodyExposure& e = exposures[b];
    for (const TagPlane& tag : bodies[b].tags) {
      const double half = 0.5 * tag.image.square_modules();
      const Vector3 centre = tag.origin_mm + half * (tag.right_mm + tag.down_mm);
      jobs.push_back({(e.camera_from_body * centre).z(), &tag,
                      e.path.empty() ? std::vector<Rigid3>{e.camera_from_body} : e.path});
    }
  }
  // Far ones first: near ones cover them.
  std::stable_sort(jobs.begin(), jobs.end(),
                   [](const Job& a, const Job& b) { return a.distance_mm > b.distance_mm; });
  for (const Job& job : jobs)
    draw_tag(*job.tag, job.path, camera, rays, {options.white, options.black}, scratch);
}

template <class UseRow>
void CameraRenderer::Impl::develop(Workspace& w, const UseRow& use_row) const {
  const int width = camera.width_px, height = camera.height_px;
  const Canvas& light = w.scratch.light;
  if (w.half_blurred.values.size() != light.values.size()) w.half_blurred = Canvas(light.width, light.height);
  // Only what was drawn on needs the lens blur; the background has been through it already.
  Window changed = w.scratch.touched;
  changed.grow(blur.radius());
  changed.clip(light.width - kPad, light.height);
  changed.x0 = std::max(changed.x0, kPad);
  if (!changed.empty()) {
    Window rows = changed;
    rows.y0 = std::max(rows.y0 - kPad, 0), rows.y1 = std::min(rows.y1 + kPad, light.height);
    blur.horizontally(light, rows, w.half_blurred);
  }
  w.line.resize(size_t(width));
  for (int y = 0; y < height; ++y) {
    const int padded = y + kPad;
    std::copy_n(blurred_background.row(padded) + kPad, width, w.line.begin());
    if (!changed.empty() && padded >= changed.y0 && padded < changed.y1)
      blur.vertically(w.half_blurred, padded, changed.x0, changed.x1, w.line.data() + changed.x0 - kPad);
    Row(w.line.data(), width) *= ConstRow(vignetting.data() + size_t(y) * size_t(width), width);
    use_row(y, w.line.data());
  }
}

CameraRenderer::CameraRenderer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CameraRenderer::CameraRenderer(CameraRenderer&&) noexcept = default;
CameraRenderer& CameraRenderer::operator=(CameraRenderer&&) noexcept = default;
CameraRenderer::~CameraRenderer() = default;

Result<CameraRenderer> CameraRenderer::create(const CameraModel& camera, std::vector<SceneBody> bodies,
                                              const RenderOptions& options) {
  auto impl = std::make_unique<Impl>(camera, options);
  for (SceneBody& body : bodies) {
    std::vector<TagPlane> tags;
    for (const BodyTag& tag : body.tags.tags) {
      GNATHION_TRY(TagImage pattern, tag_image(body.tags.family, tag.id));
      tags.emplace_back(std::move(pattern), tag);
    }
    impl->bodies.push_back({std::move(tags), Surface(std::move(body.surface), body.albedo)});
  }
  return CameraRenderer(std::move(impl));
}

Image8 CameraRenderer::render(const std::vector<BodyExposure>& exposures, std::uint32_t frame) const {
  Workspace& w = impl_->workspaces.local();
  impl_->draw(exposures, w);
  Image8 image(impl_->camera.width_px, impl_->camera.height_px);
  impl_->develop(w, [&](int y, float* light) {
    if (!impl_->noise.silent())
      Row(light, image.width_px) += ConstRow(impl_->noise.row(frame, y), image.width_px);
    std::uint8_t* out = &image.at(0, y);
    for (int x = 0; x < image.width_px; ++x) out[x] = to_byte(light[x]);
  });
  return image;
}

std::vector<float> CameraRenderer::light(const std::vector<BodyExposure>& exposures) const {
  Workspace& w = impl_->workspaces.local();
  impl_->draw(exposures, w);
  const auto width = static_cast<std::size_t>(impl_->camera.width_px);
  std::vector<float> all(width * static_cast<std::size_t>(impl_->camera.height_px));
  impl_->develop(
      w, [&](int y, const float* light) { std::copy_n(light, width, all.begin() + long(width) * y); });
  return all;
}

int CameraRenderer::sub_exposures(std::size_t body, const Rigid3& opens, const Rigid3& closes) const {
  constexpr double kStepPx = 0.3;
  constexpr int kMost = 6;
  double moved_px = 0;
  for (const TagPlane& tag : impl_->bodies[body].tags) {
    const auto before = impl_->camera.project(opens * tag.origin_mm);
    const auto after = impl_->camera.project(closes * tag.origin_mm);
    if (before && after) moved_px = std::max(moved_px, (*after - *before).norm());
  }
  return std::clamp(static_cast<int>(std::ceil(moved_px / kStepPx)), 1, kMost);
}

}  // namespace gnathion
