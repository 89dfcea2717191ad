#include "renderer/gl/host_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "renderer/gl/flip_rows.h"

namespace splatvol {
namespace {

constexpr std::string_view vertex_source = R"(#version 450 core
void main() { gl_Position = vec4(4 * (gl_VertexID & 1) - 1, 2 * (gl_VertexID & 2) - 1, 0, 1); }
)";

constexpr std::string_view fragment_source = R"(#version 450 core
layout(binding = 0) uniform sampler2D picture;
layout(location = 0) uniform vec2 corner;  // of the viewport
layout(location = 0) out vec4 result;
void main() { result = texelFetch(picture, ivec2(gl_FragCoord.xy - corner), 0); }
)";

std::array<int, 2> size_of(GLuint texture) {
  std::array<int, 2> size{};
  glGetTextureLevelParameteriv(texture, 0, GL_TEXTURE_WIDTH, &size[0]);
  glGetTextureLevelParameteriv(texture, 0, GL_TEXTURE_HEIGHT, &size[1]);
  return size;
}

Status check_depths(const DepthTexture& texture, bool is_perspective) {
  const double a = texture.distance_at_0, b = texture.distance_at_1;
  const bool are_distances =
      is_perspective ? a > 0 && b > 0 && std::isfinite(std::min(a, b)) : std::isfinite(a) && std::isfinite(b);
  if (!are_distances || a == b)
    return fail(ErrorCode::invalid_argument, "depths of surfaces: no planes with distances of {} and {}", a, b);
  if (!glIsTexture(texture.name))
    return fail(ErrorCode::invalid_argument, "depths of surfaces: {} is no texture", texture.name);
  GLint target = 0, bits = 0;
  glGetTextureParameteriv(texture.name, GL_TEXTURE_TARGET, &target);
  if (target == GL_TEXTURE_2D) glGetTextureLevelParameteriv(texture.name, 0, GL_TEXTURE_DEPTH_SIZE, &bits);
  if (bits > 0) return {};
  return fail(ErrorCode::invalid_argument, "depths of surfaces: texture {} is no GL_TEXTURE_2D with depths",
              texture.name);
}

}  // namespace

Result<SurfaceDepths> read_depths(const DepthTexture& texture, bool is_perspective) {
  SPLATVOL_TRY(check_depths(texture, is_perspective));
  const auto [width, height] = size_of(texture.name);
  SurfaceDepths depths{width, height, {}};
  depths.depths.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  glGetTextureImage(texture.name, 0, GL_DEPTH_COMPONENT, GL_FLOAT,
                    static_cast<GLsizei>(depths.depths.size() * sizeof(float)), depths.depths.data());
  SPLATVOL_TRY(check_gl("reading depths of surfaces"));

  const double at_0 = texture.distance_at_0, at_1 = texture.distance_at_1;
  const float background = at_0 < at_1 ? 1 : 0;
  const auto distance = [=](double depth) {
    return is_perspective ? 1 / ((1 - depth) / at_0 + depth / at_1) : at_0 + depth * (at_1 - at_0);
  };
  for (float& depth : depths.depths)
    depth = depth == background ? std::numeric_limits<float>::infinity() : static_cast<float>(distance(depth));
  flip_rows(depths.depths, width);
  return depths;
}

HostPicture::HostPicture(Program program, VertexArray vertex_array)
    : program_(std::move(program)), vertex_array_(std::move(vertex_array)) {}

Result<HostPicture> HostPicture::create() {
  SPLATVOL_TRY_ASSIGN(program, build_program("the picture", {{GL_VERTEX_SHADER, {vertex_source}},
                                                             {GL_FRAGMENT_SHADER, {fragment_source}}}));
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  return HostPicture(std::move(program), VertexArray(name));
}

Status HostPicture::show(const DevicePicture& picture) {
  if (const auto* texture = std::get_if<TexturePicture>(&picture)) {
    texture_ = texture->name;
    return {};
  }
  Image image = *std::get<const Image*>(picture);
  flip_rows(image.pixels, image.width);
  SPLATVOL_TRY(uploaded_.upload(image));
  texture_ = uploaded_.name();
  return {};
}

Status HostPicture::draw_over() const {
  if (texture_ == 0) return fail(ErrorCode::invalid_argument, "no picture is drawn yet");
  std::array<GLint, 4> viewport{};
  glGetIntegerv(GL_VIEWPORT, viewport.data());
  const auto [width, height] = size_of(texture_);
  if (viewport[2] != width || viewport[3] != height)
    return fail(ErrorCode::invalid_argument, "a picture of {} x {} pixels, but a viewport of {} x {}", width, height,
                viewport[2], viewport[3]);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glEnable(GL_BLEND);
  glBlendEquation(GL_FUNC_ADD);
  glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);  // premultiplied over
  glUseProgram(program_.name());
  glUniform2f(0, static_cast<GLfloat>(viewport[0]), static_cast<GLfloat>(viewport[1]));
  glBindTextureUnit(0, texture_);
  glBindVertexArray(vertex_array_.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
  return check_gl("drawing the picture over the host's");
}

}  // namespace splatvol
