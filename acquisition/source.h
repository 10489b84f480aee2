#pragma once
#include "core/source.h"
