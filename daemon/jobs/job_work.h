// The folder of one running job, and how what it made comes to its place: whole, by rename, or not at all.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "daemon/api_error.h"
#include "daemon/jobs/job_table.h"
#include "pipeline/case_path.h"

namespace gnathion::daemon {

struct JobOrder {
  std::string case_id, kind;
  std::vector<std::pair<std::string, std::string>> values;
  bool force = false;
  std::string who;
};

/// An order that has been checked: what to run, and where its outputs go.
struct JobPlan {
  const JobKind* kind = nullptr;
  std::filesystem::path case_folder, work;  ///< work: CASE/.jobs/ID, all that is half-made
  std::vector<std::string> arguments;       ///< without the program
  struct Output {
    std::filesystem::path made, final_place;  ///< folder in `work` whose content goes to that folder
    std::string shown;                        ///< inside the case's folder
  };
  std::vector<Output> outputs;
  bool force = false;
};

/// Refused: an unknown kind or option, a missing one, a number that is none, a path that leaves the case or
/// is not there, an output that exists (unless forced). Nothing is made yet.
ApiResult<JobPlan> plan_job(const CaseRoot& root, const JobOrder& order, const std::string& id);

/// Makes the work folder with its output folders.
Status prepare(const JobPlan& plan);
/// Everything that was made goes to its place; what stood there is replaced when forced.
Status publish(const JobPlan& plan);
/// Removes the work folder and what the process `pid` left half-written in the case's folder.
void clean(const JobPlan& plan, int pid);
/// After a crash: removes the work folders of all cases and what processes that are gone left half-written.
/// A folder that was being replaced is put back. Returns one line for each case that had something.
std::vector<std::string> clean_after_crash(const CaseRoot& root);

}  // namespace gnathion::daemon
