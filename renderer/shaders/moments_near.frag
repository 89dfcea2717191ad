// Any ellipsoid, the eye beside or in it.
noperspective in vec2 s;
flat in vec4 form[near_form_count];
layout(location = 0) out vec4 pixel;

const float pi = 3.14159265;

// The integral of (1 - u^2)^(3/2) from u to 1, and the mean of u over it. Near 1, where the difference would cancel, a
// series.
vec2 rest_of_chord(float u) {
  float x = 1.0 - u;
  float w = max(x * (1.0 + u), 0.0);
  float rest = u > 0.8 ? 1.13137085 * x * x * sqrt(x) * (1.0 - x * (0.535714286 - x * 0.0520833333))
                       : (1.5 * pi - (3.0 * asin(u) + u * (5.0 - 2.0 * u * u) * sqrt(w)) ) / 8.0;
  return vec2(rest, 0.2 * w * w * sqrt(w) / max(rest, 1e-30));
}

void main() {
  vec4 d = form[0] + form[1] * s.x + form[2] * s.y;  // d', o' . d'
  vec3 n = form[3].xyz + form[4].xyz * s.x + form[5].xyz * s.y;
  vec3 gradient = form[6].xyz;
  float r = 1.0 / dot(d.xyz, d.xyz);
  float root = sqrt(r);
  float q = max(1.0 - dot(n, n) * r, 0.0);

  // The chord runs from -1 to 1 in u; what is behind the eye does not count.
  float half_chord = sqrt(q);
  float behind = clamp(d.w * root / max(half_chord, 1e-20), -1.0, 1.0);
  vec2 rest = rest_of_chord(behind);
  float ray = sqrt(ray_length_squared());
  float depth = form[3].w * ray * root * q * q * rest.x * (8.0 / (3.0 * pi));

  float along = dot(gradient, d.xyz) * root;
  float mean = form[5].w + dot(gradient, cross(d.xyz, n)) * r + along * half_chord * rest.y;
  float spread = sqrt(form[4].w + along * along / (half_axis * half_axis));
  float columns;
  float row = transfer_row(spread, columns);
  vec4 material = transfer((mean - 0.5) * columns + 0.5 * transfer_columns(), row);
  float alpha = opacity(depth * material.a);
  float cosine = form[6].w > 0.0 ? min(abs(along) * form[6].w / (root * ray), 1.0) : 1.0;
  pixel = vec4(material.rgb * (alpha * (frame.ambient + frame.diffuse * cosine)), alpha);
}
