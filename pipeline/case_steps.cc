#include "pipeline/case_steps.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>

#include "core/file.h"
#include "core/interrupt.h"
#include "core/transform_io.h"
#include "core/utc.h"
#include "pipeline/build_id.h"
#include "pipeline/case_private.h"
#include "pipeline/version.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;
constexpr const char* kWhat = "cannot run case";
constexpr const char* kRecord = "step.json";

fs::path steps_of(const fs::path& folder) {
  return folder / ".steps";
}

tl::unexpected<Error> cannot(const fs::path& where, const std::string& why) {
  return fail(ErrorCode::kInternal, kWhat, where.string(), why);
}

/// What the key is the hash of. Paths are not in it: a case may move.
std::string key_of(const StepSpec& spec, const StepRecord& record, const std::vector<StepRecord>& earlier) {
  json k = {{"step", spec.name},
            {"step_version", spec.version},
            {"version", kVersion},
            {"build", record.build},
            {"parameters", json::parse(record.parameters)},
            {"inputs", json::object()},
            {"uses", json::object()}};
  for (const StepInput& in : spec.inputs)
    if (in.path.empty()) k["inputs"][in.role] = nullptr;
  for (const FileRecord& in : record.inputs) {
    if (!in.from_step) k["inputs"][in.role] = in.sha256;
    for (const StepRecord& s : earlier)
      if (in.from_step && s.step == in.role) k["uses"][in.path] = s.key;
  }
  return sha256_hex(k.dump());
}

/// Device, inode, size and time of writing; of a folder, of all files in it. As in sha256_of() links to
/// folders are not followed.
std::string stamp_of(const fs::path& path, bool named = true) {
  struct stat s {};
  if (::stat(path.c_str(), &s) != 0) return "gone";
  std::error_code link;
  if (!named && S_ISDIR(s.st_mode) && fs::is_symlink(path, link)) return "";
  std::string text =
      fmt::format("{} {} {} {}.{}", s.st_dev, s.st_ino, s.st_size, s.st_mtim.tv_sec, s.st_mtim.tv_nsec);
  if (!S_ISDIR(s.st_mode)) return text;
  std::vector<std::string> all;
  std::error_code ec;
  for (const auto& entry : fs::directory_iterator(path, ec))
    all.push_back(entry.path().filename().string() + " " + stamp_of(entry.path(), false) + "\n");
  std::sort(all.begin(), all.end());
  for (const std::string& one : all) text += "\n" + one;
  return sha256_hex(text);
}

std::string what_changed(const json& was, const json& is) {
  std::string text;
  if (!was.is_object() || !is.is_object()) return "parameters changed";
  for (const auto& [key, value] : is.items())
    if (!was.contains(key) || was[key] != value)
      text += fmt::format("{}{}: {} became {}", text.empty() ? "" : ", ", key,
                          was.contains(key) ? was[key].dump().substr(0, 60) : "nothing",
                          value.dump().substr(0, 60));
  for (const auto& [key, value] : was.items())
    if (!is.contains(key)) text += fmt::format("{}{} is no more", text.empty() ? "" : ", ", key);
  return text.empty() ? "parameters changed" : text;
}

/// Why a step that was made as `was` says cannot stand for one that is to be made as `is` says.
std::string why_again(const StepRecord& was, const StepRecord& is) {
  if (was.program != is.program) return "made by gnathion " + was.program;
  if (was.version != is.version) return "the step itself is another version";
  if (was.build != is.build) return "made by another build of gnathion";
  const json before = json::parse(was.parameters, nullptr, false),
             now = json::parse(is.parameters, nullptr, false);
  if (before != now) return what_changed(before, now);
  const auto find = [](const StepRecord& r, const FileRecord& f) -> const FileRecord* {
    for (const FileRecord& o : r.inputs)
      if (o.from_step == f.from_step && o.role == f.role && (!f.from_step || o.path == f.path)) return &o;
    return nullptr;
  };
  std::string text;
  for (const FileRecord& f : is.inputs) {
    const FileRecord* old = find(was, f);
    if (old != nullptr && (f.from_step || old->sha256 == f.sha256)) continue;
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", f.from_step ? f.path : f.role,
                        old == nullptr ? "is new" : "changed");
  }
  for (const FileRecord& f : was.inputs)
    if (find(is, f) == nullptr)
      text += fmt::format("{}{} is no more", text.empty() ? "" : ", ", f.from_step ? f.path : f.role);
  return text.empty() ? "a step before it was redone" : text;
}

