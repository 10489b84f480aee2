// Which commands of `gnathion` clients may have run, and with which options. What is not here cannot be asked
// for; every path among the options is held inside the case's folder.
#pragma once

#include <string>
#include <vector>

namespace gnathion::daemon {

/// kNumbers: some numbers with spaces or commas between them, passed as an argument each.
enum class OptionType { kText, kNumber, kNumbers, kFlag, kInput, kOutput };

struct JobOption {
  std::string name;  ///< "maxilla", passed as --maxilla=VALUE
  OptionType type = OptionType::kText;
  bool required = false, repeated = false;
};

struct JobKind {
  std::string name, help;
  std::vector<std::string> words;  ///< of the command: {"calibrate", "camera"}
  bool takes_case = false;         ///< the case's folder is the command's argument
  std::vector<JobOption> options;
};

const std::vector<JobKind>& job_kinds();
const JobKind* find_job_kind(const std::string& name);

}  // namespace gnathion::daemon
