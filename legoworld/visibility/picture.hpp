// Tiles go to the picture, and between two rounds come back from it. Included once per instruction set.

// Rows go to memory past the caches when they are whole cache lines of a picture that would not fit.
static inline bool streams(const Frame& frame, const int32_t* instance, const float* depth) {
#if defined(__x86_64__)
  constexpr int64_t kInCache = int64_t{1} << 20;  // pixels
  return static_cast<int64_t>(frame.width) * frame.height > kInCache && frame.width % 16 == 0 &&
         reinterpret_cast<uintptr_t>(instance) % 64 == 0 && reinterpret_cast<uintptr_t>(depth) % 64 == 0;
#else
  return static_cast<void>(frame), static_cast<void>(instance), static_cast<void>(depth), false;
#endif
}

// Between two rounds the picture holds the tiles as they are, with holdouts and open pixels.
static void put_aside(const Frame& frame, Tile& tile, SoFar& so_far, int64_t index, int32_t* instance,
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

static void take_up(const Frame& frame, Tile& tile, const int32_t* instance, const float* depth) {
  for (int32_t r = 0; r < tile.rows; ++r) {
    const int64_t at = static_cast<int64_t>(tile.top + r) * frame.width + tile.left;
    const auto columns = static_cast<size_t>(tile.columns);
    std::memcpy(tile.id + r * kStride, instance + at, columns * sizeof(int32_t));
    std::memcpy(tile.depth + r * kStride, depth + at, columns * sizeof(float));
  }
}

static void write_tile(const Frame& frame, const Tile& tile, int32_t* instance, float* depth) {
  const int32_t columns = tile.columns, rows = tile.rows;
  const bool past_cache = streams(frame, instance, depth);
  for (int32_t r = 0; r < rows; ++r) {
    const int64_t at = static_cast<int64_t>(tile.top + r) * frame.width + tile.left;
    const float* from_depth = tile.depth + r * kStride;
    const int32_t* from_id = tile.id + r * kStride;
    alignas(64) int32_t ids[kTile];
    alignas(64) float depths[kTile];
    for (int32_t c = 0; c < kTile; ++c) {
      const bool there = from_id[c] >= 0 && from_id[c] != INT32_MAX;
      ids[c] = there ? from_id[c] : kNothing;
      depths[c] = there ? from_depth[c] : INFINITY;
    }
    if (past_cache) {
#if defined(__x86_64__)
      for (int32_t c = 0; c < columns; c += 4) {
        _mm_stream_si128(reinterpret_cast<__m128i*>(instance + at + c), load<__m128i>(ids + c));
      }
      for (int32_t c = 0; c < columns; c += 4) {
        _mm_stream_si128(reinterpret_cast<__m128i*>(depth + at + c), load<__m128i>(depths + c));
      }
#endif
    } else {
      std::memcpy(instance + at, ids, static_cast<size_t>(columns) * sizeof(int32_t));
      std::memcpy(depth + at, depths, static_cast<size_t>(columns) * sizeof(float));
    }
  }
}
