// The paper's kernel, `octant`: a round Gaussian. Its centre is as opaque as a slab of the splat's thickness (Meredith
// and Ma 2001, section 3.1).

const uint shape_size = 3u;  // words
const uint value_size = 2u;

bool is_nan(float x) { return (floatBitsToUint(x) & 0x7fffffffu) > 0x7f800000u; }

// Returns 1 - exp(-depth); by its series where the subtraction would cancel.
float opacity(float depth) { return depth < 0.01 ? depth * (1.0 - depth * (0.5 - depth / 6.0)) : 1.0 - exp(-depth); }

vec3 position_in_view(uint number) { return position_of(shape_size * record_of(number), range_of(number)); }

// Sets the rectangle to the pixels whose centres lie inside a square round `center`, of half width `cut`; false if no
// pixel does. `scale`: world units that a length of 1 in the quad stands for. Next to the eye the square's bounds are
// infinite until they are clamped.
bool set_rectangle(vec3 center, float cut, float pixel_size, float scale, inout Quad quad) {
  vec2 middle = 0.5 * frame.image_size;
  vec2 low = (center.xy - cut) / pixel_size + middle;
  vec2 high = (center.xy + cut) / pixel_size + middle;
  if (!(all(lessThan(low, frame.image_size)) && all(greaterThan(high, vec2(0.0))))) return false;
  uvec2 first = uvec2(ceil(clamp(low, vec2(0.0), frame.image_size) - 0.5));
  uvec2 end = uvec2(ceil(clamp(high, vec2(0.0), frame.image_size) - 0.5));
  if (any(greaterThanEqual(first, end))) return false;
  quad.pixel = pixel_size / scale;
  quad.corner = (vec2(first) - middle) * quad.pixel - center.xy / scale;
  quad.columns = first.x | end.x << 16;
  quad.rows = first.y | end.y << 16;
  return true;
}

// The factor on the colour; the light is at the eye.
float light_on(vec3 gradient, vec3 center, float distance_to_eye) {
  bool orthographic = frame.orthographic != 0.0;
  float length_product = length(gradient) * (orthographic ? 1.0 : distance_to_eye);
  float along = abs(orthographic ? gradient.z : dot(gradient, center));
  float cosine = length_product > 0.0 ? min(along / length_product, 1.0) : 1.0;
  return frame.ambient + frame.diffuse * cosine;
}

// Empties the quad if surfaces hide all of it.
void compare_with_surfaces(vec2 depths, inout Quad quad) {
  uvec2 edges = uvec2(quad.columns, quad.rows);
  if (depths.x >= surface_range(vec2(edges & 0xffffu), vec2((edges >> 16) - 1u)).y) quad = empty_quad();
}

// Projects a splat; false if it draws nothing. Exact sorting orders the splats by `distance_to_eye`. The splat lies
// between two `depths`, which are one: it is flat.
bool project(uint number, out Quad quad, out float distance_to_eye, out vec2 depths) {
  uint record = record_of(number);
  float size = uintBitsToFloat(shape_words[shape_size * record + 2u]);
  float value = uintBitsToFloat(value_words[value_size * record]);
  uint gradient = value_words[value_size * record + 1u];
  if (is_nan(value) || !(size > 0.0)) return false;

  vec3 center = position_in_view(number);
  bool orthographic = frame.orthographic != 0.0;
  distance_to_eye = orthographic ? center.z : max(length(center), center.z);  // the length may underflow
  if (!(center.z > 0.0)) return false;

  vec4 material = transfer(value);
  float alpha = opacity(material.a * opacity_factor(number) * size);

  // A splat too small for the raster spreads the same light over more of it.
  float pixel_size = max((orthographic ? 1.0 : center.z) / frame.focal, smallest_float);
  float true_sigma = sigma_per_size * size;
  float sigma = max(true_sigma, smallest_sigma * pixel_size);
  alpha *= (true_sigma / sigma) * (true_sigma / sigma);
  if (!(alpha > faintest_alpha)) return false;

  float cut = sigma * min(largest_cut, sqrt(2.0 * log(alpha / faintest_alpha)));
  if (!set_rectangle(center, cut, pixel_size, half_width_per_sigma * sigma, quad)) return false;
  float light = light_on(rotate_to_view(unpackSnorm4x8(gradient).xyz), center, distance_to_eye);
  quad.color = vec4(material.rgb * (alpha * light), alpha);
  quad.depth = center.z;
  depths = vec2(center.z);
  return true;
}
