// The interactive 3D view of a report: meshes simplified, quantised and packed into the HTML itself.
#pragma once

#include <string>

#include "evaluation/evaluation.h"

namespace gnathion {

struct HtmlViewOptions {
  std::size_t triangles = 14000;  ///< of each mesh, for viewing
  double range_mm = 0.3;          ///< of the colours at the start
};

/// A <div> with canvas, controls, data and script; nothing is fetched. Its #view-status gets data-drawn="yes"
/// after the first frame, with data-coverage (share of covered pixels) and data-error (of WebGL, 0: none).
std::string html_view(const std::vector<SplintEvaluation>& splints, const HtmlViewOptions& options);

/// pipeline/html_view.js, put in at build time.
extern const char* const kHtmlViewScript;

}  // namespace gnathion
