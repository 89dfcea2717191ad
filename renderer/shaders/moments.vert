// Corner gl_VertexID % 4 of quad gl_VertexID / 4.
noperspective out vec2 s;
#ifdef NEAR
flat out vec4 form[near_form_count];
#else
flat out vec4 form[far_form_count];
#endif

void main() {
  uint index = gl_VertexID >> 2;
#ifdef NEAR
  form = quads[index].near_form;
#else
  form = quads[index].far_form;
#endif
  s = quads[index].reach * vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, (gl_VertexID & 2) == 0 ? -1.0 : 1.0);
  vec2 place = quads[index].centre + s.x * quads[index].axes.xy + s.y * quads[index].axes.zw;
  gl_Position = vec4(2.0 * place / frame.image_size - 1.0, 0.0, 1.0);
}
