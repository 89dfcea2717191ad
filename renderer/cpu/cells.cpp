#include "renderer/cpu/cells.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>
#include <utility>

#include "base/interruption.h"
#include "base/parallel.h"
#include "renderer/common.h"
#include "renderer/cpu/cell_frame.h"
#include "renderer/cpu/samples.h"
#include "renderer/sampled_view.h"
#include "scene/box_in_view.h"
#include "scene/clipped_depths.h"
#include "scene/tile_grid.h"

namespace splatvol {

using namespace tiles;

namespace {

constexpr float behind_all = 2 * farthest;  // key

/// The box round what is in a chunk, in view coordinates.
Box box_in_view(const View& view, const Box& box) {
  Box result;
  for (const dvec3& corner : corners_in_view(view, box)) result.include(corner);
  // Rounded outwards.
  const dvec3 margin = 1e-12 * glm::max(glm::abs(result.low), glm::abs(result.high));
  result.low -= margin, result.high += margin;
  return result;
}

/// The unit of length in which a picture is drawn, in world units: a power of two, so that it rounds nothing. All that
/// is in view has coordinates up to about 1 then, whatever the data's units are: single precision has room for them.
double unit_of(const CellSource& source, const View& view) {
  double reach = 0;
  for (const CellSource::Chunk& chunk : source.chunks())
    for (const dvec3& corner : corners_in_view(view, chunk.box))
      reach = std::max({reach, std::abs(corner.x), std::abs(corner.y), std::abs(corner.z)});
  return reach > 0 && std::isfinite(reach) ? std::exp2(std::ceil(std::log2(reach))) : 1;
}

View in_units(View view, double unit) {
  view.right /= unit, view.up /= unit, view.forward /= unit;
  if (view.orthographic) view.focal *= unit;
  return view;
}

TransferFunction in_units(TransferFunction function, double unit) {
  function.density_factor *= unit;
  return function;
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
  bool is_small = false;              // it surely fits into memory
  std::uint64_t largest_chunk = 0;    // bytes, if its cells cover many tiles; estimated

  [[nodiscard]] std::uint32_t end() const { return first + static_cast<std::uint32_t>(slots.size()); }

  // Ends after so many chunks.
  void cut(std::size_t count) {
    chunks.resize(count);
    slots.resize(chunks.back() - first + 1);
  }
};

/// Gives back the memory. Assigning {} would keep it.
template <class T>
void release(std::vector<T>& all) {
  std::vector<T>().swap(all);
}

/// A tile between batches.
struct Tile {
  CellTileArea area;
  CellTileLight light;               // if it has chunks or layers
  std::vector<CellSegment> waiting;  // pixel by pixel
  std::vector<SegmentShade> shades;  // of these
  std::vector<std::int32_t> counts;  // [pixel]; empty: none wait
  std::vector<InTile> chunks;
  std::size_t next = 0;        // of these
  std::uint64_t segments = 0;  // drawn
  float end_key = behind_all;  // no segment behind it is seen
  bool is_open = true;
  bool is_full = false;                                              // it has more segments than fit into memory
  bool is_left = false;                                              // for another sweep
  alignas(64) std::array<std::uint8_t, cell_tile_pixels> is_wanted;  // of a picture of some blocks

