// How PLUS names transforms, and how ours are named for it.
#pragma once

#include <cctype>
#include <string>

namespace gnathion {

/// Seconds since 1970 of the sequence's time 0, where the sequence was written by us.
inline constexpr const char* kPlusStartField = "RecordingStartTimestamp";

/// Status of a transform in a frame where something else was measured, but not it.
inline constexpr const char* kPlusNotMeasured = "NOT_MEASURED";

struct PlusNames {
  std::string from, to;
};
/// "StylusToTracker": the pose of Stylus in Tracker. A name without "To" is a pose in "Tracker".
inline PlusNames split_transform_name(const std::string& name) {
  for (std::size_t at = name.find("To", 1); at != std::string::npos; at = name.find("To", at + 1))
    if (at + 2 < name.size() && std::isupper(static_cast<unsigned char>(name[at + 2])))
      return {name.substr(0, at), name.substr(at + 2)};
  return {name, "Tracker"};
}

/// "head_frame" as PLUS writes names: "HeadFrame".
inline std::string plus_name(const std::string& name) {
  std::string out;
  bool capital = true;
  for (const char c : name) {
    const auto u = static_cast<unsigned char>(c);
    if (!std::isalnum(u)) {
      capital = true;
      continue;
    }
    out += capital ? static_cast<char>(std::toupper(u)) : c;
    capital = false;
  }
  return out.empty() ? "Unnamed" : out;
}

}  // namespace gnathion
