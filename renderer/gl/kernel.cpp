#include "renderer/gl/kernel.h"

#include <array>

#include "renderer/gl/shaders.h"

namespace splatvol {

namespace {

using namespace shaders;

Result<Program> build_compute(std::string_view name, std::string_view common, std::string_view quad,
                              std::string_view project, std::string_view main) {
  return build_program(
      name, {{GL_COMPUTE_SHADER, {frame_glsl, records_glsl, surface_ranges_glsl, common, quad, project, main}}});
}

/// What programs with opaque surfaces have besides.
struct SurfaceSources {
  std::string_view define = "", depths = "";  // of both stages; of the fragments
};
constexpr SurfaceSources no_surfaces;
constexpr SurfaceSources with_surfaces{"#define SURFACES\n", surface_depths_glsl};

Result<std::vector<Program>> make_octant_forms(const SurfaceSources& surfaces) {
  std::vector<Program> forms;
  SPLATVOL_TRY_ASSIGN(
      form, build_program("octant's quads",
                          {{GL_VERTEX_SHADER, {frame_glsl, surfaces.define, octant_quad_glsl, octant_vert}},
                           {GL_FRAGMENT_SHADER, {frame_glsl, surfaces.define, surfaces.depths, octant_frag}}}));
  forms.push_back(std::move(form));
  return forms;
}

Result<std::vector<Program>> make_moments_forms() {
  struct Form {
    std::string_view defines, functions, fragment;
  };
  constexpr std::array<Form, 3> sources{
      Form{"#define FORM far_form\n#define FORM_COUNT far_form_count\n", moments_far_glsl, moments_far_frag},
      Form{"#define FORM middle_form\n#define FORM_COUNT middle_form_count\n", "", moments_middle_frag},
      Form{"#define FORM near_form\n#define FORM_COUNT near_form_count\n", moments_near_glsl, moments_near_frag}};
  std::vector<Program> forms;
  for (const auto& [defines, functions, fragment] : sources) {
    SPLATVOL_TRY_ASSIGN(
        form,
        build_program(
            "moments' quads",
            {{GL_VERTEX_SHADER, {frame_glsl, moments_common_glsl, moments_quad_glsl, defines, moments_vert}},
             {GL_FRAGMENT_SHADER, {frame_glsl, moments_common_glsl, moments_fragment_glsl, functions, fragment}}}));
    forms.push_back(std::move(form));
  }
  return forms;
}

Result<Program> make_moments_form_with_surfaces() {
  return build_program(
      "moments' quads with surfaces",
      {{GL_VERTEX_SHADER, {frame_glsl, with_surfaces.define, moments_common_glsl, moments_quad_glsl, moments_vert}},
       {GL_FRAGMENT_SHADER,
        {frame_glsl, with_surfaces.define, with_surfaces.depths, moments_common_glsl, moments_quad_glsl,
         moments_fragment_glsl, moments_far_glsl, moments_near_glsl, moments_surfaces_frag}}});
}

/// What a kernel's compute programs consist of, and their names in messages.
struct ComputeSources {
  std::string_view keys, projection, common, quad, project;
  std::size_t quad_bytes;
};
constexpr ComputeSources octant_sources{"octant's keys",  "octant's projection", octant_transfer_glsl,
                                        octant_quad_glsl, octant_project_glsl,   48};
constexpr ComputeSources moments_sources{"moments' keys",   "moments' projection", moments_common_glsl,
                                         moments_quad_glsl, moments_project_glsl,  352};

}  // namespace

Result<Kernel> make_kernel(KernelKind kind) {
  const bool is_octant = kind == KernelKind::octant;
  const auto& [keys, projection, common, quad, projecting, quad_bytes] = is_octant ? octant_sources : moments_sources;
  SPLATVOL_TRY_ASSIGN(key, build_compute(keys, common, quad, projecting, key_comp));
  SPLATVOL_TRY_ASSIGN(project, build_compute(projection, common, quad, projecting, project_comp));
  SPLATVOL_TRY_ASSIGN(forms, is_octant ? make_octant_forms(no_surfaces) : make_moments_forms());
  return Kernel{.kind = kind,
                .key = std::move(key),
                .project = std::move(project),
                .forms = std::move(forms),
                .forms_with_surfaces = {},
                .quad_bytes = quad_bytes,
                .table = table_size(kind)};
}

Status add_surface_forms(Kernel& kernel) {
  if (!kernel.forms_with_surfaces.empty()) return {};
  if (kernel.kind == KernelKind::octant) {
    SPLATVOL_TRY_SET(kernel.forms_with_surfaces, make_octant_forms(with_surfaces));
    return {};
  }
  SPLATVOL_TRY_ASSIGN(forms, make_moments_forms());
  SPLATVOL_TRY_ASSIGN(last, make_moments_form_with_surfaces());
  forms.push_back(std::move(last));
  kernel.forms_with_surfaces = std::move(forms);
  return {};
}

}  // namespace splatvol