  void begin(const CellTileArea& drawn) {
    area = drawn;
    release(waiting);
    release(shades);
    counts.clear();
    chunks.clear();
    next = 0;
    segments = 0;
    end_key = behind_all;
    is_open = true;
    is_full = is_left = false;
  }
  void begin_light() {
    light = {};
    for (int y = area.pixels.y0; y <= area.pixels.y1; ++y)
      for (int x = area.pixels.x0; x <= area.pixels.x1; ++x) {
        const std::size_t pixel = CellTileArea::number_of(x, y);
        light.transmittance[pixel] = area.wants(pixel) ? 1 : 0;
      }
  }
  [[nodiscard]] std::uint64_t waiting_bytes() const {
    return waiting.capacity() * sizeof(CellSegment) + shades.capacity() * sizeof(SegmentShade);
  }
  void leave() {
    is_left = true;
    is_open = false;
    release(waiting);
    release(shades);
  }
};

std::uint64_t waiting_bytes(std::span<const Tile> tiles) {
  std::uint64_t bytes = 0;
  for (const Tile& tile : tiles) bytes += tile.waiting_bytes();
  return bytes;
}

struct SetupScratch {
  Tetrahedra cells;
  CellSetup setup;
};

struct TileScratch {
  TileSegments segments;
  std::vector<std::array<double, cell_tile_pixels>> limits, slices;  // as those of TileSegments, but nearness
};

constexpr int tile_of(int pixel) { return pixel / cell_tile_side; }

/// Halves what is drawn: tiles, then rows of one, then a row. Keeps one half, and returns the other; none of a pixel.
std::optional<PixelRectangle> halve(PixelRectangle& area) {
  const auto cut = [](int& last, int first, int side) -> std::optional<int> {
    const int begin = first / side, end = last / side + 1;
    if (end - begin < 2) return std::nullopt;
    const int middle = (begin + end + 1) / 2 * side;
    last = middle - 1;
    return middle;
  };
  PixelRectangle other = area;
  for (const int side : {cell_tile_side, 1}) {
    if (const auto middle = cut(area.y1, area.y0, side)) {
      other.y0 = *middle;
      return other;
    }
    if (const auto middle = cut(area.x1, area.x0, side)) {
      other.x0 = *middle;
      return other;
    }
  }
  return std::nullopt;
}

std::int64_t pixels_of(const PixelRectangle& area) {
  return std::int64_t{area.x1 - area.x0 + 1} * (area.y1 - area.y0 + 1);
}

}  // namespace

/// What pictures share: its memory.
struct tiles::CellWorkspace {
  std::vector<Tile> tiles;             // of a sweep
  std::vector<CellsOnScreen> screens;  // of a batch
  ThreadValues<SetupScratch> scratches;
  ThreadValues<TileScratch> tile_scratches;
};

namespace {

/// The picture of cells: in one sweep over the chunks, or in one for each part of the picture.
class CellSweep {
 public:
  /// `blocks`: the pixels to draw; null: all.
  CellSweep(const CellSource& source, const CellDrawing& drawing, const View& view, CellWorkspace& workspace,
            const DifferingBlocks* blocks = nullptr)
      : source_(source),
        drawing_(drawing),
        world_view_(view),
        unit_(unit_of(source, view)),
        view_(in_units(view, unit_)),
        function_(in_units(drawing.transfer.function, unit_)),
        workspace_(workspace) {
    const TransferFunction& function = drawing.transfer.function;
    frame_.view = &view_;
    frame_.blocks = blocks;
    frame_.function = &function_;
    frame_.low = function.lo;
    frame_.inverse_domain = 1 / (function.hi - function.lo);
    frame_.middle_x = 0.5 * view.width - 0.5;
    frame_.middle_y = 0.5 * view.height - 0.5;
    const auto side = static_cast<float>(std::max(view.width, view.height));
    frame_.widest = std::max(1024.0F, 2 * side);
    if (drawing.lighting) frame_.lighting = &*drawing.lighting;
    if (const TransferFunction* opacity = drawing.transfer.opacity) {
      opacity_.emplace(*opacity);
      frame_.opacity = &*opacity_;
      frame_.opacity_low = opacity->lo;
      frame_.opacity_inverse = 1 / (opacity->hi - opacity->lo);
    }
    frame_.layers = drawing.layers.size();
    set_events();
    frame_.slack = std::max(0.002F, 4e-6F * side);
    order_chunks();
  }

  /// `memory`: as that of CellRasterizer::draw; the picture whose blocks are drawn.
  Result<CellPicture> draw(Image memory);

 private:
  void set_events();
  void order_chunks();
  [[nodiscard]] PixelRectangle tiles_of(const Box& box) const;
  [[nodiscard]] double nearest_depth(const Box& box, int column, int row) const;
  [[nodiscard]] double nearness(double depth) const;
  [[nodiscard]] float key_of(double depth) const;
  [[nodiscard]] float first_key(const Chunk& chunk, int column, int row) const;

  Status draw_area(const PixelRectangle& area);
  void begin_tiles();
  void choose_pixels(Tile& tile) const;
  void choose_batch(std::uint32_t first);
  [[nodiscard]] bool shows(const Chunk& chunk) const;
  Status read_batch();
  Status read(const Chunk& chunk, CellsOnScreen& screen);
  Status shade(const Chunk& chunk, const Tetrahedra& cells, const CellSetup& setup, CellsOnScreen& screen);
  [[nodiscard]] std::uint64_t most_in_batch() const;
  [[nodiscard]] Status read_chunks(std::size_t begin, std::size_t end);
  [[nodiscard]] std::uint64_t most_waiting() const;
  Status leave_what_does_not_fit();
  Status leave(Tile& tile);
  void leave_half();
  void report(double share);

  [[nodiscard]] double layer_depth(const CellLayer& layer, int x, int y) const;
  [[nodiscard]] double opaque_depth(int x, int y) const;
  void begin_slices(const CellTileArea& area, TileScratch& scratch) const;
  void begin_limits(const CellTileArea& area, TileScratch& scratch) const;
  void set_limits(const CellTileArea& area, const CellsOnScreen& screen, TileScratch& scratch) const;
  void draw_tile(int column, int row, Tile& tile);
  void add_chunks(int column, int row, Tile& tile, TileScratch& scratch);
  void restore_waiting(const Tile& tile, TileSegments& segments) const;
  void keep_waiting(const TileSegments& segments, Tile& tile);
  [[nodiscard]] bool has_light(const Tile& tile) const { return !tile.chunks.empty() || frame_.layers > 0; }
  void finish_tile(const Tile& tile);

  // The bytes that a thread's segments may take, at the least.
  static constexpr std::uint64_t least_room = std::uint64_t{4} << 20;

