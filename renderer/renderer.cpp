#include "renderer/renderer.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <limits>

namespace splatvol {

namespace {

constexpr std::size_t table_entries = 4097;  // 4096 steps: control points at binary fractions fall on entries
constexpr std::size_t quads_per_run = std::size_t{1} << 14;  // projected and drawn at a time

/// FrameBlock of frame.glsl, laid out by std140.
struct alignas(16) FrameBlock {
  std::array<vec4, 3> rotation;
  float image_width, image_height;
  float focal;
  float orthographic;
  float value_low;
  float inverse_domain;
};
static_assert(sizeof(FrameBlock) == 80 && offsetof(FrameBlock, focal) == 56 && offsetof(FrameBlock, value_low) == 64);

/// Seconds since the last call, or since its making.
class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    return std::chrono::duration<double>(now - std::exchange(start_, now)).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

bool same_view(const View& a, const View& b) {
  return a.eye == b.eye && a.right == b.right && a.up == b.up && a.forward == b.forward && a.focal == b.focal &&
         a.orthographic == b.orthographic && a.width == b.width && a.height == b.height;
}

void bind(const Buffer& buffer, Binding binding) {
  buffer.bind(GL_SHADER_STORAGE_BUFFER, static_cast<GLuint>(binding));
}

/// Runs a compute program over `count` elements from `first` on.
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

void write_records(std::span<const SplatBatch> batches, std::span<const std::size_t> first_of_batch,
                   OctantRecord* records) {
  tbb::parallel_for(std::size_t{0}, batches.size(), [&](std::size_t batch) {
    OctantRecord* record = records + first_of_batch[batch];
    for (const OctantSplat& splat : batches[batch].splats) *record++ = {splat, static_cast<std::uint32_t>(batch)};
  });
}

}  // namespace

Result<std::unique_ptr<Renderer>> Renderer::create() {
  if (epoxy_gl_version() < 45 || !epoxy_is_desktop_gl())
    return fail(ErrorCode::device, "OpenGL 4.5 is needed, the current context has {}.{} (0.0: there is none)",
                epoxy_gl_version() / 10, epoxy_gl_version() % 10);
  SPLATVOL_TRY_ASSIGN(kernel, make_octant_kernel());
  std::unique_ptr<Renderer> renderer(new Renderer(std::move(kernel)));
  SPLATVOL_TRY(renderer->prepare_quads());
  SPLATVOL_TRY(renderer->frame_.reserve(sizeof(FrameBlock)));
  SPLATVOL_TRY(check_gl("setting up the renderer"));
  return renderer;
}

Renderer::Renderer(Kernel kernel) : kernel_(std::move(kernel)) {}

Status Renderer::prepare_quads() {
  // The same two triangles for every quad. Indices, so that each corner is computed once; and no instances, which
  // rasterisers in software and hardware alike handle badly when they are this small.
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

Status Renderer::set_transfer_function(const TransferFunction& function, double value_offset) {
  if (function.colors.empty() || function.densities.empty() || !(function.lo < function.hi))
    return fail(ErrorCode::invalid_argument, "transfer function: no control points, or an empty domain");
  value_low_ = static_cast<float>(function.lo - value_offset);
  inverse_domain_ = static_cast<float>(1 / (function.hi - function.lo));
  ordered_view_.reset();

  if (transfer_table_.name() == 0) {
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_1D, 1, &name);
    transfer_table_ = Texture(name);
    glTextureStorage1D(name, 1, GL_RGBA32F, table_entries);
  }
  const std::vector<vec4> table = function.table(table_entries);
  glTextureSubImage1D(transfer_table_.name(), 0, 0, table_entries, GL_RGBA, GL_FLOAT, table.data());
  return check_gl("setting the transfer function");
}

std::uint64_t Renderer::max_splats() {
  const std::uint64_t by_buffer = largest_buffer() / sizeof(OctantRecord);
  return std::min<std::uint64_t>(by_buffer, std::numeric_limits<std::uint32_t>::max());
}

Status Renderer::set_splats(std::span<const SplatBatch> batches) {
  splat_count_ = 0;
  ordered_view_.reset();
  batch_origins_.clear();

  std::vector<std::size_t> first_of_batch;
  std::size_t count = 0;
  for (const SplatBatch& batch : batches) {
    first_of_batch.push_back(count);
    batch_origins_.push_back(batch.origin);
    count += batch.splats.size();
  }
  if (count > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::device, "{} splats: more than 32-bit indices reach", count);
  if (count == 0) return {};

  const std::size_t bytes = count * sizeof(OctantRecord);
  SPLATVOL_TRY(splats_.reserve(bytes));
  SPLATVOL_TRY(origins_.reserve(batches.size() * sizeof(vec4)));
  auto* records = static_cast<OctantRecord*>(splats_.map_to_write(bytes));
  if (!records) return fail(ErrorCode::device, "splats: {} bytes of the GPU's memory cannot be mapped", bytes);
  write_records(batches, first_of_batch, records);
  splats_.unmap();
  SPLATVOL_TRY(check_gl("uploading splats"));
  splat_count_ = count;
  return {};
}

Result<FrameTimes> Renderer::draw(const View& view, SortMode sort) {
  if (transfer_table_.name() == 0) return fail(ErrorCode::invalid_argument, "no transfer function has been set");
  SPLATVOL_TRY(prepare_target(view));
  clear_target();
  FrameTimes times;
  if (splat_count_ == 0) return times;

  Stopwatch stopwatch;
  SPLATVOL_TRY(upload_frame(view));
  times.upload = stopwatch.lap();
  if (sort == SortMode::exact) SPLATVOL_TRY(update_order(view, times));

  stopwatch.lap();
  if (sort == SortMode::exact)
    draw_quads(ordered_count_, true);
  else
    draw_quads(splat_count_, false);
  glFinish();
  times.draw = stopwatch.lap();
  SPLATVOL_TRY(check_gl("drawing"));
  return times;
}

Status Renderer::prepare_target(const View& view) {
  if (view.width == width_ && view.height == height_) return {};
  GLint largest = 0;
  std::array<GLint, 2> largest_viewport{};
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, largest_viewport.data());

