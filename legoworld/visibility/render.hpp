// The two passes of a render, put together: once, or in rounds of placements from near to far.
// Included once per instruction set.

constexpr int64_t kOwnScratch = 16384;        // meshes up to this many vertices: one worker, one go
constexpr int64_t kShared = int64_t{1} << 22; // vertices bounded together between two barriers
constexpr int64_t kPart = 16384;              // vertices or triangles in one piece of shared work

struct Large {  // a placement whose mesh is worked on by everyone
  int64_t placement;
  int64_t first_vertex;  // in the shared scratch
};

struct Piece {
  int64_t large, begin, end;
};

struct Render {
  Frame& frame;
  Team& team;
  std::vector<Worker>& workers;
  Schedule schedule{};
  SoFar so_far{};
  int64_t first = 0, end = 0;  // this round's placements, in the schedule's order
  int64_t offered = 0;         // their triangles
  bool last = false;           // no round follows
  std::vector<std::vector<Large>> batches{};
  std::vector<std::vector<Piece>> vertex_pieces{}, triangle_pieces{};
  Buffer<uint64_t> bounds{};
  Buffer<float> depths{};
  Queue sight_queue{}, small{}, vertex_queue{}, triangle_queue{}, tile_queue{};
  LwHits* hits = nullptr;      // where the hits' sources go, if anyone asks
  Buffer<int32_t> between{};   // their place between two rounds, where they are not asked for
  std::atomic<int64_t> flipped{0};
};

static Placed placed(const Render& r, Worker& worker, const Shape& shape, int64_t placement,
                     const uint64_t* bounds, const float* depths) {
  const LwSurfaces& all = r.frame.surfaces;
  const int32_t* cutout =
      all.triangle_cutout == nullptr ? nullptr : all.triangle_cutout + shape.first_triangle;
  return Placed{r.frame, worker,  shape,  all.cam_from_mesh + 12 * placement,
                bounds,  depths,  cutout, r.so_far,
                static_cast<uint32_t>(placement), all.placement_id[placement], r.hits != nullptr};
}

static void bound_placements(Render& r) {
  for (int64_t begin, end; r.sight_queue.take(begin, end);) {
    for (int64_t i = begin; i < end; ++i) r.schedule.bounds.data()[i] = screen_bounds_of(r.frame, i);
  }
}

static bool is_hidden(const Render& r, int64_t placement) {
  if (r.so_far.depth == nullptr) return false;
  const ScreenBounds& bounds = r.schedule.bounds.data()[placement];
  return r.so_far.hides(bounds.pixels, bounds.nearest);
}

// The same by the placement's own vertices, once they are bounded: far tighter than its box.
static bool is_hidden(const Render& r, const uint64_t* bounds, const float* depths, int64_t count) {
  if (r.so_far.depth == nullptr) return false;
  typedef int16_t Packed __attribute__((vector_size(8)));
  Packed low = load<Packed>(bounds);
  float nearest = depths[0];
  for (int64_t i = 1; i < count; ++i) {
    const Packed one = load<Packed>(bounds + i);
    low = one < low ? one : low;
    nearest = depths[i] < nearest ? depths[i] : nearest;
  }
  const Bounds box(load<uint64_t>(&low));
  if (box.x0 < 0) return false;
  if (box.x0 > box.x1 || box.y0 > box.y1) return true;
  return r.so_far.hides(Extent{box.x0, box.x1, box.y0, box.y1}, nearest);
}

