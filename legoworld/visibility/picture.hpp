// Tiles go to the picture, and between two rounds come back from it. Included once per instruction set.

constexpr int32_t kCacheLine = 64;  // bytes

// Rows go to memory past the caches when they are whole cache lines of a picture that would not fit.
static inline bool streams(const Frame& frame, const int32_t* instance, const float* depth) {
#if defined(__x86_64__)
  constexpr int64_t kInCache = int64_t{1} << 20;  // pixels
  return static_cast<int64_t>(frame.width) * frame.height > kInCache && frame.width % 16 == 0 &&
         reinterpret_cast<uintptr_t>(instance) % kCacheLine == 0 &&
         reinterpret_cast<uintptr_t>(depth) % kCacheLine == 0;
#else
  return static_cast<void>(frame), static_cast<void>(instance), static_cast<void>(depth), false;
#endif
}

// Between two rounds the picture holds the tiles as they are, with holdouts and open pixels.
static void store_tile(const Frame& frame, Tile& tile, SoFar& so_far, int64_t index, int32_t* instance,
                      float* depth) {
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = static_cast<int64_t>(tile.top + r) * frame.width + tile.left;
    const auto columns = static_cast<size_t>(tile.columns);
    std::memcpy(instance + at, tile.id + r * kStride, columns * sizeof(int32_t));
    std::memcpy(depth + at, tile.depth + r * kStride, columns * sizeof(float));
  }
  float* blocks = so_far.blocks.data() + index * (kBlocks * kBlocks);
  float farthest = -INFINITY;
  for (int block = 0; block < kBlocks * kBlocks; ++block) {
    blocks[block] = tile.farthest_of(block);
    farthest = blocks[block] > farthest ? blocks[block] : farthest;
  }
  so_far.tiles.data()[index] = farthest;
}

static void load_tile(const Frame& frame, Tile& tile, const SoFar& so_far, int64_t index,
                    const int32_t* instance, const float* depth) {
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = static_cast<int64_t>(tile.top + r) * frame.width + tile.left;
    const auto columns = static_cast<size_t>(tile.columns);
    std::memcpy(tile.id + r * kStride, instance + at, columns * sizeof(int32_t));
    std::memcpy(tile.depth + r * kStride, depth + at, columns * sizeof(float));
  }
  const float* blocks = so_far.blocks.data() + index * (kBlocks * kBlocks);
  std::memcpy(tile.farthest, blocks, sizeof tile.farthest);
}

// Without holdouts and open pixels.
static inline void finish_row(const int32_t* __restrict from_id, const float* __restrict from_depth,
                              int32_t columns, int32_t* __restrict ids, float* __restrict depths) {
  for (int32_t c = 0; c < columns; ++c) {
    const bool there = from_id[c] >= 0 && from_id[c] != INT32_MAX;
    ids[c] = there ? from_id[c] : kNothing;
    depths[c] = there ? from_depth[c] : INFINITY;
  }
}

#if defined(__x86_64__)
template <class Element>
static inline void stream_row(const Element* from, int32_t columns, Element* to) {
  for (int32_t c = 0; c < columns; c += 4) {
    _mm_stream_si128(reinterpret_cast<__m128i*>(to + c), load<__m128i>(from + c));
  }
}
#endif

// Rows of a tile lie far apart in the picture, where no hardware expects the next one.
template <class Element>
static inline void expect_row(int32_t count, const Element* row) {
  for (int32_t i = 0; i < count; i += kCacheLine / 4) __builtin_prefetch(row + i, 1);
}
constexpr int32_t kAhead = 4;  // rows

static void write_tile(const Frame& frame, const Tile& tile, int32_t* instance, float* depth) {
  const bool past_cache = streams(frame, instance, depth);
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = static_cast<int64_t>(tile.top + r) * frame.width + tile.left;
    const float* from_depth = tile.depth + r * kStride;
    const int32_t* from_id = tile.id + r * kStride;
    if (!past_cache) {
      const int64_t ahead = at + int64_t{kAhead} * frame.width;
      if (r + kAhead < tile.rows) {
        expect_row(tile.columns, instance + ahead);
        expect_row(tile.columns, depth + ahead);
      }
      finish_row(from_id, from_depth, tile.columns, instance + at, depth + at);
      continue;
    }
#if defined(__x86_64__)
    int32_t ids[kTile];
    float depths[kTile];
    finish_row(from_id, from_depth, kTile, ids, depths);
    stream_row(ids, tile.columns, instance + at);
    stream_row(depths, tile.columns, depth + at);
#endif
  }
}