  // Visits the tiles of the area that a rectangle of tiles has.
  template <class Visit>
  void visit_tiles(const PixelRectangle& tiles, const Visit& visit) const {
    for (int row = std::max(tiles.y0, tiles_.y0); row <= std::min(tiles.y1, tiles_.y1); ++row)
      for (int column = std::max(tiles.x0, tiles_.x0); column <= std::min(tiles.x1, tiles_.x1); ++column)
        visit(column, row, tile_at(column, row));
  }
  [[nodiscard]] int across() const { return tiles_.x1 - tiles_.x0 + 1; }
  [[nodiscard]] Tile& tile_at(int column, int row) const {
    return workspace_.tiles[static_cast<std::size_t>(row - tiles_.y0) * static_cast<std::size_t>(across()) +
                            static_cast<std::size_t>(column - tiles_.x0)];
  }
  // Visits all tiles of the area, in parallel.
  template <class Visit>
  void for_each_tile(const Visit& visit) {
    parallel_for(std::size_t{0}, workspace_.tiles.size(), [&](std::size_t i) {
      visit(tiles_.x0 + static_cast<int>(i) % across(), tiles_.y0 + static_cast<int>(i) / across(),
            workspace_.tiles[i]);
    });
  }
  [[nodiscard]] std::size_t place_of(int x, int y) const {
    return static_cast<std::size_t>(view_.height - 1 - y) * static_cast<std::size_t>(view_.width) +
           static_cast<std::size_t>(x);
  }

  const CellSource& source_;
  const CellDrawing& drawing_;
  View world_view_;
  double unit_;
  View view_;  // in units
  FunctionPieces function_;
  std::optional<FunctionPieces> opacity_, contour_colors_;
  CellEvents events_;
  std::vector<PlaneDepths> slices_;
  CellFrame frame_;
  std::vector<Chunk> chunks_;  // by their nearest depth
  CellWorkspace& workspace_;

