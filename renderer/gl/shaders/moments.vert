// Corner gl_VertexID % 4 of quad gl_VertexID / 4. FORM and FORM_COUNT name the form of the fragments.
noperspective out vec2 s;
flat out vec4 form[FORM_COUNT];
#ifdef SURFACES
flat out float inverse_depth;
#endif

void main() {
  uint index = gl_VertexID >> 2;
  form = quads[index].FORM;
#ifdef SURFACES
  inverse_depth = quads[index].far_form[0].w;
#endif
  s = quads[index].reach * vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, (gl_VertexID & 2) == 0 ? -1.0 : 1.0);
  vec2 corner = quads[index].centre + s.x * quads[index].axes.xy + s.y * quads[index].axes.zw;
  gl_Position = vec4(2.0 * corner / frame.image_size - 1.0, 0.0, 1.0);
}
