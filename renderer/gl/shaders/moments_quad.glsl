// A splat of the kernel `moments` on the screen: a parallelogram, in which s runs from -1 to 1 along both axes, and the
// data of its fragments in three forms. A later form serves every splat that an earlier one serves. Form 3 is the near
// one of a splat of which surfaces may hide a part.
struct Quad {
  vec4 far_form[far_form_count];        // of moments_far.glsl; [0].w: a depth of 1 in units of d'
  vec4 middle_form[middle_form_count];  // of moments_middle.frag
  vec4 near_form[near_form_count];      // of moments_near.glsl
  vec4 axes;                            // to s = (1, 0) and to s = (0, 1), pixels
  vec2 center;                          // pixels
  float reach;                          // largest |s|: less than 1 if the rest is too faint; 0: nothing to draw
  uint form;                            // the first form that serves: 0 to 3
};

layout(std430, binding = 4) restrict buffer QuadBlock { Quad quads[]; };

uint form_of(Quad quad) { return quad.form; }

Quad empty_quad() {
  Quad quad;
  quad.axes = vec4(0.0);
  quad.center = vec2(0.0);
  quad.reach = 0.0;
  quad.form = 0u;
  return quad;
}
