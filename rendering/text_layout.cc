// Texts cut and broken to a width.
#include "rendering/drawing.h"

namespace gnathion {
namespace {

/// Start of the UTF-8 character that ends before `end`.
std::size_t previous(const std::string& text, std::size_t end) {
  do --end;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xc0) == 0x80);
  return end;
}

/// The longest beginning (whole characters, at least one) that fits.
std::size_t fitting(const std::string& text, double width_pt, double size_pt, bool bold) {
  std::size_t end = text.size();
  while (end > 1 && text_width_pt(text.substr(0, end), size_pt, bold) > width_pt) {
    const std::size_t shorter = previous(text, end);
    if (shorter == 0) break;
    end = shorter;
  }
  return end;
}

}  // namespace

std::string text_fitted(const std::string& text, double width_pt, double size_pt, bool bold) {
  if (text_width_pt(text, size_pt, bold) <= width_pt) return text;
  const double room = width_pt - text_width_pt("…", size_pt, bold);
  return text.substr(0, fitting(text, room, size_pt, bold)) + "…";
}

std::vector<std::string> text_wrapped(const std::string& text, double width_pt, double size_pt, bool bold) {
  std::vector<std::string> lines;
  std::string line;
  const auto flush = [&] {
    lines.push_back(line);
    line.clear();
  };
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t space = std::min(text.find(' ', at), text.size());
    std::string word = text.substr(at, space - at);
    at = space + 1;
    const std::string longer = line.empty() ? word : line + " " + word;
    if (text_width_pt(longer, size_pt, bold) <= width_pt) {
      line = longer;
      continue;
    }
    if (!line.empty()) flush();
    while (text_width_pt(word, size_pt, bold) > width_pt) {
      const std::size_t end = fitting(word, width_pt, size_pt, bold);
      if (end >= word.size()) break;
      lines.push_back(word.substr(0, end));
      word.erase(0, end);
    }
    line = word;
  }
  if (!line.empty() || lines.empty()) flush();
  return lines;
}

}  // namespace gnathion
