#include "acquisition/camera/natural_order.h"

#include <cctype>

namespace gnathion {
namespace {

bool digit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

/// The run of digits that starts at `i`, without leading zeros.
std::string number_at(const std::string& s, std::size_t i, std::size_t* end) {
  std::size_t e = i;
  while (e < s.size() && digit(s[e])) ++e;
  *end = e;
  while (i + 1 < e && s[i] == '0') ++i;
  return s.substr(i, e - i);
}

}  // namespace

bool natural_less(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (digit(a[i]) && digit(b[j])) {
      std::size_t i_end = 0, j_end = 0;
      const std::string x = number_at(a, i, &i_end), y = number_at(b, j, &j_end);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
      i = i_end, j = j_end;
    } else {
      if (a[i] != b[j]) return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
      ++i, ++j;
    }
  }
  if (i < a.size() || j < b.size()) return j < b.size();
  return a.size() != b.size() ? a.size() < b.size() : a < b;
}

std::optional<std::vector<std::uint64_t>> frame_numbers(const std::vector<std::string>& sorted_names) {
  std::vector<std::uint64_t> numbers;
  std::string prefix;
  for (const std::string& name : sorted_names) {
    std::size_t end = name.rfind('.');
    if (end == std::string::npos) end = name.size();
    while (end > 0 && !digit(name[end - 1])) --end;
    std::size_t begin = end;
    while (begin > 0 && digit(name[begin - 1])) --begin;
    if (begin == end || end - begin > 15) return std::nullopt;
    if (numbers.empty()) prefix = name.substr(0, begin);
    if (name.compare(0, begin, prefix) != 0) return std::nullopt;
    numbers.push_back(std::stoull(name.substr(begin, end - begin)));
    if (numbers.size() > 1 && numbers.back() <= numbers[numbers.size() - 2]) return std::nullopt;
  }
  if (numbers.empty() || numbers.back() - numbers.front() + 1 > 2 * numbers.size()) return std::nullopt;
  return numbers;
}

}  // namespace gnathion
