// Every instance drawn alone, in one pass: per pixel the nearest depth of each instance there, near first.
// Included once per instruction set.
//
// A tile's records are grouped by instance, and each group is drawn into the tile by the code that draws
// the picture: the depths are those of the picture, and of the instance drawn alone, bit for bit.

constexpr int64_t kLayerRound = int64_t{1} << 21;  // triangles culled before the tiles are drawn

struct Fragment {  // what one instance shows in one tile; behind the masks, the depths in their order
  Fragment* older;
  int32_t id, top, rows;
  uint64_t masks[1];  // of each row from `top` on, bit by bit the columns

  static size_t bytes(int32_t rows, size_t depths) {
    return sizeof(Fragment) + sizeof(uint64_t) * static_cast<size_t>(rows) + sizeof(float) * depths;
  }
  float* depths() { return reinterpret_cast<float*>(masks + rows); }
  const float* depths() const { return reinterpret_cast<const float*>(masks + rows); }
};

// Visits (first, length) of each run of set bits.
template <class Visit>
static inline void each_run(uint64_t mask, Visit&& visit) {
  while (mask != 0) {
    const int first = __builtin_ctzll(mask);
    const uint64_t ended = ~(mask >> first);
    const int length = ended == 0 ? 64 : __builtin_ctzll(ended);
    visit(first, length);
    mask &= length == 64 ? 0 : ~(((uint64_t{1} << length) - 1) << first);
  }
}

struct Group {  // of one instance in the tile at hand
  uint32_t candidates, samples;    // how many; then where the next one goes
  int32_t x0, x1, y0, y1;

  void widen(int32_t left, int32_t right, int32_t top, int32_t bottom) {
    x0 = left < x0 ? left : x0;
    x1 = right > x1 ? right : x1;
    y0 = top < y0 ? top : y0;
    y1 = bottom > y1 ? bottom : y1;
  }
};

struct LayerWorker {
  Arena kept;                      // the fragments
  Buffer<Group> groups;            // of each instance; `present` have records in the tile at hand
  std::vector<int32_t> present;
  Buffer<Candidate> candidates;    // by instance, near first in each
  Buffer<Sample> samples;          // by instance
  Buffer<uint64_t> keys;
  float found[kTile * kTile];
};

struct LayerPass {
  Render& r;
  const LwLayers& out;
  std::vector<LayerWorker> workers;
  Buffer<Fragment*> newest{};      // of each tile
  std::atomic<int64_t> entries{0};
  int32_t* instance = nullptr;
  float* depth = nullptr;
};

static const Group kNoGroup = {0, 0, kTile, -1, kTile, -1};

static inline Group& group_of(LayerWorker& mine, int32_t id) {
  Group& group = mine.groups.data()[id];
  if (group.candidates + group.samples == 0) mine.present.push_back(id);
  return group;
}

template <class Visit>
static void each_sample(const Render& r, int64_t tile, Visit&& visit) {
  for (const Worker& worker : r.workers) {
    worker.bins.data()[tile].samples.each_block([&](const Sample* from, uint32_t count) {
      for (uint32_t i = 0; i < count; ++i) visit(from[i]);
    });
  }
}

// Leaves the tile's records grouped in `candidates` and `samples`, and each group at its end there.
static void group_records(LayerPass& pass, const Candidate* from, int64_t count, LayerWorker& mine,
                          int64_t tile) {
  const int32_t* ids = pass.r.frame.surfaces.placement_id;
  for (int64_t i = 0; i < count; ++i) {
    Group& group = group_of(mine, ids[from[i].placement]);
    ++group.candidates;
    group.widen(from[i].x0, from[i].x1, from[i].y0, from[i].y1);
  }
  each_sample(pass.r, tile, [&](const Sample& sample) {
    Group& group = group_of(mine, sample.id);
    const auto row = static_cast<int32_t>(sample.pixel / kStride);
    const auto column = static_cast<int32_t>(sample.pixel % kStride);
    ++group.samples;
    group.widen(column, column, row, row);
  });
  uint32_t candidates = 0, samples = 0;
  for (const int32_t id : mine.present) {
    Group& group = mine.groups.data()[id];
    std::swap(group.candidates, candidates);
    std::swap(group.samples, samples);
    candidates += group.candidates;
    samples += group.samples;
  }
  Candidate* to = mine.candidates.at_least(candidates);
  for (int64_t i = 0; i < count; ++i) to[mine.groups.data()[ids[from[i].placement]].candidates++] = from[i];
  Sample* put = mine.samples.at_least(samples);
  each_sample(pass.r, tile, [&](const Sample& one) { put[mine.groups.data()[one.id].samples++] = one; });
}

