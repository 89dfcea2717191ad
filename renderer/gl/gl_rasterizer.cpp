#include "renderer/gl/gl_rasterizer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "renderer/gl/flip_rows.h"
#include "renderer/sampled_view.h"
#include "renderer/transfer_table.h"

namespace splatvol {

namespace {

constexpr std::size_t quads_per_run = std::size_t{1} << 12;         // projected and drawn at a time
constexpr std::size_t indices_per_part = std::size_t{1} << 22;      // of an order; whole runs
constexpr std::size_t entries_per_dispatch = std::size_t{1} << 16;  // OpenGL grants 65535 work groups
constexpr std::size_t records_of_entry = RecordPages::slot_records;
constexpr std::uint64_t most_splats = std::numeric_limits<std::uint32_t>::max();
constexpr unsigned page_shift = 6;  // of Entry::count_and_page

/// FrameBlock of frame.glsl, laid out by std140.
struct alignas(16) FrameBlock {
  std::array<vec4, 3> rotation;
  float image_width, image_height;
  float focal;
  float orthographic;
  float value_low;
  float inverse_domain;
  float ambient, diffuse;
  float value_axis, value_zero, value_unit, value_start;
  float opacity_low, opacity_inverse_domain, opacity_kind, opacity_zero, opacity_unit, opacity_start;
};
static_assert(sizeof(FrameBlock) == 128 && offsetof(FrameBlock, focal) == 56 && offsetof(FrameBlock, value_low) == 64);

/// DrawCommand of project.comp.
struct DrawCommand {
  GLuint count = 0, instances = 1, first_index = 0, base_vertex = 0, base_instance = 0;
};
using Run = std::array<DrawCommand, most_forms>;
static_assert(sizeof(Run) == 80);

void bind(const Buffer& buffer, Binding binding) {
  buffer.bind(GL_SHADER_STORAGE_BUFFER, static_cast<GLuint>(binding));
}

/// Runs a compute program for `count` elements from `first` on.
void dispatch(const Program& program, std::size_t first, std::size_t count) {
  glUseProgram(program.name());
  glUniform1ui(location::first, static_cast<GLuint>(first));
  glUniform1ui(location::count, static_cast<GLuint>(count));
  glDispatchCompute(static_cast<GLuint>((count + group_size - 1) / group_size), 1, 1);
}

/// Calls visit(first, count) for runs of at most quads_per_run elements.
template <class Visit>
void for_each_run(std::size_t count, const Visit& visit) {
  for (std::size_t first = 0; first < count; first += quads_per_run)
    visit(first, std::min(quads_per_run, count - first));
}

}  // namespace

Result<std::unique_ptr<GlRasterizer>> GlRasterizer::create(KernelKind kind, std::uint64_t most_bytes,
                                                           std::uint64_t page_bytes) {
  SPLATVOL_TRY(check_current_context());
  SPLATVOL_TRY_ASSIGN(kernel, make_kernel(kind));
  SPLATVOL_TRY_ASSIGN(upsampler, Upsampler::create());
  std::unique_ptr<GlRasterizer> rasterizer(
      new GlRasterizer(std::move(kernel), std::move(upsampler), most_bytes, page_bytes));
  SPLATVOL_TRY(rasterizer->prepare_quads());
  SPLATVOL_TRY(rasterizer->frame_.reserve(sizeof(FrameBlock)));
  SPLATVOL_TRY(check_gl("setting up the rasterizer"));
  return rasterizer;
}

Result<std::unique_ptr<Rasterizer>> GlRasterizer::make(const RasterizerOptions& options, bool is_automatic) {
  std::unique_ptr<HeadlessContext> context;
  if (!options.in_current_context) {
    const ContextKind kind = is_automatic ? ContextKind::hardware : ContextKind::any;
    SPLATVOL_TRY_SET(context, HeadlessContext::create(kind));
  } else if (is_automatic && is_software_renderer(device_text())) {
    return fail(ErrorCode::device, "OpenGL draws in software here");
  }
  SPLATVOL_TRY_ASSIGN(rasterizer, GlRasterizer::create(options.kernel, options.gpu_bytes));
  rasterizer->context_ = std::move(context);
  return rasterizer;
}

GlRasterizer::GlRasterizer(Kernel kernel, Upsampler upsampler, std::uint64_t most_bytes, std::uint64_t page_bytes)
    : kernel_(std::move(kernel)),
      upsampler_(std::move(upsampler)),
      most_bytes_(most_bytes),
      largest_side_(largest_target_side()),
      pages_(kernel_.kind, page_bytes) {}

Status GlRasterizer::prepare_quads() {
  // The same two triangles for every quad. With indices each corner is computed once. Instances would be slower: they
  // are too small here, for rasterisers in software and in hardware.
  std::vector<std::uint32_t> indices;
  indices.reserve(6 * quads_per_run);
  for (std::uint32_t quad = 0; quad < quads_per_run; ++quad)
    for (const std::uint32_t corner : {0, 1, 2, 2, 1, 3}) indices.push_back(4 * quad + corner);

  SPLATVOL_TRY(quad_indices_.reserve(indices.size() * sizeof(std::uint32_t)));
  quad_indices_.write(indices.data(), indices.size() * sizeof(std::uint32_t));
  SPLATVOL_TRY(quads_.reserve(quads_per_run * kernel_.quad_bytes));

  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  vertex_array_ = VertexArray(name);
  glVertexArrayElementBuffer(name, quad_indices_.object());
  return {};
}

Status GlRasterizer::set_transfer_function(const Transfer& transfer, const DrawingUnits& units) {
  SPLATVOL_TRY_ASSIGN(function, in_drawing_units(transfer.function, units));
  SPLATVOL_TRY_ASSIGN(opacity, make_opacity_table(transfer.opacity, units));
  if (units.length != units_.length) forget_surfaces();
  units_ = units;
  axis_ = stored_axis(function, units.value_offset, units.value_scale);
  ordered_view_.reset();

  const TransferTable table = make_transfer_table(function, kernel_.table.columns, kernel_.table.rows);
  const auto columns = static_cast<GLsizei>(table.columns);
  const auto rows = static_cast<GLsizei>(table.rows);
  if (transfer_table_.name() == 0) {
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_1D_ARRAY, 1, &name);
    transfer_table_ = Texture(name);
    glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTextureParameteri(name, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTextureParameteri(name, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTextureStorage2D(name, 1, GL_RGBA32F, columns, rows);
    glCreateTextures(GL_TEXTURE_1D, 1, &name);
    peak_table_ = Texture(name);
    glTextureStorage1D(name, std::bit_width(unsigned{peak_entries}), GL_R32F, peak_entries);
  }
  glTextureSubImage2D(transfer_table_.name(), 0, 0, 0, columns, rows, GL_RGBA, GL_FLOAT, table.entries.data());

  GLint level = 0;
  for (const std::vector<float>& peaks : make_peak_levels(function, peak_entries))
    glTextureSubImage1D(peak_table_.name(), level++, 0, static_cast<GLsizei>(peaks.size()), GL_RED, GL_FLOAT,
                        peaks.data());
  return set_opacity_table(opacity);
}

Status GlRasterizer::set_opacity_table(const OpacityTable& table) {
  opacity_axis_.reset();
  if (!table.factors.empty()) {
    const auto columns = static_cast<GLsizei>(table.columns), rows = static_cast<GLsizei>(table.rows);
    if (opacity_table_.name() == 0) {
      GLuint name = 0;
      glCreateTextures(GL_TEXTURE_1D_ARRAY, 1, &name);
      opacity_table_ = Texture(name);
      glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
      glTextureStorage2D(name, 1, GL_R32F, columns, rows);
    }
    glTextureSubImage2D(opacity_table_.name(), 0, 0, 0, columns, rows, GL_RED, GL_FLOAT, table.factors.data());
    opacity_axis_ = table.axis;
  }
  return check_gl("setting the transfer function");
}

void GlRasterizer::set_lighting(const std::optional<Lighting>& lighting) { lighting_ = lighting; }

std::uint64_t GlRasterizer::fixed_bytes() const {
  const std::uint64_t table =
      kernel_.table.columns * kernel_.table.rows * sizeof(vec4) + 2 * peak_entries * sizeof(float);
  return table + frame_.bytes() + quads_.bytes() + quad_indices_.bytes() + picture_bytes_ + surface_bytes();
}

// Returns the bytes of a list besides its records: entries, keys, one order and runs of quads.
std::uint64_t GlRasterizer::list_bytes(std::uint64_t splats, std::uint64_t ranges) const {
  const std::uint64_t entries = splats / records_of_entry + 2 * ranges;
  return ranges * sizeof(Range) + entries * (sizeof(Entry) + sizeof(std::uint32_t)) +
         std::min<std::uint64_t>(entries, entries_per_dispatch) * records_of_entry * sizeof(std::uint32_t) +
         splats * sizeof(std::uint32_t) + (splats / quads_per_run + 1) * sizeof(Run);
}

std::uint64_t GlRasterizer::plan_picture(int width, int height) {
  // The picture; as much again for the samples and the rows between them, if samples are farther apart than pixels.
  picture_bytes_ = 2 * sizeof(vec4) * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  return std::min(free_bytes() / splat_bytes(), most_splats);
}

// Returns what pictures and tables leave of the device's bytes.
std::uint64_t GlRasterizer::free_bytes() const {
  const std::uint64_t fixed = fixed_bytes();
  return most_bytes_ > fixed ? most_bytes_ - fixed : 0;
}

// Returns the bytes of a splat's record. Slots that are not full take a quarter more, for ranges of some 60 splats.
std::uint64_t GlRasterizer::padded_record_bytes() const {
  return (record_bytes(kernel_.kind) + (opacity_axis_ ? sizeof(OpacityValue) : 0)) * 5 / 4;
}

// Returns the bytes of a splat: its record, and its share of keys, order, entries and ranges.
std::uint64_t GlRasterizer::splat_bytes() const { return padded_record_bytes() + 2 * sizeof(std::uint32_t) + 4; }

GlRasterizer::RangeKey GlRasterizer::key_of(const DrawRange& range) {
  return {range.row.shapes->id(), range.row.values->id(), range.block, range.begin, range.count};
}

void GlRasterizer::forget_list() {
  range_keys_.clear();
  range_origins_.clear();
  ranges_.clear();
  entries_.clear();
  entries_of_pages_.clear();
  page_ends_.clear();
  axis_orders_ = {};
  ordered_view_.reset();
}

Status GlRasterizer::set_draw_list(const DrawList& list) {
  if (std::ranges::equal(list.ranges, range_keys_, {}, key_of)) return {};
  forget_list();
  for (const DrawRange& range : list.ranges) SPLATVOL_TRY(check_range(range, kernel_.kind));
  // The share of the pages is the same for all lists: pages do not shrink.
  const std::uint64_t free = free_bytes(), for_pages = free / splat_bytes() * padded_record_bytes();
  if (const std::uint64_t needed = list_bytes(list.splats, list.ranges.size()); needed > free - for_pages)
    return fail(ErrorCode::out_of_budget, "{} splats take {} bytes besides their records, {} are left on the device",
                list.splats, needed, free - for_pages);
  SPLATVOL_TRY(pages_.hold(list.ranges, for_pages));
  add_ranges(list);
  if (entries_.size() * records_of_entry > most_splats) {
    forget_list();
    return fail(ErrorCode::device, "{} splats: more than 32-bit numbers reach", list.splats);
  }
  Status uploaded = upload_entries();
  if (!uploaded) forget_list();
  return uploaded;
}

void GlRasterizer::add_ranges(const DrawList& list) {
  std::vector<std::size_t> counts(pages_.page_count());
  for (const DrawRange& range : list.ranges) {
    const ShapeRow& shapes = *range.row.shapes;
    const RecordBlock& block = shapes.blocks()[range.block];
    const auto number = static_cast<std::uint32_t>(ranges_.size());
    range_keys_.push_back(key_of(range));
    range_origins_.push_back(block.origin);
    ranges_.push_back({vec3(0), nearest_float(block.step), nearest_float(shapes.mass_scale()),
                       nearest_float(shapes.deviation_scale()), nearest_float(range.row.values->deviation_scale()),
                       nearest_float(range.row.values->opacity().deviation_scale)});
    if (range.count > 0)
      pages_.for_each_part(range, [&](std::uint32_t page, std::uint32_t first, std::uint32_t count) {
        entries_.push_back({first, count | page << page_shift, number});
        ++counts[page];
      });
  }
  std::size_t end = 0;
  for (const std::size_t count : counts) page_ends_.push_back(end += count);
  std::vector<std::size_t> next(counts.size());
  for (std::size_t page = 1; page < next.size(); ++page) next[page] = page_ends_[page - 1];
  entries_of_pages_.resize(entries_.size());
  for (std::size_t i = 0; i < entries_.size(); ++i)
    entries_of_pages_[next[entries_[i].count_and_page >> page_shift]++] = static_cast<std::uint32_t>(i);
}

Status GlRasterizer::upload_entries() {
  SPLATVOL_TRY(entry_buffer_.reserve(entries_.size() * sizeof(Entry)));
  SPLATVOL_TRY(page_buffer_.reserve(entries_.size() * sizeof(std::uint32_t)));
  SPLATVOL_TRY(range_buffer_.reserve(ranges_.size() * sizeof(Range)));
  entry_buffer_.write(entries_.data(), entries_.size() * sizeof(Entry));
  page_buffer_.write(entries_of_pages_.data(), entries_of_pages_.size() * sizeof(std::uint32_t));
  return check_gl("uploading the draw list");
}

std::string GlRasterizer::description() const { return device_text(); }

Result<FrameTimes> GlRasterizer::draw(const View& view, SortMode sort, int sample_spacing) {
  if (transfer_table_.name() == 0) return fail(ErrorCode::invalid_argument, "no transfer function has been set");
  SPLATVOL_TRY(check_drawing(capabilities(), view, sample_spacing));
  SPLATVOL_TRY(picture_.resize(view.width, view.height));
  Stopwatch stopwatch;
  SPLATVOL_TRY(upload_surfaces(view));
  const double upload = stopwatch.lap();
  if (sample_spacing == 1 || surface_depths_) {
    SPLATVOL_TRY_ASSIGN(times, draw_samples(view, sort, picture_));
    times.upload += upload;
    return times;
  }

  const View sampled = sampled_view(view, sample_spacing);
  SPLATVOL_TRY(samples_.resize(sampled.width, sampled.height));
  SPLATVOL_TRY_ASSIGN(times, draw_samples(sampled, sort, samples_));
  stopwatch.lap();
  SPLATVOL_TRY(upsampler_.run(samples_, sample_spacing, picture_));
  glFinish();
  times.draw += stopwatch.lap();
  return times;
}

Result<FrameTimes> GlRasterizer::draw_samples(const View& view, SortMode sort, const Target& target) {
  target.clear();
  FrameTimes times;
  if (entries_.empty()) return times;

  Stopwatch stopwatch;
  SPLATVOL_TRY(upload_frame(view));
  times.upload = stopwatch.lap();
  SPLATVOL_TRY_ASSIGN(order, prepare_order(view, sort, times));

  stopwatch.lap();
  SPLATVOL_TRY(prepare_runs(order.count));
  target.use();
  draw_quads(order);
  glFinish();
  times.draw = stopwatch.lap();
  SPLATVOL_TRY(check_gl("drawing"));
  return times;
}

Status GlRasterizer::set_surface_depths(std::shared_ptr<const SurfaceDepths> depths) {
  if (depths) SPLATVOL_TRY(check_surface_depths(*depths));
  surface_depths_ = std::move(depths);
  forget_surfaces();
  return {};
}

void GlRasterizer::forget_surfaces() {
  depth_texture_ = {};
  range_texture_ = {};
  surface_levels_ = 0;
}

// Returns the bytes of the depths, and the most that their ranges may take.
std::uint64_t GlRasterizer::surface_bytes() const {
  if (!surface_depths_) return 0;
  return surface_depths_->depths.size() * sizeof(float) * 5;
}

Status GlRasterizer::upload_surfaces(const View& view) {
  if (!surface_depths_ || surface_levels_ > 0) return surface_depths_ ? check_size(*surface_depths_, view) : Status{};
  SPLATVOL_TRY(check_size(*surface_depths_, view));
  SPLATVOL_TRY(add_surface_forms(kernel_));
  const DepthPyramid surfaces(*surface_depths_, units_.length);
  GLuint name = 0;
  glCreateTextures(GL_TEXTURE_2D, 1, &name);
  depth_texture_ = Texture(name);
  glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTextureStorage2D(name, 1, GL_R32F, surfaces.width(), surfaces.height());
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glPixelStorei(GL_UNPACK_ROW_LENGTH, surfaces.row_stride());
  glTextureSubImage2D(name, 0, 0, 0, surfaces.width(), surfaces.height(), GL_RED, GL_FLOAT, surfaces.at(0, 0));
  glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);

  const std::vector<DepthPyramid::Level>& levels = surfaces.levels();
  glCreateTextures(GL_TEXTURE_2D, 1, &name);
  range_texture_ = Texture(name);
  glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_NEAREST_MIPMAP_NEAREST);
  glTextureStorage2D(name, static_cast<GLsizei>(levels.size()), GL_RG32F, levels[0].columns, levels[0].rows);
  for (GLint i = 0; const DepthPyramid::Level& level : levels)
    glTextureSubImage2D(name, i++, 0, 0, level.columns, level.rows, GL_RG, GL_FLOAT, level.ranges.data());
  surface_levels_ = static_cast<GLint>(levels.size());
  return check_gl("uploading the depths of surfaces");
}