Result<std::vector<FileRecord>> hash_outputs(const fs::path& folder) {
  std::vector<FileRecord> out;
  std::error_code ec;
  for (auto it = fs::recursive_directory_iterator(folder, ec);
       !ec && it != fs::recursive_directory_iterator(); it.increment(ec)) {
    const std::string path = it->path().lexically_relative(folder).generic_string();
    if (it->is_directory() || path == kRecord) continue;
    GNATHION_TRY(std::string sha, sha256_of(it->path()));
    out.push_back({"", path, std::move(sha), false, false});
  }
  if (ec) return cannot(folder, ec.message());
  std::sort(out.begin(), out.end(), [](const FileRecord& a, const FileRecord& b) { return a.path < b.path; });
  return out;
}

/// "" where every output is what it was.
std::string damage_of(const fs::path& folder, const StepRecord& record) {
  const auto now = hash_outputs(folder);
  if (!now) return now.error().why;
  std::map<std::string, std::string> hashes;
  for (const FileRecord& f : *now) hashes[f.path] = f.sha256;
  for (const FileRecord& f : record.outputs) {
    const auto found = hashes.find(f.path);
    if (found == hashes.end()) return "its result " + f.path + " is gone";
    if (found->second != f.sha256) return "its result " + f.path + " was changed since";
  }
  return now->size() == record.outputs.size() ? "" : "a file was put among its results";
}

/// JSON results say themselves where they come from.
Status tell_provenance(const fs::path& out, const StepRecord& record) {
  json provenance = step_json(record);
  provenance.erase("outputs");
  std::error_code ec;
  for (auto it = fs::directory_iterator(out, ec); !ec && it != fs::directory_iterator(); it.increment(ec)) {
    if (it->path().extension() != ".json") continue;
    GNATHION_TRY(json j, read_json(it->path()));
    if (!j.is_object()) continue;
    j["provenance"] = provenance;
    GNATHION_CHECK_OK(write_json(it->path(), j));
  }
  return {};
}

/// The same file under a second name where the file system can, else a copy.
Status link_or_copy(const fs::path& from, const fs::path& to) {
  std::error_code ec;
  fs::create_directories(to.parent_path(), ec);
  fs::create_hard_link(from, to, ec);
  if (!ec) return {};
  fs::copy_file(from, to, ec);
  return ec ? Status(cannot(to, ec.message())) : Status();
}

Status exchange(const fs::path& a, const fs::path& b) {
  if (::renameat2(AT_FDCWD, a.c_str(), AT_FDCWD, b.c_str(), RENAME_EXCHANGE) == 0) return {};
  if (errno != EINVAL && errno != ENOSYS) return cannot(b, std::strerror(errno));
  // A file system that cannot: two renames, and the next run mends what a kill between them leaves.
  std::error_code ec;
  const fs::path aside = a.string() + ".old";
  fs::remove_all(aside, ec);
  fs::rename(b, aside, ec);
  if (!ec) fs::rename(a, b, ec);
  if (!ec) fs::rename(aside, a, ec);
  return ec ? Status(cannot(b, ec.message())) : Status();
}

/// A folder, and no link to one: what a link leads to is not this case's.
bool is_own_folder(const fs::path& path) {
  std::error_code ec;
  return fs::is_directory(fs::symlink_status(path, ec));
}

/// Of a run that was killed: steps half-made, results half put together. With the case's lock.
void remove_parts(const fs::path& folder) {
  const fs::path results = folder / "results", staging = folder / ".results.part";
  std::error_code ec;
  if (!fs::exists(results, ec) && fs::exists(staging.string() + ".old", ec))
    fs::rename(staging.string() + ".old", results, ec);
  for (const fs::path& path : {staging, fs::path(staging.string() + ".old")}) fs::remove_all(path, ec);
  if (!is_own_folder(steps_of(folder))) return;
  for (const auto& entry : fs::directory_iterator(steps_of(folder), ec)) {
    std::error_code one;
    if (entry.path().filename().string().front() == '.') fs::remove_all(entry.path(), one);
  }
}

}  // namespace

bool clean_interrupted_run(const fs::path& folder) {
  std::error_code ec;
  const fs::path staging = folder / ".results.part";
  bool any = fs::exists(staging, ec) || fs::exists(staging.string() + ".old", ec);
  if (is_own_folder(steps_of(folder)))
    for (const auto& entry : fs::directory_iterator(steps_of(folder), ec))
      any = any || entry.path().filename().string().front() == '.';
  if (!any) return false;
  const auto lock = CaseLock::take(folder, kWhat);
  if (!lock) return false;  // one is at work there
  remove_parts(folder);
  return true;
}

