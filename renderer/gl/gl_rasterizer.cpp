#include "renderer/gl/gl_rasterizer.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <limits>

#include "renderer/transfer_table.h"

namespace splatvol {

namespace {

constexpr std::size_t peak_entries = 1024;
constexpr std::size_t quads_per_run = std::size_t{1} << 12;  // projected and drawn at a time

/// FrameBlock of frame.glsl, laid out by std140.
struct alignas(16) FrameBlock {
  std::array<vec4, 3> rotation;
  float image_width, image_height;
  float focal;
  float orthographic;
  float value_low;
  float inverse_domain;
  float ambient, diffuse;
  float value_axis, value_zero, value_unit;
};
static_assert(sizeof(FrameBlock) == 96 && offsetof(FrameBlock, focal) == 56 && offsetof(FrameBlock, value_low) == 64);

/// DrawCommand of project.comp.
struct DrawCommand {
  GLuint count = 0, instances = 1, first_index = 0, base_vertex = 0, base_instance = 0;
};
using Run = std::array<DrawCommand, most_forms>;
static_assert(sizeof(Run) == 60);

/// Measures the seconds between calls of `lap`; the first call counts from construction.
class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    return std::chrono::duration<double>(now - std::exchange(start_, now)).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

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

template <class Splat>
void write_records(std::span<const Splat> splats, std::span<const SplatBatch> batches,
                   std::span<const std::size_t> first_of_batch, void* records) {
  tbb::parallel_for(std::size_t{0}, batches.size(), [&](std::size_t batch) {
    auto* record = static_cast<Record<Splat>*>(records) + first_of_batch[batch];
    for (const Splat& splat : splats.subspan(batches[batch].first, batches[batch].count))
      *record++ = {splat, static_cast<std::uint32_t>(batch)};
  });
}

MomentsSplat moments_splat(const RecordRow& row, std::uint32_t record) {
  const Material m = unpack(row, record);
  const double sign = m.orientation.w < 0 ? -1 : 1;
  std::uint32_t correlations = 0, boundary = 0;
  for (int k = 0; k < 3; ++k) {
    correlations |= (static_cast<std::uint32_t>(std::lround(127 * m.correlations[k])) & 0xFFU) << 8 * k;
    boundary |= (static_cast<std::uint32_t>(std::lround(128 * m.boundary[k])) & 0x3FFU) << 10 * k;
  }
  const double explained = glm::dot(m.correlations, m.correlations);
  correlations |= static_cast<std::uint32_t>(std::lround(127 * std::sqrt(std::max(0.0, 1 - explained)))) << 24;
  return {vec3(m.center),
          static_cast<float>(m.mass),
          vec3(m.deviations),
          vec3(sign * m.orientation.x, sign * m.orientation.y, sign * m.orientation.z),
          static_cast<float>(m.value),
          static_cast<float>(m.value_deviation),
          correlations,
          boundary};
}

/// Rounds to single precision. Numbers beyond its range become the largest that it has, so that no product is NaN.
float nearest_float(double number) {
  constexpr double largest = std::numeric_limits<float>::max();
  return static_cast<float>(std::clamp(number, -largest, largest));
}

}  // namespace

Result<std::unique_ptr<GlRasterizer>> GlRasterizer::create(KernelKind kind) {
  if (epoxy_gl_version() < 45 || !epoxy_is_desktop_gl())
    return fail(ErrorCode::device, "OpenGL 4.5 is needed, the current context has {}.{} (0.0: there is none)",
                epoxy_gl_version() / 10, epoxy_gl_version() % 10);
  SPLATVOL_TRY_ASSIGN(kernel, make_kernel(kind));
  SPLATVOL_TRY_ASSIGN(upsampler, Upsampler::create());
  std::unique_ptr<GlRasterizer> rasterizer(new GlRasterizer(std::move(kernel), std::move(upsampler)));
  SPLATVOL_TRY(rasterizer->prepare_quads());
  SPLATVOL_TRY(rasterizer->frame_.reserve(sizeof(FrameBlock)));
  SPLATVOL_TRY(check_gl("setting up the rasterizer"));
  return rasterizer;
}

GlRasterizer::GlRasterizer(Kernel kernel, Upsampler upsampler)
    : kernel_(std::move(kernel)), upsampler_(std::move(upsampler)) {}

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

GlRasterizer::Axis GlRasterizer::axis_of(const TransferFunction& function, const DrawingUnits& units) {
  Axis axis;
  axis.zero = nearest_float(-units.value_offset / units.value_scale);
  double low = (function.lo - units.value_offset) / units.value_scale;
  double width = (function.hi - function.lo) / units.value_scale;
  if (function.axis == ValueAxis::log) {
    axis.kind = 1;
    low = std::log(function.lo / units.value_scale);
    width = std::log(function.hi / function.lo);
  } else if (function.axis == ValueAxis::asinh) {
    axis.kind = 2;
    axis.unit = nearest_float(units.value_scale / function.linear_width);
    low = std::asinh(function.lo / function.linear_width);
    width = std::asinh(function.hi / function.linear_width) - low;
  }
  axis.low = nearest_float(low);
  axis.inverse_domain = nearest_float(1 / width);
  return axis;
}

Status GlRasterizer::set_transfer_function(const TransferFunction& world_function, const DrawingUnits& units) {
  TransferFunction function = world_function;
  for (TransferFunction::Density& density : function.densities) density.extinction *= units.length;
  if (function.colors.empty() || function.densities.empty() || !(function.lo < function.hi) ||
      (function.axis == ValueAxis::log && !(function.lo > 0)))
    return fail(ErrorCode::invalid_argument, "transfer function: no control points, or an empty domain");
  units_ = units;
  axis_ = axis_of(function, units);
  ordered_view_.reset();

  const TransferTable table = make_transfer_table(function, kernel_.table_columns, kernel_.table_rows);
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
    glTextureStorage1D(name, std::bit_width(peak_entries), GL_R32F, peak_entries);
  }
  glTextureSubImage2D(transfer_table_.name(), 0, 0, 0, columns, rows, GL_RGBA, GL_FLOAT, table.entries.data());