  std::vector<PixelRectangle> left_;                 // what other sweeps draw
  PixelRectangle area_{}, tiles_{};                  // of this sweep: what it still draws; all of its tiles
  int most_rows_ = std::numeric_limits<int>::max();  // of tiles, that fit into memory
  Batch batch_;
  std::atomic<std::uint64_t> waiting_ = 0;  // bytes of segments
  std::atomic<bool> has_too_many_ = false;  // memory lacks the room: what waits is looked at first
  std::int64_t finished_pixels_ = 0;
  double reported_ = 0;
  CellPicture picture_;
};

void CellSweep::set_events() {
  const Contours& contours = drawing_.contours;
  if (contours.surfaces.empty() && view_.slices.empty()) return;
  const auto add = [&](double opacity, const dvec3& color, CellEvents::Coloring coloring) {
    events_.opacities.push_back(static_cast<float>(opacity));
    for (int c = 0; c < 3; ++c) events_.colors[static_cast<std::size_t>(c)].push_back(nearest_float(color[c]));
    events_.colorings.push_back(static_cast<std::int32_t>(coloring));
  };
  for (const Contour& contour : contours.surfaces) {
    events_.values.push_back(contour.value);
    events_.u.push_back(u_of(contour.value, frame_.low, frame_.inverse_domain, function_.origin));
    add(contour.opacity, contour.color,
        contour.is_colored ? CellEvents::Coloring::by_attribute : CellEvents::Coloring::own);
  }
  for (const Slice& slice : view_.slices) {
    add(slice.opacity, dvec3(0), CellEvents::Coloring::by_value);
    slices_.emplace_back(world_view_, slice.plane);
  }
  frame_.events = &events_;
  frame_.contour_lighting = contours.lighting;
  if (contours.attribute.empty()) return;
  contour_colors_.emplace(contours.colors);
  frame_.contour_colors = &*contour_colors_;
  frame_.contour_low = contours.colors.lo;
  frame_.contour_inverse = 1 / (contours.colors.hi - contours.colors.lo);
}

void CellSweep::order_chunks() {
  double reach = 0;
  for (const CellSource::Chunk& chunk : source_.chunks()) {
    chunks_.push_back({chunk, box_in_view(view_, chunk.box)});
    reach = std::max(reach, chunks_.back().box.high.z);
  }
  frame_.nearest = view_.orthographic ? 0 : 1e-7 * reach;
  frame_.farthest_nearness = nearness(std::max(reach, std::numeric_limits<double>::min()));
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
  return {tile_of(left), tile_of(right), tile_of(bottom), tile_of(top)};
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

// Rises towards the eye, and differs from each chunk's d by a number.
double CellSweep::nearness(double depth) const {
  if (depth == std::numeric_limits<double>::infinity()) return -double{farthest};
  if (view_.orthographic) return -depth;
  return depth > 0 ? 1 / depth : double{farthest};
}

float CellSweep::key_of(double depth) const { return static_cast<float>(frame_.farthest_nearness - nearness(depth)); }

// A key that no segment of a chunk in the tile has, nor a lower one.
float CellSweep::first_key(const Chunk& chunk, int column, int row) const {
  const double depth = std::max(nearest_depth(chunk.box, column, row), frame_.nearest);
  return std::nextafter(key_of(depth), -farthest);
}

Result<CellPicture> CellSweep::draw(Image memory) {
  picture_.image = std::move(memory);
  picture_.image.width = view_.width;
  picture_.image.height = view_.height;
  if (!frame_.blocks)
    picture_.image.pixels.assign(static_cast<std::size_t>(view_.width) * static_cast<std::size_t>(view_.height),
                                 vec4(0));
  left_ = {{0, view_.width - 1, 0, view_.height - 1}};
  while (!left_.empty()) {
    PixelRectangle area = left_.back();
    left_.pop_back();
    if (tile_of(area.y1) - tile_of(area.y0) >= most_rows_) {
      PixelRectangle& rest = left_.emplace_back(area);
      rest.y0 = (tile_of(area.y0) + most_rows_) * cell_tile_side;
      area.y1 = rest.y0 - 1;
    }
    SPLATVOL_TRY(draw_area(area));
  }
  return std::move(picture_);
}

Status CellSweep::draw_area(const PixelRectangle& area) {
  area_ = area;
  tiles_ = {tile_of(area.x0), tile_of(area.x1), tile_of(area.y0), tile_of(area.y1)};
  begin_tiles();
  // Threads of the loops know nothing of the stop of this one.
  const std::stop_token stop = stop_of_thread();
  for (std::uint32_t first = 0; first < chunks_.size(); first = batch_.end()) {
    SPLATVOL_TRY(check_interruption());
    choose_batch(first);
    SPLATVOL_TRY(read_batch());
    do {
      has_too_many_ = false;
      for_each_tile([&](int column, int row, Tile& tile) {
        if (!has_too_many_ && !stop.stop_requested()) draw_tile(column, row, tile);
      });
      SPLATVOL_TRY(check_interruption());
      SPLATVOL_TRY(leave_what_does_not_fit());
    } while (has_too_many_);
    report(static_cast<double>(batch_.end()) / static_cast<double>(chunks_.size()));
  }
  for_each_tile([&](int, int, const Tile& tile) {
    if (!tile.is_left && has_light(tile)) finish_tile(tile);
  });
  for (const Tile& tile : workspace_.tiles) {
    if (tile.is_left) continue;
    picture_.segments += tile.segments;
    finished_pixels_ += pixels_of(tile.area.pixels);
  }
  return {};
}

void CellSweep::begin_tiles() {
  waiting_ = 0;
  has_too_many_ = false;
  workspace_.tiles.resize(static_cast<std::size_t>(across()) * static_cast<std::size_t>(tiles_.y1 - tiles_.y0 + 1));
  for_each_tile([&](int column, int row, Tile& tile) {
    const int left = column * cell_tile_side, bottom = row * cell_tile_side;
    const auto within = [](int first, int last, int begin) {
      return std::pair(std::max(first - begin, 0), std::min(last - begin, cell_tile_side - 1));
    };
    const auto [x0, x1] = within(area_.x0, area_.x1, left);
    const auto [y0, y1] = within(area_.y0, area_.y1, bottom);
    tile.begin({left, bottom, {x0, x1, y0, y1}});
    if (frame_.blocks) choose_pixels(tile);
    if (frame_.layers == 0) return;
    tile.end_key = -farthest;
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) tile.end_key = std::max(tile.end_key, key_of(opaque_depth(left + x, bottom + y)));
  });
  for (std::uint32_t number = 0; number < chunks_.size(); ++number)
    visit_tiles(chunks_[number].tiles, [&](int column, int row, Tile& tile) {
      const float key = first_key(chunks_[number], column, row);
      if (tile.is_open && key < tile.end_key) tile.chunks.push_back({number, key, farthest});
    });
  for_each_tile([&](int, int, Tile& tile) {
    for (std::size_t i = tile.chunks.size(); i-- > 1;)
      tile.chunks[i - 1].later_key = std::min(tile.chunks[i].first_key, tile.chunks[i].later_key);
    if (has_light(tile)) tile.begin_light();
  });
}

// Closes tiles without pixels to draw.
void CellSweep::choose_pixels(Tile& tile) const {
  const PixelRectangle area = tile.area.in_picture();
  tile.is_open = frame_.blocks->meet(area);
  if (!tile.is_open) return;
  for (int y = area.y0; y <= area.y1; ++y)
    for (int x = area.x0; x <= area.x1; ++x)
      tile.is_wanted[CellTileArea::number_of(x - tile.area.left, y - tile.area.bottom)] =
          frame_.blocks->has(x, view_.height - 1 - y) ? 1 : 0;
  tile.area.is_wanted = tile.is_wanted.data();
}

std::uint64_t CellSweep::most_in_batch() const {
  return std::min<std::uint64_t>(drawing_.memory / 16 * 7, std::uint64_t{256} << 20);
}

// Chooses about as many chunks as fit into memory.
void CellSweep::choose_batch(std::uint32_t first) {
  constexpr std::uint64_t of_many_tiles = 4;  // a factor on the bytes of cells that cover many
  // A cell has about one contour, or none.
  const std::uint64_t bytes_of_cell =
      sizeof(CellOnScreen) + 2 * sizeof(std::uint32_t) +
      (frame_.events ? sizeof(CellShading) + sizeof(EventsOfCell) + sizeof(ContourInCell) + sizeof(NormalInCell) : 0);
  batch_.first = first;
  batch_.chunks.clear();
  batch_.slots.clear();
  batch_.largest_chunk = 0;
  std::uint64_t bytes = 0;
  while (batch_.end() < chunks_.size() && (bytes < most_in_batch() || batch_.chunks.empty())) {
    const std::uint32_t next = batch_.end();
    const bool is_shown = shows(chunks_[next]);
    batch_.slots.push_back(is_shown ? static_cast<std::int32_t>(batch_.chunks.size()) : -1);
    if (!is_shown) continue;
    batch_.chunks.push_back(next);
    const std::uint64_t of_chunk = chunks_[next].source.tetrahedra * bytes_of_cell;
    bytes += of_chunk;
    batch_.largest_chunk = std::max(batch_.largest_chunk, of_many_tiles * of_chunk);
  }
  batch_.is_small = of_many_tiles * bytes <= most_in_batch();
}

bool CellSweep::shows(const Chunk& chunk) const {
  bool is_shown = false;
  visit_tiles(chunk.tiles, [&](int column, int row, const Tile& tile) {
    is_shown = is_shown || (tile.is_open && first_key(chunk, column, row) < tile.end_key);
  });
  return is_shown;
}

// Reads the chunks of the batch. It ends where they have more memory than it may: cells that cover many tiles do.
Status CellSweep::read_batch() {
  std::vector<std::uint64_t> numbers;
  for (const std::uint32_t chunk : batch_.chunks) numbers.push_back(chunks_[chunk].source.number);
  SPLATVOL_TRY_ASSIGN(ahead, source_.read_ahead(numbers));
  // What an earlier batch had stays for its memory.
  std::vector<CellsOnScreen>& screens = workspace_.screens;
  screens.resize(batch_.chunks.size());
  for (CellsOnScreen& screen : screens) screen.clear();
  std::uint64_t bytes = 0, largest = batch_.largest_chunk;
  for (std::size_t begin = 0, end = 0; begin < batch_.chunks.size(); begin = end) {
    // Half of what fits if no other chunk is larger than those so far.
    const std::uint64_t fitting = (most_in_batch() - bytes) / std::max(largest, std::uint64_t{1}) / 2;
    const std::uint64_t left = batch_.chunks.size() - begin;
    end = begin + (batch_.is_small ? left : std::clamp(fitting, std::uint64_t{1}, left));
    if (begin == 0) largest = 0;
    SPLATVOL_TRY(read_chunks(begin, end));
    for (std::size_t i = begin; i < end; ++i) {
      bytes += screens[i].memory_bytes();
      largest = std::max(largest, screens[i].memory_bytes());
    }
    if (bytes >= most_in_batch() && end < batch_.chunks.size()) batch_.cut(end);
  }
  screens.resize(batch_.chunks.size());
  return {};
}

Status CellSweep::read_chunks(std::size_t begin, std::size_t end) {
  const std::stop_token stop = stop_of_thread();
  std::mutex mutex;
  Status status;
  parallel_for(begin, end, [&](std::size_t i) {
    const Interruptible heeds_stop(stop);
    if (is_interrupted()) return;
    Status read_one = read(chunks_[batch_.chunks[i]], workspace_.screens[i]);
    const std::scoped_lock lock(mutex);
    if (!read_one && status) status = std::move(read_one);
  });
  SPLATVOL_TRY(check_interruption());
  return status;
}

Status CellSweep::read(const Chunk& chunk, CellsOnScreen& screen) {
  auto& [memory, setup] = workspace_.scratches.local();
  SPLATVOL_TRY_ASSIGN(held, source_.read(chunk.source, memory));
  const Tetrahedra& cells = *held;
  if (cells.corners.empty()) return {};
  place_values(frame_, cells, setup);
  cut_by_slices(frame_, chunk.source.box, cells, setup);
  list_seen_cells(frame_, cells, setup);
  if (setup.seen.empty()) return {};
  place_points(frame_, chunk.box, cells, setup, screen);
  set_up_cells(frame_, cells, setup, screen);
  if (frame_.has_shades() || frame_.events) SPLATVOL_TRY(shade(chunk, cells, setup, screen));
  sort_into_tiles(setup, screen);
  return {};
}

Status CellSweep::shade(const Chunk& chunk, const Tetrahedra& cells, const CellSetup& setup, CellsOnScreen& screen) {
  if (frame_.events) find_events(frame_, cells, setup, screen);
  std::shared_ptr<const std::vector<dvec3>> gradients;
  if (!screen.normals.empty()) SPLATVOL_TRY_SET(gradients, source_.gradients(chunk.source, cells, events_.values));
  shade_cells(frame_, cells, gradients ? std::span(*gradients) : std::span<const dvec3>(), setup, screen);
  return {};
}

std::uint64_t CellSweep::most_waiting() const { return drawing_.memory / 16 * 5; }

// Leaves parts of the area to other sweeps, so that memory holds the rest.
Status CellSweep::leave_what_does_not_fit() {
  for (Tile& tile : workspace_.tiles)
    if (tile.is_full && !tile.is_left) SPLATVOL_TRY(leave(tile));
  for (;;) {
    waiting_ = waiting_bytes(workspace_.tiles);
    const bool is_one_tile = tile_of(area_.x0) == tile_of(area_.x1) && tile_of(area_.y0) == tile_of(area_.y1);
    if (waiting_ <= most_waiting() || (is_one_tile && waiting_ <= least_room)) return {};
    if (is_one_tile)
      SPLATVOL_TRY(leave(tile_at(tile_of(area_.x0), tile_of(area_.y0))));
    else
      leave_half();
  }
}

// Leaves a tile to two sweeps.
Status CellSweep::leave(Tile& tile) {
  PixelRectangle half = tile.area.in_picture();
  const std::optional<PixelRectangle> other = halve(half);
  if (!other)
    return fail(ErrorCode::out_of_budget,
                "the cells that overlap in a pixel need more memory: give more, or draw splats");
  left_.push_back(half);
  left_.push_back(*other);
  tile.leave();
  return {};
}

// Leaves half of the area to other sweeps: to one, unless some of its tiles have been left already.
void CellSweep::leave_half() {
  const PixelRectangle other = *halve(area_);
  most_rows_ = tile_of(area_.y1) - tile_of(area_.y0) + 1;
  const std::size_t left_before = left_.size();
  bool is_whole = true;
  visit_tiles({tile_of(other.x0), tile_of(other.x1), tile_of(other.y0), tile_of(other.y1)}, [&](int, int, Tile& tile) {
    is_whole = is_whole && !tile.is_left;
    if (tile.is_left) return;
    left_.push_back(tile.area.in_picture());
    tile.leave();
  });
  if (!is_whole) return;
  left_.resize(left_before);
  left_.push_back(other);
}

void CellSweep::report(double share) {
  if (!drawing_.progress) return;
  std::int64_t pixels = 0;
  for (const Tile& tile : workspace_.tiles) pixels += tile.is_left ? 0 : pixels_of(tile.area.pixels);
  const double done = (static_cast<double>(finished_pixels_) + share * static_cast<double>(pixels)) /
                      static_cast<double>(picture_.image.pixels.size());
  drawing_.progress(reported_ = std::max(reported_, done));
}

// Where a pixel's ray meets a layer.
double CellSweep::layer_depth(const CellLayer& layer, int x, int y) const {
  const double depth = layer.depths->depths[place_of(x, y)];
  return std::isnan(depth) ? std::numeric_limits<double>::infinity() : depth / unit_;
}

// Where a pixel's ray meets its nearest opaque layer.
double CellSweep::opaque_depth(int x, int y) const {
  for (const CellLayer& layer : drawing_.layers)
    if (!layer.light || layer.light->pixels[place_of(x, y)].a >= 1) return layer_depth(layer, x, y);
  return std::numeric_limits<double>::infinity();
}

// Finds where the rays of a tile meet slices: moved as they are.
void CellSweep::begin_slices(const CellTileArea& area, TileScratch& scratch) const {
  scratch.slices.resize(slices_.size());
  scratch.segments.slices.resize(slices_.size());
  for (std::size_t i = 0; i < slices_.size(); ++i) {
    scratch.slices[i].fill(-double{farthest});
    for (int y = area.pixels.y0; y <= area.pixels.y1; ++y)
      for (int x = area.pixels.x0; x <= area.pixels.x1; ++x)
        scratch.slices[i][CellTileArea::number_of(x, y)] =
            nearness(slices_[i].at((area.left + x - frame_.middle_x + ray_shift_x) / world_view_.focal,
                                   (area.bottom + y - frame_.middle_y + ray_shift_y) / world_view_.focal) /
                     unit_);
  }
}

// Prepares the layers of a tile, and between which depths its rays show something.
void CellSweep::begin_limits(const CellTileArea& area, TileScratch& scratch) const {
  TileSegments& segments = scratch.segments;
  const std::size_t layers = frame_.layers;
  segments.limits.resize(layers + 2);
  scratch.limits.resize(layers + 2);
  segments.layers.resize(layers + 1);
  segments.layers[layers].keys.fill(behind_all);
  segments.end_keys.fill(behind_all);
  for (auto& limit : scratch.limits) limit.fill(0);
  for (int y = area.bottom + area.pixels.y0; y <= area.bottom + area.pixels.y1; ++y)
    for (int x = area.left + area.pixels.x0; x <= area.left + area.pixels.x1; ++x) {
      const std::size_t pixel = CellTileArea::number_of(x - area.left, y - area.bottom);
      const VisibleDepths visible = clipped_depths(world_view_, (x - frame_.middle_x) / world_view_.focal,
                                                   (y - frame_.middle_y) / world_view_.focal);
      const double end = opaque_depth(x, y), from = nearness(visible.from / unit_);
      const double to = std::min(from, nearness(std::min(visible.to / unit_, end)));
      scratch.limits.front()[pixel] = from;
      scratch.limits.back()[pixel] = to;
      segments.end_keys[pixel] = key_of(end);
      for (std::size_t i = 0; i < layers; ++i) {
        const CellLayer& layer = drawing_.layers[i];
        const double depth = layer_depth(layer, x, y);
        scratch.limits[i + 1][pixel] = std::clamp(nearness(depth), to, from);
        segments.layers[i].keys[pixel] = key_of(depth);
        const vec4 light = layer.light ? layer.light->pixels[place_of(x, y)] : vec4(0);
        for (int c = 0; c < 4; ++c) segments.layers[i].light[static_cast<std::size_t>(c)][pixel] = light[c];
      }
    }
}

void CellSweep::set_limits(const CellTileArea& area, const CellsOnScreen& screen, TileScratch& scratch) const {
  const DepthOrigin& origin = screen.origin;
  const auto set = [&](const std::array<double, cell_tile_pixels>& from, TileSegments::Limits& to) {
    for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel) {
      const int x = area.left + static_cast<int>(pixel) % cell_tile_side;
      const int y = area.bottom + static_cast<int>(pixel) / cell_tile_side;
      to.d[pixel] = static_cast<float>(from[pixel] - origin.w - origin.rise(x - frame_.middle_x, y - frame_.middle_y));
    }
  };
  if (frame_.has_limits())
    for (std::size_t i = 0; i < scratch.limits.size(); ++i) set(scratch.limits[i], scratch.segments.limits[i]);
  for (std::uint64_t slices = screen.slices; slices != 0; slices &= slices - 1) {
    const auto slice = static_cast<std::size_t>(std::countr_zero(slices));
    set(scratch.slices[slice], scratch.segments.slices[slice]);
  }
}

void CellSweep::draw_tile(int column, int row, Tile& tile) {
  const auto is_in_batch = [&] {
    return tile.next < tile.chunks.size() && tile.chunks[tile.next].chunk < batch_.end();
  };
  if (!is_in_batch()) return;
  if (tile.is_open) {
    TileScratch& scratch = workspace_.tile_scratches.local();
    TileSegments& segments = scratch.segments;
    segments.most_bytes = std::max(drawing_.memory / 4 / parallel_threads(), least_room);
    segments.begin(tile.area, frame_.has_shades());
    if (!tile.counts.empty()) restore_waiting(tile, segments);
    if (!slices_.empty()) begin_slices(tile.area, scratch);
    if (frame_.has_limits()) begin_limits(tile.area, scratch);
    add_chunks(column, row, tile, scratch);
    if (tile.is_full) return;
    keep_waiting(segments, tile);
  }
  while (is_in_batch()) ++tile.next;
}

// Adds the segments of the batch's chunks, and blends what is final.
void CellSweep::add_chunks(int column, int row, Tile& tile, TileScratch& scratch) {
  constexpr std::uint64_t blended_at_once = std::uint64_t{32} * cell_tile_pixels;
  TileSegments& segments = scratch.segments;
  std::uint64_t unblended = 0, waiting = segments.count();
  float later_key = -farthest;
  const auto blend = [&] {
    tile.is_open = blend_segments(frame_, tile.area, later_key, segments, tile.light);
    unblended = 0;
    waiting = segments.count();
  };
  for (; tile.next < tile.chunks.size() && tile.chunks[tile.next].chunk < batch_.end(); ++tile.next) {
    const InTile& chunk = tile.chunks[tile.next];
    later_key = chunk.later_key;
    const std::int32_t slot = batch_.slots[chunk.chunk - batch_.first];
    if (slot < 0) continue;
    const CellsOnScreen& screen = workspace_.screens[static_cast<std::size_t>(slot)];
    const std::uint64_t had = segments.added;
    set_limits(tile.area, screen, scratch);
    add_segments(frame_, screen, screen.in_tile(column, row), tile.area, chunk.first_key, segments);
    tile.is_full = segments.is_full;
    if (tile.is_full) return;
    unblended += segments.added - had;
    tile.segments += segments.added - had;
    // Those that wait are sorted again each time.
    if (unblended < std::max(blended_at_once, waiting / 4)) continue;
    blend();
    if (!tile.is_open) return;
  }
  blend();
}

void CellSweep::restore_waiting(const Tile& tile, TileSegments& segments) const {
  while (segments.room < std::ranges::max(tile.counts)) static_cast<void>(segments.make_room());
  std::size_t from = 0;
  for (std::size_t pixel = 0; pixel < cell_tile_pixels; from += static_cast<std::size_t>(tile.counts[pixel++])) {
    if (tile.counts[pixel] == 0) continue;
    const auto copy = [&](const auto& waiting, auto& all) {
      std::copy_n(waiting.begin() + static_cast<std::ptrdiff_t>(from), tile.counts[pixel],
                  all.begin() + static_cast<std::ptrdiff_t>(segments.begin_of(pixel)));
    };
    copy(tile.waiting, segments.segments);
    if (frame_.has_shades()) copy(tile.shades, segments.shades);
  }
  std::ranges::copy(tile.counts, segments.counts.begin());
}

void CellSweep::keep_waiting(const TileSegments& segments, Tile& tile) {
  const std::uint64_t count = tile.is_open ? segments.count() : 0, before = tile.waiting_bytes();
  tile.waiting.clear();
  tile.shades.clear();
  tile.counts.clear();
  const auto make_room = [count](auto& waiting) {
    if (waiting.capacity() > 2 * count) release(waiting);
    waiting.reserve(count);
  };
  make_room(tile.waiting);
  if (frame_.has_shades()) make_room(tile.shades);
  if ((waiting_ += tile.waiting_bytes() - before) > most_waiting()) has_too_many_ = true;
  if (count == 0) return;
  tile.counts.assign(segments.counts.begin(), segments.counts.end());
  for (std::size_t pixel = 0; pixel < cell_tile_pixels; ++pixel) {
    if (segments.counts[pixel] == 0) continue;
    const auto keep = [&](const auto& all, auto& waiting) {
      const auto from = all.begin() + static_cast<std::ptrdiff_t>(segments.begin_of(pixel));
      waiting.insert(waiting.end(), from, from + segments.counts[pixel]);
    };
    keep(segments.segments, tile.waiting);
    if (frame_.has_shades()) keep(segments.shades, tile.shades);
  }
}

void CellSweep::finish_tile(const Tile& tile) {
  const PixelRectangle area = tile.area.in_picture();
  for (int y = area.y0; y <= area.y1; ++y)
    for (int x = area.x0; x <= area.x1; ++x) {
      const std::size_t pixel = CellTileArea::number_of(x - tile.area.left, y - tile.area.bottom);
      if (!tile.area.wants(pixel)) continue;
      const auto& color = tile.light.color;
      vec4 light(color[0][pixel], color[1][pixel], color[2][pixel], tile.light.transmittance[pixel]);
      // Layers of tiles without cells.
      for (auto i = static_cast<std::size_t>(tile.light.layers[pixel]); i < frame_.layers; ++i)
        if (const Image* layer = drawing_.layers[i].light) {
          const vec4& surface = layer->pixels[place_of(x, y)];
          light = vec4(vec3(light) + light.a * vec3(surface), light.a * (1 - surface.a));
        }
      light.a = 1 - light.a;
      picture_.image.pixels[place_of(x, y)] = light;
    }
}

}  // namespace

