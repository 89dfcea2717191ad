#include "renderer/kernel.h"

#include "renderer/shaders.h"

namespace splatvol {

namespace {

using namespace shaders;

Result<Kernel> make_octant_kernel() {
  SPLATVOL_TRY_ASSIGN(key, build_program("octant's keys", {{GL_COMPUTE_SHADER,
                                                            {frame_glsl, octant_transfer_glsl, octant_quad_glsl,
                                                             octant_project_glsl, key_comp}}}));
  SPLATVOL_TRY_ASSIGN(project, build_program("octant's projection", {{GL_COMPUTE_SHADER,
                                                                      {frame_glsl, octant_transfer_glsl, octant_quad_glsl,
                                                                       octant_project_glsl, project_comp}}}));
  SPLATVOL_TRY_ASSIGN(draw,
                      build_program("octant's quads", {{GL_VERTEX_SHADER, {frame_glsl, octant_quad_glsl, octant_vert}},
                                                       {GL_FRAGMENT_SHADER, {frame_glsl, octant_frag}}}));
  return Kernel{.kind = KernelKind::octant,
                .key = std::move(key),
                .project = std::move(project),
                .draw_far = std::move(draw),
                .draw_near = {},
                .record_bytes = sizeof(Record<OctantSplat>),
                .quad_bytes = 48,
                .table_columns = 4097,
                .table_rows = 1};
}

Result<Program> build_moments_drawing(std::string_view define, std::string_view fragment) {
  return build_program("moments' quads",
                       {{GL_VERTEX_SHADER, {frame_glsl, define, moments_common_glsl, moments_quad_glsl, moments_vert}},
                        {GL_FRAGMENT_SHADER, {frame_glsl, moments_common_glsl, moments_fragment_glsl, fragment}}});
}

Result<Kernel> make_moments_kernel() {
  SPLATVOL_TRY_ASSIGN(key, build_program("moments' keys", {{GL_COMPUTE_SHADER,
                                                            {frame_glsl, moments_common_glsl, moments_quad_glsl,
                                                             moments_project_glsl, key_comp}}}));
  SPLATVOL_TRY_ASSIGN(project, build_program("moments' projection", {{GL_COMPUTE_SHADER,
                                                                      {frame_glsl, moments_common_glsl, moments_quad_glsl,
                                                                       moments_project_glsl, project_comp}}}));
  SPLATVOL_TRY_ASSIGN(draw_far, build_moments_drawing("", moments_far_frag));
  SPLATVOL_TRY_ASSIGN(draw_near, build_moments_drawing("#define NEAR\n", moments_near_frag));
  return Kernel{.kind = KernelKind::moments,
                .key = std::move(key),
                .project = std::move(project),
                .draw_far = std::move(draw_far),
                .draw_near = std::move(draw_near),
                .record_bytes = sizeof(Record<MomentsSplat>),
                .quad_bytes = 208,
                .table_columns = 513,
                .table_rows = 64};
}

}  // namespace

Result<Kernel> make_kernel(KernelKind kind) {
  return kind == KernelKind::octant ? make_octant_kernel() : make_moments_kernel();
}

}  // namespace splatvol
