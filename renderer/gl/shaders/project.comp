// Projects a run's splats of one page, in the order in which they are drawn.
layout(local_size_x = 64) in;

// The last form that one of a run's quads needs draws the whole run. So commands[f] gets a count if a quad needs form
// f, and keeps its instance only if no quad needs a later form.
struct DrawCommand {
  uint count, instances, first_index, base_vertex, base_instance;
};
struct Run {
  DrawCommand commands[4];
};

layout(std430, binding = 2) restrict readonly buffer OrderBlock { uint order[]; };
layout(std430, binding = 5) restrict writeonly buffer RunBlock { Run runs[]; };
layout(location = 0) uniform uint first;  // in the order; the first number if there is none
layout(location = 1) uniform uint count;
layout(location = 2) uniform int ordering;  // 0: as the splats lie, 1: by `order`, -1: by `order` from its end
layout(location = 3) uniform uint page;     // that is bound; splats of other pages are left to other calls
layout(location = 4) uniform uint run;

void main() {
  uint i = gl_GlobalInvocationID.x;
  if (i >= count) return;
  uint number = first + (ordering < 0 ? count - 1u - i : i);
  if (ordering != 0) number = order[number];
  if (page_of(number) != page) return;
  Quad quad;
  float distance_to_eye;
  vec2 depths;
  if (!is_in_entry(number) || !project(number, quad, distance_to_eye, depths))
    quad = empty_quad();
  else if (surface_levels > 0)
    compare_with_surfaces(depths, quad);
  quads[i] = quad;

  uint form = form_of(quad);
  if (form > 0u) runs[run].commands[form].count = 6u * count;
  for (uint earlier = 0u; earlier < form; ++earlier) runs[run].commands[earlier].instances = 0u;
}
