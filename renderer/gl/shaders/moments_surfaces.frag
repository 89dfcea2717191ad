// Draws each splat in the form that it needs, and ends it at surfaces if they may hide a part of it. A run with such
// splats has whole ones too, which are to look as without surfaces.
noperspective in vec2 s;
flat in uint index;
layout(location = 0) out vec4 pixel;

void main() {
  if (quads[index].form == 0u) {
    pixel = draw_far(s, quads[index].far_form);
  } else {
    float surface = quads[index].form == 3u ? surface_depth() * quads[index].far_form[0].w : 1e30;
    pixel = draw_near(s, quads[index].near_form, surface);
  }
}
