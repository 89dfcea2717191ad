#include "splatvol/gl_renderer.h"

#include <epoxy/gl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "renderer/gl/context.h"
#include "renderer/gl/gl_objects.h"
#include "splatvol/build.h"
#include "tests/library/lattice.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

constexpr int width = 96, height = 64;

// A context of a host, and a file.
struct HostedDrawing : ::testing::TestWithParam<Device> {
  HostedDrawing() {
    // Without cells, a Renderer draws splats, as a GlRenderer does.
    EXPECT_EQ(message_of(build(Lattice(12).mesh(), path_, {.keep_cells = false})), "");
    scene_ = Renderer::open(path_, std::nullopt, {.device = Device::cpu})->fitting_scene("", width, height).value();
  }
  [[nodiscard]] GlRenderer open() const { return GlRenderer::open(path_, scene_, {.device = GetParam()}).value(); }
  [[nodiscard]] Renderer open_apart() const { return Renderer::open(path_, scene_, {.device = GetParam()}).value(); }

  std::unique_ptr<HeadlessContext> context_ = HeadlessContext::create().value();
  TempFolder folder_;
  std::string path_ = folder_.path("lattice.svol");
  Scene scene_;
};
INSTANTIATE_TEST_SUITE_P(Devices, HostedDrawing, ::testing::Values(Device::gl, Device::cpu),
                         [](const auto& device) { return device.param == Device::gl ? "Gl" : "Cpu"; });

std::vector<vec4> pixels_of(GLuint texture) {
  std::vector<vec4> pixels(std::size_t{width} * height);
  glGetTextureImage(texture, 0, GL_RGBA, GL_FLOAT, static_cast<GLsizei>(pixels.size() * sizeof(vec4)), pixels.data());
  return pixels;
}

// The largest difference of a texture's pixels, lower left first, from an image's.
float difference(const std::vector<vec4>& pixels, const Image& image) {
  float most = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const vec4 apart = pixels[static_cast<std::size_t>(height - 1 - y) * width + x] - image.at(x, y);
      for (int i = 0; i < 4; ++i) most = std::max(most, std::abs(apart[i]));
    }
  return most;
}

// Objects of a host, bound wherever the renderer binds its own.
class HostObjects {
 public:
  HostObjects() {
    GLuint name = 0;
    for (Texture& texture : textures_) {
      glCreateTextures(GL_TEXTURE_2D, 1, &name);
      texture = Texture(name);
    }
    glCreateVertexArrays(1, &name);
    array_ = VertexArray(name);
    glCreateFramebuffers(1, &name);
    framebuffer_ = Framebuffer(name);
    glGenSamplers(1, &sampler_);
    EXPECT_TRUE(buffer_.reserve(4096));
  }
  ~HostObjects() { glDeleteSamplers(1, &sampler_); }

