// What both fragment shaders of the kernel `moments` share.

// Interpolated here: a texture unit's own weights have eight bits only, and its coordinate misses the entries a little.
vec4 transfer(float column, int row) {
  float last = transfer_columns();
  float place = clamp(column, 0.0, last);
  float left = min(floor(place), last - 1.0);
  vec4 a = texelFetch(transfer_table, ivec2(int(left), row), 0);
  return mix(a, texelFetch(transfer_table, ivec2(int(left) + 1, row), 0), place - left);
}

// 1 - exp(-depth) without cancellation: from its series at depth / 16, doubled four times by f(2 x) = f(x) (2 - f(x)).
float opacity(float depth) {
  float x = min(depth * 0.0625, 1.0);
  float f = x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x / 24.0)));
  f *= 2.0 - f;
  f *= 2.0 - f;
  f *= 2.0 - f;
  return f * (2.0 - f);
}

// Of a pixel's ray at depth 1, squared: 1 in orthographic projection.
float ray_length_squared() {
  vec2 tangent = (gl_FragCoord.xy - 0.5 * frame.image_size) * ((1.0 - frame.orthographic) / frame.focal);
  return 1.0 + dot(tangent, tangent);
}
