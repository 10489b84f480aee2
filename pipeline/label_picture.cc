#include "pipeline/label_picture.h"

#include <algorithm>

#include "rendering/scene.h"

namespace gnathion {
namespace fs = std::filesystem;

Status draw_label(const SplintDesign& design, const fs::path& folder) {
  if (!design.label) return {};
  const EmbossedLabel& label = *design.label;
  const double reach_mm = 0.5 * label.width_mm + 4.0;
  std::vector<bool> keep(design.splint.triangles.size());
  for (std::size_t t = 0; t < keep.size(); ++t)
    keep[t] = (design.splint.corner(t, 0) - label.centre_mm).norm() < reach_mm;
  const TriangleMesh about = submesh(design.splint, keep);
  SceneMesh item;
  item.mesh = &about;
  item.color = palette::kSplintClear;
  const ArchRuler ruler(design.arch);
  const Vector3 outward = ruler.outward(ruler.measure(label.centre_mm).s_mm);
  PictureOptions o;
  o.title = "Label: " + label.text;
  std::error_code ec;
  fs::create_directories(folder / "pictures", ec);
  return render_scene(folder / "pictures" / "label.png", {item}, {},
                      {label.buccal ? outward : Vector3(-outward), design.arch.up, 1.0}, o);
}

}  // namespace gnathion
