#include <algorithm>

#include <nlohmann/json.hpp>

#include "calibration/chain_json.h"
#include "viewer/panels/panel.h"

namespace gnathion {
namespace {

struct Look {
  const char *id, *name, *group, *role;
  Color color_3d, color_2d;
  double width_2d_px, opacity;
  bool in_section;
};

constexpr Color kBone = {0.90, 0.87, 0.82}, kSkin = {0.87, 0.72, 0.62};
constexpr Look kLooks[] = {
    {"maxilla", "Maxilla", "Patient", "maxilla_mi", palette::kToothIvory, palette::kMaxilla, 1.8, 1, true},
    {"mandible_tp", "Mandible in TP", "Patient", "mandible_mi", palette::kMandibleIvory, palette::kMandible,
     1.8, 1, true},
    {"mandible_mi",
     "Mandible in MI",
     "Patient",
     "mandible_mi",
     {0.70, 0.78, 0.70},
     {0.52, 0.74, 0.55},
     1.2,
     1,
     true},
    {"mandible_live", "Mandible in motion", "Patient", "mandible_mi", palette::kMandibleIvory,
     palette::kMandible, 1.8, 1, false},
    {"face", "Face", "Patient", "face_mi", kSkin, {0.70, 0.50, 0.40}, 1.2, 0.35, false},
    {"condyle_left", "Left condyle", "Bone", "condyle_left", kBone, {0.45, 0.35, 0.25}, 1.5, 1, true},
    {"condyle_right", "Right condyle", "Bone", "condyle_right", kBone, {0.45, 0.35, 0.25}, 1.5, 1, true},
    {"fossa_left",
     "Left fossa",
     "Bone",
     "fossa_left",
     {0.72, 0.76, 0.82},
     {0.40, 0.45, 0.55},
     1.5,
     0.6,
     true},
    {"fossa_right",
     "Right fossa",
     "Bone",
     "fossa_right",
     {0.72, 0.76, 0.82},
     {0.40, 0.45, 0.55},
     1.5,
     0.6,
     true},
    {"splint", "Splint", "Design", "splint", palette::kSplintClear, palette::kSplint, 2.4, 0.8, true}};

/// The face scan stands in its own frame; the chain brings it to the teeth.
std::optional<Rigid3> dental_from_face(const CaseContent& c) {
  if (!c.chain) return std::nullopt;
  const Result<Chain> chain = chain_from_json(*c.chain, "chain.json");
  if (!chain || !chain->has_faces) return std::nullopt;
  return chain->dental_from_face.value;
}

Layer layer_of(const Look& look, SharedMesh mesh) {
  Layer layer;
  layer.id = look.id;
  layer.name = look.name;
  layer.group = look.group;
  layer.mesh = std::move(mesh);
  layer.color_3d = look.color_3d;
  layer.color_2d = look.color_2d;
  layer.width_2d_px = look.width_2d_px;
  layer.opacity = look.opacity;
  layer.in_section = look.in_section;
  layer.visible = false;
  return layer;
}

}  // namespace

QString Panel::case_folder() const {
  if (!bench_.document.is_open()) return {};
  return QString::fromStdString(bench_.document.content().folder.string());
}

std::vector<Absence> Panel::absences() const {
  std::vector<Absence> out;
  if (!bench_.document.is_open()) return out;
  for (const Absence& a : bench_.document.content().absences)
    if (a.step == step_ || (a.broken && a.step == Step::kCapture)) out.push_back(a);
  return out;
}

void put_patient_layers(Document& document) {
  const CaseContent& c = document.content();
  for (const Look& look : kLooks) {
    const SharedMesh mesh = c.mesh(look.role);
    if (!mesh) continue;
    Layer layer = layer_of(look, mesh);
    if (layer.id == "face") {
      const auto pose = dental_from_face(c);
      if (!pose) continue;  // it would stand somewhere
      layer.pose = *pose;
    }
    if (layer.id == "mandible_tp" && !document.state().therapeutic) continue;
    document.layers().put(std::move(layer));
  }
  pose_patient_layers(document);
}

void put_joint_layers(Document& document, const Joints& joints, bool visible) {
  for (const auto* joint : {&joints.left, &joints.right}) {
    if (!*joint) continue;
    for (const auto& [bone, mesh] :
         {std::pair("condyle_", &(*joint)->condyle), {"fossa_", &(*joint)->fossa}}) {
      const std::string id = std::string(bone) + side_name((*joint)->side);
      if (document.layers().find(id)) continue;
      const auto look =
          std::find_if(std::begin(kLooks), std::end(kLooks), [&](const Look& l) { return id == l.id; });
      Layer layer = layer_of(*look, std::make_shared<const TriangleMesh>(*mesh));
      layer.visible = visible;
      document.layers().put(std::move(layer));
    }
  }
}

void pose_patient_layers(Document& document) {
  const auto& t = document.state().therapeutic;
  if (!t) return;
  LayerModel& layers = document.layers();
  if (!layers.find("mandible_tp")) {
    const Layer* mi = layers.find("mandible_mi");
    if (!mi) return;
    Layer tp = *mi;
    tp.id = "mandible_tp";
    tp.name = "Mandible in TP";
    tp.color_3d = palette::kMandibleIvory;
    tp.color_2d = palette::kMandible;
    tp.visible = true;
    layers.put(std::move(tp));
  }
  layers.set_pose("mandible_tp", *t);
}

}  // namespace gnathion
