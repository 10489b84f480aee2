// What `gnathion bow print` does: bow and head frame for one patient, ready to print and to tag.
#pragma once

#include <filesystem>
#include <vector>

#include "core/progress.h"
#include "core/result.h"
#include "design/bow/bow.h"

namespace gnathion {

struct BowPrintJob {
  std::filesystem::path maxilla, mandible;        ///< in MI, one frame
  std::vector<std::filesystem::path> transforms;  ///< positions of the mandible that must stay clear: T_th
};

/// Reads the jaws and designs.
Result<BowDesign> run_bow_print(const BowPrintJob& job, const BowParameters& parameters, Progress& progress);

/// Into a folder that exists: bow.stl, head_frame.stl (named *.rejected.stl where a gate fails), bow.toml,
/// head_frame.toml, tags.pdf, bow.json, pictures/*.png.
Status write_bow_print(const BowPrintJob& job, const BowDesign& design, const BowParameters& parameters,
                       const std::filesystem::path& folder, Progress& progress);

/// tags.pdf alone: sheets of both bodies and the page that shows where each tag goes.
Status write_tag_sheets(const std::filesystem::path& pdf, const std::vector<const TaggedBody*>& bodies,
                        double side_mm);

}  // namespace gnathion
