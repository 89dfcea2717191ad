// Depths of another program's opaque surfaces, in a texture of OpenGL.
#pragma once

namespace splatvol {

/// A depth buffer of a host program. Its numbers are those that OpenGL's or another usual projection writes: from
/// perspective, linear in 1 / distance; from a parallel projection, linear in the distance. Distances count from the
/// eye's plane along the view's axis, in world units.
struct DepthTexture {
  unsigned name = 0;  // of a GL_TEXTURE_2D with depths, of the scene's size; lower left pixel first

  /// The distances of the depths 0 and 1: those of the near and the far plane, as far as the projection has them. The
  /// larger one may be infinite in perspective. A pixel with its depth shows no surface.
  double distance_at_0 = 0;
  double distance_at_1 = 0;
};

}  // namespace splatvol