  GLint level = 0;
  for (const std::vector<float>& peaks : make_peak_levels(function, peak_entries))
    glTextureSubImage1D(peak_table_.name(), level++, 0, static_cast<GLsizei>(peaks.size()), GL_RED, GL_FLOAT,
                        peaks.data());
  return check_gl("setting the transfer function");
}

void GlRasterizer::set_lighting(const std::optional<Lighting>& lighting) { lighting_ = lighting; }

std::uint64_t GlRasterizer::max_splats() const {
  const std::uint64_t by_buffer = largest_buffer() / kernel_.record_bytes;
  return std::min<std::uint64_t>(by_buffer, std::numeric_limits<std::uint32_t>::max());
}

std::uint64_t GlRasterizer::max_splats(int width, int height, std::uint64_t gpu_bytes) const {
  // The picture; as much again for the samples and the rows between them, if samples are farther apart than pixels.
  const std::uint64_t picture = sizeof(vec4) * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  const std::uint64_t table =
      kernel_.table_columns * kernel_.table_rows * sizeof(vec4) + 2 * peak_entries * sizeof(float);
  const std::uint64_t fixed = 2 * picture + table + frame_.bytes() + quads_.bytes() + quad_indices_.bytes();
  // Its record, its key and its index in the order; at worst an origin of its own. And a share of a run of quads.
  const std::uint64_t each = kernel_.record_bytes + 2 * sizeof(std::uint32_t) + sizeof(vec4) + 1;
  return gpu_bytes > fixed ? std::min(max_splats(), (gpu_bytes - fixed) / each) : 0;
}

