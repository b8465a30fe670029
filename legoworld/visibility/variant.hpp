// Everything that is compiled once per instruction set, in order. Included by kernel.cpp only.
#include "lanes.hpp"
#include "edges.hpp"
#include "screen_bounds.hpp"
#include "cull.hpp"
#include "bin.hpp"
#include "tile.hpp"
#include "spans.hpp"
#include "draw.hpp"
#include "picture.hpp"
#include "validation.hpp"
#include "coverage.hpp"
#include "render.hpp"
#undef LW_EACH
