// Pictures in a host program's OpenGL context. Internal to the renderer.
#pragma once

#include "base/error.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/gl/picture_texture.h"
#include "renderer/rasterizer.h"
#include "splatvol/depth_texture.h"
#include "splatvol/surface_depths.h"

namespace splatvol {

/// Reads the depths of surfaces. `is_perspective`: of the projection that wrote them. Fails with
/// ErrorCode::invalid_argument if there is no such texture, or no distance of a depth.
[[nodiscard]] Result<SurfaceDepths> read_depths(const DepthTexture& texture, bool is_perspective);

/// A picture in a texture, whatever has drawn it. Needs the context that was current at `create`, as HostState leaves
/// it.
class HostPicture {
 public:
  [[nodiscard]] static Result<HostPicture> create();

  /// Shows a picture, as long as it is valid.
  [[nodiscard]] Status show(const DevicePicture& picture);

  /// Returns OpenGL's name of the texture, lower left pixel first. 0 before the first picture.
  [[nodiscard]] GLuint texture() const { return texture_; }

  /// Blends the picture over the framebuffer that is bound, in its viewport. Fails with ErrorCode::invalid_argument if
  /// this has another size, or there is no picture.
  [[nodiscard]] Status draw_over() const;

 private:
  HostPicture(Program program, VertexArray vertex_array);

  Program program_;
  VertexArray vertex_array_;
  PictureTexture uploaded_;
  GLuint texture_ = 0;
};

}  // namespace splatvol