Status GlRasterizer::upload_frame(const View& view) {
  const auto row = [](dvec3 axis) { return vec4(vec3(axis), 0.0F); };
  const StoredAxis opacity = opacity_axis_.value_or(StoredAxis{});
  const FrameBlock block{.rotation = {row(view.right), row(view.up), row(view.forward)},
                         .image_width = static_cast<float>(view.width),
                         .image_height = static_cast<float>(view.height),
                         .focal = nearest_float(view.orthographic ? view.focal * units_.length : view.focal),
                         .orthographic = view.orthographic ? 1.0F : 0.0F,
                         .value_low = axis_.low,
                         .inverse_domain = axis_.inverse_domain,
                         .ambient = lighting_ ? static_cast<float>(lighting_->ambient) : 1.0F,
                         .diffuse = lighting_ ? static_cast<float>(lighting_->diffuse) : 0.0F,
                         .value_axis = static_cast<float>(axis_.kind),
                         .value_zero = axis_.zero,
                         .value_unit = axis_.unit,
                         .value_start = axis_.start,
                         .opacity_low = opacity.low,
                         .opacity_inverse_domain = opacity.inverse_domain,
                         .opacity_kind = static_cast<float>(opacity.kind),
                         .opacity_zero = opacity.zero,
                         .opacity_unit = opacity.unit,
                         .opacity_start = opacity.start};
  frame_.write(&block, sizeof(block));

  // Subtracted in double: far from the world's origin, only differences fit into single precision.
  for (std::size_t i = 0; i < ranges_.size(); ++i)
    ranges_[i].origin = vec3(view.to_view(range_origins_[i]) / units_.length);
  range_buffer_.write(ranges_.data(), ranges_.size() * sizeof(Range));

  frame_.bind(GL_UNIFORM_BUFFER, 0);
  bind(range_buffer_, Binding::ranges);
  bind(entry_buffer_, Binding::entries);
  glBindTextureUnit(0, transfer_table_.name());
  glBindTextureUnit(1, peak_table_.name());
  glBindTextureUnit(5, opacity_table_.name());
  return check_gl("uploading the view");
}

