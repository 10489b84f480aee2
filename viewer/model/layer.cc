#include "viewer/model/layer.h"

#include <algorithm>

namespace gnathion {

Layer* LayerModel::at(const std::string& id) {
  const auto it = std::find_if(layers_.begin(), layers_.end(), [&](const Layer& l) { return l.id == id; });
  return it == layers_.end() ? nullptr : &*it;
}

const Layer* LayerModel::find(const std::string& id) const {
  return const_cast<LayerModel*>(this)->at(id);
}

bool LayerModel::shows(const std::string& id) const {
  const Layer* layer = find(id);
  return layer && layer->visible;
}

void LayerModel::put(Layer layer) {
  const std::string id = layer.id;
  if (Layer* old = at(id)) {
    layer.visible = old->visible;
    layer.opacity = old->opacity;
    *old = std::move(layer);
    changed(id, LayerChange::kSurface);
    return;
  }
  layers_.push_back(std::move(layer));
  changed(id, LayerChange::kAdded);
}

void LayerModel::remove(const std::string& id) {
  const std::string name = id;  // the caller's may be the layer's own
  const auto it = std::find_if(layers_.begin(), layers_.end(), [&](const Layer& l) { return l.id == name; });
  if (it == layers_.end()) return;
  layers_.erase(it);
  changed(name, LayerChange::kRemoved);
}

void LayerModel::clear() {
  while (!layers_.empty()) remove(layers_.back().id);
}

void LayerModel::set_visible(const std::string& id, bool visible) {
  Layer* layer = at(id);
  if (!layer || layer->visible == visible) return;
  layer->visible = visible;
  changed(id, LayerChange::kLook);
}

void LayerModel::set_opacity(const std::string& id, double opacity) {
  Layer* layer = at(id);
  if (!layer || layer->opacity == opacity) return;
  layer->opacity = opacity;
  changed(id, LayerChange::kLook);
}

void LayerModel::set_pose(const std::string& id, const Rigid3& pose) {
  Layer* layer = at(id);
  if (!layer) return;
  layer->pose = pose;
  changed(id, LayerChange::kPose);
}

void LayerModel::set_colors(const std::string& id, std::shared_ptr<const VertexColors> colors) {
  Layer* layer = at(id);
  if (!layer) return;
  layer->colors = std::move(colors);
  changed(id, LayerChange::kSurface);
}

}  // namespace gnathion