// Empties the blocks of the group's box, and those a row of lanes may reach beyond it.
static void clear_box(Tile& tile, const Group& box) {
  const int left = box.x0 / kBlock, right = std::min(box.x1 / kBlock + 1, kBlocks - 1);
  const int32_t end = std::min(right * kBlock + kBlock, tile.columns);
  for (int by = box.y0 / kBlock; by <= box.y1 / kBlock; ++by) {
    for (int block = left; block <= right; ++block) tile.farthest[by * kBlocks + block] = INFINITY;
    const int32_t last = std::min(by * kBlock + kBlock, tile.rows);
    for (int32_t y = by * kBlock; y < last; ++y) {
      for (int32_t x = left * kBlock; x < end; ++x) tile.depth[y * kStride + x] = INFINITY;
    }
  }
  tile.stale = 0;
}

// The columns of a row that hold a depth, from column x on and before `end`.
static inline uint64_t mask_of_row(const float* row, int32_t x, int32_t end) {
  uint64_t mask = 0;
  for (x = x / kBlock * kBlock; x < end; x += kBlock) {
    mask |= static_cast<uint64_t>(row_bits(load<Row>(row + x) < spread_row(INFINITY))) << x;
  }
  return end < kTile ? mask & ((uint64_t{1} << end) - 1) : mask;
}

// What the box holds now, as the tile's newest fragment.
static void keep_fragment(LayerPass& pass, LayerWorker& mine, const Tile& tile, const Group& box, int32_t id,
                          int64_t index) {
  const int32_t rows = box.y1 - box.y0 + 1, end = std::min(box.x1 + kBlock, tile.columns);
  uint64_t masks[kTile];
  size_t count = 0;
  for (int32_t r = 0; r < rows; ++r) {
    const float* row = tile.depth + (box.y0 + r) * kStride;
    masks[r] = mask_of_row(row, box.x0, end);
    each_run(masks[r], [&](int first, int length) {
      std::memcpy(mine.found + count, row + first, static_cast<size_t>(length) * sizeof(float));
      count += static_cast<size_t>(length);
    });
  }
  if (count == 0) return;
  auto* out = static_cast<Fragment*>(mine.kept.take(Fragment::bytes(rows, count)));
  out->older = pass.newest.data()[index];
  out->id = id;
  out->top = box.y0;
  out->rows = rows;
  std::memcpy(out->masks, masks, static_cast<size_t>(rows) * sizeof *masks);
  std::memcpy(out->depths(), mine.found, count * sizeof(float));
  pass.newest.data()[index] = out;
  pass.entries += static_cast<int64_t>(count);
}

static void draw_groups(LayerPass& pass, Worker& worker, LayerWorker& mine, Tile& tile, int64_t index) {
  const int64_t count = near_first(pass.r, worker, index);
  group_records(pass, worker.near_first.data(), count, mine, index);
  const Drawing drawing{pass.r.frame, tile, nullptr};
  uint32_t candidates = 0, samples = 0;
  for (const int32_t id : mine.present) {
    Group& group = mine.groups.data()[id];
    clear_box(tile, group);
    for (uint32_t i = samples; i < group.samples; ++i) {
      const Sample& one = mine.samples.data()[i];
      float& old = tile.depth[one.pixel];
      old = one.depth < old ? one.depth : old;
    }
    if (samples < group.samples) tile.stale = ~uint64_t{0};
    draw_candidates<false>(drawing, mine.candidates.data() + candidates, group.candidates - candidates);
    keep_fragment(pass, mine, tile, group, id, index);
    candidates = group.candidates;
    samples = group.samples;
    group = kNoGroup;
  }
  mine.present.clear();
}

static void draw_layers(LayerPass& pass, Worker& worker, LayerWorker& mine) {
  Buffer<Tile> scratch;
  Tile& tile = *scratch.at_least(1);
  for (int64_t begin, end; pass.r.tile_queue.take(begin, end);) {
    for (int64_t i = begin; i < end; ++i) {
      if (pass.entries > pass.out.most) {
        pass.r.frame.status = kTooManyLayers;
        return;
      }
      if (!has_records(pass.r, i)) continue;
      tile.begin(pass.r.frame, i);
      draw_groups(pass, worker, mine, tile, i);
    }
  }
}