  // State that would spoil the renderer's pictures.
  void set() const {
    for (const GLenum capability :
         {GL_BLEND, GL_CULL_FACE, GL_DEPTH_TEST, GL_SCISSOR_TEST, GL_STENCIL_TEST, GL_COLOR_LOGIC_OP, GL_CLIP_DISTANCE0,
          GL_RASTERIZER_DISCARD, GL_PRIMITIVE_RESTART, GL_SAMPLE_MASK, GL_SAMPLE_ALPHA_TO_COVERAGE})
      glEnable(capability);
    glScissor(3, 4, 5, 6);
    glViewport(1, 2, 3, 4);
    glViewportIndexedf(1, 5, 6, 7, 8);
    glDepthFunc(GL_NEVER);
    glCullFace(GL_FRONT_AND_BACK);
    glPolygonMode(GL_FRONT_AND_BACK, GL_LINE);
    glProvokingVertex(GL_FIRST_VERTEX_CONVENTION);
    glPrimitiveRestartIndex(0);
    glClipControl(GL_UPPER_LEFT, GL_ZERO_TO_ONE);
    glLogicOp(GL_CLEAR);
    glBlendEquationSeparate(GL_FUNC_SUBTRACT, GL_MAX);
    glBlendFuncSeparate(GL_DST_COLOR, GL_ONE, GL_ZERO, GL_SRC_ALPHA);
    glBlendFunci(1, GL_ZERO, GL_ZERO);
    glColorMask(GL_TRUE, GL_FALSE, GL_TRUE, GL_FALSE);
    glColorMaski(1, GL_FALSE, GL_TRUE, GL_TRUE, GL_TRUE);
    for (GLuint unit = 0; unit < textures_.size(); ++unit) {
      glBindTextureUnit(unit, textures_[unit].name());
      glBindSampler(unit, sampler_);
    }
    glActiveTexture(GL_TEXTURE3);
    for (GLuint index = 0; index < 8; ++index)
      glBindBufferRange(GL_SHADER_STORAGE_BUFFER, index, buffer_.object(), 256 * index, 256);
    glBindBufferBase(GL_UNIFORM_BUFFER, 0, buffer_.object());
    for (const GLenum target : {GL_DRAW_INDIRECT_BUFFER, GL_PIXEL_PACK_BUFFER, GL_PIXEL_UNPACK_BUFFER})
      glBindBuffer(target, buffer_.object());
    for (const GLenum store : {GL_PACK_ROW_LENGTH, GL_UNPACK_ROW_LENGTH, GL_UNPACK_SKIP_PIXELS, GL_PACK_SKIP_ROWS})
      glPixelStorei(store, 7);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 8);
    glBindVertexArray(array_.name());
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer_.name());
  }

 private:
  std::array<Texture, 5> textures_;
  VertexArray array_;
  Framebuffer framebuffer_;
  GLuint sampler_ = 0;
  Buffer buffer_{"a host's buffer"};
};

constexpr std::array state_names = {GL_DEPTH_FUNC,
                                    GL_DEPTH_WRITEMASK,
                                    GL_CULL_FACE_MODE,
                                    GL_FRONT_FACE,
                                    GL_POLYGON_MODE,
                                    GL_PROVOKING_VERTEX,
                                    GL_CLIP_ORIGIN,
                                    GL_CLIP_DEPTH_MODE,
                                    GL_LOGIC_OP_MODE,
                                    GL_CURRENT_PROGRAM,
                                    GL_VERTEX_ARRAY_BINDING,
                                    GL_DRAW_FRAMEBUFFER_BINDING,
                                    GL_READ_FRAMEBUFFER_BINDING,
                                    GL_DRAW_INDIRECT_BUFFER_BINDING,
                                    GL_DISPATCH_INDIRECT_BUFFER_BINDING,
                                    GL_SHADER_STORAGE_BUFFER_BINDING,
                                    GL_UNIFORM_BUFFER_BINDING,
                                    GL_ARRAY_BUFFER_BINDING,
                                    GL_COPY_READ_BUFFER_BINDING,
                                    GL_COPY_WRITE_BUFFER_BINDING,
                                    GL_PIXEL_PACK_BUFFER_BINDING,
                                    GL_PIXEL_UNPACK_BUFFER_BINDING,
                                    GL_PACK_ALIGNMENT,
                                    GL_PACK_ROW_LENGTH,
                                    GL_PACK_SKIP_ROWS,
                                    GL_UNPACK_ALIGNMENT,
                                    GL_UNPACK_ROW_LENGTH,
                                    GL_UNPACK_SKIP_PIXELS,
                                    GL_ACTIVE_TEXTURE};

