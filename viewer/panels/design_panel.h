// Design: parameters with a preview, the full build, gates, maps of the splint, edits by hand, comparison.
#pragma once

#include <memory>

#include <nlohmann/json_fwd.hpp>

#include "design/preview.h"
#include "viewer/model/splint_maps.h"
#include "viewer/panels/compare_tools.h"
#include "viewer/panels/edit_tools.h"
#include "viewer/panels/margin_tools.h"
#include "viewer/panels/panel.h"
#include "viewer/panels/parameter_page.h"
#include "viewer/widgets/parts.h"

class QCheckBox;
class QTabWidget;

namespace gnathion {

class DesignPanel : public Panel {
 public:
  explicit DesignPanel(Workbench& bench);
  void enter() override;
  void leave() override;
  std::set<std::string> first_layers() const override {
    return {"maxilla", worn() == Arch::kMaxilla ? "mandible_tp" : "mandible_mi", "splint"};
  }

 private:
  QWidget* make_gates();
  void opened();
  void show_state();
  void show_gates();
  void build();
  void build_by_daemon();
  void built(const std::filesystem::path& folder, bool cancelled, const std::string& trouble);
  void preview();
  void make_maps();
  void put_maps(const SplintMaps& maps, const std::vector<float>& undercut,
                const std::vector<ToothLabel>& teeth, Arch arch);
  void show_marks();
  void click_gate(int row);
  Vector3 place_of(const std::string& gate) const;
  void show_scale();
  Arch worn() const;
  void pose_jaws();

  StepStatus* status_;
  QTabWidget* tabs_;
  ParameterPage* parameters_;
  QCheckBox *preview_, *numbers_, *margin_, *apertures_;
  QPushButton *build_, *cancel_;
  QTableWidget* gates_;
  QLabel *verdict_, *preview_note_;
  EditTools* edits_;
  MarginTools* margins_;
  CompareTools* compare_;
  std::uint64_t previews_asked_ = 0;
  std::vector<std::string> gate_names_;
  std::shared_ptr<const nlohmann::json> report_;
  std::shared_ptr<const SplintMaps> maps_;
  Arch maps_arch_ = Arch::kMaxilla;  ///< that wears the splint which was measured
  std::vector<ToothLabel> teeth_;
  bool on_lower_ = false;  ///< the jaws stand as for a splint of the lower teeth
  std::shared_ptr<SplintPreviewer> previewer_ = std::make_shared<SplintPreviewer>();
};

}  // namespace gnathion
