// The kernel `moments`: an ellipsoid of the material's covariance, whose density falls as (1 - rho^2)^(3/2); its integral
// along a ray has a closed form (docs/design.md). In the frame in which the ellipsoid is the unit ball, a ray o' + s d'
// has the squared distance b^2 = |o' x d'|^2 / |d'|^2 from its centre, and the integral is 3 pi / 8 (1 - b^2)^2 / |d'|.

struct Splat {
  float x, y, z;  // relative to the batch's origin, world units
  float mass;
  float deviations[3];
  float orientation[3];
  float value;
  float value_deviation;
  uint correlations;
  uint batch_index;
};

layout(std430, binding = 0) restrict readonly buffer SplatBlock { Splat splats[]; };
layout(std430, binding = 1) restrict readonly buffer OriginBlock { vec4 origins[]; };  // of batches, view coordinates
layout(binding = 1) uniform sampler1D peak_table;  // level k: the largest extinction of 2^k steps

const float pi = 3.14159265;
const float low_pass = 0.1;         // variance that the raster adds, squared pixels
const float smallest_float = 1e-30;
const float faintest_depth = 1e-5;  // optical depth of what is cut
const float nearest = 1.05;         // closer to the eye's plane, in its reach towards it, an ellipsoid is near
const float most_change = 0.2;      // of |d'|^2 within the outline, in terms of that in the middle, for the far form
const float largest = 16.0;         // and so it is where it is longer than this, in distances of the centre (or half images)

bool is_finite(float x) { return (floatBitsToUint(x) & 0x7f800000u) != 0x7f800000u; }
bool is_finite(vec3 x) { return is_finite(x.x) && is_finite(x.y) && is_finite(x.z); }

vec3 place(uint index) {
  return origins[splats[index].batch_index].xyz + rotate_to_view(vec3(splats[index].x, splats[index].y, splats[index].z));
}

// The principal axes as columns, view coordinates.
mat3 principal_axes(Splat splat) {
  vec3 q = vec3(splat.orientation[0], splat.orientation[1], splat.orientation[2]);
  float w = sqrt(max(1.0 - dot(q, q), 0.0));
  vec3 x = vec3(1.0 - 2.0 * (q.y * q.y + q.z * q.z), 2.0 * (q.x * q.y + q.z * w), 2.0 * (q.x * q.z - q.y * w));
  vec3 y = vec3(2.0 * (q.x * q.y - q.z * w), 1.0 - 2.0 * (q.x * q.x + q.z * q.z), 2.0 * (q.y * q.z + q.x * w));
  return mat3(rotate_to_view(x), rotate_to_view(y), rotate_to_view(cross(x, y)));
}

// Largest extinction of the values in [low, high], in domain units.
float peak_extinction(float low, float high) {
  int steps = textureSize(peak_table, 0);
  int first = min(int(clamp(low, 0.0, 1.0) * float(steps)), steps - 1);
  int end = min(int(clamp(high, 0.0, 1.0) * float(steps)), steps - 1);
  int level = findMSB(end - first) + 1;  // two entries there hold it all
  return max(texelFetch(peak_table, first >> level, level).r, texelFetch(peak_table, end >> level, level).r);
}

// The tangents k of x = k z to the part in front of the eye of an ellipsoid; -1e30 or 1e30 where it has none on that side.
// x: its centre and the row of L; likewise z.
vec2 tangents(float x, vec3 l_x, float z, vec3 l_z) {
  // Roots of a k^2 - 2 b k + c.
  float a = z * z - dot(l_z, l_z);
  float b = x * z - dot(l_x, l_z);
  float c = x * x - dot(l_x, l_x);
  float discriminant = b * b - a * c;
  if (!(discriminant > 0.0)) return vec2(-1e30, 1e30);  // the eye is inside of the shadow
  float root = sqrt(discriminant);
  float sum = b < 0.0 ? b - root : b + root;
  vec2 k = vec2(sum / a, c / sum);
  k = vec2(min(k.x, k.y), max(k.x, k.y));
  if (a > 0.0) return k;
  // The eye's plane cuts it: on the side where its section lies there is no tangent in front.
  return x * dot(l_z, l_z) > dot(l_x, l_z) * z ? vec2(k.y, 1e30) : vec2(-1e30, k.x);
}