// Large placements of the round, in batches whose vertices fit the shared scratch.
static void plan(Render& r) {
  const LwSurfaces& all = r.frame.surfaces;
  int64_t used = 0, most = 0;
  r.batches.clear();
  r.vertex_pieces.clear();
  r.triangle_pieces.clear();
  r.offered = 0;
  for (int64_t i = r.first; i < r.end; ++i) {
    const int64_t placement = r.schedule.order[static_cast<size_t>(i)];
    const Shape shape(all, all.placement_mesh[placement]);
    r.offered += shape.triangle_count;
    if (shape.vertex_count <= kOwnScratch) continue;
    if (is_hidden(r, placement)) {
      r.workers[0].left_out += shape.triangle_count;
      continue;
    }
    if (r.batches.empty() || used + shape.vertex_count > kShared) {
      r.batches.emplace_back();
      r.vertex_pieces.emplace_back();
      r.triangle_pieces.emplace_back();
      used = 0;
    }
    const auto large = static_cast<int64_t>(r.batches.back().size());
    r.batches.back().push_back(Large{placement, used});
    for (int64_t at = 0; at < shape.vertex_count; at += kPart) {
      const int64_t end = at + kPart < shape.vertex_count ? at + kPart : shape.vertex_count;
      r.vertex_pieces.back().push_back(Piece{large, at, end});
    }
    for (int64_t at = 0; at < shape.triangle_count; at += kPart) {
      const int64_t end = at + kPart < shape.triangle_count ? at + kPart : shape.triangle_count;
      r.triangle_pieces.back().push_back(Piece{large, at, end});
    }
    used += shape.vertex_count + kPadding;
    most = used > most ? used : most;
  }
  if (most > 0) {
    r.bounds.at_least(static_cast<size_t>(most));
    r.depths.at_least(static_cast<size_t>(most));
  }
}

static void cull_small(Render& r, Worker& worker) {
  const LwSurfaces& all = r.frame.surfaces;
  uint64_t* bounds = worker.bounds.at_least(kOwnScratch + kPadding);
  float* depths = worker.depths.at_least(kOwnScratch + kPadding);
  for (int64_t begin, end; r.small.take(begin, end);) {
    for (int64_t i = r.first + begin; i < r.first + end; ++i) {
      const int64_t placement = r.schedule.order[static_cast<size_t>(i)];
      const Shape shape(all, all.placement_mesh[placement]);
      if (shape.vertex_count > kOwnScratch) continue;
      bool hidden = is_hidden(r, placement);
      if (!hidden) {
        bound_vertices(r.frame, all.cam_from_mesh + 12 * placement, shape.vertices,
                       shape.vertex_count, bounds, depths);
        hidden = is_hidden(r, bounds, depths, shape.vertex_count);
      }
      if (hidden) {
        worker.left_out += shape.triangle_count;
        continue;
      }
      cull_triangles(placed(r, worker, shape, placement, bounds, depths), 0,
                     shape.triangle_count);
    }
  }
}

static void bound_large(Render& r, size_t batch) {
  const LwSurfaces& all = r.frame.surfaces;
  for (int64_t begin, end; r.vertex_queue.take(begin, end);) {
    const Piece& piece = r.vertex_pieces[batch][static_cast<size_t>(begin)];
    const Large& large = r.batches[batch][static_cast<size_t>(piece.large)];
    const Shape shape(all, all.placement_mesh[large.placement]);
    // Lanes past the end of a piece are written by the next piece too, with other values: keep to
    // a scratch of our own for the last group.
    const int64_t whole = piece.begin + (piece.end - piece.begin) / kLanes * kLanes;
    uint64_t* bounds = r.bounds.data() + large.first_vertex;
    float* depths = r.depths.data() + large.first_vertex;
    const double* matrix = all.cam_from_mesh + 12 * large.placement;
    bound_vertices(r.frame, matrix, shape.vertices + 3 * piece.begin, whole - piece.begin,
                   bounds + piece.begin, depths + piece.begin);
    if (whole == piece.end) continue;
    uint64_t last_bounds[kPadding];
    float last_depths[kPadding];
    bound_vertices(r.frame, matrix, shape.vertices + 3 * whole, piece.end - whole, last_bounds,
                   last_depths);
    for (int64_t i = whole; i < piece.end; ++i) {
      bounds[i] = last_bounds[i - whole];
      depths[i] = last_depths[i - whole];
    }
  }
}

static void cull_large(Render& r, Worker& worker, size_t batch) {
  const LwSurfaces& all = r.frame.surfaces;
  for (int64_t begin, end; r.triangle_queue.take(begin, end);) {
    const Piece& piece = r.triangle_pieces[batch][static_cast<size_t>(begin)];
    const Large& large = r.batches[batch][static_cast<size_t>(piece.large)];
    const Shape shape(all, all.placement_mesh[large.placement]);
    cull_triangles(placed(r, worker, shape, large.placement,
                          r.bounds.data() + large.first_vertex,
                          r.depths.data() + large.first_vertex),
                   piece.begin, piece.end);
  }
}