Result<GlRasterizer::Sequence> GlRasterizer::prepare_order(const View& view, SortMode sort, FrameTimes& times) {
  switch (sort) {
    case SortMode::none:
      return Sequence{nullptr, entries_.size() * records_of_entry};
    case SortMode::axis: {
      const dvec3 forward = view.forward;
      const int axis = longest_axis(glm::abs(forward));
      SPLATVOL_TRY_ASSIGN(sequence, order_along(axis, view, times));
      sequence.from_end = forward[axis] < 0;
      return sequence;
    }
    case SortMode::exact:
      if (ordered_view_ != view) {
        ordered_view_.reset();
        SPLATVOL_TRY(make_order(false, order_, times));
        ordered_view_ = view;
      }
      return Sequence{&order_, order_.count};
  }
  return fail(ErrorCode::invalid_argument, "no such sorting");
}

Result<GlRasterizer::Sequence> GlRasterizer::order_along(int axis, const View& view, FrameTimes& times) {
  std::optional<Order>& order = axis_orders_[axis];
  if (!order) {
    // The view of an eye in the middle of the blocks.
    dvec3 eye(0);
    for (const dvec3& origin : range_origins_) eye += origin / static_cast<double>(range_origins_.size());
    SPLATVOL_TRY(upload_frame(view_along(axis, eye)));
    Order sorted;
    SPLATVOL_TRY(make_order(true, sorted, times));
    order = std::move(sorted);
    SPLATVOL_TRY(upload_frame(view));
  }
  return Sequence{&*order, order->count};
}