// The coefficients of x^2, x y and y^2 in the product of two linear forms.
vec3 product(vec2 a, vec2 b) { return vec3(a.x * b.x, a.x * b.y + a.y * b.x, a.y * b.y); }

// Projects a splat; false where it draws nothing. `distance_to_eye` is what exact sorting goes by.
bool project(uint index, out Quad quad, out float distance_to_eye) {
  Splat splat = splats[index];
  vec3 centre = place(index);
  vec3 deviations = vec3(splat.deviations[0], splat.deviations[1], splat.deviations[2]);
  bool orthographic = frame.orthographic != 0.0;
  distance_to_eye = max(orthographic ? centre.z : length(centre), 0.0);
  if (!(splat.mass > 0.0) || !is_finite(splat.mass) || !is_finite(centre) || !is_finite(deviations) ||
      !is_finite(splat.value) || !is_finite(splat.value_deviation))
    return false;

  // From here on lengths are in pixels, as large as in the middle of what the eye can see of the splat.
  mat3 axes = transpose(principal_axes(splat));  // columns: the view's axes in the principal frame
  float reach_z = half_axis * length(axes[2] * deviations);
  if (!(centre.z + reach_z > 0.0)) return false;
  float pixel_size = (orthographic ? 1.0 : max(centre.z, 0.5 * (centre.z + reach_z))) / frame.focal;
  pixel_size = max(pixel_size, smallest_float);
  centre /= pixel_size;
  deviations /= pixel_size;
  vec3 widened = sqrt(deviations * deviations + low_pass);
  vec3 half_axes = half_axis * widened;
  vec3 l_x = axes[0] * half_axes;  // rows of L
  vec3 l_y = axes[1] * half_axes;
  vec3 l_z = axes[2] * half_axes;
  vec3 u = axes[0] / half_axes;  // columns of L^-1
  vec3 v = axes[1] / half_axes;
  vec3 w = axes[2] / half_axes;
  reach_z = length(l_z);
  float longest = max(max(half_axes.x, half_axes.y), half_axes.z);
  vec2 half_image = 0.5 * frame.image_size / (orthographic ? 1.0 : frame.focal);
  bool near = centre.z < nearest * reach_z || longest > largest * (orthographic ? max(half_image.x, half_image.y) : centre.z);

  // The value's gradient in the frame of the ball, and the variance that it leaves; in units of the domain.
  vec4 correlations = unpackSnorm4x8(splat.correlations);
  vec3 kept = deviations / widened;
  float value_deviation = splat.value_deviation * frame.inverse_domain;
  vec3 gradient = half_axis * value_deviation * correlations.xyz * kept;
  vec3 smoothed = correlations.xyz * correlations.xyz * (1.0 - kept * kept);
  float residual = value_deviation * value_deviation * (correlations.w * correlations.w + smoothed.x + smoothed.y + smoothed.z);
  float mean = (splat.value - frame.value_low) * frame.inverse_domain;
  float extent = length(gradient) + 4.0 * sqrt(residual);
  float peak = peak_extinction(mean - extent, mean + extent);

  // Where it is on the screen: k = middle + e_1 s.x + e_2 s.y, tangents (perspective) or pixels (orthographic).
  // `anchor` is a point k of the ellipsoid, at depth anchor_z and from_centre of the ball.
  vec2 anchor = orthographic ? centre.xy : centre.xy / centre.z;
  float anchor_z = centre.z;
  vec3 from_centre = vec3(0.0);
  vec2 middle, e_1, e_2;
  if (near) {
    vec2 x = orthographic ? centre.x + vec2(-1.0, 1.0) * length(l_x) : tangents(centre.x, l_x, centre.z, l_z);
    vec2 y = orthographic ? centre.y + vec2(-1.0, 1.0) * length(l_y) : tangents(centre.y, l_y, centre.z, l_z);
    vec2 low = max(vec2(x.x, y.x), -half_image);
    vec2 high = min(vec2(x.y, y.y), half_image);
    if (!all(lessThan(low, high))) return false;
    middle = 0.5 * (low + high);
    e_1 = vec2(0.5 * (high.x - low.x), 0.0);
    e_2 = vec2(0.0, 0.5 * (high.y - low.y));
    if (!orthographic) {
      from_centre = l_z / reach_z;
      anchor_z = centre.z + reach_z;
      anchor = (centre.xy + vec2(dot(l_x, from_centre), dot(l_y, from_centre))) / anchor_z;
    }
  } else {
    // The outline is an ellipse. With x and y sheared so that the centre lies straight ahead, L L^T = (Q, q; q^T, r^2), its
    // matrix is (Q + q q^T / (z^2 - r^2)) / (z^2 - r^2) and its centre -q / (z^2 - r^2). Any of its pairs of conjugate half
    // axes bounds the same area; determinants come from cross products, which do not cancel.
    vec3 sheared_x = orthographic ? l_x : l_x - anchor.x * l_z;
    vec3 sheared_y = orthographic ? l_y : l_y - anchor.y * l_z;
    float a = orthographic ? 1.0 : (centre.z - reach_z) * (centre.z + reach_z);
    vec2 q = orthographic ? vec2(0.0) : vec2(dot(sheared_x, l_z), dot(sheared_y, l_z));
    vec3 minors = cross(sheared_x, sheared_y);
    vec3 skew = q.x * sheared_y - q.y * sheared_x;
    float xx = dot(sheared_x, sheared_x) + q.x * q.x / a;
    float xy = dot(sheared_x, sheared_y) + q.x * q.y / a;
    float determinant = dot(minors, minors) + dot(skew, skew) / a;
    e_1 = vec2(sqrt(xx / a), xy / sqrt(xx * a));
    e_2 = vec2(0.0, sqrt(determinant / (xx * a)));
    middle = anchor - q / a;
    vec2 reach = vec2(e_1.x, abs(e_1.y) + e_2.y);
    if (!(all(lessThan(middle - reach, half_image)) && all(greaterThan(middle + reach, -half_image)))) return false;
  }

  // On the ray to s, as quantities linear in s: d' = scale L^-1 d, n = o' x d', p = o' . d'. In terms of the anchor, from
  // which the rays differ by little: o' x (direction to it) does not cancel then.
  vec2 shift = middle - anchor;
  vec3 o = -(centre.x * u + centre.y * v + centre.z * w);
  vec3 d_0 = w, d_1 = vec3(0.0), d_2 = vec3(0.0), n_0 = vec3(0.0), n_1, n_2, p;
  float scale = 1.0;
  float kappa = dot(w, w);
  if (orthographic) {
    vec3 o_shift = shift.x * u + shift.y * v;
    vec3 o_1 = e_1.x * u + e_1.y * v;
    vec3 o_2 = e_2.y * v;
    n_0 = cross(o_shift, w);
    n_1 = cross(o_1, w);
    n_2 = cross(o_2, w);
    p = vec3(dot(o_shift - centre.z * w, w), dot(o_1, w), dot(o_2, w));
  } else {
    scale = anchor_z;  // so that d' ends at the anchor's depth
    vec3 d_shift = scale * (shift.x * u + shift.y * v);
    d_0 = from_centre - o + d_shift;
    d_1 = scale * (e_1.x * u + e_1.y * v);
    d_2 = scale * (e_2.y * v);
    n_0 = cross(o, from_centre + d_shift);
    n_1 = cross(o, d_1);
    n_2 = cross(o, d_2);
    p = vec3(dot(o, d_0), dot(o, d_1), dot(o, d_2));
    float aside = 1.0 - dot(o, d_shift);
    kappa = (dot(o, o) - 1.0) * (1.0 - dot(d_shift, d_shift)) + aside * aside;  // of use only where not near
  }

  // Optical depth where extinction, |d'| and 1 - b^2 are 1.
  float strength = min(splat.mass / pixel_size / pixel_size / half_axes.x / half_axes.y / half_axes.z * (3.0 / pi) * scale, 1e18);
  float gradient_length = length(gradient / half_axes);
  float focal = orthographic ? 1.0 : frame.focal;
  quad.centre = (middle + half_image) * focal;
  quad.axes = vec4(e_1, e_2) * focal;
  quad.reach = 1.0;
  quad.form = 2u;
  quad.near_form[0] = vec4(d_0, p.x);
  quad.near_form[1] = vec4(d_1, p.y);
  quad.near_form[2] = vec4(d_2, p.z);
  quad.near_form[3] = vec4(n_0, strength);
  quad.near_form[4] = vec4(n_1, residual);
  quad.near_form[5] = vec4(n_2, mean);
  quad.near_form[6] = vec4(gradient, gradient_length > 0.0 ? 1.0 / (scale * gradient_length) : 0.0);
  float sum = 0.0;
  for (int i = 0; i < near_form_count; ++i) sum += dot(abs(quad.near_form[i]), vec4(1.0));
  if (!is_finite(sum)) return false;  // so large or so near that single precision overflows
  if (near) return peak * strength / scale * longest > faintest_depth;

  // The eye's plane does not cut it: 1 - b^2 = (1 - s^2) / g, where g = |d'|^2 / kappa is a square form of s.
  float ray = orthographic ? 1.0 : length(vec3(middle, 1.0));
  float square = dot(d_0, d_0);
  vec2 slope = 2.0 * vec2(dot(d_0, d_1), dot(d_0, d_2)) / square;  // of g / g(0)
  vec3 bend = vec3(dot(d_1, d_1), 2.0 * dot(d_1, d_2), dot(d_2, d_2)) / square;
  float change = length(slope) + bend.x + bend.z;
  float g = square / kappa;
  float depth = strength * inversesqrt(kappa);
  float brightest = peak * min(strength / scale * longest, depth * ray * pow(g * max(1.0 - change, 0.1), -2.5));
  if (!(brightest > faintest_depth)) return false;
  quad.reach = sqrt(1.0 - sqrt(faintest_depth / brightest));

  float along = dot(gradient, d_0) * inversesqrt(square);
  float spread = sqrt(residual + along * along / (half_axis * half_axis));
  float columns;
  float row = transfer_row(spread, columns);
  float column = (mean - 0.5) * columns + 0.5 * transfer_columns();
  float cosine = gradient_length > 0.0 ? min(abs(along) * sqrt(square) / (scale * ray * gradient_length), 1.0) : 1.0;
  float light = frame.ambient + frame.diffuse * cosine;
  vec3 g_0 = cross(gradient, d_0) * columns / kappa;
  vec3 g_1 = cross(gradient, d_1) * columns / kappa;
  vec3 g_2 = cross(gradient, d_2) * columns / kappa;
  float shift_0 = dot(n_0, g_0);
  vec2 shift_slope = vec2(dot(n_0, g_1) + dot(n_1, g_0), dot(n_0, g_2) + dot(n_2, g_0));
  vec3 shift_bend = vec3(dot(n_1, g_1), dot(n_1, g_2) + dot(n_2, g_1), dot(n_2, g_2));
  quad.form = change > most_change ? 1u : 0u;
  quad.middle_form[0] = vec4(g, g * slope, depth);
  quad.middle_form[1] = vec4(g * bend, light);
  quad.middle_form[2] = vec4(shift_0, shift_slope, row);
  quad.middle_form[3] = vec4(shift_bend, column);

  // The same expanded to the second order: depth goes with |d| g^(-5/2), the mean's distance from that of the centre with 1 / g.
  vec2 ray_slope = orthographic ? vec2(0.0) : vec2(dot(middle, e_1), dot(middle, e_2)) / (ray * ray);
  vec2 depth_slope = ray_slope - 2.5 * slope;
  vec3 depth_bend = 4.375 * product(slope, slope) - 2.5 * (bend + product(ray_slope, slope));
  depth *= ray * pow(g, -2.5);
  quad.far_form[0] = vec4(depth, depth * depth_slope, 0.0);
  quad.far_form[1] = vec4(depth * depth_bend, light);
  quad.far_form[2] = vec4(column + shift_0 / g, (shift_slope - shift_0 * slope) / g, row);
  quad.far_form[3] = vec4((shift_bend - product(shift_slope, slope) + shift_0 * (product(slope, slope) - bend)) / g, 0.0);
  return true;
}
