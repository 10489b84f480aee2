// Report descriptors and reports of foot pedals, for tests.
#pragma once

#include <fstream>
#include <sstream>
#include <string>

namespace gnathion {

inline std::string from_hex(const std::string& text) {
  std::istringstream in(text);
  std::string bytes;
  for (unsigned v = 0; in >> std::hex >> v;) bytes += static_cast<char>(v);
  return bytes;
}

/// Three buttons as the Infinity shows them: button page, usages 1 to 3, in a consumer control.
inline std::string infinity_descriptor() {
  return from_hex("05 0c 09 03 a1 01 05 09 19 01 29 03 15 00 25 01 75 01 95 03 81 02 95 0d 81 01 c0");
}
inline std::string infinity_report(bool left, bool middle, bool right) {
  return {static_cast<char>((left ? 1 : 0) | (middle ? 2 : 0) | (right ? 4 : 0)), '\0'};
}

/// The boot keyboard of HID 1.11, appendix B.1, without its lamps.
inline std::string keyboard_descriptor() {
  return from_hex(
      "05 01 09 06 a1 01 05 07 19 e0 29 e7 15 00 25 01 75 01 95 08 81 02 95 01 75 08 81 01 95 06 75 08 15 00 "
      "25 65 "
      "05 07 19 00 29 65 81 00 c0");
}
/// Keys by their keyboard usage: 4 is "a".
inline std::string keyboard_report(const std::string& keys) {
  std::string report(2, '\0');
  report += keys;
  report.resize(8, '\0');
  return report;
}

/// The first line "LETTER: …" of a hid-recorder file; empty where there is none.
inline std::string line_of(const std::string& path, char letter) {
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);)
    if (line.size() > 3 && line[0] == letter && line[1] == ':') return line.substr(3);
  return {};
}

}  // namespace gnathion
