// Lets a module's own steps move one step of the whole.
#pragma once

#include <string_view>

#include "core/progress.h"

namespace gnathion {

/// Begins one step of `parent`; the steps begun here only move its fraction.
class NestedProgress : public Progress {
 public:
  NestedProgress(Progress& parent, std::string_view name, double share) : parent_(parent) {
    parent_.begin_step(name, share);
  }
  void begin_step(std::string_view, double share) override {
    done_ += share_;
    share_ = share;
    parent_.update(done_ < 1 ? done_ : 1);
  }
  void update(double fraction) override {
    // A module that begins no steps of its own reports on the whole.
    const double f = share_ > 0 ? done_ + share_ * fraction : fraction;
    parent_.update(f < 1 ? f : 1);
  }

 private:
  Progress& parent_;
  double done_ = 0, share_ = 0;
};

}  // namespace gnathion
