// What every function of this library is declared with, and what it answers.

#pragma once

#if defined(_WIN32)
#define LW_API extern "C" __declspec(dllexport)
#else
#define LW_API extern "C" __attribute__((visibility("default")))
#endif

constexpr int kDone = 0, kNoMemory = 1, kTooMany = 2, kUnsound = 3;