Status GlRasterizer::make_order(bool by_depth, Order& order, FrameTimes& times) {
  Stopwatch stopwatch;
  SPLATVOL_TRY(compute_keys(by_depth));
  const std::span<const std::uint32_t> sorted = sorter_.sort(keys_);
  times.sort += stopwatch.lap();

  order.count = sorted.size();
  while (order.parts.size() * indices_per_part < sorted.size()) order.parts.emplace_back("drawing order");
  for (std::size_t first = 0, part = 0; first < sorted.size(); first += indices_per_part, ++part) {
    const auto indices = sorted.subspan(first, std::min(indices_per_part, sorted.size() - first));
    SPLATVOL_TRY(order.parts[part].reserve(indices.size_bytes()));
    order.parts[part].write(indices.data(), indices.size_bytes());
  }
  SPLATVOL_TRY(check_gl("sorting"));
  times.upload += stopwatch.lap();
  return {};
}

// Computes the keys of all splats by their numbers, page by page, as many at a time as a dispatch takes.
Status GlRasterizer::compute_keys(bool by_depth) {
  keys_.resize(entries_.size() * records_of_entry);
  const std::size_t most = std::min(entries_.size(), entries_per_dispatch);
  SPLATVOL_TRY(key_buffer_.reserve(most * records_of_entry * sizeof(std::uint32_t)));
  bind(key_buffer_, Binding::keys);
  bind(page_buffer_, Binding::entries_of_page);
  glProgramUniform1i(kernel_.key.name(), location::by_depth, by_depth ? 1 : 0);
  for (std::size_t page = 0, first = 0; page < page_ends_.size(); ++page) {
    bind_page(page);
    while (first < page_ends_[page]) {
      const std::size_t count = std::min(page_ends_[page] - first, entries_per_dispatch);
      dispatch(kernel_.key, first, count * records_of_entry);
      glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
      const std::size_t bytes = count * records_of_entry * sizeof(std::uint32_t);
      const auto* keys = static_cast<const std::uint32_t*>(key_buffer_.map_to_read(bytes));
      if (!keys) return fail(ErrorCode::device, "sort keys: {} bytes of the GPU's memory cannot be mapped", bytes);
      for (std::size_t i = 0; i < count; ++i)
        std::copy_n(keys + i * records_of_entry, records_of_entry,
                    keys_.begin() + static_cast<std::ptrdiff_t>(entries_of_pages_[first + i] * records_of_entry));
      key_buffer_.unmap();
      first += count;
    }
  }
  return {};
}

