#include "renderer/cpu/cells.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>
#include <utility>

#include "base/interruption.h"
#include "renderer/cpu/cell_frame.h"
#include "renderer/cpu/samples.h"
#include "scene/clipped_depths.h"
#include "scene/tile_grid.h"

namespace splatvol {

using namespace tiles;

namespace {

/// The box round what is in a chunk, in view coordinates.
Box box_in_view(const View& view, const Box& box) {
  Box result;
  for (int i = 0; i < 8; ++i)
    result.include(view.to_view({(i & 1) != 0 ? box.high.x : box.low.x, (i & 2) != 0 ? box.high.y : box.low.y,
                                 (i & 4) != 0 ? box.high.z : box.low.z}));
  // Rounded outwards.
  const dvec3 margin = 1e-12 * glm::max(glm::abs(result.low), glm::abs(result.high));
  result.low -= margin, result.high += margin;
  return result;
}

/// A chunk that may be drawn.
struct Chunk {
  CellSource::Chunk source;
  Box box;                 // in view coordinates
  PixelRectangle tiles{};  // that it may cover
};

/// A chunk in a tile.
struct InTile {
  std::uint32_t chunk;  // its number in the order
  float first_key;      // no segment of it has a lower key here
  float later_key;      // nor has any of the chunks behind it
};

/// Chunks that are read together.
struct Batch {
  std::uint32_t first = 0;            // in the order of chunks
  std::vector<std::int32_t> slots;    // [number in the order, less first]: index of `chunks`; -1: it shows nothing
  std::vector<std::uint32_t> chunks;  // numbers in the order
};

/// A tile between batches.
struct Tile {
  CellTileLight light;
  std::vector<CellSegment> waiting;  // pixel by pixel
  std::vector<SegmentShade> shades;  // of these
  std::vector<std::int32_t> counts;  // [pixel]; empty: none wait
  std::vector<InTile> chunks;
  std::size_t next = 0;  // of these
  bool is_open = true;

  void clear() {
    for (auto& channel : light.color) channel.fill(0);
    light.transmittance.fill(1);
    waiting = {};
    shades = {};
    counts.clear();
    chunks.clear();
    next = 0;
    is_open = true;
  }
};

std::uint64_t waiting_bytes(std::span<const Tile> tiles) {
  std::uint64_t bytes = 0;
  for (const Tile& tile : tiles) bytes += (tile.waiting.capacity() + tile.shades.capacity()) * sizeof(CellSegment);
  return bytes;
}

struct SetupScratch {
  DrawnCells cells;
  CellSetup setup;
};

}  // namespace

/// What pictures share: its memory.
struct tiles::CellWorkspace {
  std::vector<Tile> tiles;             // of a band
  std::vector<CellsOnScreen> screens;  // of a batch
  tbb::enumerable_thread_specific<SetupScratch> scratches;
  tbb::enumerable_thread_specific<TileSegments> segments;
};

namespace {

/// The picture of cells in a band of tiles.
class CellSweep {
 public:
  CellSweep(const CellSource& source, const CellDrawing& drawing, const View& view, CellWorkspace& workspace)
      : source_(source),
        drawing_(drawing),
        view_(view),
        function_(drawing.transfer.function),
        across_((view.width + cell_tile_side - 1) / cell_tile_side),
        up_((view.height + cell_tile_side - 1) / cell_tile_side),
        workspace_(workspace) {
    const TransferFunction& function = drawing.transfer.function;
    frame_.view = &view_;
    frame_.function = &function_;
    frame_.low = function.lo;
    frame_.inverse_domain = 1 / (function.hi - function.lo);
    frame_.middle_x = 0.5 * view.width - 0.5;
    frame_.middle_y = 0.5 * view.height - 0.5;
    const auto side = static_cast<float>(std::max(view.width, view.height));
    frame_.widest = std::max(1024.0F, 2 * side);
    if (drawing.lighting) frame_.lighting = &*drawing.lighting;
    frame_.surfaces = drawing.surfaces;
    if (const TransferFunction* opacity = drawing.transfer.opacity) {
      opacity_.emplace(*opacity);
      frame_.opacity = &*opacity_;
      frame_.opacity_low = opacity->lo;
      frame_.opacity_inverse = 1 / (opacity->hi - opacity->lo);
    }
    frame_.slack = std::max(0.002F, 4e-6F * side);
    order_chunks();
  }

