#include "viewer/window/frame_composer.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "viewer/window/laid_out.h"

namespace splatvol {
namespace {

// Beside a moving picture, the interface's windows change so often at most.
constexpr double layer_period = 1.0 / 30;

constexpr float dark[] = {0.1F, 0.1F, 0.11F, 1};  // beside the picture
constexpr float clear[] = {0, 0, 0, 0};

constexpr std::string_view vertex_source = R"(#version 450 core
layout(location = 0) uniform vec4 corners;  // lower left and upper right
void main() {
  gl_Position = vec4(mix(corners.xy, corners.zw, vec2(gl_VertexID & 1, gl_VertexID >> 1)), 0, 1);
}
)";

constexpr std::string_view blend_source = R"(#version 450 core
layout(binding = 0) uniform sampler2D layer;
layout(location = 1) uniform int last_row;  // of a layer whose highest row is the first; else -1
layout(location = 0) out vec4 result;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  if (last_row >= 0) at.y = last_row - at.y;
  result = texelFetch(layer, at, 0);
}
)";

}  // namespace

Result<FrameComposer> FrameComposer::create() {
  FrameComposer composer;
  SPLATVOL_TRY_ASSIGN(program, build_program("the interface's layer", {{GL_VERTEX_SHADER, {vertex_source}},
                                                                       {GL_FRAGMENT_SHADER, {blend_source}}}));
  composer.blend_ = std::move(program);
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  composer.vertex_array_ = VertexArray(name);
  return composer;
}

std::optional<double> FrameComposer::waiting_seconds() const {
  if (!is_layer_old_) return {};
  return std::max(0.0, layer_period - std::max(layer_seconds_, still_seconds_));
}

Result<bool> FrameComposer::compose(const FrameParts& parts, Gui& gui, GLuint framebuffer) {
  // OpenGL counts a window's rows from below, and Mesa keeps the highest one first. A copy in Mesa's order is quick.
  const bool top_first = framebuffer == 0;
  const PixelRect area{parts.left, 0, parts.left + parts.width, parts.pixel_height};
  const bool is_other = parts.is_lost || area != area_ || parts.pixel_width != width_ || top_first != top_first_;
  if (is_other) SPLATVOL_TRY(begin(parts, top_first));
  layer_seconds_ += parts.seconds;
  still_seconds_ = parts.is_new ? 0 : still_seconds_ + parts.seconds;
  is_layer_old_ = is_other || windows_.differ(gui.windows());
  const bool updates = is_layer_old_ && (is_other || waiting_seconds() == 0.0);
  if (!is_other && !parts.is_new && !updates && !overlays_.differ(gui.overlays())) return false;

  if (updates) SPLATVOL_TRY(update_layer(gui));
  if (is_other || parts.is_new) SPLATVOL_TRY(take_picture(parts));
  overlays_.keep(gui.overlays());
  SPLATVOL_TRY(draw(gui, framebuffer));
  return true;
}

// Begins with other sizes, or anew.
Status FrameComposer::begin(const FrameParts& parts, bool top_first) {
  width_ = parts.pixel_width, height_ = parts.pixel_height;
  area_ = {parts.left, 0, parts.left + parts.width, parts.pixel_height};
  top_first_ = top_first;
  windows_ = {};
  is_layer_lost_ = true;
  return layer_.resize(width_, height_);
}

// Draws the windows where they have changed.
Status FrameComposer::update_layer(Gui& gui) {
  std::vector<PixelRect> changed = windows_.take(gui.windows(), gui.pixels_of_unit());
  const PixelRect all{0, 0, width_, height_};
  if (std::exchange(is_layer_lost_, false)) changed = {all};
  layer_.use();
  for (PixelRect& part : changed) clear_layer(part = intersection(part, all));
  is_layer_old_ = false;
  layer_seconds_ = 0;
  return gui.draw(gui.windows(), changed, top_first_);
}

// The layer is opaque beside the picture.
void FrameComposer::clear_layer(const PixelRect& part) const {
  const auto fill = [&](const PixelRect& columns, const float* color) {
    const PixelRect filled = intersection(part, columns);
    if (filled.is_empty()) return;
    glScissor(filled.left, top_first_ ? filled.top : height_ - filled.bottom, filled.right - filled.left,
              filled.bottom - filled.top);
    glClearNamedFramebufferfv(layer_.framebuffer(), GL_COLOR, 0, color);
  };
  glEnable(GL_SCISSOR_TEST);
  fill({0, 0, area_.left, height_}, dark);
  fill(area_, clear);
  fill({area_.right, 0, width_, height_}, dark);
  glDisable(GL_SCISSOR_TEST);
}

Status FrameComposer::take_picture(const FrameParts& parts) {
  const int width = area_.right - area_.left;
  SPLATVOL_TRY(picture_.resize(width, height_));
  if (parts.picture->width > 0)
    lay_out(*parts.picture, width, height_, top_first_, pixels_);
  else
    pixels_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height_), 0xFF000000U);  // black
  return picture_.write(pixels_);
}

Status FrameComposer::draw(Gui& gui, GLuint framebuffer) const {
  for (const GLenum test : {GL_SCISSOR_TEST, GL_DEPTH_TEST, GL_CULL_FACE}) glDisable(test);
  copy_columns(picture_, 0, area_.left, area_.right, framebuffer);
  copy_columns(layer_, 0, 0, area_.left, framebuffer);
  copy_columns(layer_, area_.right, area_.right, width_, framebuffer);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  SPLATVOL_TRY(gui.draw(gui.overlays(), {&area_, 1}, false));
  blend_layer();
  return check_gl("the frame");
}

// Copies columns to the same rows.
void FrameComposer::copy_columns(const ByteTarget& from, int from_left, int left, int right, GLuint framebuffer) const {
  if (left >= right) return;
  const int first = top_first_ ? height_ : 0;
  glBlitNamedFramebuffer(from.framebuffer(), framebuffer, from_left, 0, from_left + right - left, height_, left, first,
                         right, height_ - first, GL_COLOR_BUFFER_BIT, GL_NEAREST);
}

// Over the picture, where there are windows. No pixel is blended twice.
void FrameComposer::blend_layer() const {
  std::vector<PixelRect> parts;
  for (const PixelRect& bounds : windows_.bounds()) parts.push_back(intersection(bounds, area_));
  glViewport(0, 0, width_, height_);
  glEnable(GL_BLEND);
  glBlendEquation(GL_FUNC_ADD);
  glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  glUseProgram(blend_.name());
  glUniform1i(1, top_first_ ? height_ - 1 : -1);
  glBindTextureUnit(0, layer_.texture());
  glBindVertexArray(vertex_array_.name());
  for (const PixelRect& part : disjoint(std::move(parts))) {
    const auto across = [](int at, int size) { return 2 * static_cast<float>(at) / static_cast<float>(size) - 1; };
    glUniform4f(0, across(part.left, width_), -across(part.bottom, height_), across(part.right, width_),
                -across(part.top, height_));
    glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
  }
  glBindVertexArray(0);
  glDisable(GL_BLEND);
}

}  // namespace splatvol
