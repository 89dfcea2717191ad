// Corner gl_VertexID % 4 of quad gl_VertexID / 4.
flat out vec4 color;
#ifdef SURFACES
flat out float depth;
#endif
noperspective out vec2 offset;  // from the centre, in half widths at half maximum

void main() {
  Quad quad = quads[gl_VertexID >> 2];
  uvec2 first = uvec2(quad.columns, quad.rows) & 0xffffu;
  uvec2 end = uvec2(quad.columns, quad.rows) >> 16;
  uvec2 corner = uvec2((gl_VertexID & 1) == 0 ? first.x : end.x, (gl_VertexID & 2) == 0 ? first.y : end.y);

  color = quad.color;
#ifdef SURFACES
  depth = quad.depth;
#endif
  offset = quad.corner + vec2(corner - first) * quad.pixel;
  gl_Position = vec4(2.0 * vec2(corner) / frame.image_size - 1.0, 0.0, 1.0);
}
