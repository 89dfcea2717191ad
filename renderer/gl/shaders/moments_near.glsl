// The near form: any ellipsoid, with the eye beside or inside it.

// Returns the integrals of (1 - u^2)^(3/2) and of u (1 - u^2)^(3/2) from u to 1. Near 1, where the difference would
// cancel, it uses a series.
vec2 rest_of_chord(float u) {
  float x = 1.0 - u;
  float w = max(x * (1.0 + u), 0.0);
  return vec2(u > 0.8 ? 1.13137085 * x * x * sqrt(x) * (1.0 - x * (0.535714286 - x * 0.0520833333))
                      : (1.5 * pi - 3.0 * asin(u) - u * (5.0 - 2.0 * u * u) * sqrt(w)) / 8.0,
              0.2 * w * w * sqrt(w));
}

#ifdef SURFACES
// `surface`: where the pixel's ray meets a surface, in units of d'.
vec4 draw_near(vec2 s, vec4 form[near_form_count], float surface) {
#else
vec4 draw_near(vec2 s, vec4 form[near_form_count]) {
#endif
  vec4 d = form[0] + form[1] * s.x + form[2] * s.y;  // d', o' . d'
  vec3 n = form[3].xyz + form[4].xyz * s.x + form[5].xyz * s.y;
  vec3 gradient = form[6].xyz;
  vec3 normal = form[7].xyz;  // of the boundary, outwards; 0: no boundary
  float r = 1.0 / dot(d.xyz, d.xyz);
  float root = sqrt(r);
  float q = max(1.0 - dot(n, n) * r, 0.0);
  vec3 middle = cross(d.xyz, n) * r;

  // The chord runs from -1 to 1 in u. Its parts behind the eye, beyond the boundary or behind a surface do not count.
  float half_chord = sqrt(q);
  float begin = clamp(d.w * root / max(half_chord, 1e-20), -1.0, 1.0);
  float end = 1.0;
  if (form[7].w > 0.0) {
    float towards = dot(normal, d.xyz) * root;
    float cut =
        -dot(normal, middle) / (max(half_chord, 1e-20) * (towards < 0.0 ? min(towards, -1e-12) : max(towards, 1e-12)));
    if (towards < 0.0) {
      begin = max(begin, min(cut, 1.0));
    } else {
      end = clamp(cut, begin, 1.0);
    }
  }
#ifdef SURFACES
  end = max(min(end, (d.w + surface * dot(d.xyz, d.xyz)) * root / max(half_chord, 1e-20)), begin);
#endif
  vec2 part = rest_of_chord(begin) - rest_of_chord(end);
#ifdef SURFACES
  if (end < 0.0) part.x = rest_of_chord(-end).x - rest_of_chord(-begin).x;  // a thin slice in front cancels less
#endif
  part = vec2(max(part.x, 0.0), part.y / max(part.x, 1e-10));
  float ray = sqrt(ray_length_squared());
  float depth = form[3].w * ray * root * q * q * part.x * (8.0 / (3.0 * pi));

  float along = dot(gradient, d.xyz);
  float mean = form[5].w + dot(gradient, middle) + along * root * half_chord * clamp(part.y, begin, end);
  float stretch = form[7].w * dot(normal, d.xyz);  // of the ellipsoid, beyond the covariance's extent
  // Negative numbers: an ellipse has one spread and one light.
  float variance = form[4].w + along * (along / ((half_axis * half_axis) * (1.0 / r + stretch * stretch)));
  float spread = sqrt(form[4].w < 0.0 ? -form[4].w : variance);
  float columns;
  float row = transfer_row(spread, columns);
  vec4 material = transfer((mean - 0.5) * columns + 0.5 * transfer_columns(), row);
  float alpha = opacity(depth * material.a);
  float cosine = form[6].w > 0.0 ? min(abs(along) * form[6].w / ray, 1.0) : 1.0;
  float scatter = scatter_of(form[4].w * (half_axis * half_axis), dot(gradient, gradient));
  float light =
      form[6].w < 0.0 ? -1.0 - form[6].w : frame.ambient + frame.diffuse * mean_cosine(cosine, scatter);
  return vec4(material.rgb * (alpha * light), alpha);
}