// All state that a host may rely on, as far as OpenGL tells it by a number.
std::vector<GLint64> snapshot() {
  std::vector<GLint64> all;
  const auto add = [&](GLenum name, int count = 1) {
    std::array<GLint64, 4> values{};
    glGetInteger64v(name, values.data());
    all.insert(all.end(), values.begin(), values.begin() + count);
  };
  const auto add_at = [&](GLenum name, GLuint index, int count = 1) {
    std::array<GLint64, 4> values{};
    glGetInteger64i_v(name, index, values.data());
    all.insert(all.end(), values.begin(), values.begin() + count);
  };
  for (const GLenum capability :
       {GL_CULL_FACE, GL_DEPTH_TEST, GL_STENCIL_TEST, GL_COLOR_LOGIC_OP, GL_CLIP_DISTANCE0, GL_RASTERIZER_DISCARD,
        GL_PRIMITIVE_RESTART, GL_PRIMITIVE_RESTART_FIXED_INDEX, GL_SAMPLE_MASK, GL_SAMPLE_ALPHA_TO_COVERAGE, GL_DITHER,
        GL_MULTISAMPLE, GL_FRAMEBUFFER_SRGB, GL_DEPTH_CLAMP, GL_POLYGON_SMOOTH})
    all.push_back(glIsEnabled(capability));
  for (GLuint i = 0; i < 4; ++i) {
    all.push_back(glIsEnabledi(GL_BLEND, i));
    all.push_back(glIsEnabledi(GL_SCISSOR_TEST, i));
    add_at(GL_COLOR_WRITEMASK, i, 4);
    add_at(GL_VIEWPORT, i, 4);
    add_at(GL_SCISSOR_BOX, i, 4);
    for (const GLenum name : {GL_BLEND_EQUATION_RGB, GL_BLEND_EQUATION_ALPHA, GL_BLEND_SRC_RGB, GL_BLEND_SRC_ALPHA,
                              GL_BLEND_DST_RGB, GL_BLEND_DST_ALPHA})
      add_at(name, i);
  }
  for (GLuint i = 0; i < 10; ++i)
    for (const GLenum name :
         {GL_SHADER_STORAGE_BUFFER_BINDING, GL_SHADER_STORAGE_BUFFER_START, GL_SHADER_STORAGE_BUFFER_SIZE,
          GL_UNIFORM_BUFFER_BINDING, GL_UNIFORM_BUFFER_START, GL_UNIFORM_BUFFER_SIZE})
      add_at(name, i);
  for (const GLenum name : state_names) add(name);
  const auto active = static_cast<GLenum>(all.back());
  for (GLenum unit = 0; unit < 8; ++unit) {
    glActiveTexture(GL_TEXTURE0 + unit);
    for (const GLenum name : {GL_TEXTURE_BINDING_1D, GL_TEXTURE_BINDING_1D_ARRAY, GL_TEXTURE_BINDING_2D,
                              GL_TEXTURE_BINDING_2D_ARRAY, GL_TEXTURE_BINDING_3D, GL_SAMPLER_BINDING})
      add(name);
  }
  glActiveTexture(active);
  EXPECT_EQ(glGetError(), GL_NO_ERROR);
  return all;
}

TEST_P(HostedDrawing, SlicesAreInThePicture) {
  scene_.slices = {{.point = scene_.camera.focal_point, .normal = {0.3, 1, 0.2}, .opacity = 0.5}};
  GlRenderer renderer = open();
  ASSERT_TRUE(renderer.draw());
  Renderer apart = open_apart();
  const Image with_slice = apart.render().value();
  EXPECT_LT(difference(pixels_of(renderer.texture()), with_slice), 1e-6F);
  scene_.slices.clear();
  ASSERT_TRUE(renderer.set_scene(scene_));
  ASSERT_TRUE(renderer.draw());
  EXPECT_GT(difference(pixels_of(renderer.texture()), with_slice), 0.1F);
}

TEST_P(HostedDrawing, LeavesTheStateAsItWasAndDoesNotCareForIt) {
  const Image expected = open_apart().render().value();
  const HostObjects host;
  host.set();
  const auto before = snapshot();
  {
    GlRenderer renderer = open();
    EXPECT_EQ(snapshot(), before) << "open";
    ASSERT_TRUE(renderer.draw());
    EXPECT_EQ(snapshot(), before) << "draw";
    ASSERT_TRUE(renderer.draw_now(0, {.max_splats = 100}));
    EXPECT_EQ(snapshot(), before) << "draw_now";
    ASSERT_TRUE(renderer.draw({.milliseconds = 1000}));
    EXPECT_EQ(snapshot(), before) << "draw in a time";
    EXPECT_FALSE(renderer.draw_over());
    EXPECT_EQ(snapshot(), before) << "draw_over";
    ASSERT_TRUE(renderer.set_scene(scene_));
    EXPECT_EQ(snapshot(), before) << "set_scene";
    ASSERT_TRUE(renderer.draw());
    glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    glPixelStorei(GL_PACK_ROW_LENGTH, 0);
    glPixelStorei(GL_PACK_SKIP_ROWS, 0);
    EXPECT_EQ(difference(pixels_of(renderer.texture()), expected), 0);
    host.set();
  }
  EXPECT_EQ(snapshot(), before) << "the end";
}

