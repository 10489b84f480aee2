#pragma once
#include "core/sample.h"
