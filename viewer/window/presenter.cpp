#include "viewer/window/presenter.h"

#include <vector>

#include "scene/srgb.h"

namespace splatvol {
namespace {

constexpr std::string_view version = "#version 450 core\n";

constexpr std::string_view vertex_source = R"(
out vec2 at;
void main() {
  at = vec2(2 * (gl_VertexID & 1), gl_VertexID & 2);
  gl_Position = vec4(2 * at - 1, 0, 1);
}
)";

constexpr std::string_view encode_source = R"(
in vec2 at;
layout(binding = 0) uniform sampler2D picture;
layout(location = 0) uniform vec3 background;
layout(location = 0) out vec4 result;
void main() {
  vec4 color = texture(picture, at);
  vec3 c = clamp(color.rgb + (1 - color.a) * background, 0, 1);
  vec3 curve = 1.055 * pow(c, vec3(1 / 2.4)) - 0.055;
  result = vec4(mix(12.92 * c, curve, greaterThan(c, vec3(0.0031308))), 1);
}
)";

// For the columns beside the picture.
void clear_columns(int begin, int end, int height) {
  if (begin >= end) return;
  glEnable(GL_SCISSOR_TEST);
  glScissor(begin, 0, end - begin, height);
  glClearColor(0.1f, 0.1f, 0.11f, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  glDisable(GL_SCISSOR_TEST);
}

}  // namespace

Result<Presenter> Presenter::create() {
  Presenter presenter;
  SPLATVOL_TRY_ASSIGN(encode, build_program("screen", {{GL_VERTEX_SHADER, {version, vertex_source}},
                                                       {GL_FRAGMENT_SHADER, {version, encode_source}}}));
  presenter.encode_ = std::move(encode);
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  presenter.vertex_array_ = VertexArray(name);
  return presenter;
}

void Presenter::begin() { glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &frame_); }

Status Presenter::show(const TexturePicture& picture, dvec3 background, int left, int width,
                       const WindowResized& window) {
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(frame_));
  clear_columns(0, left, window.pixel_height);
  clear_columns(left + width, window.pixel_width, window.pixel_height);
  glViewport(left, 0, width, window.pixel_height);
  glDisable(GL_BLEND);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_CULL_FACE);
  glDisable(GL_SCISSOR_TEST);
  const auto b = vec3(background);
  glUseProgram(encode_.name());
  glUniform3f(0, b.r, b.g, b.b);
  glBindTextureUnit(0, picture.name);
  glBindVertexArray(vertex_array_.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glBindVertexArray(0);
  return check_gl("showing the picture");
}

void Presenter::finish() { glFinish(); }

std::optional<double> opacity_at(const Session& session, int x, int y) {
  const std::optional<DevicePicture> volume = session.volume_picture();
  if (!volume) return {};
  const Result<vec4> pixel = read_pixel(*volume, x, y);
  return pixel ? std::optional(static_cast<double>(pixel->a)) : std::nullopt;
}

Result<Image> read_framebuffer(int width, int height) {
  std::vector<std::uint8_t> bytes(std::size_t{4} * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  glPixelStorei(GL_PACK_ALIGNMENT, 4);
  glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, bytes.data());
  SPLATVOL_TRY(check_gl("reading the window"));
  const auto linear = [](std::uint8_t byte) { return static_cast<float>(linear_of_byte(byte)); };
  Image image{width, height, std::vector<vec4>(bytes.size() / 4)};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::uint8_t* pixel = &bytes[std::size_t{4} * (static_cast<std::size_t>(height - 1 - y) * width + x)];
      image.at(x, y) = vec4(linear(pixel[0]), linear(pixel[1]), linear(pixel[2]), 1);
    }
  return image;
}

}  // namespace splatvol
