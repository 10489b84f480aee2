// Named surfaces of the 3D view: what they look like, whether they show. GUI thread only.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/mesh.h"
#include "rendering/scene.h"
#include "viewer/model/listeners.h"

namespace gnathion {

using VertexColors = std::vector<std::array<std::uint8_t, 3>>;

struct Layer {
  std::string id;     ///< stable: "maxilla", "splint"
  std::string name;   ///< as shown
  std::string group;  ///< heading in the list: "Patient", "Design", …
  std::shared_ptr<const TriangleMesh> mesh;
  std::shared_ptr<const VertexColors> colors;  ///< per vertex of mesh; null: color_3d
  Color color_3d = palette::kToothIvory;
  Color color_2d = {0, 0, 0};  ///< of its profile, the method's colours
  double width_2d_px = 1.5;
  double opacity = 1.0;
  bool visible = true;
  bool in_section = true;
  Rigid3 pose;  ///< dental_from_mesh
};

/// What changed about a layer; the scene does no more than that asks.
enum class LayerChange { kAdded, kRemoved, kLook, kPose, kSurface };

class LayerModel {
 public:
  /// Adds the layer, or replaces the one of the same id: its visibility and opacity stay as the user left
  /// them.
  void put(Layer layer);
  void remove(const std::string& id);
  void clear();
  void set_visible(const std::string& id, bool visible);
  void set_opacity(const std::string& id, double opacity);
  void set_pose(const std::string& id, const Rigid3& pose);
  void set_colors(const std::string& id, std::shared_ptr<const VertexColors> colors);

  const std::vector<Layer>& layers() const { return layers_; }
  const Layer* find(const std::string& id) const;
  bool shows(const std::string& id) const;

  Listeners<const std::string&, LayerChange> changed;

 private:
  Layer* at(const std::string& id);
  std::vector<Layer> layers_;
};

}  // namespace gnathion