// How many entries each pixel of a tile has.
static void count_entries(const Fragment* newest, uint32_t counts[kTile * kTile]) {
  std::memset(counts, 0, sizeof(uint32_t) * kTile * kTile);
  for (const Fragment* one = newest; one != nullptr; one = one->older) {
    for (int32_t r = 0; r < one->rows; ++r) {
      uint32_t* row = counts + (one->top + r) * kTile;
      each_run(one->masks[r], [&](int first, int length) {
        for (int c = first; c < first + length; ++c) ++row[c];
      });
    }
  }
}

// To start[pixel + 1], for now.
static void count_layers(LayerPass& pass) {
  uint32_t counts[kTile * kTile];
  Tile tile;
  for (int64_t begin, end; pass.r.tile_queue.take(begin, end);) {
    tile.place(pass.r.frame, begin);
    count_entries(pass.newest.data()[begin], counts);
    for (int32_t r = 0; r < tile.rows; ++r) {
      int64_t* out = pass.out.start + row_of(pass.r.frame, tile, r) + 1;
      for (int32_t c = 0; c < tile.columns; ++c) out[c] = counts[r * kTile + c];
    }
  }
}

static void make_room(LayerPass& pass) {
  int64_t* start = pass.out.start;
  const int64_t pixels = static_cast<int64_t>(pass.r.frame.width) * pass.r.frame.height;
  start[0] = 0;
  for (int64_t i = 0; i < pixels; ++i) start[i + 1] += start[i];
  if (start[pixels] > pass.out.most) pass.r.frame.status = kTooManyLayers;
  if (pass.r.frame.status != kOk) return;
  if (pass.out.allocate(start[pixels], &pass.instance, &pass.depth) == 0) throw std::bad_alloc();
}

// By depth, then by id: as unsigned numbers in that order.
static inline uint64_t key_of(float depth, int32_t id) {
  uint32_t bits = 0;
  std::memcpy(&bits, &depth, sizeof bits);
  bits ^= (bits >> 31) != 0 ? 0xffffffffu : 0x80000000u;
  return static_cast<uint64_t>(bits) << 32 | static_cast<uint32_t>(id);
}

static inline float depth_of(uint64_t key) {
  auto bits = static_cast<uint32_t>(key >> 32);
  bits ^= (bits >> 31) != 0 ? 0x80000000u : 0xffffffffu;
  float depth = 0;
  std::memcpy(&depth, &bits, sizeof depth);
  return depth;
}

// Few keys as a rule, and then in no order that could be used.
static inline void sort_keys(uint64_t* keys, int64_t count) {
  constexpr int64_t kFew = 24;
  if (count > kFew) {
    std::sort(keys, keys + count);
    return;
  }
  for (int64_t i = 1; i < count; ++i) {
    const uint64_t key = keys[i];
    int64_t at = i;
    for (; at > 0 && keys[at - 1] > key; --at) keys[at] = keys[at - 1];
    keys[at] = key;
  }
}

// The entries of a tile's pixels as keys, where `next` says; leaves each pixel's end there.
static void scatter_keys(const Fragment* newest, uint32_t next[kTile * kTile], uint64_t* keys) {
  for (const Fragment* one = newest; one != nullptr; one = one->older) {
    const float* depth = one->depths();
    for (int32_t r = 0; r < one->rows; ++r) {
      uint32_t* row = next + (one->top + r) * kTile;
      each_run(one->masks[r], [&](int first, int length) {
        for (int c = first; c < first + length; ++c) keys[row[c]++] = key_of(*depth++, one->id);
      });
    }
  }
}