TEST_P(HostedDrawing, DrawsOverTheHostsPicture) {
  GlRenderer renderer = open();
  EXPECT_EQ(renderer.texture(), 0);
  EXPECT_THAT(renderer.draw_over().error().message, HasSubstr("no picture"));
  ASSERT_TRUE(renderer.draw());

  GLuint name = 0;
  glCreateTextures(GL_TEXTURE_2D, 1, &name);
  const Texture color(name);
  glTextureStorage2D(name, 1, GL_RGBA32F, width + 10, height + 10);
  glCreateFramebuffers(1, &name);
  const Framebuffer framebuffer(name);
  glNamedFramebufferTexture(name, GL_COLOR_ATTACHMENT0, color.name(), 0);
  glBindFramebuffer(GL_FRAMEBUFFER, name);
  glClearColor(0.5F, 0.25F, 0, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  glViewport(0, 0, width + 10, height + 10);
  EXPECT_THAT(renderer.draw_over().error().message, HasSubstr("a viewport of 106 x 74"));
  glViewport(7, 3, width, height);
  ASSERT_TRUE(renderer.draw_over());

  const auto picture = pixels_of(renderer.texture());
  std::vector<vec4> result(picture.size());
  glReadPixels(7, 3, width, height, GL_RGBA, GL_FLOAT, result.data());
  float alpha = 0;
  for (std::size_t i = 0; i < picture.size(); ++i) {
    alpha = std::max(alpha, picture[i].a);
    const vec4 expected = picture[i] + (1 - picture[i].a) * vec4(0.5F, 0.25F, 0, 1);
    for (int k = 0; k < 4; ++k) ASSERT_NEAR(result[i][k], expected[k], 1e-6);
  }
  EXPECT_GT(alpha, 0.1F);
  vec4 outside;
  glReadPixels(6, 3, 1, 1, GL_RGBA, GL_FLOAT, &outside);
  EXPECT_EQ(outside, vec4(0.5F, 0.25F, 0, 1));
}

// A depth buffer of a host: background, but for a plate in the lower left quarter.
class DepthBuffer {
 public:
  DepthBuffer(GLenum format, float background, float plate) {
    GLuint name = 0;
    glCreateTextures(GL_TEXTURE_2D, 1, &name);
    texture_ = Texture(name);
    glTextureStorage2D(name, 1, format, width, height);
    const std::vector<float> plates(std::size_t{width} * height, plate);
    glClearTexImage(name, 0, GL_DEPTH_COMPONENT, GL_FLOAT, &background);
    glTextureSubImage2D(name, 0, 0, 0, width / 2, height / 2, GL_DEPTH_COMPONENT, GL_FLOAT, plates.data());
  }
  [[nodiscard]] unsigned name() const { return texture_.name(); }

 private:
  Texture texture_;
};

SurfaceDepths plate_at(double distance) {
  SurfaceDepths depths{width, height, {}};
  depths.depths.assign(std::size_t{width} * height, std::numeric_limits<float>::infinity());
  for (int y = height / 2; y < height; ++y)
    std::fill_n(&depths.depths[static_cast<std::size_t>(y) * width], width / 2, static_cast<float>(distance));
  return depths;
}

TEST_P(HostedDrawing, EndsAtTheHostsDepths) {
  const double far_away = std::numeric_limits<double>::infinity();
  for (const auto projection : {Camera::Projection::perspective, Camera::Projection::orthographic}) {
    const bool is_perspective = projection == Camera::Projection::perspective;
    scene_.camera.projection = projection;
    scene_.camera.parallel_height = 2;
    const double distance = glm::length(scene_.camera.focal_point - scene_.camera.position);
    Renderer apart = open_apart();
    const Image free = apart.render().value();
    ASSERT_TRUE(apart.set_surface_depths(plate_at(distance)));
    const Image expected = apart.render().value();
    GlRenderer renderer = open();
    const auto depth_of = [&](double at_0, double at_1) {
      return static_cast<float>(is_perspective ? (1 / distance - 1 / at_0) / (1 / at_1 - 1 / at_0)
                                               : (distance - at_0) / (at_1 - at_0));
    };
    std::vector<std::array<double, 2>> planes = {{0.5 * distance, 3 * distance}, {3 * distance, 0.5 * distance}};
    if (is_perspective) planes.insert(planes.end(), {{0.5 * distance, far_away}, {far_away, 0.5 * distance}});
    for (const auto& [at_0, at_1] : planes) {
      const DepthBuffer buffer(GL_DEPTH_COMPONENT32F, at_0 < at_1 ? 1 : 0, depth_of(at_0, at_1));
      ASSERT_EQ(message_of(renderer.set_surface_depths(DepthTexture{buffer.name(), at_0, at_1})), "");
      ASSERT_TRUE(renderer.draw());
      EXPECT_LT(difference(pixels_of(renderer.texture()), expected), 1e-4F) << at_0 << ' ' << at_1;
    }
    EXPECT_GT(difference(pixels_of(renderer.texture()), free), 0.01F);
    ASSERT_TRUE(renderer.set_surface_depths(std::nullopt));
    ASSERT_TRUE(renderer.draw());
    EXPECT_EQ(difference(pixels_of(renderer.texture()), free), 0);
  }
}

// The boundary of the file lies round the volume, and hides it, or lets half of the light through.
TEST_P(HostedDrawing, DrawsTheBoundaryOfTheFile) {
  ASSERT_TRUE(build(Lattice(12).mesh(), path_, {.boundary_triangles = 1000}));
  const Image without = open_apart().render({.tolerance_percent = 0}).value();
  for (const auto& [opacity, near_side] : {std::pair(1.0, NearSide::shown), std::pair(0.5, NearSide::shown),
                                           std::pair(1.0, NearSide::translucent), std::pair(0.5, NearSide::hidden)}) {
    scene_.surfaces = {{.color = {0, 0, 1}, .opacity = opacity, .boundary = "outer", .near_side = near_side}};
    GlRenderer hosted = open();
    ASSERT_TRUE(hosted.draw({.tolerance_percent = 0}));
    const std::vector<vec4> pixels = pixels_of(hosted.texture());
    const Image apart = open_apart().render({.tolerance_percent = 0}).value();
    EXPECT_LT(difference(pixels, apart), 1e-5F);
    EXPECT_GT(difference(pixels, without), 0.1F);
  }
}

TEST_P(HostedDrawing, RefusesOtherTextures) {
  GlRenderer renderer = open();
  const auto error_of = [&](const DepthTexture& texture) {
    const auto set = renderer.set_surface_depths(texture);
    return set ? "" : set.error().message;
  };
  const DepthBuffer depths(GL_DEPTH24_STENCIL8, 1, 1);
  EXPECT_EQ(error_of({depths.name(), 1, 2}), "");
  EXPECT_THAT(error_of({depths.name(), 1, 1}), HasSubstr("no planes with distances of 1 and 1"));
  EXPECT_THAT(error_of({depths.name(), 0, 1}), HasSubstr("no planes with distances of 0 and 1"));
  EXPECT_THAT(error_of({12345, 1, 2}), HasSubstr("12345 is no texture"));
  ASSERT_TRUE(renderer.draw());
  EXPECT_THAT(error_of({renderer.texture(), 1, 2}), HasSubstr("no GL_TEXTURE_2D with depths"));
}

TEST(HostedDrawingWithoutAContext, IsRefused) {
  EXPECT_THAT(message_of(GlRenderer::open("none.svol")), HasSubstr("OpenGL 4.5 is needed"));
}

}  // namespace
}  // namespace splatvol::test
