#include "renderer/gl/kernel.h"

#include <array>

#include "renderer/gl/shaders.h"

namespace splatvol {

namespace {

using namespace shaders;

Result<Program> build_compute(std::string_view name, std::string_view common, std::string_view quad,
                              std::string_view project, std::string_view main) {
  return build_program(name, {{GL_COMPUTE_SHADER, {frame_glsl, records_glsl, common, quad, project, main}}});
}

Result<Kernel> make_octant_kernel() {
  SPLATVOL_TRY_ASSIGN(
      key, build_compute("octant's keys", octant_transfer_glsl, octant_quad_glsl, octant_project_glsl, key_comp));
  SPLATVOL_TRY_ASSIGN(project, build_compute("octant's projection", octant_transfer_glsl, octant_quad_glsl,
                                             octant_project_glsl, project_comp));
  std::vector<Program> forms;
  for (const std::string_view fragment : {octant_frag, octant_weighted_frag}) {
    SPLATVOL_TRY_ASSIGN(
        form, build_program("octant's quads", {{GL_VERTEX_SHADER, {frame_glsl, octant_quad_glsl, octant_vert}},
                                               {GL_FRAGMENT_SHADER, {frame_glsl, fragment}}}));
    forms.push_back(std::move(form));
  }
  return Kernel{.kind = KernelKind::octant,
                .key = std::move(key),
                .project = std::move(project),
                .forms = std::move(forms),
                .quad_bytes = 48,
                .table = table_size(KernelKind::octant)};
}

Result<Kernel> make_moments_kernel() {
  SPLATVOL_TRY_ASSIGN(
      key, build_compute("moments' keys", moments_common_glsl, moments_quad_glsl, moments_project_glsl, key_comp));
  SPLATVOL_TRY_ASSIGN(project, build_compute("moments' projection", moments_common_glsl, moments_quad_glsl,
                                             moments_project_glsl, project_comp));
  struct Form {
    std::string_view defines, fragment;
  };
  constexpr std::array<Form, most_forms> sources{
      Form{"#define FORM far_form\n#define FORM_COUNT far_form_count\n", moments_far_frag},
      Form{"#define FORM middle_form\n#define FORM_COUNT middle_form_count\n", moments_middle_frag},
      Form{"#define FORM near_form\n#define FORM_COUNT near_form_count\n", moments_near_frag}};
  std::vector<Program> forms;
  for (const auto& [defines, fragment] : sources) {
    SPLATVOL_TRY_ASSIGN(
        form,
        build_program("moments' quads",
                      {{GL_VERTEX_SHADER, {frame_glsl, moments_common_glsl, moments_quad_glsl, defines, moments_vert}},
                       {GL_FRAGMENT_SHADER, {frame_glsl, moments_common_glsl, moments_fragment_glsl, fragment}}}));
    forms.push_back(std::move(form));
  }
  return Kernel{.kind = KernelKind::moments,
                .key = std::move(key),
                .project = std::move(project),
                .forms = std::move(forms),
                .quad_bytes = 352,
                .table = table_size(KernelKind::moments)};
}

}  // namespace

Result<Kernel> make_kernel(KernelKind kind) {
  return kind == KernelKind::octant ? make_octant_kernel() : make_moments_kernel();
}

}  // namespace splatvol
