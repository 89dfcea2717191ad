#include "renderer/kernel.h"

#include "renderer/shaders.h"

namespace splatvol {

Result<Kernel> make_octant_kernel() {
  using namespace shaders;
  SPLATVOL_TRY_ASSIGN(
      key, build_program("octant's keys",
                         {{GL_COMPUTE_SHADER, {frame_glsl, octant_quad_glsl, octant_project_glsl, key_comp}}}));
  SPLATVOL_TRY_ASSIGN(
      project, build_program("octant's projection",
                             {{GL_COMPUTE_SHADER, {frame_glsl, octant_quad_glsl, octant_project_glsl, project_comp}}}));
  SPLATVOL_TRY_ASSIGN(draw,
                      build_program("octant's quads", {{GL_VERTEX_SHADER, {frame_glsl, octant_quad_glsl, octant_vert}},
                                                       {GL_FRAGMENT_SHADER, {frame_glsl, octant_frag}}}));
  return Kernel{std::move(key), std::move(project), std::move(draw), 48};
}

}  // namespace splatvol
