// Draws .svol files in the OpenGL context of another program. Component `render`, where it was built with OpenGL.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "splatvol/depth_texture.h"
#include "splatvol/error.h"
#include "splatvol/export.h"
#include "splatvol/renderer.h"
#include "splatvol/scene.h"

namespace splatvol {

/// An open file, its scene, and pictures of it in a host's context of OpenGL 4.5. As Renderer, besides: every call but
/// `cancel` comes from one thread, in which the context is current, the destructor too. OpenGL's state is after a call
/// what it was before. A query, conditional rendering or transform feedback must not be active, and errors of OpenGL
/// that the host has not fetched are forgotten.
class SPLATVOL_EXPORT GlRenderer {
 public:
  /// Opens a file as Renderer::open does. Device::automatic: OpenGL draws where it is a graphics card; else the
  /// processor does, which is faster, and the picture becomes a texture. Fails with ErrorCode::device without an OpenGL
  /// 4.5 context.
  [[nodiscard]] static Result<GlRenderer> open(const std::string& path,
                                               const std::optional<Scene>& scene = std::nullopt,
                                               const RendererOptions& options = {});
  GlRenderer(GlRenderer&&) noexcept;
  GlRenderer& operator=(GlRenderer&&) noexcept;
  ~GlRenderer();

  // As in Renderer.
  [[nodiscard]] const Scene& scene() const;
  [[nodiscard]] Status set_scene(const Scene& scene);
  [[nodiscard]] Result<Scene> fitting_scene(const std::string& attribute = "", int width = 512, int height = 512) const;
  [[nodiscard]] const std::vector<double>& times() const;
  [[nodiscard]] std::size_t step() const;
  [[nodiscard]] Status show_step(std::size_t step);
  [[nodiscard]] const RenderStatistics& statistics() const;
  [[nodiscard]] std::string device() const;
  void cancel();

  /// Hides what lies behind the host's surfaces, exactly: the part of each splat that is in front is drawn. Copies the
  /// depths, by way of the processor, and holds them until the next call. Needs a scene of the texture's size, with the
  /// camera of the host. None: no surfaces. If it fails, all stays as it was. Fails if the scene shows slices.
  [[nodiscard]] Status set_surface_depths(const std::optional<DepthTexture>& depths);

  /// Draw as Renderer::render and render_now do, into the texture. Fail for an exact quality.
  [[nodiscard]] Status draw(const Quality& quality = {});
  [[deprecated("draw({.milliseconds = 1e3 * seconds})")]] [[nodiscard]] Status draw_within(double seconds);
  [[nodiscard]] Status draw_now(double wait_seconds = 0, const Quality& quality = {});

  /// Returns OpenGL's name of the texture that holds the last picture: GL_RGBA32F, linear, premultiplied, lower left
  /// pixel first. It stays the renderer's, and holds until the next picture. 0 before the first.
  [[nodiscard]] unsigned texture() const;

  /// Blends the last picture over the framebuffer that is bound, in its viewport, which must have the scene's size.
  /// Colours are linear: the framebuffer holds floats, or sRGB with GL_FRAMEBUFFER_SRGB on.
  [[nodiscard]] Status draw_over() const;

 private:
  struct Contents;
  explicit GlRenderer(std::unique_ptr<Contents> contents);
  std::unique_ptr<Contents> contents_;
};

}  // namespace splatvol
