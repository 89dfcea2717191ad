// The programs and layouts with which one kind of splat is drawn. Internal to the renderer.
#pragma once

#include <vector>

#include "renderer/common.h"
#include "renderer/gl/gl_objects.h"
#include "splat/splat.h"

namespace splatvol {

/// The programs that draw one kind of splat. `project` turns splats into quads in drawing order, once for each splat
/// and not for each corner; one of `forms` rasterises a run of quads; `key` computes the keys for sorting.
///
/// In GLSL a kernel consists of a struct Quad with empty_quad() and form_of(), of functions project() and
/// position_in_view(), and of a vertex and a fragment shader. The layouts below belong to it too.
struct Kernel {
  KernelKind kind;
  Program key;
  Program project;
  std::vector<Program> forms;                // at most most_forms; each serves all quads that the one before does
  std::vector<Program> forms_with_surfaces;  // the same with opaque surfaces; none until add_surface_forms
  std::size_t quad_bytes;                    // of Quad, as std430 lays it out
  TableSize table;                           // of the transfer function
};

inline constexpr std::size_t most_forms = 4;

/// The binding points of the buffers, as in the shaders.
enum class Binding : GLuint {
  shapes = 0,
  values = 1,
  order = 2,            // of `project`
  entries_of_page = 2,  // of `key`
  keys = 3,
  quads = 4,
  runs = 5,
  entries = 6,
  ranges = 7
};

/// Locations of the uniforms of `key` and `project`.
namespace location {
inline constexpr GLint first = 0;
inline constexpr GLint count = 1;
inline constexpr GLint ordering = 2;  // of `project`
inline constexpr GLint by_depth = 2;  // of `key`
inline constexpr GLint page = 3;
inline constexpr GLint run = 4;
inline constexpr GLint surface_levels = 5;
inline constexpr GLint opacity_offset = 6;
}  // namespace location

/// Invocations in a work group of `key` and `project`.
inline constexpr std::size_t group_size = 64;

/// Compiles the programs. Needs a current context.
[[nodiscard]] Result<Kernel> make_kernel(KernelKind kind);

/// Compiles the programs for pictures with opaque surfaces, unless they are there. Needs a current context.
[[nodiscard]] Status add_surface_forms(Kernel& kernel);

}  // namespace splatvol
