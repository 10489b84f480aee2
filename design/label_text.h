// Text as a flat shape with distances.
#pragma once

#include <string>
#include <vector>

namespace gnathion {

/// Outlines of a line of text, `height_mm` tall, its lower left corner at the origin, sampled every 0.05 mm.
class LabelText {
 public:
  LabelText(const std::string& text, double height_mm);
  double width_mm() const { return width_mm_; }
  double height_mm() const { return height_mm_; }
  /// Signed distance across the text to the nearest outline, negative in the strokes; told up to 0.6 mm about
  /// the text, larger beyond. Strokes are widened to what prints.
  double distance_mm(double x_mm, double y_mm) const;

 private:
  double width_mm_ = 0.0, height_mm_ = 0.0;
  int nx_ = 0, ny_ = 0;
  std::vector<float> values_;
};

}  // namespace gnathion