Status GlRasterizer::set_splats(SplatSpan splats, std::span<const SplatBatch> batches) {
  splat_count_ = 0;
  ordered_view_.reset();
  axis_orders_ = {};
  batch_origins_.clear();
  batch_weights_.clear();

  const bool moments = std::holds_alternative<std::span<const MomentsSplat>>(splats);
  if (moments != (kernel_.kind == KernelKind::moments))
    return fail(ErrorCode::invalid_argument, "splats of the kernel {} cannot be drawn with the other one",
                moments ? "moments" : "octant");
  const std::size_t available = std::visit([](auto span) { return span.size(); }, splats);
  std::vector<std::size_t> first_of_batch;
  std::size_t count = 0;
  for (const SplatBatch& batch : batches) {
    if (batch.first > available || batch.count > available - batch.first)
      return fail(ErrorCode::invalid_argument, "a batch reaches beyond the {} splats", available);
    first_of_batch.push_back(count);
    batch_origins_.push_back(batch.origin);
    batch_weights_.push_back(batch.weight);
    count += batch.count;
  }
  if (count > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::device, "{} splats: more than 32-bit indices reach", count);
  if (count == 0) return {};

  const std::size_t bytes = count * kernel_.record_bytes;
  SPLATVOL_TRY(splats_.reserve(bytes));
  SPLATVOL_TRY(origins_.reserve(batches.size() * sizeof(vec4)));
  void* records = splats_.map_to_write(bytes);
  if (!records) return fail(ErrorCode::device, "splats: {} bytes of the GPU's memory cannot be mapped", bytes);
  std::visit([&](auto span) { write_records(span, batches, first_of_batch, records); }, splats);
  splats_.unmap();
  SPLATVOL_TRY(check_gl("uploading splats"));
  splat_count_ = count;
  return {};
}

Status GlRasterizer::set_weights(std::span<const DrawRange> ranges) {
  if (std::ranges::equal(ranges, batch_weights_, {}, &DrawRange::weight)) return {};
  std::ranges::transform(ranges, batch_weights_.begin(), &DrawRange::weight);
  ordered_view_.reset();  // the order leaves out splats that are too faint to be drawn
  return {};
}

Status GlRasterizer::set_draw_list(const DrawList& list) {
  const bool same = std::ranges::equal(list.ranges, list_.ranges, [](const DrawRange& a, const DrawRange& b) {
    return a.row == b.row && a.begin == b.begin && a.count == b.count;
  });
  if (same) {
    list_ = list;
    return set_weights(list.ranges);
  }
  list_ = {};
  std::vector<OctantSplat> octants;
  std::vector<MomentsSplat> moments;
  std::vector<SplatBatch> batches;
  const bool are_moments = kernel_.kind == KernelKind::moments;
  for (const DrawRange& range : list.ranges) {
    if (std::holds_alternative<std::vector<MomentsShape>>(range.row.shapes->records()) != are_moments)
      return fail(ErrorCode::invalid_argument, "splats of the kernel {} cannot be drawn with the other one",
                  are_moments ? "octant" : "moments");
    batches.push_back(
        {range.row.shapes->blocks()[range.block].origin, moments.size() + octants.size(), range.count, range.weight});
    for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i)
      if (are_moments)
        moments.push_back(moments_splat(range.row, i));
      else
        octants.push_back(unpack_octant(range.row, i));
  }
  SPLATVOL_TRY(are_moments ? set_splats(std::span<const MomentsSplat>(moments), batches)
                           : set_splats(std::span<const OctantSplat>(octants), batches));
  list_ = list;
  return {};
}

std::string GlRasterizer::description() const { return device_text(); }

Result<FrameTimes> GlRasterizer::draw(const View& view, SortMode sort, int sample_spacing) {
  if (transfer_table_.name() == 0) return fail(ErrorCode::invalid_argument, "no transfer function has been set");
  if (sample_spacing < 1 || sample_spacing > max_sample_spacing)
    return fail(ErrorCode::invalid_argument, "samples every {} pixels: 1 to {} are possible", sample_spacing,
                max_sample_spacing);
  SPLATVOL_TRY(picture_.resize(view.width, view.height));
  if (sample_spacing == 1) return draw_samples(view, sort, picture_);

  const View sampled = sampled_view(view, sample_spacing);
  SPLATVOL_TRY(samples_.resize(sampled.width, sampled.height));
  SPLATVOL_TRY_ASSIGN(times, draw_samples(sampled, sort, samples_));
  Stopwatch stopwatch;
  SPLATVOL_TRY(upsampler_.run(samples_, sample_spacing, picture_));
  glFinish();
  times.draw += stopwatch.lap();
  return times;
}