  // A quad holds its pixels as 16-bit numbers.
  const int limit = std::min({largest, largest_viewport[0], largest_viewport[1], 65535});
  if (view.width < 1 || view.height < 1 || view.width > limit || view.height > limit)
    return fail(ErrorCode::invalid_argument, "image: {} x {} pixels, but this device draws 1 to {} each way",
                view.width, view.height, limit);

  width_ = height_ = 0;
  framebuffer_ = {};
  color_ = {};
  GLuint name = 0;
  glCreateTextures(GL_TEXTURE_2D, 1, &name);
  color_ = Texture(name);
  glTextureStorage2D(name, 1, GL_RGBA32F, view.width, view.height);
  glCreateFramebuffers(1, &name);
  framebuffer_ = Framebuffer(name);
  glNamedFramebufferTexture(name, GL_COLOR_ATTACHMENT0, color_.name(), 0);
  SPLATVOL_TRY(check_gl("making the picture's memory"));
  if (glCheckNamedFramebufferStatus(name, GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    return fail(ErrorCode::device, "this device does not draw into 32-bit float pictures");
  width_ = view.width;
  height_ = view.height;
  return {};
}

Status Renderer::upload_frame(const View& view) {
  const auto row = [](dvec3 axis) { return vec4(vec3(axis), 0.0F); };
  const FrameBlock block{.rotation = {row(view.right), row(view.up), row(view.forward)},
                         .image_width = static_cast<float>(view.width),
                         .image_height = static_cast<float>(view.height),
                         .focal = static_cast<float>(view.focal),
                         .orthographic = view.orthographic ? 1.0F : 0.0F,
                         .value_low = value_low_,
                         .inverse_domain = inverse_domain_};
  frame_.write(&block, sizeof(block));

  // Subtracted in double: far from the world's origin, only differences fit into single precision.
  std::vector<vec4> origins;
  origins.reserve(batch_origins_.size());
  for (const dvec3& origin : batch_origins_) origins.emplace_back(vec3(view.to_view(origin)), 0.0F);
  origins_.write(origins.data(), origins.size() * sizeof(vec4));

  frame_.bind(GL_UNIFORM_BUFFER, 0);
  bind(splats_, Binding::splats);
  bind(origins_, Binding::origins);
  glBindTextureUnit(0, transfer_table_.name());
  return check_gl("uploading the view");
}

Status Renderer::update_order(const View& view, FrameTimes& times) {
  if (ordered_view_ && same_view(*ordered_view_, view)) return {};
  ordered_view_.reset();
  Stopwatch stopwatch;
  const std::size_t bytes = splat_count_ * sizeof(std::uint32_t);
  SPLATVOL_TRY(keys_.reserve(bytes));
  SPLATVOL_TRY(order_.reserve(bytes));

  bind(keys_, Binding::keys);
  for_each_run(splat_count_, [&](std::size_t first, std::size_t count) { dispatch(kernel_.key, first, count); });
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
  const auto* keys = static_cast<const std::uint32_t*>(keys_.map_to_read(bytes));
  if (!keys) return fail(ErrorCode::device, "sort keys: {} bytes of the GPU's memory cannot be mapped", bytes);
  const std::span<const std::uint32_t> order = sorter_.sort({keys, splat_count_});
  keys_.unmap();
  times.sort += stopwatch.lap();

  order_.write(order.data(), order.size_bytes());
  SPLATVOL_TRY(check_gl("sorting"));
  times.upload += stopwatch.lap();
  ordered_count_ = order.size();
  ordered_view_ = view;
  return {};
}

void Renderer::clear_target() const {
  constexpr std::array<GLfloat, 4> transparent_black{};
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glClearNamedFramebufferfv(framebuffer_.name(), GL_COLOR, 0, transparent_black.data());
}

void Renderer::draw_quads(std::size_t count, bool ordered) const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glViewport(0, 0, width_, height_);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_STENCIL_TEST);
  glDisable(GL_CULL_FACE);
  glEnable(GL_BLEND);
  glBlendEquation(GL_FUNC_ADD);
  glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);  // premultiplied over
  glBindVertexArray(vertex_array_.name());
  bind(order_, Binding::order);
  bind(quads_, Binding::quads);
  glProgramUniform1i(kernel_.project.name(), location::ordered, ordered ? 1 : 0);

  // Run by run through the same small buffer of quads: its size does not grow with the splats, and it stays in caches.
  for_each_run(count, [&](std::size_t first, std::size_t run) {
    dispatch(kernel_.project, first, run);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
    glUseProgram(kernel_.draw.name());
    glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(6 * run), GL_UNSIGNED_INT, nullptr);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
  });
}

