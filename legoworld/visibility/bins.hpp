// What the first pass leaves for the tiles: one list of samples and one of triangles per worker and tile.
#pragma once
#include "team.hpp"

namespace lw {

struct Sample {      // a pixel of the tile a small triangle covers
  float depth;       // as it will be stored
  int32_t id;
  uint32_t pixel;    // offset into the tile's buffers
};

struct Candidate {        // a triangle that may cover pixels of the tile
  float nearest;          // no sample of it has a smaller stored depth
  uint32_t triangle;      // local to the mesh
  uint32_t placement;
  uint8_t x0, x1, y0, y1; // pixels inside the tile, both ends included
};

template <class Record>
struct Block {
  Block* older;
  uint32_t capacity;
  Record records[1];
};

// A list that is only appended to. The newest block is the only one that is not full.
template <class Record>
struct Bin {
  Block<Record>* newest;
  uint32_t used;

  void push(Arena& arena, const Record& record) {
    if (newest == nullptr || used == newest->capacity) grow(arena);
    newest->records[used++] = record;
  }

  template <class Visit>
  void each_block(Visit&& visit) const {
    uint32_t count = used;
    for (const Block<Record>* block = newest; block != nullptr; block = block->older) {
      visit(block->records, count);
      if (block->older != nullptr) count = block->older->capacity;
    }
  }

 private:
  void grow(Arena& arena) {
    const uint32_t capacity = newest == nullptr ? 10 : (newest->capacity < 100 ? 84 : 340);
    auto* block = static_cast<Block<Record>*>(
        arena.take(sizeof(Block<Record>) + sizeof(Record) * (capacity - 1)));
    block->older = newest;
    block->capacity = capacity;
    newest = block;
    used = 0;
  }
};

// Where a sample comes from, as one number that orders ties of one instance.
inline int64_t source_of(uint32_t placement, uint32_t triangle) {
  return static_cast<int64_t>(placement) << 32 | triangle;
}

struct TileBins {
  Bin<Sample> samples;
  Bin<Candidate> candidates;
  Bin<int64_t> sources;  // one for each sample, in the same order; empty where nobody asks
};

}  // namespace lw