CaseSteps::CaseSteps(fs::path folder, std::string id, bool force, Clock& clock, CaseLock lock)
    : folder_(std::move(folder)), id_(std::move(id)), force_(force), clock_(&clock), lock_(std::move(lock)) {}

Result<CaseSteps> CaseSteps::open(const fs::path& folder, const std::string& case_id, bool force,
                                  Clock& clock) {
  GNATHION_TRY(CaseLock lock, CaseLock::take(folder, kWhat));
  const fs::path results = folder / "results";
  remove_parts(folder);
  std::error_code ec;
  const fs::file_status status = fs::symlink_status(results, ec);
  if (fs::exists(status) && !fs::is_directory(status))
    return fail(ErrorCode::kUsage, kWhat, results.string(), "is not a folder; move it away");
  if (fs::exists(status) && !fs::is_empty(results, ec) && !fs::exists(results / "provenance.json", ec) &&
      !force)
    return fail(ErrorCode::kUsage, "cannot write", results.string(),
                "exists, and does not say where it comes from; --force replaces it");
  fs::create_directory(steps_of(folder), ec);
  if (ec) return cannot(folder, ec.message());
  if (!is_own_folder(steps_of(folder)))
    return fail(ErrorCode::kUsage, kWhat, steps_of(folder).string(),
                "is a link; steps are kept in the case itself");
  GNATHION_CHECK_OK(make_private(steps_of(folder)));
  return CaseSteps(folder, case_id, force, clock, std::move(lock));
}

Result<std::string> CaseSteps::hash_of(const fs::path& path) {
  const auto known = hashes_.find(path.string());
  if (known != hashes_.end()) return known->second.sha256;
  const std::string stamp = stamp_of(path);
  GNATHION_TRY(std::string sha, sha256_of(path));
  hashes_[path.string()] = {sha, stamp};
  return sha;
}

Status CaseSteps::know(const fs::path& input) {
  if (input.empty()) return {};
  GNATHION_TRY(const std::string sha, hash_of(input));
  return {};
}

/// What a step says that it read is what it read.
Status CaseSteps::inputs_stand() const {
  for (const auto& [path, known] : hashes_)
    if (stamp_of(path) != known.stamp)
      return bad_input(kWhat, path, "was changed while the case was run; run it again");
  return {};
}

Result<StepRecord> CaseSteps::record_for(const StepSpec& spec) {
  StepRecord r;
  r.step = spec.name;
  r.version = spec.version;
  r.program = kVersion;
  r.build = build_id();
  r.parameters = spec.parameters.empty() ? "{}" : spec.parameters;
  for (const StepInput& in : spec.inputs) {
    if (in.path.empty()) continue;
    GNATHION_TRY(const std::string sha, hash_of(in.path));
    const fs::path relative = in.path.lexically_relative(folder_);
    const bool inside = !relative.empty() && *relative.begin() != "..";
    r.inputs.push_back(
        {in.role, inside ? relative.generic_string() : in.path.filename().string(), sha, false, !inside});
  }
  for (const auto& [step, file] : spec.uses) {
    const auto from =
        std::find_if(records_.begin(), records_.end(), [&](const StepRecord& s) { return s.step == step; });
    if (from == records_.end()) return cannot(step, spec.name + " builds on it, and it was not run");
    const auto output = std::find_if(from->outputs.begin(), from->outputs.end(),
                                     [&](const FileRecord& f) { return f.path == file; });
    if (output == from->outputs.end()) return cannot(step, "it made no " + file);
    r.inputs.push_back({step, file, output->sha256, true, false});
  }
  r.key = key_of(spec, r, records_);
  return r;
}

Result<fs::path> CaseSteps::run(const StepSpec& spec, const Work& work) {
  GNATHION_TRY(StepRecord record, record_for(spec));
  const fs::path place = steps_of(folder_) / spec.name;
  StepOutcome outcome{spec.name, false, "never ran"};
  std::error_code ec;
  if (fs::exists(place / kRecord, ec)) {
    const auto j = read_json(place / kRecord);
    const auto old = j ? step_from_json(*j, (place / kRecord).string()) : tl::unexpected<Error>(j.error());
    if (!old) {
      outcome.why = "its record cannot be read";
    } else if (force_) {
      outcome.why = "--force";
    } else if (old->key != record.key) {
      outcome.why = why_again(*old, record);
    } else if (outcome.why = damage_of(place, *old); outcome.why.empty()) {
      outcome = {spec.name, true, "nothing changed"};
      records_.push_back(*old);
      outcomes_.push_back(outcome);
      return place;
    }
  }
  GNATHION_CHECK_OK(make(spec, work, record));
  records_.push_back(std::move(record));
  outcomes_.push_back(std::move(outcome));
  return place;
}

