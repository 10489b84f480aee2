// For this module's tests: a source that plays samples which a test made.
#pragma once

#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "core/source.h"

namespace gnathion::testing {

class ListSource : public Source {
 public:
  explicit ListSource(std::vector<Sample> samples) : samples_(samples.begin(), samples.end()) {}
  Result<std::optional<Sample>> next() override {
    if (samples_.empty()) return std::optional<Sample>();
    std::optional<Sample> sample(std::move(samples_.front()));
    samples_.pop_front();
    return sample;
  }

 private:
  std::deque<Sample> samples_;
};

}  // namespace gnathion::testing