std::size_t count_pieces(const TransferFunction& function) { return tiles::FunctionPieces(function).count; }

CellRasterizer::CellRasterizer() : workspace_(std::make_unique<CellWorkspace>()) {}
CellRasterizer::~CellRasterizer() = default;

Result<CellPicture> CellRasterizer::draw(const CellSource& source, const CellDrawing& drawing, Image memory) {
  // Wider samples would blur the outlines of surfaces.
  const int spacing = drawing.layers.empty() ? drawing.sample_spacing : 1;
  const View view = spacing > 1 ? sampled_view(drawing.view, spacing) : drawing.view;
  const bool refines = spacing > 1 && drawing.refined_difference > 0;
  CellDrawing samples = drawing;
  if (refines && drawing.progress) samples.progress = [&](double share) { drawing.progress(0.5 * share); };
  CellSweep sweep(source, samples, view, *workspace_);
  if (spacing <= 1) return sweep.draw(std::move(memory));
  SPLATVOL_TRY_ASSIGN(picture, sweep.draw(std::move(samples_)));
  memory.width = drawing.view.width;
  memory.height = drawing.view.height;
  memory.pixels.resize(static_cast<std::size_t>(memory.width) * static_cast<std::size_t>(memory.height));
  interpolate(picture.image, spacing, sample_rows_, memory);
  samples_ = std::exchange(picture.image, std::move(memory));
  if (refines) SPLATVOL_TRY(refine(source, drawing, picture));
  return picture;
}