  Result<CellPicture> draw() {
    picture_.image.width = view_.width;
    picture_.image.height = view_.height;
    picture_.image.pixels.assign(static_cast<std::size_t>(view_.width) * static_cast<std::size_t>(view_.height),
                                 vec4(0));
    int height = up_;
    for (int begin = 0; begin < up_;) {
      SPLATVOL_TRY_ASSIGN(end, draw_band(begin, std::min(begin + height, up_)));
      height = end - begin;
      begin = end;
    }
    picture_.segments = drawn_segments_;
    return std::move(picture_);
  }

 private:
  void order_chunks();
  [[nodiscard]] PixelRectangle tiles_of(const Box& box) const;
  [[nodiscard]] double nearest_depth(const Box& box, int column, int row) const;
  [[nodiscard]] float first_key(double depth) const;
  Result<int> draw_band(int begin, int end);
  [[nodiscard]] bool shows(const Chunk& chunk, int begin, int end) const;
  Status read(const Chunk& chunk, CellsOnScreen& screen);
  [[nodiscard]] VisibleDepths visible_depths(int x, int y) const;
  using TileDepths = std::array<VisibleDepths, cell_tile_pixels>;
  void set_limits(const CellsOnScreen& screen, const TileDepths& depths, TileSegments& segments) const;
  bool draw_tile(int column, int row, const Batch& batch, Tile& tile);
  [[nodiscard]] float nearest_d(const CellsOnScreen& screen, float key) const;
  void finish_tile(int column, int row, const Tile& tile);
  [[nodiscard]] Tile& tile_at(int column, int row) {
    return workspace_.tiles[static_cast<std::size_t>(row - band_begin_) * static_cast<std::size_t>(across_) +
                            static_cast<std::size_t>(column)];
  }
  [[nodiscard]] const Tile& tile_at(int column, int row) const {
    return const_cast<CellSweep*>(this)->tile_at(column, row);
  }

