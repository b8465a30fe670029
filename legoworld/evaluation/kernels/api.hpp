// What the functions of this library answer.

#pragma once

#include "exported.hpp"

constexpr int kDone = 0, kNoMemory = 1, kTooMany = 2, kUnsound = 3;
