// One log for the whole process, on stderr. spdlog stays behind this header.
#pragma once

#include <string_view>

namespace gnathion {

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

void set_log_level(LogLevel level);  ///< default: kWarning
void log(LogLevel level, std::string_view message);

}  // namespace gnathion