  const CellSource& source_;
  const CellDrawing& drawing_;
  View view_;
  FunctionPieces function_;
  std::optional<FunctionPieces> opacity_;
  CellFrame frame_;
  int across_, up_;            // tiles
  std::vector<Chunk> chunks_;  // by their nearest depth
  int band_begin_ = 0;
  CellWorkspace& workspace_;
  std::atomic<std::uint64_t> drawn_segments_ = 0;
  CellPicture picture_;
};

void CellSweep::order_chunks() {
  double reach = 0;
  for (const CellSource::Chunk& chunk : source_.chunks()) {
    chunks_.push_back({chunk, box_in_view(view_, chunk.box)});
    reach = std::max(reach, chunks_.back().box.high.z);
  }
  frame_.nearest = view_.orthographic ? 0 : 1e-7 * reach;
  frame_.farthest_w = view_.orthographic ? reach : 1 / std::max(reach, std::numeric_limits<double>::min());
  std::erase_if(chunks_, [&](Chunk& chunk) {
    if (chunk.box.high.z <= frame_.nearest) return true;
    chunk.tiles = tiles_of(chunk.box);
    return chunk.tiles.is_empty();
  });
  std::ranges::sort(chunks_, {}, [](const Chunk& chunk) { return std::pair(chunk.box.low.z, chunk.source.number); });
}

PixelRectangle CellSweep::tiles_of(const Box& box) const {
  const bool is_round_eye = !view_.orthographic && box.low.z <= frame_.nearest;
  const auto range = [&](double low, double high, double middle, int pixels) {
    if (is_round_eye) {
      if (low > 0 || high < 0) {  // beside the axis: beyond what the farthest point shows
        const double at = view_.focal * (low > 0 ? low : high) / box.high.z;
        low = low > 0 ? at : -1e9, high = high < 0 ? at : 1e9;
      } else {
        low = -1e9, high = 1e9;
      }
    } else {
      const double low_scale = view_.orthographic ? view_.focal : view_.focal / (low < 0 ? box.low.z : box.high.z);
      const double high_scale = view_.orthographic ? view_.focal : view_.focal / (high < 0 ? box.high.z : box.low.z);
      low *= low_scale, high *= high_scale;
    }
    const double slack = frame_.slack;
    return std::pair(static_cast<int>(std::clamp(std::ceil(low + middle - slack), 0.0, static_cast<double>(pixels))),
                     static_cast<int>(std::clamp(std::floor(high + middle + slack), -1.0, pixels - 1.0)));
  };
  const auto [left, right] = range(box.low.x, box.high.x, frame_.middle_x, view_.width);
  const auto [bottom, top] = range(box.low.y, box.high.y, frame_.middle_y, view_.height);
  if (left > right || bottom > top) return {0, -1, 0, -1};
  return {left / cell_tile_side, right / cell_tile_side, bottom / cell_tile_side, top / cell_tile_side};
}

// A depth that no ray of the tile reaches before it is in the box.
double CellSweep::nearest_depth(const Box& box, int column, int row) const {
  double depth = std::max(box.low.z, 0.0);
  if (view_.orthographic) return depth;
  const auto bound = [&](double low, double high, int tile, double middle) {
    const double first = (tile * cell_tile_side - middle) / view_.focal;
    const double last = first + (cell_tile_side - 1) / view_.focal;
    if (low > 0 && last > 0) depth = std::max(depth, low / last);
    if (high < 0 && first < 0) depth = std::max(depth, high / first);
  };
  bound(box.low.x, box.high.x, column, frame_.middle_x);
  bound(box.low.y, box.high.y, row, frame_.middle_y);
  return depth * (1 - 1e-6);
}

// A key that no segment has that begins at this depth or behind it.
float CellSweep::first_key(double depth) const {
  const double d =
      view_.orthographic ? frame_.farthest_w - depth : 1 / std::max(depth, frame_.nearest) - frame_.farthest_w;
  return std::nextafter(static_cast<float>(-d), -farthest);
}

// The largest d whose key is not below `key`.
float CellSweep::nearest_d(const CellsOnScreen& screen, float key) const {
  float d = -key - screen.key_offset;
  while (-(d + screen.key_offset) < key) d = std::nextafter(d, -farthest);
  return d;
}

// Draws a band of rows. Leaves out upper ones if more segments wait than fit into memory. Returns where it ends.
Result<int> CellSweep::draw_band(int begin, int end) {
  band_begin_ = begin;
  std::vector<Tile>& tiles = workspace_.tiles;
  tiles.resize(static_cast<std::size_t>(across_) * static_cast<std::size_t>(end - begin));
  tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) { tiles[i].clear(); });
  for (std::uint32_t number = 0; number < chunks_.size(); ++number) {
    const Chunk& chunk = chunks_[number];
    for (int row = std::max(chunk.tiles.y0, begin); row <= std::min(chunk.tiles.y1, end - 1); ++row)
      for (int column = chunk.tiles.x0; column <= chunk.tiles.x1; ++column)
        tile_at(column, row).chunks.push_back({number, first_key(nearest_depth(chunk.box, column, row)), farthest});
  }
  for (Tile& tile : tiles)
    for (std::size_t i = tile.chunks.size(); i-- > 1;)
      tile.chunks[i - 1].later_key = std::min(tile.chunks[i].first_key, tile.chunks[i].later_key);

