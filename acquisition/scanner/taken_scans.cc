#include "acquisition/scanner/taken_scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

#include "core/file.h"

namespace gnathion {

Result<TakenScans> TakenScans::load(const std::filesystem::path& file) {
  TakenScans taken;
  taken.file_ = file;
  std::error_code ec;
  if (!std::filesystem::exists(file, ec)) return taken;
  GNATHION_TRY(const std::string text, read_file(file));
  std::istringstream lines(text);
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (line.empty()) continue;
    const bool good = line.size() > 66 && line.compare(64, 2, "  ") == 0 &&
                      std::all_of(line.begin(), line.begin() + 64,
                                  [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
    if (!good)
      return bad_input("cannot read list of taken scans", file.string(),
                       fmt::format("line {} is not \"sha256  name\"; mend or remove the file", number));
    taken.names_[line.substr(0, 64)] = line.substr(66);
  }
  return taken;
}

const std::string* TakenScans::find(const std::string& sha256) const {
  const auto found = names_.find(sha256);
  return found == names_.end() ? nullptr : &found->second;
}

Status TakenScans::add(const std::string& sha256, const std::string& name) {
  std::string shown = name;
  std::replace_if(
      shown.begin(), shown.end(), [](unsigned char c) { return c < 0x20; }, '_');
  names_[sha256] = shown;
  std::string text;
  for (const auto& [hash, known] : names_) text += fmt::format("{}  {}\n", hash, known);
  return write_file(file_, text);
}

Result<ScansUnderway> ScansUnderway::load(const std::filesystem::path& file) {
  ScansUnderway underway;
  underway.file_ = file;
  std::error_code ec;
  if (!std::filesystem::exists(file, ec)) return underway;
  GNATHION_TRY(const std::string text, read_file(file));
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    if (!line.empty()) underway.names_.insert(line);
  return underway;
}

Status ScansUnderway::set(std::set<std::string> names) {
  // A name with a line's end in it cannot stand on a line; such a file is not remembered.
  std::erase_if(names, [](const std::string& name) { return name.find('\n') != std::string::npos; });
  if (names == names_) return {};
  names_ = std::move(names);
  if (names_.empty()) {
    std::error_code ec;
    std::filesystem::remove(file_, ec);
    return {};
  }
  std::string text;
  for (const std::string& name : names_) text += name + "\n";
  return write_file(file_, text);
}

}  // namespace gnathion
