#include "daemon/jobs/job_work.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <stdio.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <optional>
#include <regex>
#include <set>
#include <sstream>

#include "daemon/client_path.h"
#include "pipeline/case_file.h"
#include "pipeline/case_steps.h"

namespace gnathion::daemon {
namespace {

namespace fs = std::filesystem;
constexpr const char* kJobs = ".jobs";

bool is_number(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' && std::isfinite(value);
}

tl::unexpected<ApiError> wrong(const JobKind& kind, const std::string& why) {
  return refuse(ApiCode::kInvalidArgument, fmt::format("cannot {}: {}", kind.name, why));
}

std::string names_of(const std::vector<JobOption>& options) {
  std::string names;
  for (const JobOption& option : options) names += (names.empty() ? "" : ", ") + option.name;
  return names;
}

/// Adds one option to the plan's command line.
class PlanWriter {
 public:
  PlanWriter(const CaseRoot& root, JobPlan& plan) : root_(root), plan_(plan) {}

  ApiStatus add(const JobOption& option, const std::string& value) {
    if (value.size() > 4096) return wrong(*plan_.kind, option.name + " is longer than 4096 bytes");
    switch (option.type) {
      case OptionType::kText:
        break;
      case OptionType::kNumber:
        if (!is_number(value))
          return wrong(*plan_.kind, fmt::format("'{}' must be a number, not '{}'", option.name, value));
        break;
      case OptionType::kNumbers:
        return add_numbers(option, value);
      case OptionType::kFlag:
        if (value != "true" && value != "false")
          return wrong(*plan_.kind, fmt::format("'{}' must be true or false", option.name));
        if (value == "true") plan_.arguments.push_back("--" + option.name);
        return {};
      case OptionType::kInput:
        return add_input(option, value);
      case OptionType::kOutput:
        return add_output(option, value);
    }
    plan_.arguments.push_back(fmt::format("--{}={}", option.name, value));
    return {};
  }