  constexpr std::uint64_t bytes_of_cell = sizeof(CellOnScreen) + 2 * sizeof(std::uint32_t);
  const std::uint64_t most = std::min<std::uint64_t>(drawing_.memory / 4, std::uint64_t{128} << 20);
  Batch batch;
  for (std::uint32_t first = 0; first < chunks_.size();) {
    SPLATVOL_TRY(check_interruption());
    batch.chunks.clear();
    batch.slots.clear();
    batch.first = first;
    std::uint32_t next = first;
    for (std::uint64_t bytes = 0; next < chunks_.size() && (bytes < most || batch.chunks.empty()); ++next) {
      const bool is_shown = shows(chunks_[next], begin, end);
      batch.slots.push_back(is_shown ? static_cast<std::int32_t>(batch.chunks.size()) : -1);
      if (!is_shown) continue;
      batch.chunks.push_back(next);
      bytes += chunks_[next].source.tetrahedra * bytes_of_cell;
    }
    std::vector<std::uint64_t> numbers;
    for (const std::uint32_t chunk : batch.chunks) numbers.push_back(chunks_[chunk].source.number);
    SPLATVOL_TRY_ASSIGN(ahead, source_.read_ahead(numbers));
    // What an earlier batch had stays for its memory.
    if (workspace_.screens.size() < batch.chunks.size()) workspace_.screens.resize(batch.chunks.size());
    for (CellsOnScreen& screen : workspace_.screens) screen.clear();
    // Threads of the loops know nothing of the stop of this one.
    const std::stop_token stop = stop_of_thread();
    std::mutex mutex;
    Status status;
    tbb::parallel_for(std::size_t{0}, batch.chunks.size(), [&](std::size_t i) {
      const Interruptible heeds_stop(stop);
      if (is_interrupted()) return;
      Status read_one = read(chunks_[batch.chunks[i]], workspace_.screens[i]);
      const std::scoped_lock lock(mutex);
      if (!read_one && status) status = std::move(read_one);
    });
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY(status);
    std::atomic<bool> is_full = false;
    tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
      if (stop.stop_requested()) return;
      const int row = begin + static_cast<int>(i) / across_, column = static_cast<int>(i) % across_;
      if (!draw_tile(column, row, batch, tiles[i])) is_full = true;
    });
    SPLATVOL_TRY(check_interruption());
    if (is_full)
      return fail(ErrorCode::out_of_budget, "more than {} cells overlap at a place: draw splats instead",
                  TileSegments::most_room);
    while (end - begin > 1 && waiting_bytes(tiles) > drawing_.memory / 2) {
      end = (begin + end + 1) / 2;
      tiles.resize(static_cast<std::size_t>(across_) * static_cast<std::size_t>(end - begin));
    }
    first = next;
    if (drawing_.progress && !chunks_.empty())
      drawing_.progress((begin + (end - begin) * static_cast<double>(first) / static_cast<double>(chunks_.size())) /
                        up_);
  }
  tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
    finish_tile(static_cast<int>(i) % across_, begin + static_cast<int>(i) / across_, tiles[i]);
  });
  return end;
}

bool CellSweep::shows(const Chunk& chunk, int begin, int end) const {
  for (int row = std::max(chunk.tiles.y0, begin); row <= std::min(chunk.tiles.y1, end - 1); ++row)
    for (int column = chunk.tiles.x0; column <= chunk.tiles.x1; ++column)
      if (tile_at(column, row).is_open) return true;
  return false;
}

Status CellSweep::read(const Chunk& chunk, CellsOnScreen& screen) {
  auto& [memory, setup] = workspace_.scratches.local();
  SPLATVOL_TRY_ASSIGN(held, source_.read(chunk.source, memory));
  const DrawnCells& cells = *held;
  if (cells.tetrahedra.empty()) return {};
  place_values(frame_, cells, setup);
  list_seen_cells(frame_, cells, setup);
  if (setup.seen.empty()) return {};
  place_points(frame_, chunk.box, cells, setup, screen);
  set_up_cells(frame_, cells, setup, screen);
  if (frame_.has_shades()) shade_cells(frame_, cells, setup, screen);
  sort_into_tiles(setup, screen);
  return {};
}

