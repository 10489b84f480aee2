// What one camera of the phantom sees: tagged bodies before a cluttered room, as 8-bit grey frames.
//
// Tags are exact: each pixel integrates the pattern over its own square (analytic where one edge
// crosses it), seen through the undistorted ray map. Edges stand to better than 0.01 px.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/camera_model.h"
#include "core/image.h"
#include "core/mesh.h"
#include "core/result.h"

namespace gnathion {

struct RenderOptions {
  std::uint64_t seed = 1;          ///< of clutter and noise
  double noise_sigma = 2;          ///< grey levels
  double blur_sigma_px = 0.7;      ///< the lens, Gaussian
  double vignetting = 0.14;        ///< share of light lost in the image's corners
  double white = 225, black = 25;  ///< a tag's print, facing the light
  bool clutter = true;             ///< otherwise an even grey background
};

/// A body in the scene: tags over a surface, both in the body's frame.
struct SceneBody {
  TaggedBody tags;
  TriangleMesh surface;  ///< may be empty; colours, where present, give the albedo
  double albedo = 0.55;  ///< 0..1, of a surface without colours
};

/// Where a body is while the shutter is open.
struct BodyExposure {
  Rigid3 camera_from_body;   ///< at mid-exposure
  std::vector<Rigid3> path;  ///< equally weighted sub-exposures; empty: standing still
};

/// Immutable after construction; render() may be called from many threads.
class CameraRenderer {
 public:
  /// Fails for tags of unknown family or id.
  static Result<CameraRenderer> create(const CameraModel& camera, std::vector<SceneBody> bodies,
                                       const RenderOptions& options);
  CameraRenderer(CameraRenderer&&) noexcept;
  CameraRenderer& operator=(CameraRenderer&&) noexcept;
  ~CameraRenderer();

  /// One frame; `exposures` in the order of the bodies. Noise depends on the seed and `frame` alone.
  Image8 render(const std::vector<BodyExposure>& exposures, std::uint32_t frame) const;
  /// The same light before noise, saturation and rounding, row-major (for tests).
  std::vector<float> light(const std::vector<BodyExposure>& exposures) const;

  /// Sub-exposures that this movement asks for (1 when no tag moves more than 0.3 px, at most 6).
  int sub_exposures(std::size_t body, const Rigid3& shutter_opens, const Rigid3& shutter_closes) const;

 private:
  struct Impl;
  explicit CameraRenderer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace gnathion