static void write_layers(LayerPass& pass, LayerWorker& mine) {
  uint32_t next[kTile * kTile];
  Tile tile;
  for (int64_t begin, end; pass.r.tile_queue.take(begin, end);) {
    tile.place(pass.r.frame, begin);
    uint32_t total = 0;
    for (int32_t r = 0; r < tile.rows; ++r) {
      const int64_t* start = pass.out.start + row_of(pass.r.frame, tile, r);
      for (int32_t c = 0; c < tile.columns; ++c) {
        next[r * kTile + c] = total + static_cast<uint32_t>(start[c] - start[0]);
      }
      total += static_cast<uint32_t>(start[tile.columns] - start[0]);
    }
    uint64_t* keys = mine.keys.at_least(total);
    scatter_keys(pass.newest.data()[begin], next, keys);
    for (int32_t r = 0; r < tile.rows; ++r) {
      const int64_t* start = pass.out.start + row_of(pass.r.frame, tile, r);
      const int64_t count = start[tile.columns] - start[0];
      for (int32_t c = 0; c < tile.columns; ++c) {
        if (start[c + 1] - start[c] > 1) sort_keys(keys + (start[c] - start[0]), start[c + 1] - start[c]);
      }
      int32_t* instance = pass.instance + start[0];
      float* depth = pass.depth + start[0];
      for (int64_t i = 0; i < count; ++i) {
        instance[i] = pass.out.ident[static_cast<uint32_t>(keys[i])];
        depth[i] = depth_of(keys[i]);
      }
      keys += count;
    }
  }
}

// The placements in sight, instance by instance; a round ends between two instances.
static void schedule_instances(const Frame& frame, Schedule& plan) {
  const LwSurfaces& all = frame.surfaces;
  for (int64_t i = 0; i < all.placements; ++i) {
    if (plan.bounds.data()[i].pixels.x0 <= plan.bounds.data()[i].pixels.x1) plan.order.push_back(i);
  }
  std::sort(plan.order.begin(), plan.order.end(), [&](int64_t a, int64_t b) {
    const int32_t ia = all.placement_id[a], ib = all.placement_id[b];
    return ia < ib || (ia == ib && a < b);
  });
  int64_t taken = 0;
  for (size_t i = 0; i < plan.order.size(); ++i) {
    const int64_t placement = plan.order[i];
    if (taken >= kLayerRound && all.placement_id[plan.order[i - 1]] != all.placement_id[placement]) {
      plan.ends.push_back(static_cast<int64_t>(i));
      taken = 0;
    }
    taken += Shape(all, all.placement_mesh[placement]).triangle_count;
  }
  plan.ends.push_back(static_cast<int64_t>(plan.order.size()));
}

static void begin_layers(LayerPass& pass) {
  const auto tiles = static_cast<size_t>(pass.r.frame.tiles());
  schedule_instances(pass.r.frame, pass.r.schedule);
  std::memset(pass.newest.at_least(tiles), 0, tiles * sizeof(Fragment*));
}

static void work(LayerPass& pass, int index) {
  Render& r = pass.r;
  Worker& worker = r.workers[static_cast<size_t>(index)];
  LayerWorker& mine = pass.workers[static_cast<size_t>(index)];
  validate_and_bound(r.frame, r.team, index);
  if (r.frame.status != kOk) return;
  r.team.phase([&] { bound_placements(r); });
  r.team.phase([&] {
    if (index == 0) begin_layers(pass);
    Group* groups = mine.groups.at_least(static_cast<size_t>(pass.out.instances));
    for (int64_t i = 0; i < pass.out.instances; ++i) groups[i] = kNoGroup;
  });
  for (const int64_t round_end : r.schedule.ends) {
    r.team.phase([&] {
      empty_bins(r, worker);
      if (index == 0) offer(r, r.end, round_end);
    });
    cull(r, worker, index == 0);
    r.team.phase([&] { draw_layers(pass, worker, mine); });
  }
  const auto each_tile = [&](auto&& write) {
    r.team.phase([&] {
      if (index == 0) r.tile_queue.reset(r.frame.tiles(), 1);
    });
    r.team.phase([&] {
      if (r.frame.status == kOk) write();
    });
  };
  each_tile([&] { count_layers(pass); });
  r.team.phase([&] {
    if (index == 0 && r.frame.status == kOk) make_room(pass);
  });
  each_tile([&] { write_layers(pass, mine); });
}

static int32_t layers(const LwSurfaces& surfaces, const LwView& view, int threads, const LwLayers& out) {
  Frame frame(surfaces, view);
  Team team(threads);
  std::vector<Worker> workers(static_cast<size_t>(team.size()));
  Render r{frame, team, workers};
  LayerPass pass{r, out, std::vector<LayerWorker>(static_cast<size_t>(team.size()))};
  prepare(r);
  team.run([&](int index) { work(pass, index); });
  return team.failed() ? static_cast<int32_t>(kNoMemory) : frame.status.load();
}
