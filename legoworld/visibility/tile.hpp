// One tile of the picture while it is drawn. Included once per instruction set.

struct Tile {
  float depth[kTile * kStride];
  int32_t id[kTile * kStride];
  float farthest[kBlocks * kBlocks];  // no stored depth of the block is larger
  uint64_t stale;                     // bit by bit the blocks where `farthest` may have come down since
  int32_t left, top, columns, rows;   // pixels; the part inside the picture

  void place(const Frame& frame, int64_t index) {
    left = static_cast<int32_t>(index % frame.tiles_x) * kTile;
    top = static_cast<int32_t>(index / frame.tiles_x) * kTile;
    columns = frame.width - left < kTile ? frame.width - left : kTile;
    rows = frame.height - top < kTile ? frame.height - top : kTile;
  }

  // Places the tile in the picture, empty. What lies beyond the picture is nearer than anything.
  void begin(const Frame& frame, int64_t index) {
    place(frame, index);
    for (float& d : depth) d = INFINITY;
    for (int32_t& i : id) i = INT32_MAX;
    for (float& f : farthest) f = INFINITY;
    stale = 0;
    for (int32_t r = 0; r < kTile; ++r) {
      for (int32_t c = r < rows ? columns : 0; c < kTile; ++c) depth[r * kStride + c] = -INFINITY;
    }
  }

  float farthest_of(int block) {
    if ((stale >> block & 1) != 0) look_again(block);
    return farthest[block];
  }

  // Whether all that is stored within the box is nearer than the candidate.
  bool hides(const Candidate& box) {
    const int x0 = box.x0 / kBlock, x1 = box.x1 / kBlock;
    const int y0 = box.y0 / kBlock * kBlocks, y1 = box.y1 / kBlock * kBlocks;
    if (x1 - x0 > 1 || y1 - y0 > kBlocks) return hides_all(box, x0, x1, y0, y1);
    const int corners[4] = {y0 + x0, y0 + x1, y1 + x0, y1 + x1};
    if (box.nearest > farthest_of_known(corners)) return true;
    bool again = false;
    for (const int block : corners) again |= (stale >> block & 1) != 0;
    if (!again) return false;
    for (const int block : corners) farthest_of(block);
    return box.nearest > farthest_of_known(corners);
  }

 private:
  float farthest_of_known(const int blocks[4]) const {
    const float a = farthest[blocks[0]], b = farthest[blocks[1]];
    const float c = farthest[blocks[2]], d = farthest[blocks[3]];
    const float upper = a > b ? a : b, lower = c > d ? c : d;
    return upper > lower ? upper : lower;
  }

  bool hides_all(const Candidate& box, int x0, int x1, int y0, int y1) {
    for (int y = y0; y <= y1; y += kBlocks) {
      for (int block = y + x0; block <= y + x1; ++block) {
        if (!(box.nearest > farthest_of(block))) return false;
      }
    }
    return true;
  }

  void look_again(int block) {
    const float* row = depth + (block / kBlocks * kStride + block % kBlocks) * kBlock;
    Row most = load<Row>(row);
    for (int r = 1; r < kBlock; ++r) {
      const Row one = load<Row>(row + r * kStride);
      most = most > one ? most : one;
    }
    float out = most[0];
    for (int c = 1; c < kBlock; ++c) out = out > most[c] ? out : most[c];
    farthest[block] = out;
    stale &= ~(uint64_t{1} << block);
  }
};