// The candidates of a tile, roughly nearest first: by 64 equal steps of their nearest depth.
static int64_t near_first(Render& r, Worker& worker, int64_t tile) {
  const auto each = [&](auto&& visit) {
    for (const Worker& other : r.workers) {
      other.bins.data()[tile].candidates.each_block([&](const Candidate* from, uint32_t n) {
        for (uint32_t i = 0; i < n; ++i) visit(from[i]);
      });
    }
  };
  int64_t count = 0;
  float low = INFINITY, high = -INFINITY;
  each([&](const Candidate& one) {
    ++count;
    low = one.nearest < low ? one.nearest : low;
    high = one.nearest > high ? one.nearest : high;
  });
  if (count == 0) return 0;
  Candidate* out = worker.near_first.at_least(static_cast<size_t>(count));
  constexpr int kSteps = 64;
  const float scale = high > low ? (kSteps - 1) / (high - low) : 0.0f;
  const auto step = [&](const Candidate& one) { return static_cast<int>((one.nearest - low) * scale); };
  int64_t start[kSteps + 1] = {};
  each([&](const Candidate& one) { ++start[step(one) + 1]; });
  for (int i = 0; i < kSteps; ++i) start[i + 1] += start[i];
  each([&](const Candidate& one) { out[start[step(one)]++] = one; });
  return count;
}

// The samples that small triangles left for a tile.
template <bool kSource>
static void take_samples(const TileBins& bins, Tile& tile, Origins* origins) {
  const Block<int64_t>* their = bins.sources.newest;
  bins.samples.each_block([&](const Sample* from, uint32_t count) {
    for (uint32_t i = 0; i < count; ++i) {
      const uint32_t at = from[i].pixel;
      const float old = tile.depth[at];
      const bool tied = from[i].depth == old;
      const bool wins = from[i].depth < old || (tied && from[i].id < tile.id[at]);
      if (kSource && (wins || (tied && from[i].id == tile.id[at] &&
                               their->records[i] < origins->source(origins->at[at])))) {
        origins->at[at] = origins->add(their->records[i]);
      }
      tile.depth[at] = wins ? from[i].depth : old;
      tile.id[at] = wins ? from[i].id : tile.id[at];
    }
    tile.stale = ~uint64_t{0};
    if (kSource) their = their->older;
  });
}

template <bool kSource>
static void draw_tile(Render& r, Worker& worker, Tile& tile, Origins* origins, int64_t index) {
  for (const Worker& other : r.workers) take_samples<kSource>(other.bins.data()[index], tile, origins);
  const int64_t count = near_first(r, worker, index);
  const Drawing drawing{r.frame, tile, origins};
  draw_candidates<kSource>(drawing, worker.near_first.data(), count);
}

static void cull(Render& r, Worker& worker, bool first_worker) {
  r.team.phase([&] { cull_small(r, worker); });
  for (size_t batch = 0; batch < r.batches.size(); ++batch) {
    r.team.phase([&] {
      if (!first_worker) return;
      r.vertex_queue.reset(static_cast<int64_t>(r.vertex_pieces[batch].size()), 1);
      r.triangle_queue.reset(static_cast<int64_t>(r.triangle_pieces[batch].size()), 1);
    });
    r.team.phase([&] { bound_large(r, batch); });
    r.team.phase([&] { cull_large(r, worker, batch); });
  }
}

static bool has_records(const Render& r, int64_t tile) {
  for (const Worker& worker : r.workers) {
    const TileBins& bins = worker.bins.data()[tile];
    if (bins.samples.newest != nullptr || bins.candidates.newest != nullptr) return true;
  }
  return false;
}

template <bool kSource>
static void draw_tiles(Render& r, Worker& worker, int32_t* instance, float* depth) {
  Buffer<Tile> scratch;
  Tile& tile = *scratch.at_least(1);
  const std::unique_ptr<Origins> origins(kSource ? new Origins(*r.hits) : nullptr);
  const bool again = r.first > 0;
  for (int64_t begin, end; r.tile_queue.take(begin, end);) {
    for (int64_t i = begin; i < end; ++i) {
      if (again && !r.last && !has_records(r, i)) continue;
      tile.begin(r.frame, i);
      if (kSource) origins->count = 0;
      if (again) load_tile(r.frame, tile, r.so_far, i, instance, depth);
      if (kSource && again) load_sources(r.frame, tile, *r.hits, *origins);
      draw_tile<kSource>(r, worker, tile, origins.get(), i);
      if (r.last) {
        write_tile(r.frame, tile, instance, depth);
        if (kSource) write_hits(r.frame, tile, *origins, *r.hits);
      } else {
        store_tile(r.frame, tile, r.so_far, i, instance, depth);
        if (kSource) store_sources(r.frame, tile, *origins, *r.hits);
      }
    }
  }
  if (kSource) r.flipped += origins->turns.flipped;
}

