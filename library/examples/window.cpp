// window FILE.svol|URL [OUT.png]: shows a file in an OpenGL window, with a plate of this program through its middle.
// With OUT.png: keeps the first frame, and ends.
#include <epoxy/gl.h>
// After epoxy
#include <GLFW/glfw3.h>
#include <splatvol/gl_renderer.h>

#include <cmath>
#include <cstdio>
#include <glm/ext.hpp>

namespace {

constexpr int width = 800, height = 600;

// The program's own scene: a plate, with the camera of `scene`, into a framebuffer whose depths are a texture.
class Plate {
 public:
  Plate() {
    const char* vertex = R"(#version 450
      layout(location = 0) uniform mat4 projection_view;
      layout(location = 4) uniform vec3 center;
      layout(location = 5) uniform float half_edge;
      void main() {
        vec2 corner = half_edge * vec2(2 * (gl_VertexID & 1) - 1, (gl_VertexID & 2) - 1);
        gl_Position = projection_view * vec4(center + vec3(corner.x, 0, corner.y), 1);
      })";
    const char* fragment = "#version 450\nout vec4 color;\nvoid main() { color = vec4(.9, .5, .1, 1); }";
    program_ = glCreateProgram();
    for (const auto& [kind, source] : {std::pair{GL_VERTEX_SHADER, vertex}, {GL_FRAGMENT_SHADER, fragment}}) {
      const GLuint shader = glCreateShader(kind);
      glShaderSource(shader, 1, &source, nullptr);
      glCompileShader(shader);
      glAttachShader(program_, shader);
    }
    glLinkProgram(program_);
    glCreateVertexArrays(1, &no_attributes_);
    glCreateTextures(GL_TEXTURE_2D, 1, &color_);
    glTextureStorage2D(color_, 1, GL_RGBA16F, width, height);
    glCreateTextures(GL_TEXTURE_2D, 1, &depths_);
    glTextureStorage2D(depths_, 1, GL_DEPTH_COMPONENT32F, width, height);
    glCreateFramebuffers(1, &framebuffer_);
    glNamedFramebufferTexture(framebuffer_, GL_COLOR_ATTACHMENT0, color_, 0);
    glNamedFramebufferTexture(framebuffer_, GL_DEPTH_ATTACHMENT, depths_, 0);
  }

  // Leaves its framebuffer bound.
  splatvol::DepthTexture draw(const splatvol::Camera& camera) const {
    const double distance = glm::distance(camera.position, camera.focal_point), near = 0.1 * distance;
    const double tangent = std::tan(glm::radians(camera.vertical_fov_degrees) / 2);
    const glm::mat4 matrix = glm::infinitePerspective(2 * std::atan(tangent), double{width} / height, near) *
                             glm::lookAt(camera.position, camera.focal_point, camera.up);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
    glViewport(0, 0, width, height);
    glClearColor(0, 0, 0, 1);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glEnable(GL_DEPTH_TEST);
    glUseProgram(program_);
    glUniformMatrix4fv(0, 1, GL_FALSE, glm::value_ptr(matrix));
    glUniform3fv(4, 1, glm::value_ptr(glm::vec3(camera.focal_point)));
    glUniform1f(5, static_cast<float>(0.4 * distance * tangent));
    glBindVertexArray(no_attributes_);
    glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
    return {.name = depths_, .distance_at_0 = near, .distance_at_1 = INFINITY};
  }

  void show() const {
    glBlitNamedFramebuffer(framebuffer_, 0, 0, 0, width, height, 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
  }

 private:
  GLuint program_, no_attributes_, color_, depths_, framebuffer_;
};

splatvol::Status draw_frame(splatvol::GlRenderer& renderer, const Plate& plate, bool is_complete) {
  const splatvol::DepthTexture depths = plate.draw(renderer.scene().camera);
  if (const auto set = renderer.set_surface_depths(depths); !set) return set;
  if (const auto drawn = is_complete ? renderer.draw() : renderer.draw({.milliseconds = 1000.0 / 60}); !drawn)
    return drawn;
  return renderer.draw_over();
}

splatvol::Status keep_frame(const char* path) {
  splatvol::Image image{width, height, std::vector<splatvol::vec4>(std::size_t{width} * height)};
  for (int y = 0; y < height; ++y) glReadPixels(0, height - 1 - y, width, 1, GL_RGBA, GL_FLOAT, &image.at(0, y));
  return splatvol::write_image(path, image, {0, 0, 0}, {});
}

splatvol::Status show(GLFWwindow* window, const char* file, const char* picture) {
  auto renderer = splatvol::GlRenderer::open(file);
  if (!renderer) return tl::unexpected(renderer.error());
  auto scene = renderer->fitting_scene("", width, height);
  if (!scene) return tl::unexpected(scene.error());
  const Plate plate;
  glEnable(GL_FRAMEBUFFER_SRGB);  // the window's colours are linear until they are shown
  while (!glfwWindowShouldClose(window)) {
    if (const auto set = renderer->set_scene(*scene); !set) return set;
    if (const auto drawn = draw_frame(*renderer, plate, picture != nullptr); !drawn) return drawn;
    if (picture) return keep_frame(picture);
    plate.show();
    glfwSwapBuffers(window);
    glfwPollEvents();
    splatvol::Camera& camera = scene->camera;  // turns by a degree
    const auto turn = glm::rotate(glm::dmat4(1), glm::radians(1.0), camera.up);
    camera.position = camera.focal_point + splatvol::dvec3(turn * glm::dvec4(camera.position - camera.focal_point, 0));
  }
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) return std::fputs("usage: window FILE.svol [OUT.png]\n", stderr), 2;
  if (!glfwInit()) return std::fputs("window: no display\n", stderr), 1;
  glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 4);
  glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 5);
  glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
  glfwWindowHint(GLFW_SRGB_CAPABLE, GLFW_TRUE);
  glfwWindowHint(GLFW_RESIZABLE, GLFW_FALSE);
  GLFWwindow* window = glfwCreateWindow(width, height, argv[1], nullptr, nullptr);
  if (!window) return std::fputs("window: no window with OpenGL 4.5\n", stderr), 1;
  glfwMakeContextCurrent(window);
  const splatvol::Status shown = show(window, argv[1], argc == 3 ? argv[2] : nullptr);
  if (!shown) std::fprintf(stderr, "window: %s\n", shown.error().message.c_str());
  glfwTerminate();
  return shown ? 0 : 1;
}
