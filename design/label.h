// A label embossed on the splint's outer wall, where there is room.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "design/label_text.h"
#include "design/preparation.h"

namespace gnathion {

/// What label and wall are measured with; all at a point of the design frame, mm.
struct LabelSurroundings {
  std::function<double(const Vector3&)> body;      ///< distance from the splint's outer body
  std::function<double(const Vector3&)> opposing;  ///< from the opposing arch in TP and on its ways
};

/// What to emboss, the fullest first: the label with the hash of parameters, edits and T_th (six hex digits),
/// and the label alone. Nothing where no label was asked for.
std::vector<std::string> label_texts(const SplintInputs& inputs, const SplintParameters& parameters);

/// Letters that stand kProudMm out of the wall. The text runs along the arch, upright as the patient stands,
/// readable from outside (buccal) or from the palate.
class Label {
 public:
  static constexpr double kProudMm = 0.35;
  /// Looks for the flattest part of the buccal or palatal wall that holds the text, with letters of 3, 2.5 or
  /// 2 mm, away from the rim and 1 mm from the opposing arch; behind the canines, if need be in front.
  /// Nothing where there is none.
  static std::optional<Label> placed(const std::string& text, const Preparation& preparation,
                                     const SplintParameters& parameters,
                                     const LabelSurroundings& surroundings);

  /// The body with the letters on it, which keep their distance from the opposing arch and its ways.
  double raised_mm(const Vector3& p_mm, double body_mm, double opposing_mm) const;

  const std::string& text() const { return text_; }
  bool buccal() const { return buccal_; }
  double letter_mm() const { return glyphs_->height_mm(); }
  double width_mm() const { return glyphs_->width_mm(); }
  Vector3 centre_mm() const { return centre_mm_; }  ///< on the wall, design frame

 private:
  std::string text_;
  std::shared_ptr<const LabelText> glyphs_;
  bool buccal_ = true;
  double up_ = 1.0;                ///< along z
  std::vector<Vector3> baseline_;  ///< on the wall, at half of the letters' height, in reading direction
  std::vector<double> along_mm_;   ///< of each of these, from the text's left end
  Vector3 centre_mm_ = Vector3::Zero();
  double reach_mm_ = 0.0;  ///< from the baseline, across z: the wall that bears the text, and no other
  Box box_;                ///< of all that can be raised
};

}  // namespace gnathion
