// Shared by the fragment shaders of the kernel `moments`.

// Looks up the table. The texture unit interpolates along the row, with weights of eight bits or more: 1/131072 of the
// domain.
vec4 transfer(float column, float row) {
  return textureLod(transfer_table, vec2((column + 0.5) / (transfer_columns() + 1.0), row), 0.0);
}

// Returns 1 - exp(-depth) without cancellation: the series at depth / 16, then four times f(2 x) = f(x) (2 - f(x)).
float opacity(float depth) {
  float x = min(depth * 0.0625, 1.0);
  float f = x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x / 24.0)));
  f *= 2.0 - f;
  f *= 2.0 - f;
  f *= 2.0 - f;
  return f * (2.0 - f);
}

// Returns the squared length of the pixel's ray at depth 1; in orthographic projection it is 1.
float ray_length_squared() {
  vec2 tangent = (gl_FragCoord.xy - 0.5 * frame.image_size) * ((1.0 - frame.orthographic) / frame.focal);
  return 1.0 + dot(tangent, tangent);
}

// Evaluates a polynomial of the second order.
float at_s(vec2 s, float constant, vec2 slope, vec3 bend) {
  return constant + s.x * (slope.x + bend.x * s.x + bend.y * s.y) + s.y * (slope.y + bend.z * s.y);
}

// A chord runs from -1 to 1, with the density (1 - u^2)^(3/2). Returns the share of its mass up to u, and the mean of u
// there.
vec2 part_of_chord(float u) {
  u = clamp(u, -1.0, 1.0);
  float square = u * u;
  float odd = u * (share_1 - square * (share_3 - square * (share_5 + square * share_7)));
  return vec2(max(0.5 + odd, 0.0),
              -(1.0 - u) * (1.0 - u) * (mean_0 + u * (mean_1 - u * (mean_2 + u * mean_3))));
}