// Draws the blocks of pixels whose samples differ.
Status CellRasterizer::refine(const CellSource& source, const CellDrawing& drawing, CellPicture& picture) {
  const DifferingBlocks blocks(samples_, drawing.sample_spacing, {}, drawing.view.width, drawing.view.height,
                               drawing.refined_difference);
  if (blocks.is_empty()) return {};
  CellDrawing rest = drawing;
  if (drawing.progress) rest.progress = [&](double share) { drawing.progress(0.5 + 0.5 * share); };
  SPLATVOL_TRY_ASSIGN(refined,
                      CellSweep(source, rest, drawing.view, *workspace_, &blocks).draw(std::move(picture.image)));
  picture.image = std::move(refined.image);
  picture.segments += refined.segments;
  return {};
}

void tiles::TileSegments::begin(const CellTileArea& area, bool has_shades) {
  first_pixel = area.first_pixel();
  const std::size_t all = area.last_pixel() - first_pixel + 1;
  if (all != pixels) room = least_room;
  pixels = all;
  const std::size_t all_places = pixels * static_cast<std::size_t>(room);
  segments.resize(all_places);
  shades.resize(has_shades ? all_places : 0);
  counts.fill(0);
  is_full = false;
}

std::uint64_t tiles::TileSegments::count() const {
  return static_cast<std::uint64_t>(std::accumulate(counts.begin(), counts.end(), std::int64_t{0}));
}

bool tiles::TileSegments::make_room() {
  const std::uint64_t more_room = 2 * static_cast<std::uint64_t>(room) + 4;
  // What there is, and what takes its place; the keys and places of the deepest pixels, in the same way.
  const std::uint64_t of_place = pixels * sizeof(CellSegment) * (shades.empty() ? 1 : 2) + sizeof(Row);
  // Integers of 32 bits are places of numbers.
  constexpr std::uint64_t most_places = std::numeric_limits<std::int32_t>::max() / 4;
  is_full = is_full || (static_cast<std::uint64_t>(room) + more_room) * of_place > most_bytes ||
            more_room * pixels > most_places;
  if (is_full) return false;
  const auto spread = [&](auto& all) {
    if (all.empty()) return;
    std::remove_reference_t<decltype(all)> more(more_room * pixels);
    for (std::size_t pixel = first_pixel; pixel < first_pixel + pixels; ++pixel)
      std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(begin_of(pixel)), std::min(counts[pixel], room),
                  more.begin() + static_cast<std::ptrdiff_t>((pixel - first_pixel) * more_room));
    all = std::move(more);
  };
  spread(segments);
  spread(shades);
  room = static_cast<int>(more_room);
  return true;
}

}  // namespace splatvol
