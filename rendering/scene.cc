#include "rendering/scene.h"

#include <vtkImageData.h>
#include <vtkJPEGWriter.h>
#include <vtkNew.h>
#include <vtkUnsignedCharArray.h>

#include "core/file.h"
#include "rendering/raster.h"

namespace gnathion {
namespace {

constexpr Color kInk = {0.12, 0.12, 0.15};

/// Lines, title, and a bar of ten millimetres: the projection is parallel, so one bar holds for the whole
/// picture. In pixels.
Drawing notes_of(const std::vector<SceneLine>& lines, const Projection& projection,
                 const PictureOptions& options) {
  Drawing out(options.width_px, options.height_px);
  for (const SceneLine& line : lines) {
    std::vector<Point2> points;
    for (const Vector3& p : line.points_mm) points.emplace_back(projection.seen(p).head<2>());
    out.path(std::move(points), false, stroked(line.color, line.width_px));
  }
  TextStyle style;
  style.color = kInk;
  style.size_pt = 23;
  if (!options.title.empty())
    out.text({24, 42}, text_fitted(options.title, options.width_px - 48.0, style.size_pt), style);
  if (options.scale_bar) {
    const double x1 = options.width_px - 40.0, x0 = x1 - 10.0 * projection.px_per_mm;
    const double y = options.height_px - 40.0;
    out.path({{x0, y - 6}, {x0, y}, {x1, y}, {x1, y - 6}}, false, stroked(kInk, 3));
    style.size_pt = 19;
    out.text({x0, y - 12}, "10 mm", style);
  }
  return out;
}

struct Drawn {
  Projection projection;
  Pixels pixels;
};

Result<Drawn> drawn(const std::vector<SceneMesh>& meshes, const std::vector<SceneLine>& lines,
                    const SceneView& view, const PictureOptions& options) {
  const Projection projection(meshes, view, options.width_px, options.height_px);
  Drawn out{projection, rasterized(meshes, projection)};
  GNATHION_CHECK_OK(paint(notes_of(lines, projection, options), 1.0, out.pixels));
  return out;
}

Result<std::string> jpeg_bytes(const Pixels& pixels) {
  vtkNew<vtkImageData> image;
  image->SetDimensions(pixels.width_px, pixels.height_px, 1);
  image->AllocateScalars(VTK_UNSIGNED_CHAR, 3);
  auto* to = static_cast<unsigned char*>(image->GetScalarPointer());
  for (int y = pixels.height_px - 1; y >= 0; --y)  // VTK's rows run upwards
    for (int x = 0; x < pixels.width_px; ++x) {
      const std::uint32_t rgb =
          pixels.rgb[static_cast<std::size_t>(y) * static_cast<std::size_t>(pixels.width_px) +
                     static_cast<std::size_t>(x)];
      for (const int shift : {16, 8, 0}) *to++ = static_cast<unsigned char>(rgb >> shift);
    }
  vtkNew<vtkJPEGWriter> writer;
  writer->SetQuality(88);
  writer->SetInputData(image);
  writer->WriteToMemoryOn();
  writer->Write();
  vtkUnsignedCharArray* bytes = writer->GetResult();
  if (!bytes || bytes->GetNumberOfValues() == 0)
    return fail(ErrorCode::kInternal, "cannot draw", "picture", "nothing came out of the JPEG writer");
  return std::string(reinterpret_cast<const char*>(bytes->GetPointer(0)),
                     static_cast<std::size_t>(bytes->GetNumberOfValues()));
}

}  // namespace

Result<RenderedView> render_view(const std::vector<SceneMesh>& meshes, const std::vector<SceneLine>& lines,
                                 const SceneView& view, const PictureOptions& options) {
  GNATHION_TRY(const Drawn picture, drawn(meshes, lines, view, options));
  RenderedView out;
  GNATHION_TRY(out.png, png_bytes(picture.pixels));
  GNATHION_TRY(out.jpeg, jpeg_bytes(picture.pixels));
  out.width_px = options.width_px;
  out.height_px = options.height_px;
  out.px_per_mm = picture.projection.px_per_mm;
  return out;
}

Status render_scene(const std::filesystem::path& png, const std::vector<SceneMesh>& meshes,
                    const std::vector<SceneLine>& lines, const SceneView& view,
                    const PictureOptions& options) {
  GNATHION_TRY(const Drawn picture, drawn(meshes, lines, view, options));
  GNATHION_TRY(const std::string bytes, png_bytes(picture.pixels));
  return write_file(png, bytes);
}

}  // namespace gnathion
