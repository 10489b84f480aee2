// How the window looks: one sheet for all, readable on any screen.
#pragma once

#include <QString>

namespace gnathion {

QString window_style();

}  // namespace gnathion
