#include "viewer/screen.h"

#include <vector>

#include "scene/srgb.h"

namespace splatvol {
namespace {

constexpr std::string_view version = "#version 450 core\n";

constexpr std::string_view vertex_source = R"(
layout(location = 1) uniform float top_first;  // 1 or 0
out vec2 at;
void main() {
  at = vec2(2 * (gl_VertexID & 1), gl_VertexID & 2);
  gl_Position = vec4(2 * at - 1, 0, 1);
  at.y = mix(at.y, 1 - at.y, top_first);
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

constexpr std::string_view copy_source = R"(
in vec2 at;
layout(binding = 0) uniform sampler2D picture;
layout(location = 0) out vec4 result;
void main() { result = texture(picture, at); }
)";

}  // namespace

Result<Screen> Screen::create() {
  Screen screen;
  const auto build = [](std::string_view fragments) {
    return build_program("screen",
                         {{GL_VERTEX_SHADER, {version, vertex_source}}, {GL_FRAGMENT_SHADER, {version, fragments}}});
  };
  SPLATVOL_TRY_ASSIGN(encode, build(encode_source));
  SPLATVOL_TRY_ASSIGN(copy, build(copy_source));
  screen.encode_ = std::move(encode);
  screen.copy_ = std::move(copy);
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  screen.vertex_array_ = VertexArray(name);
  return screen;
}

Status Screen::show(const ShownPicture& picture, dvec3 background, int left, int width, int height) const {
  glViewport(left, 0, width, height);
  glDisable(GL_BLEND);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_CULL_FACE);
  glDisable(GL_SCISSOR_TEST);
  const auto b = vec3(background);
  glUseProgram(picture.encoded ? copy_.name() : encode_.name());
  if (!picture.encoded) glUniform3f(0, b.r, b.g, b.b);
  glUniform1f(1, picture.top_first ? 1.0F : 0.0F);
  glBindTextureUnit(0, picture.texture);
  glBindVertexArray(vertex_array_.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glBindVertexArray(0);
  return check_gl("showing the picture");
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
