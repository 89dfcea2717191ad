// The programs and layouts with which one kind of splat is drawn. Internal to the renderer.
#pragma once

#include "renderer/gl_objects.h"
#include "streamer/splat.h"

namespace splatvol {

/// How a kind of splat gets onto the screen: `project` turns splats into quads in drawing order, once for each splat
/// and not for each corner; `draw` rasterises the quads; `key` gives sorting what it needs.
///
/// A kernel is, in GLSL, a struct Quad with an empty_quad, a function project(), and a vertex and a fragment shader;
/// and the layout of its splats below.
struct Kernel {
  Program key;
  Program project;
  Program draw;
  std::size_t quad_bytes;  // of Quad, as std430 lays it out
};

/// Where each buffer is bound, as the shaders have it.
enum class Binding : GLuint { splats = 0, origins = 1, order = 2, keys = 3, quads = 4 };

/// Locations of the uniforms of `key` and `project`.
namespace location {
inline constexpr GLint first = 0;
inline constexpr GLint count = 1;
inline constexpr GLint ordered = 2;
}  // namespace location

/// Invocations of a group of `key` and `project`.
inline constexpr std::size_t group_size = 64;

/// A splat of the kernel `octant`, as octant_project.glsl reads it.
struct OctantRecord {
  OctantSplat splat;
  std::uint32_t batch_index;
};
static_assert(sizeof(OctantRecord) == 24 && offsetof(OctantRecord, batch_index) == 20);

/// Needs a current context.
[[nodiscard]] Result<Kernel> make_octant_kernel();

}  // namespace splatvol