static void empty_bins(const Render& r, Worker& worker) {
  const auto tiles = static_cast<size_t>(r.frame.tiles());
  std::memset(worker.bins.at_least(tiles), 0, tiles * sizeof(TileBins));
  worker.arena.rewind();
}

// The next round: placements [first, end) of the schedule's order.
static void offer(Render& r, int64_t first, int64_t end) {
  r.first = first;
  r.end = end;
  const int64_t count = end - first, step = count / (8 * r.team.size());
  r.small.reset(count, step < 16 ? step + 1 : 16);
  r.tile_queue.reset(r.frame.tiles(), 1);
  plan(r);
}

static void begin_round(Render& r, size_t round, const float* depth) {
  const auto tiles = static_cast<size_t>(r.frame.tiles());
  if (round == 0 && r.schedule.ends.size() > 1) {
    r.so_far.blocks.at_least(tiles * kBlocks * kBlocks);
    r.so_far.tiles.at_least(tiles);
    if (r.hits != nullptr && r.hits->placement == nullptr) {
      const auto pixels = static_cast<size_t>(r.frame.width) * static_cast<size_t>(r.frame.height);
      r.hits->placement = r.between.at_least(2 * pixels);
      r.hits->triangle = r.hits->placement + pixels;
    }
  }
  int64_t left_out = 0;
  for (Worker& worker : r.workers) {
    left_out += worker.left_out;
    worker.left_out = 0;
  }
  const bool culling_unprofitable = round > 1 && left_out * kWorthAsking < r.offered;
  r.so_far.depth = round == 0 || culling_unprofitable ? nullptr : depth;
  offer(r, r.end, culling_unprofitable ? r.schedule.ends.back() : r.schedule.ends[round]);
  r.last = r.end == r.schedule.ends.back();
}

static void work(Render& r, int index, int32_t* instance, float* depth) {
  Worker& worker = r.workers[static_cast<size_t>(index)];
  validate_and_bound(r.frame, r.team, index);
  if (r.frame.status != kOk) return;
  r.team.phase([&] { bound_placements(r); });
  r.team.phase([&] {
    if (index == 0) schedule(r.frame, r.schedule);
  });
  bool last = false;
  for (size_t round = 0; round < r.schedule.ends.size() && !last; ++round) {
    r.team.phase([&] {
      empty_bins(r, worker);
      if (index == 0) begin_round(r, round, depth);
    });
    cull(r, worker, index == 0);
    last = r.last;
    r.team.phase([&] {
      if (r.hits == nullptr) {
        draw_tiles<false>(r, worker, instance, depth);
      } else {
        draw_tiles<true>(r, worker, instance, depth);
      }
    });
  }
}

// What must be so before a team may work.
static void prepare(Render& r) {
  const LwSurfaces& surfaces = r.frame.surfaces;
  r.so_far.width = r.frame.width;
  r.so_far.tiles_x = r.frame.tiles_x;
  r.schedule.bounds.at_least(static_cast<size_t>(surfaces.placements));
  r.sight_queue.reset(surfaces.placements, 64);
  prepare_validation(r.frame);
}

// hits: null, or where what else is known of each pixel's hit is written.
static int32_t render(const LwSurfaces& surfaces, const LwView& view, int threads, int32_t* instance,
                      float* depth, LwHits* hits) {
  Frame frame(surfaces, view);
  Team team(threads);
  std::vector<Worker> workers(static_cast<size_t>(team.size()));
  Render r{frame, team, workers};
  r.hits = hits;
  prepare(r);
  team.run([&](int index) { work(r, index, instance, depth); });
  if (hits != nullptr) hits->flipped = r.flipped;
  return team.failed() ? static_cast<int32_t>(kNoMemory) : frame.status.load();
}