 private:
  /// What a job may not replace: the case itself, its identity, what it was given, what others work in.
  static bool keeps_the_case(const fs::path& in_case) {
    if (may_hold_identity(in_case) || in_case.filename() == "viewer.json") return true;
    for (const fs::path& part : in_case)
      if (part.string().front() == '.') return true;
    for (const char* kept : {"scans", "bodies", "recordings"})
      if (*in_case.begin() == kept) return true;
    return false;
  }
  /// Every result in a folder has its JSON; a folder of folders is none. An empty one may go.
  static bool holds_a_result(const fs::path& folder) {
    std::error_code ec;
    const fs::directory_iterator entries(folder, ec);
    return fs::is_empty(folder, ec) || std::any_of(begin(entries), end(entries), [](const auto& entry) {
             std::error_code unread;
             return entry.is_regular_file(unread) && entry.path().extension() == ".json";
           });
  }
  ApiStatus add_numbers(const JobOption& option, const std::string& value) {
    std::string spaced = value;
    std::replace(spaced.begin(), spaced.end(), ',', ' ');
    std::istringstream words(spaced);
    const std::vector<std::string> numbers{std::istream_iterator<std::string>(words), {}};
    if (numbers.empty()) return wrong(*plan_.kind, fmt::format("'{}' is empty", option.name));
    for (const std::string& number : numbers)
      if (!is_number(number))
        return wrong(*plan_.kind,
                     fmt::format("'{}' must be numbers, as 1.5 2 3, not '{}'", option.name, value));
    plan_.arguments.push_back("--" + option.name);
    plan_.arguments.insert(plan_.arguments.end(), numbers.begin(), numbers.end());
    return {};
  }
  ApiStatus add_input(const JobOption& option, const std::string& value) {
    const auto path = path_in_case(root_, plan_.case_folder, value, PathUse::kExisting);
    if (!path) return tl::unexpected(path.error());
    plan_.arguments.push_back(fmt::format("--{}={}", option.name, path->string()));
    return {};
  }
  ApiStatus add_output(const JobOption& option, const std::string& value) {
    const auto path = output_in_case(root_, plan_.case_folder, value);
    if (!path) return tl::unexpected(path.error());
    if (keeps_the_case(path->lexically_relative(plan_.case_folder)))
      return wrong(*plan_.kind, fmt::format("'{}' is no name for an output: choose another", value));
    std::error_code ec;
    if (fs::exists(*path, ec) && !plan_.force)
      return refuse(ApiCode::kAlreadyExists, fmt::format("{} exists; force replaces it", value));
    if (fs::is_directory(*path, ec) && !holds_a_result(*path))
      return wrong(*plan_.kind,
                   fmt::format("'{}' holds no result that could be replaced: choose another", value));
    const fs::path made = plan_.work / option.name;
    plan_.outputs.push_back({made, path->parent_path(), value});
    plan_.arguments.push_back(fmt::format("--{}={}", option.name, (made / path->filename()).string()));
    return {};
  }
  const CaseRoot& root_;
  JobPlan& plan_;
};

ApiStatus add_values(const JobOrder& order, PlanWriter& writer, const JobKind& kind) {
  std::set<std::string> given;
  for (const auto& [name, value] : order.values) {
    const auto option = std::find_if(kind.options.begin(), kind.options.end(),
                                     [&, n = name](const JobOption& o) { return o.name == n; });
    if (option == kind.options.end())
      return wrong(kind, fmt::format("it has no option '{}'; it has {}", name, names_of(kind.options)));
    if (!given.insert(name).second && !option->repeated)
      return wrong(kind, fmt::format("'{}' is given twice", name));
    if (const ApiStatus added = writer.add(*option, value); !added) return added;
  }
  for (const JobOption& option : kind.options)
    if (option.required && !given.count(option.name))
      return wrong(kind, fmt::format("'{}' is missing", option.name));
  return {};
}

/// What is at `to` goes away; for folders the two change places first, so that one of them is always there.
Status replace(const fs::path& from, const fs::path& to) {
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return {};
  if (errno == EEXIST && ::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_EXCHANGE) == 0)
    return {};  // the old one goes with the work folder
  return fail(ErrorCode::kInternal, "cannot put in place", to.string(), std::strerror(errno));
}

/// ".NAME.staging.PID", ".NAME.part.PID", ".NAME.old.PID": core/file.cc.
struct Leftover {
  std::string name, kind;
  int pid = 0;
};
std::optional<Leftover> leftover(const std::string& file) {
  static const std::regex pattern(R"(^\.(.+)\.(staging|part|old)\.([0-9]{1,9})$)");
  std::smatch m;
  if (!std::regex_match(file, m, pattern)) return std::nullopt;
  return Leftover{m[1], m[2], std::atoi(m[3].str().c_str())};
}

bool alive(int pid) {
  return pid > 0 && (::kill(pid, 0) == 0 || errno == EPERM);
}

/// Below `folder`, of this process; 0: of all that are gone. How many there were.
int remove_leftovers(const fs::path& folder, int pid) {
  std::vector<fs::path> found;
  std::error_code ec;
  for (auto it = fs::recursive_directory_iterator(folder, ec);
       !ec && it != fs::recursive_directory_iterator(); it.increment(ec)) {
    const auto left = leftover(it->path().filename().string());
    if (!left || (pid != 0 ? left->pid != pid : alive(left->pid))) continue;
    found.push_back(it->path());
    it.disable_recursion_pending();
  }
  for (const fs::path& path : found) {
    const auto left = leftover(path.filename().string());
    const fs::path whole = path.parent_path() / left->name;
    if (left->kind == "old" && !fs::exists(whole, ec))
      fs::rename(path, whole, ec);  // was being replaced
    else
      fs::remove_all(path, ec);
  }
  return static_cast<int>(found.size());
}

}  // namespace

