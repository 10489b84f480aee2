// File names as people number them: frame_9 before frame_10.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace gnathion {

/// Runs of digits compare as numbers, everything else by byte; equal numbers by their length ("7" before
/// "07").
bool natural_less(const std::string& a, const std::string& b);

/// The running number that each name carries (its last run of digits before the extension), where all names
/// agree in what stands before it, the numbers rise, and gaps do not make up more than half; else nothing.
std::optional<std::vector<std::uint64_t>> frame_numbers(const std::vector<std::string>& sorted_names);

}  // namespace gnathion
