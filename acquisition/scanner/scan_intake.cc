#include "acquisition/scanner/scan_intake.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace gnathion {
namespace {

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

std::string file_part(const std::string& name) {
  return name.substr(name.find_last_of('/') + 1);  // npos + 1 is 0
}

}  // namespace

bool is_temporary_name(const std::string& path) {
  const std::string name = lower(file_part(path));
  if (name.empty() || name.front() == '.' || name.front() == '~' || name.back() == '~') return true;
  for (const char* end : {".part", ".tmp", ".temp", ".partial", ".crdownload", ".filepart", ".swp"})
    if (ends_with(name, end)) return true;
  return false;
}

bool is_mesh_name(const std::string& path) {
  const std::string name = lower(path);
  return !is_temporary_name(path) &&
         (ends_with(name, ".obj") || ends_with(name, ".ply") || ends_with(name, ".stl"));
}

void ScanIntake::ignore_present(const Listing& listing) {
  for (const auto& [name, state] : listing) {
    File file;
    file.state = state;
    file.done = true;
    // A texture that stands there already is as good as one that comes.
    file.closed = true;
    files_[name] = file;
  }
}

void ScanIntake::note(const std::string& name, FileEvent event) {
  if (event == FileEvent::kLost) {
    for (auto& [other, file] : files_) file.written = file.closed = false;
    early_.clear();
    return;
  }
  const auto found = files_.find(name);
  if (found == files_.end()) {
    early_[name] = event;
    return;
  }
  File& file = found->second;
  file.written = event == FileEvent::kWritten;
  file.closed = !file.written;
  if (file.closed && file.given_up) {
    file.given_up = file.done = file.aside = false;
    file.why.clear();
  }
}

void ScanIntake::update(const Listing& listing, HostTime now) {
  for (auto it = files_.begin(); it != files_.end();)
    it = listing.count(it->first) ? std::next(it) : files_.erase(it);
  for (const auto& [name, state] : listing) {
    const auto [it, is_new] = files_.try_emplace(name);
    File& file = it->second;
    if (is_new) file.first_seen = now;
    const bool spoken = file.done && !file.given_up;
    if (!is_new && (spoken ? file.state.same_content(state) : file.state == state)) continue;
    // A done file that changes is another scan under an old name.
    if (file.done) file.first_seen = now;
    file.state = state;
    file.last_change = now;
    file.done = file.aside = file.given_up = false;
    file.why = state.problem;
  }
  for (const auto& [name, event] : early_)
    if (files_.count(name)) note(name, event);
  early_.clear();
}

bool ScanIntake::settled(const File& file, HostTime now) const {
  if (!file.state.problem.empty() || file.written) return false;
  const std::int64_t still_ns = now.ns - file.last_change.ns;
  return still_ns >= (file.closed ? options_.settle_ns : options_.settle_unseen_ns);
}

bool ScanIntake::is_settled(const std::string& name, HostTime now) const {
  const auto found = files_.find(name);
  return found != files_.end() && settled(found->second, now);
}

std::vector<std::string> ScanIntake::ready(HostTime now) const {
  std::vector<std::pair<std::int64_t, std::string>> found;
  for (const auto& [name, file] : files_)
    if (is_mesh_name(name) && !file.done && !file.aside && settled(file, now))
      found.emplace_back(file.first_seen.ns, name);
  std::sort(found.begin(), found.end());
  std::vector<std::string> names;
  for (auto& [seen, name] : found) names.push_back(std::move(name));
  return names;
}

std::vector<ScanIntake::GivenUp> ScanIntake::overdue(HostTime now) {
  std::vector<GivenUp> out;
  for (auto& [name, file] : files_) {
    if (!is_mesh_name(name) || file.done || now.ns - file.last_change.ns < options_.incomplete_ns) continue;
    if (!file.aside && settled(file, now) && file.why.empty()) continue;  // about to be looked at
    const double waited_s = static_cast<double>(now.ns - file.last_change.ns) * 1e-9;
    const std::string why =
        !file.why.empty() ? file.why : "its writer has not closed it; end or restart the scanner's program";
    out.push_back({name, fmt::format("not complete after {:.0f} s: {}", waited_s, why)});
    file.given_up = file.done = true;
  }
  return out;
}

void ScanIntake::close_case(const std::string& name) {
  const auto found = files_.find(name);
  if (found != files_.end()) found->second.done = true;
}

void ScanIntake::set_aside(const std::string& name, const std::string& why) {
  const auto found = files_.find(name);
  if (found == files_.end()) return;
  found->second.aside = true;
  found->second.why = why;
}

void ScanIntake::hold(const std::string& name, const std::string& why) {
  const auto found = files_.find(name);
  if (found != files_.end()) found->second.why = why;
}

std::optional<HostTime> ScanIntake::first_seen(const std::string& name) const {
  const auto found = files_.find(name);
  if (found == files_.end()) return std::nullopt;
  return found->second.first_seen;
}

std::optional<HostTime> ScanIntake::last_change(const std::string& name) const {
  const auto found = files_.find(name);
  if (found == files_.end()) return std::nullopt;
  return found->second.last_change;
}

std::optional<FileState> ScanIntake::state_of(const std::string& name) const {
  const auto found = files_.find(name);
  if (found == files_.end()) return std::nullopt;
  return found->second.state;
}

std::vector<std::string> ScanIntake::waiting() const {
  std::vector<std::string> names;
  for (const auto& [name, file] : files_)
    if (is_mesh_name(name) && !file.done) names.push_back(name);
  return names;
}

}  // namespace gnathion