ApiResult<JobPlan> plan_job(const CaseRoot& root, const JobOrder& order, const std::string& id) {
  JobPlan plan;
  plan.kind = find_job_kind(order.kind);
  if (!plan.kind) {
    std::string known;
    for (const JobKind& kind : job_kinds()) known += (known.empty() ? "" : ", ") + kind.name;
    return refuse(ApiCode::kInvalidArgument,
                  fmt::format("there is no job '{}'; there are {}", order.kind, known));
  }
  const auto folder = root.case_folder(order.case_id);
  if (!folder) return refuse(ApiCode::kNotFound, folder.error().line());
  plan.case_folder = *folder;
  plan.work = *folder / kJobs / id;
  plan.force = order.force;
  plan.arguments = plan.kind->words;
  if (plan.kind->takes_case) {
    // The command reads case.toml as its owner would; what that names must lie in the case.
    const auto files = read_case(*folder, CaseTrust::kConfined);
    if (!files) return refuse(files.error());
    plan.arguments.push_back(folder->string());
  }
  PlanWriter writer(root, plan);
  if (const ApiStatus added = add_values(order, writer, *plan.kind); !added)
    return tl::unexpected(added.error());
  plan.arguments.push_back("--json");
  if (order.force) plan.arguments.push_back("--force");
  return plan;
}

Status prepare(const JobPlan& plan) {
  std::error_code ec;
  fs::remove_all(plan.work, ec);
  fs::create_directories(plan.work, ec);
  for (const JobPlan::Output& output : plan.outputs) fs::create_directories(output.made, ec);
  if (ec) return fail(ErrorCode::kInternal, "cannot begin job", plan.work.string(), ec.message());
  return {};
}

Status publish(const JobPlan& plan) {
  for (const JobPlan::Output& output : plan.outputs) {
    std::vector<fs::path> made;
    std::error_code ec;
    for (const auto& entry : fs::directory_iterator(output.made, ec)) made.push_back(entry.path());
    std::sort(made.begin(), made.end());
    fs::create_directories(output.final_place, ec);
    if (ec) return fail(ErrorCode::kInternal, "cannot write", output.shown, ec.message());
    for (const fs::path& path : made) {
      const fs::path to = output.final_place / path.filename();
      if (!plan.force && fs::exists(fs::symlink_status(to, ec)))
        return fail(ErrorCode::kUsage, "cannot write", output.shown, "appeared while the job ran");
      GNATHION_CHECK_OK(replace(path, to));
    }
  }
  return {};
}

void clean(const JobPlan& plan, int pid) {
  std::error_code ec;
  fs::remove_all(plan.work, ec);
  fs::remove(plan.work.parent_path(), ec);  // when it is empty
  if (pid <= 0) return;
  remove_leftovers(plan.case_folder, pid);
  if (plan.kind->takes_case) clean_interrupted_run(plan.case_folder);
}

std::vector<std::string> clean_after_crash(const CaseRoot& root) {
  std::vector<std::string> lines;
  std::error_code ec;
  for (const auto& entry : fs::directory_iterator(root.path(), ec)) {
    if (entry.is_symlink(ec) || !entry.is_directory(ec)) continue;
    if (const auto left = leftover(entry.path().filename().string())) {  // a case that was being made
      if (!alive(left->pid)) lines.push_back("removed a case that was being made: " + left->name);
      if (!alive(left->pid)) fs::remove_all(entry.path(), ec);
      continue;
    }
    std::uintmax_t removed = 0;
    if (fs::exists(entry.path() / kJobs, ec)) removed = fs::remove_all(entry.path() / kJobs, ec);
    const int left = remove_leftovers(entry.path(), 0);
    const bool run = clean_interrupted_run(entry.path());
    if (removed > 0 || left > 0 || run)
      lines.push_back(fmt::format("case {}: removed what interrupted jobs had left half-made",
                                  entry.path().filename().string()));
  }
  return lines;
}

}  // namespace gnathion::daemon