Result<Image> Renderer::read_image() const {
  if (width_ == 0) return fail(ErrorCode::invalid_argument, "no picture has been drawn");
  std::vector<vec4> rows(static_cast<std::size_t>(width_) * height_);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
  glPixelStorei(GL_PACK_ROW_LENGTH, 0);
  glPixelStorei(GL_PACK_ALIGNMENT, 4);
  glGetTextureImage(color_.name(), 0, GL_RGBA, GL_FLOAT, static_cast<GLsizei>(rows.size() * sizeof(vec4)), rows.data());
  SPLATVOL_TRY(check_gl("reading the picture"));

  // OpenGL's row 0 is the lowest.
  for (int y = 0; y < height_ / 2; ++y)
    std::swap_ranges(rows.begin() + std::ptrdiff_t{y} * width_, rows.begin() + std::ptrdiff_t{y + 1} * width_,
                     rows.begin() + std::ptrdiff_t{height_ - 1 - y} * width_);
  return Image{width_, height_, std::move(rows)};
}

std::uint64_t Renderer::gpu_bytes() const {
  std::uint64_t bytes = static_cast<std::uint64_t>(width_) * height_ * sizeof(vec4);
  if (transfer_table_.name() != 0) bytes += table_entries * sizeof(vec4);
  for (const Buffer* buffer : {&splats_, &frame_, &origins_, &keys_, &order_, &quads_, &quad_indices_})
    bytes += buffer->bytes();
  return bytes;
}

}  // namespace splatvol
