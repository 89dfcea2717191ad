#include "renderer/gl/host_state.h"

#include <array>
#include <ranges>

namespace splatvol {
namespace {

// What shaders of the renderer are bound to: `binding` in shaders/.
constexpr GLuint texture_units = 6, storage_buffers = 8, uniform_buffers = 1;

// The first number of a state. Some drivers return more than one, as of GL_POLYGON_MODE: one for each face.
GLint integer(GLenum name) {
  std::array<GLint, 4> values{};
  glGetIntegerv(name, values.data());
  return values[0];
}

GLuint object(GLenum binding) { return static_cast<GLuint>(integer(binding)); }

GLenum enumerator(GLenum name) { return static_cast<GLenum>(integer(name)); }

GLenum enumerator_at(GLenum name, GLuint index) {
  std::array<GLint, 4> values{};
  glGetIntegeri_v(name, index, values.data());
  return static_cast<GLenum>(values[0]);
}

void set_capability(GLenum capability, bool on) { on ? glEnable(capability) : glDisable(capability); }

void set_capability(GLenum capability, GLuint index, bool on) {
  on ? glEnablei(capability, index) : glDisablei(capability, index);
}

}  // namespace

HostState::HostState() {
  while (glGetError() != GL_NO_ERROR) {
  }
  keep_fragment_state();
  keep_primitive_state();
  keep_bindings();
  keep_textures();
  keep_pixel_transfers();
}

HostState::~HostState() {
  for (const auto& restore : std::views::reverse(restores_)) restore();
}

void HostState::keep_fragment_state() {
  for (const GLenum capability : {GL_DEPTH_TEST, GL_STENCIL_TEST, GL_COLOR_LOGIC_OP, GL_SAMPLE_ALPHA_TO_COVERAGE,
                                  GL_SAMPLE_ALPHA_TO_ONE, GL_SAMPLE_COVERAGE, GL_SAMPLE_MASK, GL_SAMPLE_SHADING}) {
    restores_.emplace_back([=, on = glIsEnabled(capability) != 0] { set_capability(capability, on); });
    glDisable(capability);
  }
  for (GLint target = 0; target < integer(GL_MAX_DRAW_BUFFERS); ++target) keep_blending(static_cast<GLuint>(target));
}

void HostState::keep_blending(GLuint target) {
  const auto kept = [&](GLenum name) { return enumerator_at(name, target); };
  std::array<GLboolean, 4> mask{};
  glGetBooleani_v(GL_COLOR_WRITEMASK, target, mask.data());
  restores_.emplace_back([=, on = glIsEnabledi(GL_BLEND, target) != 0, rgb = kept(GL_BLEND_EQUATION_RGB),
                          alpha = kept(GL_BLEND_EQUATION_ALPHA), source_rgb = kept(GL_BLEND_SRC_RGB),
                          source_alpha = kept(GL_BLEND_SRC_ALPHA), target_rgb = kept(GL_BLEND_DST_RGB),
                          target_alpha = kept(GL_BLEND_DST_ALPHA)] {
    set_capability(GL_BLEND, target, on);
    glBlendEquationSeparatei(target, rgb, alpha);
    glBlendFuncSeparatei(target, source_rgb, target_rgb, source_alpha, target_alpha);
    glColorMaski(target, mask[0], mask[1], mask[2], mask[3]);
  });
}

void HostState::keep_primitive_state() {
  for (const GLenum capability : {GL_CULL_FACE, GL_RASTERIZER_DISCARD, GL_PRIMITIVE_RESTART,
                                  GL_PRIMITIVE_RESTART_FIXED_INDEX, GL_POLYGON_SMOOTH, GL_POLYGON_OFFSET_FILL}) {
    restores_.emplace_back([=, on = glIsEnabled(capability) != 0] { set_capability(capability, on); });
    glDisable(capability);
  }
  for (GLint plane = 0; plane < integer(GL_MAX_CLIP_DISTANCES); ++plane) {
    const auto capability = static_cast<GLenum>(GL_CLIP_DISTANCE0 + plane);
    if (!glIsEnabled(capability)) continue;
    restores_.emplace_back([=] { glEnable(capability); });
    glDisable(capability);
  }
  restores_.emplace_back([mode = enumerator(GL_POLYGON_MODE)] { glPolygonMode(GL_FRONT_AND_BACK, mode); });
  glPolygonMode(GL_FRONT_AND_BACK, GL_FILL);
  restores_.emplace_back([vertex = enumerator(GL_PROVOKING_VERTEX)] { glProvokingVertex(vertex); });
  glProvokingVertex(GL_LAST_VERTEX_CONVENTION);
  restores_.emplace_back(
      [origin = enumerator(GL_CLIP_ORIGIN), depth = enumerator(GL_CLIP_DEPTH_MODE)] { glClipControl(origin, depth); });
  glClipControl(GL_LOWER_LEFT, GL_NEGATIVE_ONE_TO_ONE);
  for (GLint viewport = 0; viewport < integer(GL_MAX_VIEWPORTS); ++viewport)
    keep_viewport(static_cast<GLuint>(viewport));
}

void HostState::keep_viewport(GLuint viewport) {
  std::array<GLfloat, 4> area{};
  glGetFloati_v(GL_VIEWPORT, viewport, area.data());
  restores_.emplace_back([=, on = glIsEnabledi(GL_SCISSOR_TEST, viewport) != 0] {
    glViewportIndexedfv(viewport, area.data());
    set_capability(GL_SCISSOR_TEST, viewport, on);
  });
}

void HostState::keep_bindings() {
  restores_.emplace_back([program = object(GL_CURRENT_PROGRAM)] { glUseProgram(program); });
  restores_.emplace_back([array = object(GL_VERTEX_ARRAY_BINDING)] { glBindVertexArray(array); });
  for (const auto& [target, binding] : {std::array<GLenum, 2>{GL_DRAW_FRAMEBUFFER, GL_DRAW_FRAMEBUFFER_BINDING},
                                        {GL_READ_FRAMEBUFFER, GL_READ_FRAMEBUFFER_BINDING}})
    restores_.emplace_back([target, name = object(binding)] { glBindFramebuffer(target, name); });
  // Buffers of targets first of all: to bind one with an index binds it to its target, too.
  keep_buffers(GL_SHADER_STORAGE_BUFFER, GL_SHADER_STORAGE_BUFFER_BINDING, GL_SHADER_STORAGE_BUFFER_START,
               GL_SHADER_STORAGE_BUFFER_SIZE, storage_buffers);
  keep_buffers(GL_UNIFORM_BUFFER, GL_UNIFORM_BUFFER_BINDING, GL_UNIFORM_BUFFER_START, GL_UNIFORM_BUFFER_SIZE,
               uniform_buffers);
  restores_.emplace_back(
      [buffer = object(GL_DRAW_INDIRECT_BUFFER_BINDING)] { glBindBuffer(GL_DRAW_INDIRECT_BUFFER, buffer); });
}

void HostState::keep_buffers(GLenum target, GLenum binding, GLenum start, GLenum size, GLuint count) {
  restores_.emplace_back([target, buffer = object(binding)] { glBindBuffer(target, buffer); });
  for (GLuint index = 0; index < count; ++index) {
    GLint64 first = 0, bytes = 0;
    glGetInteger64i_v(start, index, &first);
    glGetInteger64i_v(size, index, &bytes);
    restores_.emplace_back([=, buffer = enumerator_at(binding, index)] {
      if (bytes > 0)
        glBindBufferRange(target, index, buffer, first, bytes);
      else
        glBindBufferBase(target, index, buffer);
    });
  }
}

void HostState::keep_textures() {
  restores_.emplace_back([active = enumerator(GL_ACTIVE_TEXTURE)] { glActiveTexture(active); });
  for (GLuint unit = 0; unit < texture_units; ++unit) {
    glActiveTexture(GL_TEXTURE0 + unit);
    restores_.emplace_back([=, sampler = object(GL_SAMPLER_BINDING)] { glBindSampler(unit, sampler); });
    glBindSampler(unit, 0);
    for (const auto& [target, binding] : {std::array<GLenum, 2>{GL_TEXTURE_1D, GL_TEXTURE_BINDING_1D},
                                          {GL_TEXTURE_1D_ARRAY, GL_TEXTURE_BINDING_1D_ARRAY},
                                          {GL_TEXTURE_2D, GL_TEXTURE_BINDING_2D}})
      restores_.emplace_back([unit, target, texture = object(binding)] {
        glActiveTexture(GL_TEXTURE0 + unit);
        glBindTexture(target, texture);
      });
  }
}

void HostState::keep_pixel_transfers() {
  for (const auto& [target, binding] : {std::array<GLenum, 2>{GL_PIXEL_PACK_BUFFER, GL_PIXEL_PACK_BUFFER_BINDING},
                                        {GL_PIXEL_UNPACK_BUFFER, GL_PIXEL_UNPACK_BUFFER_BINDING}}) {
    restores_.emplace_back([target, buffer = object(binding)] { glBindBuffer(target, buffer); });
    glBindBuffer(target, 0);
  }
  // With the values that OpenGL begins with.
  for (const auto& [name, value] : {std::pair<GLenum, GLint>{GL_PACK_ALIGNMENT, 4},
                                    {GL_PACK_ROW_LENGTH, 0},
                                    {GL_PACK_SKIP_ROWS, 0},
                                    {GL_PACK_SKIP_PIXELS, 0},
                                    {GL_PACK_SWAP_BYTES, 0},
                                    {GL_PACK_LSB_FIRST, 0},
                                    {GL_PACK_IMAGE_HEIGHT, 0},
                                    {GL_PACK_SKIP_IMAGES, 0},
                                    {GL_UNPACK_ALIGNMENT, 4},
                                    {GL_UNPACK_ROW_LENGTH, 0},
                                    {GL_UNPACK_SKIP_ROWS, 0},
                                    {GL_UNPACK_SKIP_PIXELS, 0},
                                    {GL_UNPACK_SWAP_BYTES, 0},
                                    {GL_UNPACK_LSB_FIRST, 0},
                                    {GL_UNPACK_IMAGE_HEIGHT, 0},
                                    {GL_UNPACK_SKIP_IMAGES, 0}}) {
    restores_.emplace_back([name, kept = integer(name)] { glPixelStorei(name, kept); });
    glPixelStorei(name, value);
  }
}

}  // namespace splatvol