Result<FrameTimes> GlRasterizer::draw_samples(const View& view, SortMode sort, const Target& target) {
  target.clear();
  FrameTimes times;
  if (splat_count_ == 0) return times;

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

Status GlRasterizer::upload_frame(const View& view) {
  const auto row = [](dvec3 axis) { return vec4(vec3(axis), 0.0F); };
  const FrameBlock block{.rotation = {row(view.right), row(view.up), row(view.forward)},
                         .image_width = static_cast<float>(view.width),
                         .image_height = static_cast<float>(view.height),
                         .focal = nearest_float(view.orthographic ? view.focal * units_.length : view.focal),
                         .orthographic = view.orthographic ? 1.0F : 0.0F,
                         .value_low = axis_.low,
                         .inverse_domain = axis_.inverse_domain,
                         .ambient = lighting_ ? static_cast<float>(lighting_->ambient) : 1.0F,
                         .diffuse = lighting_ ? static_cast<float>(lighting_->diffuse) : 0.0F,
                         .value_axis = axis_.kind,
                         .value_zero = axis_.zero,
                         .value_unit = axis_.unit};
  frame_.write(&block, sizeof(block));

  // Subtracted in double: far from the world's origin, only differences fit into single precision.
  std::vector<vec4> origins;
  origins.reserve(batch_origins_.size());
  for (std::size_t i = 0; i < batch_origins_.size(); ++i)
    origins.emplace_back(vec3(view.to_view(batch_origins_[i]) / units_.length), batch_weights_[i]);
  origins_.write(origins.data(), origins.size() * sizeof(vec4));

  frame_.bind(GL_UNIFORM_BUFFER, 0);
  bind(splats_, Binding::splats);
  bind(origins_, Binding::origins);
  glBindTextureUnit(0, transfer_table_.name());
  glBindTextureUnit(1, peak_table_.name());
  return check_gl("uploading the view");
}

Result<GlRasterizer::Order> GlRasterizer::prepare_order(const View& view, SortMode sort, FrameTimes& times) {
  switch (sort) {
    case SortMode::none:
      return Order{nullptr, splat_count_};
    case SortMode::axis: {
      const dvec3 forward = view.forward;
      const dvec3 size = glm::abs(forward);
      const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
      SPLATVOL_TRY_ASSIGN(order, order_along(axis, view, times));
      order.from_end = forward[axis] < 0;
      return order;
    }
    case SortMode::exact:
      if (ordered_view_ != view) {
        ordered_view_.reset();
        SPLATVOL_TRY_ASSIGN(count, sort_keys(false, order_, times));
        ordered_count_ = count;
        ordered_view_ = view;
      }
      return Order{&order_, ordered_count_};
  }
  return fail(ErrorCode::invalid_argument, "no such sorting");
}

Result<GlRasterizer::Order> GlRasterizer::order_along(int axis, const View& view, FrameTimes& times) {
  std::optional<Buffer>& order = axis_orders_[axis];
  if (!order) {
    // The view of an eye in the middle of the batches.
    View along_axis{};
    along_axis.orthographic = true;
    for (const dvec3& origin : batch_origins_) along_axis.eye += origin / static_cast<double>(batch_origins_.size());
    along_axis.forward[axis] = 1;
    SPLATVOL_TRY(upload_frame(along_axis));
    Buffer sorted("order along an axis");
    SPLATVOL_TRY(sort_keys(true, sorted, times));
    order = std::move(sorted);
    SPLATVOL_TRY(upload_frame(view));
  }
  return Order{&*order, splat_count_};
}

Result<std::size_t> GlRasterizer::sort_keys(bool by_depth, Buffer& order, FrameTimes& times) {
  Stopwatch stopwatch;
  const std::size_t bytes = splat_count_ * sizeof(std::uint32_t);
  SPLATVOL_TRY(keys_.reserve(bytes));
  SPLATVOL_TRY(order.reserve(bytes));

  bind(keys_, Binding::keys);
  glProgramUniform1i(kernel_.key.name(), location::by_depth, by_depth ? 1 : 0);
  for_each_run(splat_count_, [&](std::size_t first, std::size_t count) { dispatch(kernel_.key, first, count); });
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
  const auto* keys = static_cast<const std::uint32_t*>(keys_.map_to_read(bytes));
  if (!keys) return fail(ErrorCode::device, "sort keys: {} bytes of the GPU's memory cannot be mapped", bytes);
  const std::span<const std::uint32_t> sorted = sorter_.sort({keys, splat_count_});
  keys_.unmap();
  times.sort += stopwatch.lap();

  order.write(sorted.data(), sorted.size_bytes());
  SPLATVOL_TRY(check_gl("sorting"));
  times.upload += stopwatch.lap();
  return sorted.size();
}

Status GlRasterizer::prepare_runs(std::size_t count) {
  std::vector<Run> runs;
  for_each_run(count,
               [&](std::size_t, std::size_t run) { runs.push_back({DrawCommand{static_cast<GLuint>(6 * run)}}); });
  SPLATVOL_TRY(runs_.reserve(runs.size() * sizeof(Run)));
  runs_.write(runs.data(), runs.size() * sizeof(Run));
  return {};
}

void GlRasterizer::draw_quads(const Order& order) const {
  glEnable(GL_BLEND);
  glBlendEquation(GL_FUNC_ADD);
  glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);  // premultiplied over
  glBindVertexArray(vertex_array_.name());
  if (order.indices) bind(*order.indices, Binding::order);
  bind(quads_, Binding::quads);
  bind(runs_, Binding::runs);
  glBindBuffer(GL_DRAW_INDIRECT_BUFFER, runs_.object());
  const GLuint project = kernel_.project.name();
  glProgramUniform1i(project, location::ordering, !order.indices ? 0 : order.from_end ? -1 : 1);
  glProgramUniform1ui(project, location::last, static_cast<GLuint>(order.count - 1));

  // Run by run through the same small buffer of quads: it stays in caches, and does not grow with the splats.
  for_each_run(order.count, [&](std::size_t first, std::size_t count) {
    const std::size_t run = first / quads_per_run;
    glProgramUniform1ui(project, location::run, static_cast<GLuint>(run));
    dispatch(kernel_.project, first, count);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_COMMAND_BARRIER_BIT);
    for (std::size_t form = 0; form < kernel_.forms.size(); ++form) {
      glUseProgram(kernel_.forms[form].name());
      const std::size_t command = run * sizeof(Run) + form * sizeof(DrawCommand);
      glDrawElementsIndirect(GL_TRIANGLES, GL_UNSIGNED_INT, reinterpret_cast<const void*>(command));
    }
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
  });
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

  // OpenGL's row 0 is the lowest.
  for (int y = 0; y < height / 2; ++y)
    std::swap_ranges(rows.begin() + std::ptrdiff_t{y} * width, rows.begin() + std::ptrdiff_t{y + 1} * width,
                     rows.begin() + std::ptrdiff_t{height - 1 - y} * width);
  return Image{width, height, std::move(rows)};
}

std::uint64_t GlRasterizer::device_bytes() const {
  std::uint64_t bytes = picture_.bytes() + samples_.bytes() + upsampler_.bytes();
  if (transfer_table_.name() != 0)
    bytes += kernel_.table_columns * kernel_.table_rows * sizeof(vec4) + 2 * peak_entries * sizeof(float);
  for (const std::optional<Buffer>& order : axis_orders_)
    if (order) bytes += order->bytes();
  for (const Buffer* buffer : {&splats_, &frame_, &origins_, &keys_, &order_, &runs_, &quads_, &quad_indices_})
    bytes += buffer->bytes();
  return bytes;
}

}  // namespace splatvol