Status GlRasterizer::prepare_runs(std::size_t count) {
  std::vector<Run> runs;
  for_each_run(count,
               [&](std::size_t, std::size_t run) { runs.push_back({DrawCommand{static_cast<GLuint>(6 * run)}}); });
  SPLATVOL_TRY(runs_.reserve(runs.size() * sizeof(Run)));
  runs_.write(runs.data(), runs.size() * sizeof(Run));
  return {};
}

void GlRasterizer::bind_page(std::size_t page) const {
  bind(pages_.shapes(page), Binding::shapes);
  bind(pages_.values(page), Binding::values);
  const std::size_t opacity = opacity_axis_ ? pages_.opacity_offset(page) / sizeof(std::uint32_t) : 0;
  for (const Program* program : {&kernel_.key, &kernel_.project})
    glProgramUniform1ui(program->name(), location::opacity_offset, static_cast<GLuint>(opacity));
}

// Draws elements [first, first + count) of a sequence's order, through the same small buffer of quads as all runs: it
// stays in caches, and does not grow with the splats.
void GlRasterizer::draw_run(const Sequence& sequence, std::size_t first, std::size_t count) const {
  const std::size_t run = first / quads_per_run;
  if (sequence.order) {
    bind(sequence.order->parts[first / indices_per_part], Binding::order);
    first %= indices_per_part;
  }
  const GLuint project = kernel_.project.name();
  glProgramUniform1ui(project, location::run, static_cast<GLuint>(run));
  for (std::size_t page = 0; page < page_ends_.size(); ++page) {
    if (page_ends_[page] == (page == 0 ? 0 : page_ends_[page - 1])) continue;
    if (page_ends_.size() > 1) bind_page(page);
    glProgramUniform1ui(project, location::page, static_cast<GLuint>(page));
    dispatch(kernel_.project, first, count);
  }
  glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_COMMAND_BARRIER_BIT);
  const std::vector<Program>& forms = surface_depths_ ? kernel_.forms_with_surfaces : kernel_.forms;
  for (std::size_t form = 0; form < forms.size(); ++form) {
    glUseProgram(forms[form].name());
    const std::size_t command = run * sizeof(Run) + form * sizeof(DrawCommand);
    glDrawElementsIndirect(GL_TRIANGLES, GL_UNSIGNED_INT, reinterpret_cast<const void*>(command));
  }
  glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
}

