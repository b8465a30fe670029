// What every exported function is declared with, and what a library says of its sources.

#pragma once

#if defined(_WIN32)
#define LW_API extern "C" __declspec(dllexport)
#else
#define LW_API extern "C" __attribute__((visibility("default")))
#endif

#ifndef LEGOWORLD_SOURCE_HASH
#error "compile with -DLEGOWORLD_SOURCE_HASH=\"...\", as setup.py does"
#endif
