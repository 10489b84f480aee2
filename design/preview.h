// The splint while a parameter is dragged: coarse, unverified, and made from what the last one left.
#pragma once

#include <memory>

#include "core/mesh.h"
#include "core/result.h"
#include "design/parameters.h"
#include "design/splint.h"

namespace gnathion {

struct SplintPreview {
  TriangleMesh splint;  ///< Dental; surface as extracted, largest piece, neither pressed nor verified
  ArchFrame arch;
  Insertion insertion;
  std::vector<std::string> warnings;
  StageTimes timing_s;  ///< of the stages that were done anew
};

/// Keeps the stages of the last preview with what each was made of: the supporting arch (jaws, insertion,
/// depth), the opposing arch in TP (T_th), distances on coarse grids, and makes anew only what has changed.
/// The same answer as without a memory. One thread at a time; it may be any thread.
class SplintPreviewer {
 public:
  static constexpr double kVoxelMm = 0.3;

  SplintPreviewer();
  ~SplintPreviewer();
  /// At kVoxelMm, whatever `parameters` say. Refused like design_splint.
  Result<SplintPreview> build(const SplintInputs& inputs, const SplintParameters& parameters);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace gnathion