void GlRasterizer::draw_quads(const Sequence& sequence) const {
  glEnable(GL_BLEND);
  glBlendEquation(GL_FUNC_ADD);
  glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);  // premultiplied over
  glBindVertexArray(vertex_array_.name());
  bind(quads_, Binding::quads);
  bind(runs_, Binding::runs);
  glBindBuffer(GL_DRAW_INDIRECT_BUFFER, runs_.object());
  bind_page(0);
  glProgramUniform1i(kernel_.project.name(), location::ordering, !sequence.order ? 0 : sequence.from_end ? -1 : 1);
  glProgramUniform1i(kernel_.project.name(), location::surface_levels, surface_levels_);
  if (surface_depths_) {
    glBindTextureUnit(3, depth_texture_.name());
    glBindTextureUnit(4, range_texture_.name());
  }

  const std::size_t runs = (sequence.count + quads_per_run - 1) / quads_per_run;
  for (std::size_t i = 0; i < runs; ++i) {
    const std::size_t first = (sequence.from_end ? runs - 1 - i : i) * quads_per_run;
    draw_run(sequence, first, std::min(quads_per_run, sequence.count - first));
  }
}

DevicePicture GlRasterizer::picture() const {
  return TexturePicture{picture_.texture(), picture_.width(), picture_.height()};
}

