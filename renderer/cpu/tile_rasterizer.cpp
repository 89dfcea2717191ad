#include "renderer/cpu/tile_rasterizer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/interruption.h"
#include "base/parallel.h"
#include "renderer/common.h"
#include "renderer/cpu/moments_kernel.h"
#include "renderer/cpu/octant_kernel.h"
#include "renderer/cpu/samples.h"
#include "renderer/sampled_view.h"
#include "renderer/transfer_table.h"

namespace splatvol {

using namespace tiles;

namespace {

constexpr std::size_t splats_per_batch = std::size_t{1} << 16;
constexpr std::size_t splats_per_task = std::size_t{1} << 10;

/// Sets what does not depend on the view.
RangeInView make_range(const DrawRange& range, std::uint32_t first) {
  RangeInView result;
  if (const auto* shapes = std::get_if<std::vector<MomentsShape>>(&range.row.shapes->records())) {
    result.shapes = shapes->data() + range.begin;
    result.values = std::get<std::vector<MomentsValue>>(range.row.values->records()).data() + range.begin;
  } else {
    result.octants = std::get<std::vector<OctantShape>>(range.row.shapes->records()).data() + range.begin;
    result.octant_values = std::get<std::vector<OctantValue>>(range.row.values->records()).data() + range.begin;
  }
  const OpacityValues& opacity = range.row.values->opacity();
  if (!opacity.records.empty()) result.opacities = opacity.records.data() + range.begin;
  result.opacity_deviation_scale = nearest_float(opacity.deviation_scale);
  result.first = first;
  result.count = range.count;
  result.step = nearest_float(range.row.shapes->blocks()[range.block].step);
  constexpr double by_coverage = 1.0 / 255;
  result.mass_scale = nearest_float(range.row.shapes->mass_scale() * by_coverage);
  result.deviation_scale = nearest_float(range.row.shapes->deviation_scale());
  result.value_deviation_scale = nearest_float(range.row.values->deviation_scale());
  return result;
}

/// Reads a tile's pixels from a picture, for further splats behind them.
void load_pixels(const Image& image, const TileArea& area, TilePixels& pixels) {
  constexpr int plane = TilePixels::plane;
  for (int y = 0; y < area.height; ++y) {
    const vec4* from = &image.at(area.left, image.height - 1 - area.bottom - y);
    float* to = pixels.values.data() + y * TilePixels::row_stride;
    for (int x = 0; x < area.width; ++x) {
      to[x] = from[x].r;
      to[x + plane] = from[x].g;
      to[x + 2 * plane] = from[x].b;
      to[x + 3 * plane] = 1.0F - from[x].a;
    }
  }
}

void store_pixels(const TilePixels& pixels, const TileArea& area, Image& image) {
  constexpr int plane = TilePixels::plane;
  for (int y = 0; y < area.height; ++y) {
    vec4* to = &image.at(area.left, image.height - 1 - area.bottom - y);
    const float* from = pixels.values.data() + y * TilePixels::row_stride;
    for (int x = 0; x < area.width; ++x)
      to[x] = vec4(from[x], from[x + plane], from[x + 2 * plane], 1.0F - from[x + 3 * plane]);
  }
}

template <class Element>
std::uint64_t bytes_of(const std::vector<Element>& vector) {
  return sizeof(Element) * vector.capacity();
}

/// Old pixels stay.
void resize(Image& image, int width, int height) {
  image.width = width;
  image.height = height;
  image.pixels.resize(static_cast<std::size_t>(width) * height);
}

void clear(Image& image, int width, int height) {
  resize(image, width, height);
  std::ranges::fill(image.pixels, vec4(0));
}

}  // namespace

TileRasterizer::TileRasterizer(KernelKind kernel) : kernel_(kernel) {}

TileRasterizer::~TileRasterizer() = default;

Status TileRasterizer::set_transfer_function(const Transfer& transfer, const DrawingUnits& units) {
  SPLATVOL_TRY_ASSIGN(function, in_drawing_units(transfer.function, units));
  SPLATVOL_TRY_SET(opacity_, make_opacity_table(transfer.opacity, units));
  if (units.length != units_.length) surfaces_.reset();
  units_ = units;
  frame_.axis = stored_axis(function, units.value_offset, units.value_scale);
  ordered_view_.reset();
  new_function_ = std::move(function);
  return {};
}

// Makes the tables of a new function where splats are drawn: a picture of cells needs none.
void TileRasterizer::prepare_tables() {
  if (!new_function_) return;
  const TransferFunction function = *std::exchange(new_function_, std::nullopt);
  const TableSize size = table_size(kernel_);
  const TransferTable table = make_transfer_table(function, size.columns, size.rows);
  table_ = PackedTable(table);
  frame_.table = table_.view();
  peaks_.clear();
  for (const std::vector<float>& level : make_peak_levels(function, peak_entries))
    peaks_.insert(peaks_.end(), level.begin(), level.end());
  frame_.peaks = peaks_.data();
}

void TileRasterizer::set_lighting(const std::optional<Lighting>& lighting) { lighting_ = lighting; }

Status TileRasterizer::set_draw_list(const DrawList& list) {
  if (list.ranges == list_.ranges) return {};
  ordered_view_.reset();
  axis_orders_ = {};
  list_ = {};
  ranges_.clear();
  first_ranges_.clear();
  std::uint64_t total = 0;
  for (const DrawRange& range : list.ranges) {
    SPLATVOL_TRY(check_range(range, kernel_));
    total += range.count;
  }
  if (total >= std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::device, "{} splats: more than 32-bit indices reach", total);

  list_ = list;
  list_.splats = total;
  std::uint32_t first = 0;
  for (const DrawRange& range : list_.ranges) {
    if (range.count == 0) continue;
    // The groups that begin in this range.
    while (std::uint64_t{first_ranges_.size()} * splats_per_group < std::uint64_t{first} + range.count)
      first_ranges_.push_back(static_cast<std::uint32_t>(ranges_.size()));
    ranges_.push_back(make_range(range, first));
    first += range.count;
  }
  return {};
}

Status TileRasterizer::set_surface_depths(std::shared_ptr<const SurfaceDepths> depths) {
  if (depths) SPLATVOL_TRY(check_surface_depths(*depths));
  surface_depths_ = std::move(depths);
  surfaces_.reset();
  return {};
}

Status TileRasterizer::prepare_surfaces(const View& view) {
  frame_.surfaces = nullptr;
  if (!surface_depths_) return {};
  SPLATVOL_TRY(check_size(*surface_depths_, view));
  if (!surfaces_) surfaces_.emplace(*surface_depths_, units_.length);
  frame_.surfaces = &*surfaces_;
  return {};
}

Result<FrameTimes> TileRasterizer::draw(const View& view, SortMode sort, int sample_spacing) {
  if (!new_function_ && frame_.table.columns == 0)
    return fail(ErrorCode::invalid_argument, "no transfer function has been set");
  SPLATVOL_TRY(check_drawing(capabilities(), view, sample_spacing));
  FrameTimes times;
  Stopwatch stopwatch;
  prepare_tables();
  SPLATVOL_TRY(prepare_surfaces(view));
  times.upload = stopwatch.lap();
  if (sample_spacing == 1 || frame_.surfaces) {
    clear(picture_, view.width, view.height);
    draw_samples(view, sort, picture_, times);
    SPLATVOL_TRY(check_interruption());
    return times;
  }
  const View sampled = sampled_view(view, sample_spacing);
  clear(samples_, sampled.width, sampled.height);
  draw_samples(sampled, sort, samples_, times);
  SPLATVOL_TRY(check_interruption());
  stopwatch.lap();
  resize(picture_, view.width, view.height);
  interpolate(samples_, sample_spacing, sample_rows_, picture_);
  times.draw += stopwatch.lap();
  return times;
}

void TileRasterizer::set_view(const View& view) {
  int i = 0;
  for (const dvec3& axis : {view.right, view.up, view.forward})
    for (int k = 0; k < 3; ++k) frame_.rotation[static_cast<std::size_t>(i++)] = static_cast<float>(axis[k]);
  frame_.width = static_cast<float>(view.width);
  frame_.height = static_cast<float>(view.height);
  frame_.focal = nearest_float(view.orthographic ? view.focal * units_.length : view.focal);
  frame_.orthographic = view.orthographic;
  frame_.ambient = lighting_ ? static_cast<float>(lighting_->ambient) : 1.0F;
  frame_.diffuse = lighting_ ? static_cast<float>(lighting_->diffuse) : 0.0F;
  frame_.opacity = {};
  if (!opacity_.factors.empty() && std::ranges::all_of(ranges_, &RangeInView::opacities))
    frame_.opacity = {opacity_.axis, opacity_.factors.data(), static_cast<int>(opacity_.columns),
                      static_cast<int>(opacity_.rows), opacity_.row_spreads.data()};

  // Subtracted in double: far from the world's origin, only differences fit into single precision.
  std::size_t number = 0;
  for (const DrawRange& range : list_.ranges) {
    if (range.count == 0) continue;
    const dvec3 origin = view.to_view(range.row.shapes->blocks()[range.block].origin) / units_.length;
    RangeInView& in_view = ranges_[number++];
    in_view.x = nearest_float(origin.x);
    in_view.y = nearest_float(origin.y);
    in_view.z = nearest_float(origin.z);
  }
}

void TileRasterizer::draw_samples(const View& view, SortMode sort, Image& target, FrameTimes& times) {
  Stopwatch stopwatch;
  set_view(view);
  if (ranges_.empty()) return;
  times.upload += stopwatch.lap();
  const Sequence sequence = sequence_of(view, sort);
  times.sort += stopwatch.lap();

  grid_ = {view.width, view.height};
  closed_.assign(grid_.size(), 0);
  for (std::size_t first = 0; first < sequence.count && std::ranges::count(closed_, 0) > 0; first += splats_per_batch) {
    if (is_interrupted()) return;
    times.fragments += draw_batch(sequence, first, target);
  }
  times.draw += stopwatch.lap();
}

TileRasterizer::Sequence TileRasterizer::sequence_of(const View& view, SortMode sort) {
  if (sort == SortMode::axis) {
    const int axis = longest_axis(glm::abs(view.forward));
    // Orders run back to front along the axis.
    const std::vector<std::uint32_t>& order = order_along(axis, view);
    return {order.data(), order.size(), view.forward[axis] >= 0};
  }
  if (sort == SortMode::none) return {nullptr, list_.splats, true};
  if (ordered_view_ != view) {
    order_ = sort_keys(sorter_, SortKey::distance);
    ordered_view_ = view;
  }
  return {order_.data(), order_.size(), true};
}

const std::vector<std::uint32_t>& TileRasterizer::order_along(int axis, const View& view) {
  std::vector<std::uint32_t>& order = axis_orders_[static_cast<std::size_t>(axis)];
  if (order.empty()) {
    // The view of an eye in the middle of the ranges.
    dvec3 eye(0);
    const auto count = static_cast<double>(list_.ranges.size());
    for (const DrawRange& range : list_.ranges) eye += range.row.shapes->blocks()[range.block].origin / count;
    set_view(view_along(axis, eye));
    KeySorter sorter;
    const std::span<const std::uint32_t> sorted = sort_keys(sorter, SortKey::depth);
    order.assign(sorted.begin(), sorted.end());
    set_view(view);
  }
  return order;
}

std::span<const std::uint32_t> TileRasterizer::sort_keys(KeySorter& sorter, SortKey kind) {
  const auto compute = kernel_ == KernelKind::moments ? moments_keys : octant_keys;
  keys_.resize(list_.splats);
  const SplatNumbers numbers{ranges_, first_ranges_};
  const std::size_t tasks = (list_.splats + splats_per_task - 1) / splats_per_task;
  parallel_for(std::size_t{0}, tasks, [&](std::size_t task) {
    const std::size_t begin = task * splats_per_task, end = std::min(begin + splats_per_task, keys_.size());
    compute(frame_, numbers, static_cast<std::uint32_t>(begin), kind, std::span(keys_).subspan(begin, end - begin));
  });
  return sorter.sort(keys_);
}

void TileRasterizer::reserve_batch() {
  const std::size_t batch = std::min<std::size_t>(splats_per_batch, list_.splats);
  if (numbers_.size() < batch) numbers_.resize(batch);
  if (bounds_.size() < batch) bounds_.resize(batch);
  if (forms_.size() < batch) forms_.resize(batch);
  if (kernel_ == KernelKind::octant) {
    gaussians_.reserve(batch);
    if (frame_.surfaces) depths_of_gaussians_.reserve(batch);
    return;
  }
  near_.reserve(batch);
  far_.reserve(batch);
}

ScreenSplats TileRasterizer::screen() {
  return {bounds_.data(), forms_.data(),     far_.data(),
          near_.data(),   gaussians_.data(), frame_.surfaces ? depths_of_gaussians_.data() : nullptr};
}

double TileRasterizer::draw_batch(const Sequence& sequence, std::size_t first, Image& target) {
  const std::size_t count = std::min(splats_per_batch, sequence.count - first);
  reserve_batch();
  project_batch(sequence, first, count);
  draw_tiles(count, target);
  double fragments = 0;
  for (const PixelBounds& box : std::span(bounds_).first(count))
    fragments += static_cast<double>((box.right - box.left) * (box.top - box.bottom));
  return fragments;
}

void TileRasterizer::project_batch(const Sequence& sequence, std::size_t first, std::size_t count) {
  const SplatNumbers numbers{ranges_, first_ranges_};
  const auto project = kernel_ == KernelKind::moments ? project_moments : project_octant;
  parallel_for(std::size_t{0}, (count + splats_per_task - 1) / splats_per_task, [&](std::size_t task) {
    const std::size_t begin = task * splats_per_task, end = std::min(begin + splats_per_task, count);
    for (std::size_t i = begin; i < end; ++i) numbers_[i] = sequence[first + i];
    project(frame_, numbers, std::span(numbers_).subspan(begin, end - begin), screen().from(begin));
  });
}

void TileRasterizer::draw_tiles(std::size_t slots, Image& target) {
  bins_.fill(grid_, std::span(bounds_).first(slots), closed_);
  parallel_for_ranges(0, grid_.size(), 1, [&](std::size_t tile, std::size_t /*last*/) {
    if (!bins_.slots(tile).empty()) draw_tile(tile, target);
  });
}

void TileRasterizer::draw_tile(std::size_t tile, Image& target) {
  const TileArea area = grid_.area(tile);
  const std::span<const std::uint32_t> slots = bins_.slots(tile);
  TilePixels pixels;
  pixels.values.fill(0);
  load_pixels(target, area, pixels);
  bool opaque = false;
  if (kernel_ == KernelKind::moments)
    opaque = blend_moments(frame_, screen(), slots, area, pixels);
  else
    opaque = blend_octant(frame_, screen(), slots, area, pixels);
  closed_[tile] = opaque ? 1 : 0;
  store_pixels(pixels, area, target);
}

Result<Image> TileRasterizer::read_image() const {
  if (picture_.width == 0) return fail(ErrorCode::invalid_argument, "no picture has been drawn");
  return picture_;
}

std::uint64_t TileRasterizer::device_bytes() const {
  std::uint64_t bytes = table_.memory_bytes() + bytes_of(peaks_) + bytes_of(opacity_.factors) + bytes_of(ranges_) +
                        bytes_of(first_ranges_) + bytes_of(keys_) + sorter_.memory_bytes() + bytes_of(numbers_) +
                        bytes_of(bounds_) + bytes_of(forms_) + far_.memory_bytes() + near_.memory_bytes() +
                        gaussians_.memory_bytes() + bins_.memory_bytes() + bytes_of(closed_);
  bytes += depths_of_gaussians_.memory_bytes() + (surfaces_ ? surfaces_->memory_bytes() : 0);
  for (const std::vector<std::uint32_t>& order : axis_orders_) bytes += bytes_of(order);
  for (const Image* image : {&picture_, &samples_, &sample_rows_}) bytes += bytes_of(image->pixels);
  return bytes;
}

std::uint64_t TileRasterizer::plan_picture(int /*width*/, int /*height*/) {
  return std::numeric_limits<std::uint32_t>::max();
}

std::string TileRasterizer::description() const { return fmt::format("processor ({})", tiles::instruction_set()); }

}  // namespace splatvol