// Between which depths a pixel's ray shows something.
VisibleDepths CellSweep::visible_depths(int x, int y) const {
  VisibleDepths range = clipped_depths(view_, (x - frame_.middle_x) / view_.focal, (y - frame_.middle_y) / view_.focal);
  if (!frame_.surfaces) return range;
  const auto row = static_cast<std::size_t>(view_.height - 1 - y), column = static_cast<std::size_t>(x);
  const double depth = frame_.surfaces->depths[row * static_cast<std::size_t>(view_.width) + column];
  if (!std::isnan(depth)) range.to = std::min(range.to, depth);
  return range;
}

void CellSweep::set_limits(const CellsOnScreen& screen, const TileDepths& depths, TileSegments& segments) const {
  const auto d_of = [&](double depth) {
    if (depth <= 0) return farthest;
    if (depth == std::numeric_limits<double>::infinity()) return -farthest;
    return static_cast<float>(view_.orthographic ? screen.w - depth : 1 / depth - screen.w);
  };
  for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel) {
    segments.near_limits[pixel] = d_of(depths[pixel].from);
    segments.far_limits[pixel] = d_of(depths[pixel].to);
  }
}

// Returns false if there are too many segments.
bool CellSweep::draw_tile(int column, int row, const Batch& batch, Tile& tile) {
  constexpr std::uint64_t blended_at_once = std::uint64_t{32} * cell_tile_pixels;
  const auto end = static_cast<std::uint32_t>(batch.first + batch.slots.size());
  const auto is_in_batch = [&] { return tile.next < tile.chunks.size() && tile.chunks[tile.next].chunk < end; };
  if (!is_in_batch()) return true;
  if (!tile.is_open) {
    while (is_in_batch()) ++tile.next;
    return true;
  }
  TileSegments& segments = workspace_.segments.local();
  const bool has_shades = frame_.has_shades();
  if (has_shades) segments.shades.resize(segments.segments.size());
  segments.counts.fill(0);
  segments.is_full = false;  // an earlier picture may have failed
  if (!tile.counts.empty()) {
    while (segments.room < std::ranges::max(tile.counts)) static_cast<void>(segments.make_room());
    std::size_t from = 0;
    for (std::size_t pixel = 0; pixel < cell_tile_pixels; from += static_cast<std::size_t>(tile.counts[pixel++])) {
      const auto copy = [&](const auto& waiting, auto& all) {
        std::copy_n(waiting.begin() + static_cast<std::ptrdiff_t>(from), tile.counts[pixel],
                    all.begin() + static_cast<std::ptrdiff_t>(segments.begin_of(pixel)));
      };
      copy(tile.waiting, segments.segments);
      if (has_shades) copy(tile.shades, segments.shades);
    }
    std::ranges::copy(tile.counts, segments.counts.begin());
  }
  const CellTileArea area = {column * cell_tile_side, row * cell_tile_side};
  TileDepths depths;
  if (frame_.has_limits())
    for (int pixel = 0; pixel < cell_tile_pixels; ++pixel) {
      const int x = area.left + pixel % cell_tile_side, y = area.bottom + pixel / cell_tile_side;
      depths[static_cast<std::size_t>(pixel)] =
          x < view_.width && y < view_.height ? visible_depths(x, y) : VisibleDepths{0, 0};
    }
  std::uint64_t unblended = 0;
  float later_key = -farthest;
  for (; is_in_batch(); ++tile.next) {
    const InTile& chunk = tile.chunks[tile.next];
    later_key = chunk.later_key;
    const std::int32_t slot = batch.slots[chunk.chunk - batch.first];
    if (slot < 0) continue;
    const CellsOnScreen& screen = workspace_.screens[static_cast<std::size_t>(slot)];
    const std::uint64_t had = segments.added;
    if (frame_.has_limits()) set_limits(screen, depths, segments);
    add_segments(frame_, screen, screen.in_tile(column, row), area, nearest_d(screen, chunk.first_key), segments);
    if (segments.is_full) return false;
    unblended += segments.added - had;
    drawn_segments_ += segments.added - had;
    if (unblended < blended_at_once) continue;
    tile.is_open = blend_segments(frame_, area, later_key, segments, tile.light);
    unblended = 0;
    if (!tile.is_open) break;
  }
  if (tile.is_open) tile.is_open = blend_segments(frame_, area, later_key, segments, tile.light);
  while (is_in_batch()) ++tile.next;
  tile.waiting.clear();
  tile.shades.clear();
  tile.counts.clear();
  if (!tile.is_open || std::ranges::max(segments.counts) == 0) {
    tile.waiting = {};
    tile.shades = {};
    return true;
  }
  tile.counts.assign(segments.counts.begin(), segments.counts.end());
  const auto count = static_cast<std::size_t>(std::accumulate(tile.counts.begin(), tile.counts.end(), std::int64_t{0}));
  const auto make_room = [&](auto& waiting) {
    if (waiting.capacity() > 2 * count) waiting = {};
    waiting.reserve(count);
  };
  make_room(tile.waiting);
  if (has_shades) make_room(tile.shades);
  for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel) {
    const auto keep = [&](const auto& all, auto& waiting) {
      const auto from = all.begin() + static_cast<std::ptrdiff_t>(segments.begin_of(pixel));
      waiting.insert(waiting.end(), from, from + segments.counts[pixel]);
    };
    keep(segments.segments, tile.waiting);
    if (has_shades) keep(segments.shades, tile.shades);
  }
  return true;
}