Result<Image> GlRasterizer::read_image() const {
  const int width = picture_.width(), height = picture_.height();
  if (width == 0) return fail(ErrorCode::invalid_argument, "no picture has been drawn");
  std::vector<vec4> rows(static_cast<std::size_t>(width) * height);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
  glPixelStorei(GL_PACK_ROW_LENGTH, 0);
  glPixelStorei(GL_PACK_ALIGNMENT, 4);
  glGetTextureImage(picture_.texture(), 0, GL_RGBA, GL_FLOAT, static_cast<GLsizei>(rows.size() * sizeof(vec4)),
                    rows.data());
  SPLATVOL_TRY(check_gl("reading the picture"));

  flip_rows(rows, width);
  return Image{width, height, std::move(rows)};
}

std::uint64_t GlRasterizer::device_bytes() const {
  std::uint64_t bytes = picture_.bytes() + samples_.bytes() + upsampler_.bytes() + pages_.bytes();
  if (surface_levels_ > 0) bytes += surface_bytes();
  if (transfer_table_.name() != 0)
    bytes += kernel_.table.columns * kernel_.table.rows * sizeof(vec4) + 2 * peak_entries * sizeof(float);
  const auto add = [&](const Order& order) {
    for (const Buffer& part : order.parts) bytes += part.bytes();
  };
  for (const std::optional<Order>& order : axis_orders_)
    if (order) add(*order);
  add(order_);
  for (const Buffer* buffer :
       {&entry_buffer_, &page_buffer_, &range_buffer_, &frame_, &key_buffer_, &runs_, &quads_, &quad_indices_})
    bytes += buffer->bytes();
  return bytes;
}

}  // namespace splatvol
