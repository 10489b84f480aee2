// Labels embossed on the buccal side: which case, which parameters.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "design/edits.h"
#include "design/splint_field.h"

namespace gnathion {

/// Strokes of one line of text as polylines: baseline along x, capitals one unit high, 0.6 + 0.25 wide.
/// Letters A to Z (small ones as capitals), digits, - . / and space; anything else becomes a space.
std::vector<std::vector<Eigen::Vector2d>> stroked_text(std::string_view text);
double stroked_text_width(std::string_view text);

/// The text as strokes that add material to the outer surface, in the design frame, where there is room on
/// the buccal side: full walls, away from rim and opposing arch. Empty where no place is large enough.
std::vector<Stroke> embossed_label(std::string_view text, const SplintField& field, Arch arch);

/// Six hexadecimal digits that name parameters, T_th and edits.
std::string parameters_hash(const SplintInputs& inputs, const SplintParameters& parameters);

}  // namespace gnathion
