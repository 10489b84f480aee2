// recording capture: live devices into a recording.
#pragma once

#include "cli/command.h"

namespace gnathion {

void add_capture(CLI::App& recording, ChosenCommand& chosen);

}  // namespace gnathion
