// A splat of the kernel `moments` on the screen: a parallelogram, in which s runs from -1 to 1 along both axes, and
// what its fragments need, in three forms; the later ones serve every splat that an earlier one does.
struct Quad {
  vec4 far_form[far_form_count];        // of moments_far.frag
  vec4 middle_form[middle_form_count];  // of moments_middle.frag
  vec4 near_form[near_form_count];      // of moments_near.frag
  vec4 axes;                            // to s = (1, 0) and to s = (0, 1), pixels
  vec2 centre;                          // pixels
  float reach;                          // how far s goes: less than 1 where the rest is too faint; 0: nothing to draw
  uint form;                            // the first that serves: 0, 1 or 2
};

layout(std430, binding = 4) restrict buffer QuadBlock { Quad quads[]; };

uint form_of(Quad quad) { return quad.form; }

Quad empty_quad() {
  Quad quad;
  quad.axes = vec4(0.0);
  quad.centre = vec2(0.0);
  quad.reach = 0.0;
  quad.form = 0u;
  return quad;
}