void CellSweep::finish_tile(int column, int row, const Tile& tile) {
  for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel) {
    const int x = column * cell_tile_side + static_cast<int>(pixel) % cell_tile_side;
    const int y = row * cell_tile_side + static_cast<int>(pixel) / cell_tile_side;
    if (x >= view_.width || y >= view_.height) continue;
    const auto& color = tile.light.color;
    picture_.image.at(x, view_.height - 1 - y) =
        vec4(color[0][pixel], color[1][pixel], color[2][pixel], 1 - tile.light.transmittance[pixel]);
  }
}

}  // namespace

CellRasterizer::CellRasterizer() : workspace_(std::make_unique<CellWorkspace>()) {}
CellRasterizer::~CellRasterizer() = default;

Result<CellPicture> CellRasterizer::draw(const CellSource& source, const CellDrawing& drawing) {
  // Wider samples would blur the outlines of surfaces.
  const int spacing = drawing.surfaces ? 1 : drawing.sample_spacing;
  const View view = spacing > 1 ? sampled_view(drawing.view, spacing) : drawing.view;
  SPLATVOL_TRY_ASSIGN(picture, CellSweep(source, drawing, view, *workspace_).draw());
  if (spacing <= 1) return picture;
  Image rows, whole{drawing.view.width, drawing.view.height, {}};
  whole.pixels.resize(static_cast<std::size_t>(whole.width) * static_cast<std::size_t>(whole.height));
  interpolate(picture.image, spacing, rows, whole);
  picture.image = std::move(whole);
  return picture;
}

bool tiles::TileSegments::make_room() {
  const int more_room = 2 * room + 4;
  is_full = is_full || more_room > most_room;
  if (is_full) return false;
  const auto spread = [&](auto& all) {
    if (all.empty()) return;
    std::remove_reference_t<decltype(all)> more(static_cast<std::size_t>(more_room) * cell_tile_pixels);
    for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel)
      std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(begin_of(pixel)), std::min(counts[pixel], room),
                  more.begin() + static_cast<std::ptrdiff_t>(pixel * static_cast<std::size_t>(more_room)));
    all = std::move(more);
  };
  spread(segments);
  spread(shades);
  room = more_room;
  return true;
}

}  // namespace splatvol