Status CaseSteps::make(const StepSpec& spec, const Work& work, StepRecord& record) {
  const fs::path place = steps_of(folder_) / spec.name,
                 part = steps_of(folder_) / ("." + spec.name + ".part");
  const GoesWhenInterrupted half_made(part);
  std::error_code ec;
  fs::remove_all(part, ec);
  fs::create_directory(part, ec);
  if (ec) return cannot(part, ec.message());
  record.time = utc_text(clock_->now());
  const auto finish = [&]() -> Status {
    GNATHION_CHECK_OK(work(part, record));
    GNATHION_CHECK_OK(inputs_stand());
    GNATHION_CHECK_OK(tell_provenance(part, record));
    GNATHION_TRY(record.outputs, hash_outputs(part));
    GNATHION_CHECK_OK(write_json(part / kRecord, step_json(record)));
    GNATHION_CHECK_OK(make_private(part));
    const InterruptsWait interrupts_wait;
    fs::remove_all(place, ec);
    fs::rename(part, place, ec);
    return ec ? Status(cannot(place, ec.message())) : Status();
  };
  const Status done = finish();
  if (!done) fs::remove_all(part, ec);
  return done;
}

bool CaseSteps::published(const Provenance& now) const {
  const auto was = read_provenance(folder_);
  if (!was || was->steps.size() != now.steps.size()) return false;
  std::error_code ec;
  for (std::size_t i = 0; i < now.steps.size(); ++i) {
    if (was->steps[i].key != now.steps[i].key || was->steps[i].time != now.steps[i].time) return false;
    for (const FileRecord& f : now.steps[i].outputs) {
      const fs::path shown = folder_ / "results" / f.path;
      if (fs::equivalent(shown, steps_of(folder_) / now.steps[i].step / f.path, ec))
        continue;  // hashed already
      const auto sha = sha256_of(shown);
      if (!sha || *sha != f.sha256) return false;
    }
  }
  return true;
}

Status CaseSteps::keep_foreign(const fs::path& staging) const {
  const auto was = read_provenance(folder_);
  if (!was) return {};  // forced over a folder that was not of a run
  std::set<std::string> ours = {"provenance.json"};
  for (const StepRecord& s : was->steps)
    for (const FileRecord& f : s.outputs) ours.insert(f.path);
  const fs::path results = folder_ / "results";
  std::error_code ec;
  for (auto it = fs::recursive_directory_iterator(results, ec);
       !ec && it != fs::recursive_directory_iterator(); it.increment(ec)) {
    const fs::path relative = it->path().lexically_relative(results);
    if (!it->is_regular_file(ec) || it->is_symlink(ec) || ours.count(relative.generic_string()) != 0)
      continue;
    if (!fs::exists(staging / relative, ec)) GNATHION_CHECK_OK(link_or_copy(it->path(), staging / relative));
  }
  return ec ? Status(cannot(results, ec.message())) : Status();
}

Status CaseSteps::publish() {
  GNATHION_CHECK_OK(inputs_stand());
  Provenance now{id_, kVersion, utc_text(clock_->now()), records_};
  if (published(now)) return {};
  const fs::path results = folder_ / "results", staging = folder_ / ".results.part";
  const GoesWhenInterrupted half_made(staging);
  std::error_code ec;
  fs::remove_all(staging, ec);
  fs::create_directory(staging, ec);
  if (ec) return cannot(staging, ec.message());
  for (const StepRecord& s : records_)
    for (const FileRecord& f : s.outputs)
      GNATHION_CHECK_OK(link_or_copy(steps_of(folder_) / s.step / f.path, staging / f.path));
  GNATHION_CHECK_OK(write_json(staging / "provenance.json", provenance_json(now)));
  if (fs::exists(results, ec)) GNATHION_CHECK_OK(keep_foreign(staging));
  GNATHION_CHECK_OK(make_private(staging));
  const InterruptsWait interrupts_wait;
  if (!fs::exists(results, ec)) {
    fs::rename(staging, results, ec);
    return ec ? Status(cannot(results, ec.message())) : Status();
  }
  GNATHION_CHECK_OK(exchange(staging, results));
  fs::remove_all(staging, ec);
  return {};
}

}  // namespace gnathion
