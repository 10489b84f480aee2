// The frames of one case: what `gnathion run` registered, and what case.toml adds by hand.
#pragma once

#include <filesystem>

#include "calibration/frames_graph.h"
#include "core/result.h"
#include "pipeline/case_file.h"
#include "pipeline/run_case.h"

namespace gnathion {

/// Frames: dental, bow, bow_tp, face_mi, face_tp, head_frame, camera, intraoral_tp, mandible_tp (the
/// mandible's own frame, equal to dental in MI), cbct. T_D seats the bow in MI and in TP alike and is one
/// estimate. Two intraoral scans of TP take part where the case has them; that they cannot be registered is a
/// note.
Result<FramesGraph> frames_of_run(const CaseFile& files, const CaseResults& results,
                                  std::vector<std::string>& notes);

/// Adds the [[frame]] tables of case.toml (docs/formats.md). A surface that is to be registered is.
Status add_frames_by_hand(const CaseFile& files, FramesGraph& graph);

/// The graph of a case folder: results/frames.json where it has been run, and case.toml's own edges as they
/// stand now.
Result<FramesGraph> read_case_frames(const std::filesystem::path& folder);

}  // namespace gnathion
