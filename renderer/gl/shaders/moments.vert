// Corner gl_VertexID % 4 of quad gl_VertexID / 4. FORM and FORM_COUNT name the form of the fragments. With SURFACES,
// they find the form of their quad themselves.
noperspective out vec2 s;
#ifdef SURFACES
flat out uint index;
#else
flat out vec4 form[FORM_COUNT];
#endif

void main() {
#ifdef SURFACES
  index = gl_VertexID >> 2;
#else
  uint index = gl_VertexID >> 2;
  form = quads[index].FORM;
#endif
  s = quads[index].reach * vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, (gl_VertexID & 2) == 0 ? -1.0 : 1.0);
  vec2 corner = quads[index].center + s.x * quads[index].axes.xy + s.y * quads[index].axes.zw;
  gl_Position = vec4(2.0 * corner / frame.image_size - 1.0, 0.0, 1.0);
}
