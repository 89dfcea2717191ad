// The kernel `moments`: docs/design.md, "A splat". In the coordinates x' = L^-1 x the ellipsoid is the unit ball round the
// origin, and a ray is o' + s d'.

struct Splat {
  vec3 position;     // view coordinates
  float mass;
  vec3 deviations;   // along the principal axes
  vec4 orientation;  // unit quaternion
  float value, value_deviation;
  vec3 correlations;  // of the value with the position along each principal axis
  vec3 boundary;      // foot of the perpendicular from the centroid, in deviations along the principal axes
};

const uint shape_size = 7u;  // words
const uint value_size = 3u;

layout(binding = 1) uniform sampler1D peak_table;  // level k: the largest extinction of 2^k entries of level 0

// The ellipsoid. Lengths are in pixels, of the size that they have in the middle of its visible part.
struct Body {
  float pixel_size;    // world units
  vec3 center;         // view coordinates
  vec3 l_x, l_y, l_z;  // rows of L
  vec3 u, v, w;        // columns of L^-1
  float volume;        // determinant of L
  float longest;       // bound on the half axes
  bool near;           // the eye's plane cuts it or almost touches it
  vec3 normal;         // of the boundary in the ball's coordinates, outwards; 0: no boundary
  float stretch;       // along the normal the ball is sqrt(1 + stretch^2) times as long as without a boundary
};

// The value in the ball's coordinates, in units of the domain.
struct Value {
  float mean;  // at the centre
  vec3 gradient;
  float residual;  // variance that the linear field leaves
  float slope;     // length of the gradient in view coordinates
  float scatter;   // scatter_of
};

// The outline on the screen: k = middle + e_1 s.x + e_2 s.y; tangents (perspective) or pixels (orthographic).
struct Outline {
  vec2 middle, e_1, e_2;
  vec2 anchor;       // k of a point of the ellipsoid
  float anchor_z;    // its depth
  vec3 from_center;  // its position in the ball
};

// The rays as linear functions of s: d' = scale L^-1 d, n = o' x d' and o' . d'.
struct Rays {
  float scale;
  vec3 d_0, d_1, d_2;
  vec3 n_0, n_1, n_2;
  vec3 along;
  float kappa;  // 1 - b^2 = (1 - s^2) kappa / |d'|^2, unless near
};

bool is_finite(float x) { return (floatBitsToUint(x) & 0x7f800000u) != 0x7f800000u; }
bool is_finite(vec3 x) { return is_finite(x.x) && is_finite(x.y) && is_finite(x.z); }

bool is_orthographic() { return frame.orthographic != 0.0; }

vec3 position_in_view(uint number) { return position_of(shape_size * record_of(number), range_of(number)); }

// Unpacks a quaternion (PackedOrientation): three of its components, and the index of the largest.
vec4 unpack_orientation(uint low, uint high) {
  vec3 codes = vec3((low >> 2) & 0xfffffu, (low >> 22) | ((high & 0x3ffu) << 10), (high >> 10) & 0xfffffu);
  vec3 three = (codes / 524287.0 - 1.0) * 0.707106781;
  float largest = sqrt(max(1.0 - dot(three, three), 0.0));
  uint index = low & 3u;
  return index == 0u   ? vec4(largest, three)
         : index == 1u ? vec4(three.x, largest, three.yz)
         : index == 2u ? vec4(three.xy, largest, three.z)
                       : vec4(three, largest);
}

Splat read_splat(uint number) {
  uint record = record_of(number);
  Range range = range_of(number);
  uint shape = shape_size * record, value = value_size * record;
  uint mass_word = shape_words[shape + 4u], deviation_word = shape_words[shape + 5u];
  int foot = int(shape_words[shape + 6u]);
  uint value_word = value_words[value + 1u];
  int correlations = int(value_words[value + 2u]);

  Splat splat;
  splat.position = position_of(shape, range);
  splat.mass = log_number(mass_word & 0xffffu, range.mass_scale);
  splat.mass *= float((value_word >> 16) & 0xffu) / 255.0 * opacity_factor(number);
  splat.deviations = vec3(log_number(mass_word >> 16, range.deviation_scale),
                          log_number(deviation_word & 0xffffu, range.deviation_scale),
                          log_number(deviation_word >> 16, range.deviation_scale));
  splat.orientation = unpack_orientation(shape_words[shape + 2u], shape_words[shape + 3u]);
  splat.boundary =
      vec3(bitfieldExtract(foot, 0, 10), bitfieldExtract(foot, 10, 10), bitfieldExtract(foot, 20, 10)) / 128.0;
  splat.value = uintBitsToFloat(value_words[value]);
  splat.value_deviation = log_number(value_word & 0xffffu, range.value_scale);
  splat.correlations =
      vec3(int(value_word) >> 24, bitfieldExtract(correlations, 0, 8), bitfieldExtract(correlations, 8, 8)) / 127.0;
  return splat;
}

// Returns the view's axes as columns, in coordinates along the principal axes.
mat3 view_axes(Splat splat) {
  vec4 q = splat.orientation;
  vec3 x = vec3(1.0 - 2.0 * (q.y * q.y + q.z * q.z), 2.0 * (q.x * q.y + q.z * q.w), 2.0 * (q.x * q.z - q.y * q.w));
  vec3 y = vec3(2.0 * (q.x * q.y - q.z * q.w), 1.0 - 2.0 * (q.x * q.x + q.z * q.z), 2.0 * (q.y * q.z + q.x * q.w));
  return transpose(mat3(rotate_to_view(x), rotate_to_view(y), rotate_to_view(cross(x, y))));
}

// Sets the boundary of a splat that has one, and widens `foot`. `kept`: what widening keeps of the deviations.
void set_boundary(vec3 kept, inout vec3 foot, inout Body body) {
  vec3 across = foot / max(kept, 1e-3);
  foot = across * (dot(foot, foot) / dot(across, across));
  body.stretch = length(foot);
  body.normal = foot / max(body.stretch, 1e-10);
}

// Sets L, its inverse and the sizes. `half_axes`: before the stretch along the boundary's normal by `stretch`.
void set_axes(mat3 axes, vec3 half_axes, float stretch, inout Body body) {
  body.l_x = axes[0] * half_axes;
  body.l_y = axes[1] * half_axes;
  body.l_z = axes[2] * half_axes;
  body.u = axes[0] / half_axes;
  body.v = axes[1] / half_axes;
  body.w = axes[2] / half_axes;
  vec3 stretched = (stretch - 1.0) * body.normal;
  body.l_x += dot(body.normal, body.l_x) * stretched;
  body.l_y += dot(body.normal, body.l_y) * stretched;
  body.l_z += dot(body.normal, body.l_z) * stretched;
  vec3 shrunk = (1.0 / stretch - 1.0) * body.normal;
  body.u += dot(body.normal, body.u) * shrunk;
  body.v += dot(body.normal, body.v) * shrunk;
  body.w += dot(body.normal, body.w) * shrunk;
  body.volume = half_axes.x * half_axes.y * half_axes.z * stretch;
  body.longest = max(max(half_axes.x, half_axes.y), half_axes.z) * stretch;
}

// Makes the ellipsoid and its values; false if no part of it is in front of the eye.
bool make_body(Splat splat, out Body body, out Value value) {
  mat3 axes = view_axes(splat);
  vec3 center = splat.position;
  vec3 deviations = splat.deviations;
  vec3 foot = splat.boundary;
  float reach_z = half_axis * length(axes[2] * deviations) * (1.0 + 1.1 * length(foot));
  if (!(center.z + reach_z > 0.0)) return false;
  float middle_z = is_orthographic() ? 1.0 : max(center.z, 0.5 * (center.z + reach_z));
  body.pixel_size = max(middle_z / frame.focal, smallest_pixel);
  deviations /= body.pixel_size;
  vec3 widened = sqrt(deviations * deviations + low_pass);
  vec3 kept = deviations / widened;

  vec3 correlations = splat.correlations;
  float unexplained = max(1.0 - dot(correlations, correlations), 0.0);
  vec2 of_axis = axis_moments(value_axis(), splat.value, splat.value_deviation);
  float value_deviation = of_axis.y;
  vec3 gradient = half_axis * value_deviation * correlations * kept;
  vec3 smoothed = correlations * correlations * (1.0 - kept * kept);
  value.residual = value_deviation * value_deviation * (unexplained + smoothed.x + smoothed.y + smoothed.z);
  value.slope = length(gradient / (half_axis * widened));
  value.scatter = value_deviation > 0.0 ? scatter_of(unexplained, 1.0 - unexplained) : 0.0;

  body.normal = vec3(0.0);
  body.stretch = 0.0;
  if (foot != vec3(0.0)) set_boundary(kept, foot, body);
  float stretch = sqrt(1.0 + body.stretch * body.stretch);
  body.center = center / body.pixel_size + transpose(axes) * (widened * foot);
  value.mean = of_axis.x + dot(gradient, foot) / half_axis;
  value.gradient = gradient + (stretch - 1.0) * dot(body.normal, gradient) * body.normal;

  set_axes(axes, half_axis * widened, stretch, body);
  reach_z = length(body.l_z);
  body.near = body.center.z < nearest_distance * reach_z;
  return body.center.z + reach_z > 0.0;
}

// Returns the largest extinction of the values in [low, high], which are in units of the domain.
float peak_extinction(float low, float high) {
  int entries = textureSize(peak_table, 0);
  int first = min(int(clamp(low, 0.0, 1.0) * float(entries)), entries - 1);
  int end = min(int(clamp(high, 0.0, 1.0) * float(entries)), entries - 1);
  int level = findMSB(end - first) + 1;  // two of its entries hold the whole range
  return max(texelFetch(peak_table, first >> level, level).r, texelFetch(peak_table, end >> level, level).r);
}

// Returns the two k for which x = k z touches the ellipsoid's part in front of the eye; -1e30 or 1e30 for a side
// without such a tangent. x, l_x and z, l_z: the centre's coordinates and rows of L.
vec2 tangents(float x, vec3 l_x, float z, vec3 l_z) {
  // Roots of a k^2 - 2 b k + c.
  float a = z * z - dot(l_z, l_z);
  float b = x * z - dot(l_x, l_z);
  float c = x * x - dot(l_x, l_x);
  float discriminant = b * b - a * c;
  if (!(discriminant > 0.0)) return vec2(-1e30, 1e30);  // the eye is inside the projection along the other axis
  float root = sqrt(discriminant);
  float sum = b < 0.0 ? b - root : b + root;
  vec2 k = vec2(sum / a, c / sum);
  k = vec2(min(k.x, k.y), max(k.x, k.y));
  if (a > 0.0) return k;
  // The eye's plane cuts it: there is no tangent in front on the side of the section.
  return x * dot(l_z, l_z) > dot(l_x, l_z) * z ? vec2(k.y, 1e30) : vec2(-1e30, k.x);
}

// Makes an outline of the bounding box, cut off at the picture's edges.
void make_box(Body body, vec2 half_image, out Outline outline) {
  vec2 x, y;
  if (is_orthographic()) {
    x = body.center.x + vec2(-1.0, 1.0) * length(body.l_x);
    y = body.center.y + vec2(-1.0, 1.0) * length(body.l_y);
    outline.anchor = body.center.xy;
    outline.anchor_z = body.center.z;
    outline.from_center = vec3(0.0);
  } else {
    x = tangents(body.center.x, body.l_x, body.center.z, body.l_z);
    y = tangents(body.center.y, body.l_y, body.center.z, body.l_z);
    float reach_z = length(body.l_z);
    outline.from_center = body.l_z / reach_z;
    outline.anchor_z = body.center.z + reach_z;
    outline.anchor =
        (body.center.xy + vec2(dot(body.l_x, body.l_z), dot(body.l_y, body.l_z)) / reach_z) / outline.anchor_z;
  }
  vec2 low = max(vec2(x.x, y.x), -half_image);
  vec2 high = min(vec2(x.y, y.y), half_image);
  outline.middle = 0.5 * (low + high);
  outline.e_1 = vec2(0.5 * (high.x - low.x), 0.0);
  outline.e_2 = vec2(0.0, 0.5 * (high.y - low.y));
}

// Makes an outline of the ellipse.
void make_ellipse(Body body, out Outline outline) {
  bool orthographic = is_orthographic();
  outline.anchor = orthographic ? body.center.xy : body.center.xy / body.center.z;
  outline.anchor_z = body.center.z;
  outline.from_center = vec3(0.0);
  vec3 x = orthographic ? body.l_x : body.l_x - outline.anchor.x * body.l_z;
  vec3 y = orthographic ? body.l_y : body.l_y - outline.anchor.y * body.l_z;
  vec2 q = orthographic ? vec2(0.0) : vec2(dot(x, body.l_z), dot(y, body.l_z));
  float a = orthographic ? 1.0 : (body.center.z - length(body.l_z)) * (body.center.z + length(body.l_z));
  vec3 minors = cross(x, y);
  vec3 skew = q.x * y - q.y * x;
  float xx = dot(x, x) + q.x * q.x / a;
  float xy = dot(x, y) + q.x * q.y / a;
  float determinant = dot(minors, minors) + dot(skew, skew) / a;
  outline.e_1 = vec2(sqrt(xx / a), xy / sqrt(xx * a));
  outline.e_2 = vec2(0.0, sqrt(determinant / (xx * a)));
  outline.middle = outline.anchor - q / a;
}

// Computes the rays relative to the anchor, from which they differ little: this way o' x (direction) does not cancel.
Rays make_rays(Body body, Outline outline) {
  Rays rays;
  vec2 shift = outline.middle - outline.anchor;
  vec3 to_shift = shift.x * body.u + shift.y * body.v;
  vec3 to_1 = outline.e_1.x * body.u + outline.e_1.y * body.v;
  vec3 to_2 = outline.e_2.x * body.u + outline.e_2.y * body.v;
  if (is_orthographic()) {
    rays.scale = 1.0;
    rays.d_0 = body.w;
    rays.d_1 = vec3(0.0);
    rays.d_2 = vec3(0.0);
    rays.n_0 = cross(to_shift, body.w);
    rays.n_1 = cross(to_1, body.w);
    rays.n_2 = cross(to_2, body.w);
    rays.along = vec3(dot(to_shift - body.center.z * body.w, body.w), dot(to_1, body.w), dot(to_2, body.w));
    rays.kappa = dot(body.w, body.w);
  } else {
    vec3 o = -(body.center.x * body.u + body.center.y * body.v + body.center.z * body.w);
    rays.scale = outline.anchor_z;
    to_shift *= rays.scale;
    rays.d_0 = outline.from_center - o + to_shift;
    rays.d_1 = to_1 * rays.scale;
    rays.d_2 = to_2 * rays.scale;
    rays.n_0 = cross(o, outline.from_center + to_shift);
    rays.n_1 = cross(o, rays.d_1);
    rays.n_2 = cross(o, rays.d_2);
    rays.along = vec3(dot(o, rays.d_0), dot(o, rays.d_1), dot(o, rays.d_2));
    float aside = 1.0 - dot(o, to_shift);
    rays.kappa = (dot(o, o) - 1.0) * (1.0 - dot(to_shift, to_shift)) + aside * aside;
  }
  return rays;
}

// `strength`: the optical depth at an extinction, |d|, |d'| and 1 - b^2 of 1.
void set_near_form(Body body, Value value, Rays rays, float strength, inout Quad quad) {
  quad.near_form[0] = vec4(rays.d_0, rays.along.x);
  quad.near_form[1] = vec4(rays.d_1, rays.along.y);
  quad.near_form[2] = vec4(rays.d_2, rays.along.z);
  quad.near_form[3] = vec4(rays.n_0, strength);
  quad.near_form[4] = vec4(rays.n_1, value.residual);
  quad.near_form[5] = vec4(rays.n_2, value.mean);
  quad.near_form[6] = vec4(value.gradient, value.slope > 0.0 ? 1.0 / (rays.scale * value.slope) : 0.0);
  quad.near_form[7] = vec4(body.normal, body.stretch);
}

// A polynomial of s: the coefficients of 1; of x and y; of x^2, x y and y^2.
struct Polynomial {
  float constant;
  vec2 slope;
  vec3 bend;
};

Polynomial scaled(Polynomial p, float factor) {
  return Polynomial(p.constant * factor, p.slope * factor, p.bend * factor);
}

// Returns the second-order coefficients of the product of two linear forms without constants.
vec3 product(vec2 a, vec2 b) { return vec3(a.x * b.x, a.x * b.y + a.y * b.x, a.y * b.y); }

// Returns the product up to the second order.
Polynomial product(Polynomial a, Polynomial b) {
  return Polynomial(a.constant * b.constant, a.constant * b.slope + b.constant * a.slope,
                    a.constant * b.bend + b.constant * a.bend + product(a.slope, b.slope));
}

// Returns (1 + p)^exponent up to the second order, for p without a constant.
Polynomial power(Polynomial p, float exponent) {
  return Polynomial(1.0, exponent * p.slope,
                    exponent * p.bend + 0.5 * exponent * (exponent - 1.0) * product(p.slope, p.slope));
}

// Returns axis . (d' x n) = n . (axis x d').
Polynomial chord_middle(vec3 axis, Rays rays) {
  vec3 a_0 = cross(axis, rays.d_0), a_1 = cross(axis, rays.d_1), a_2 = cross(axis, rays.d_2);
  return Polynomial(dot(rays.n_0, a_0),
                    vec2(dot(rays.n_0, a_1) + dot(rays.n_1, a_0), dot(rays.n_0, a_2) + dot(rays.n_2, a_0)),
                    vec3(dot(rays.n_1, a_1), dot(rays.n_1, a_2) + dot(rays.n_2, a_1), dot(rays.n_2, a_2)));
}

// The terms of the forms for an ellipse. With g = |d'|^2 / kappa, 1 - b^2 = (1 - s^2) / g.
struct Terms {
  float g, ray;                     // g and |d| in the middle
  Polynomial g_change, ray_change;  // relative change of g and |d|^2 from the middle
  float depth;                      // optical depth at an extinction, |d|, g and 1 - s^2 of 1
  float spread;                     // of the value
  float light, row, column;         // factor on the colour; the mean's row and column in the transfer function's table
  Polynomial shift;                 // times 1 / g: from `column` to the middle of the chord
  vec3 along;                       // linear in s; times sqrt(1 - s^2) / g: from the middle of the chord to its end
  Polynomial cutting;  // the boundary is at cutting / (sqrt(1 - s^2) |towards|), in half chords from the middle
  vec3 towards;        // linear in s; positive if the chord ends at the boundary
};

Terms make_terms(Body body, Value value, Outline outline, Rays rays, float strength) {
  Terms terms;
  float square = dot(rays.d_0, rays.d_0);
  float root_kappa = sqrt(rays.kappa);
  terms.g = square / rays.kappa;
  terms.g_change =
      Polynomial(0.0, 2.0 * vec2(dot(rays.d_0, rays.d_1), dot(rays.d_0, rays.d_2)) / square,
                 vec3(dot(rays.d_1, rays.d_1), 2.0 * dot(rays.d_1, rays.d_2), dot(rays.d_2, rays.d_2)) / square);
  terms.ray = 1.0;
  terms.ray_change = Polynomial(0.0, vec2(0.0), vec3(0.0));
  if (!is_orthographic()) {
    vec2 e_1 = outline.e_1, e_2 = outline.e_2;
    terms.ray = length(vec3(outline.middle, 1.0));
    terms.ray_change = scaled(Polynomial(0.0, 2.0 * vec2(dot(outline.middle, e_1), dot(outline.middle, e_2)),
                                         vec3(dot(e_1, e_1), 2.0 * dot(e_1, e_2), dot(e_2, e_2))),
                              1.0 / (terms.ray * terms.ray));
  }
  terms.depth = strength / root_kappa;

  // Spread and light are those of the middle.
  terms.along = vec3(dot(value.gradient, rays.d_0), dot(value.gradient, rays.d_1), dot(value.gradient, rays.d_2));
  float along = terms.along.x;
  float stretched = body.stretch * dot(body.normal, rays.d_0);
  float spread = sqrt(value.residual + along * (along / (half_axis * half_axis * (square + stretched * stretched))));
  terms.spread = spread;
  float cosine = value.slope > 0.0 ? min(abs(along) / (rays.scale * terms.ray * value.slope), 1.0) : 1.0;
  terms.light = frame.ambient + frame.diffuse * mean_cosine(cosine, value.scatter);
  float columns;
  terms.row = transfer_row(spread, columns);
  terms.column = (value.mean - 0.5) * columns + 0.5 * transfer_columns();
  terms.shift = scaled(chord_middle(value.gradient, rays), columns / rays.kappa);
  terms.along *= columns / root_kappa;

  // Without a boundary: a boundary far beyond the chord's end.
  terms.cutting = Polynomial(1e18, vec2(0.0), vec3(0.0));
  if (body.stretch > 0.0) terms.cutting = scaled(chord_middle(body.normal, rays), -1.0 / root_kappa);
  terms.towards = vec3(dot(body.normal, rays.d_0), dot(body.normal, rays.d_1), dot(body.normal, rays.d_2));
  return terms;
}

void set_middle_form(Terms terms, inout Quad quad) {
  quad.middle_form[0] = vec4(terms.g, terms.g * terms.g_change.slope, terms.depth);
  quad.middle_form[1] = vec4(terms.g * terms.g_change.bend, terms.light);
  quad.middle_form[2] = vec4(terms.shift.constant, terms.shift.slope, terms.row);
  quad.middle_form[3] = vec4(terms.shift.bend, terms.column);
  quad.middle_form[4] = vec4(terms.cutting.constant, terms.cutting.slope, terms.along.x);
  quad.middle_form[5] = vec4(terms.cutting.bend, terms.along.y);
  quad.middle_form[6] = vec4(terms.towards, terms.along.z);
}

// The middle form expanded to the second order: depth is proportional to |d| g^(-5/2). A boundary is expanded to the
// first order; one that contains the line of sight is no sharper than a pixel.
void set_far_form(Terms terms, inout Quad quad) {
  Polynomial depth = scaled(product(power(terms.g_change, -2.5), power(terms.ray_change, 0.5)),
                            terms.depth * terms.ray * pow(terms.g, -2.5));
  Polynomial shift = scaled(product(power(terms.g_change, -1.0), terms.shift), 1.0 / terms.g);
  vec2 by_pixel = vec2(0.0, terms.cutting.slope.y / quad.axes.w);
  by_pixel.x = (terms.cutting.slope.x - by_pixel.y * quad.axes.y) / quad.axes.x;
  float towards = max(max(abs(terms.towards.x), 0.5 * length(by_pixel)), 1e-6);
  vec2 cutting =
      terms.cutting.slope - terms.cutting.constant * terms.towards.x / (towards * towards) * terms.towards.yz;
  quad.far_form[0].xyz = vec3(depth.constant, depth.slope);
  quad.far_form[1] = vec4(depth.bend, terms.light);
  quad.far_form[2] = vec4(terms.column + shift.constant, shift.slope, terms.row);
  quad.far_form[3] = vec4(shift.bend, 0.0);
  quad.far_form[4] = vec4(vec3(terms.cutting.constant, cutting) / towards,
                          terms.along.x / terms.g * (terms.towards.x < 0.0 ? -1.0 : 1.0));
}

// Returns about the largest change within the outline.
float size(Polynomial change) { return length(change.slope) + change.bend.x + change.bend.z; }

// Sets the forms for an ellipse; false if it is too faint. `peak`: the largest extinction in it.
bool set_ellipse_forms(Body body, Value value, Outline outline, Rays rays, float strength, float peak,
                       inout Quad quad) {
  Terms terms = make_terms(body, value, outline, rays, strength);

  // The faint rim is cut, and the rest takes over its light: the divisor is the share of the integral of (1 - s^2)^2
  // that lies in the remaining square.
  float least_g = terms.g * max(1.0 - size(terms.g_change), 0.1);
  float brightest = peak * min(strength / rays.scale * body.longest, terms.depth * terms.ray * pow(least_g, -2.5));
  if (!(brightest > least_depth)) return false;
  float cut = min(sqrt(faintest_depth / brightest), widest_cut);
  quad.reach = sqrt(1.0 - cut);
  terms.depth /= 1.0 - cut * cut * cut * sqrt(cut) * (lost_0 + cut * (lost_1 + cut * lost_2));

  quad.form = max(size(terms.g_change), size(terms.ray_change)) > most_change ? 1u : 0u;
  set_middle_form(terms, quad);
  set_far_form(terms, quad);
  // A splat looks the same in any form: that of its run depends on its neighbours.
  quad.near_form[4].w = -max(terms.spread * terms.spread, 1e-30);
  quad.near_form[6].w = -1.0 - terms.light;
  return true;
}

bool is_finite(Quad quad) {
  float sum = 0.0;
  for (int i = 0; i < near_form_count; ++i) sum += dot(abs(quad.near_form[i]), vec4(1.0));
  return is_finite(sum);
}

// Makes the outline: an ellipse, or a bounding box if the eye's plane cuts the ellipsoid or the ellipse is too large.
// False if the outline lies outside of the picture.
bool make_outline(vec2 half_image, inout Body body, out Outline outline) {
  vec2 reach;
  if (!body.near) {
    make_ellipse(body, outline);
    reach = vec2(outline.e_1.x, abs(outline.e_1.y) + outline.e_2.y);
    body.near = any(greaterThan(reach, 2.0 * largest_outline * half_image));
  }
  if (body.near) {
    make_box(body, half_image, outline);
    reach = vec2(outline.e_1.x, outline.e_2.y);  // not positive if the box is empty
  }
  if (!(all(lessThan(outline.middle - reach, half_image)) && all(greaterThan(outline.middle + reach, -half_image))))
    return false;
  return all(greaterThan(reach, vec2(0.0)));
}

// Empties the quad if surfaces hide all of the splat, and gives it the last form if they may hide a part.
void compare_with_surfaces(vec2 depths, inout Quad quad) {
  vec2 reach = quad.reach * (abs(quad.axes.xy) + abs(quad.axes.zw));
  vec2 range = surface_range(quad.center - reach, quad.center + reach);
  if (depths.x >= range.y)
    quad = empty_quad();
  else if (depths.y > range.x)
    quad.form = 3u;
}

// Projects a splat; false if it draws nothing. Exact sorting orders the splats by `distance_to_eye`. The splat lies
// between two `depths`.
bool project(uint number, out Quad quad, out float distance_to_eye, out vec2 depths) {
  Splat splat = read_splat(number);
  vec3 center = splat.position;
  distance_to_eye = max(is_orthographic() ? center.z : length(center), 0.0);
  if (!(splat.mass > 0.0) || !is_finite(splat.mass) || !is_finite(center) || !is_finite(splat.value)) return false;

  Body body;
  Value value;
  if (!make_body(splat, body, value)) return false;
  depths = body.pixel_size * (body.center.z + length(body.l_z) * vec2(-1.0, 1.0));
  float extent = length(value.gradient) + 4.0 * sqrt(value.residual);
  float peak = peak_extinction(value.mean - extent, value.mean + extent);
  if (!(peak > 0.0)) return false;

  float focal = is_orthographic() ? 1.0 : frame.focal;
  vec2 half_image = 0.5 * frame.image_size / focal;
  Outline outline;
  if (!make_outline(half_image, body, outline)) return false;

  Rays rays = make_rays(body, outline);
  float share = body.stretch > 0.0 ? 2.0 : 1.0;
  float strength = splat.mass / (body.pixel_size * body.pixel_size) * (share * 3.0 / pi) / body.volume * rays.scale;
  strength = min(strength, 1e18);
  quad.center = (outline.middle + half_image) * focal;
  quad.axes = vec4(outline.e_1, outline.e_2) * focal;
  quad.reach = 1.0;
  quad.form = 2u;
  quad.far_form[0].w = 1.0 / (rays.scale * body.pixel_size);
  set_near_form(body, value, rays, strength, quad);
  if (!is_finite(quad)) return false;  // so large or so near that single precision overflows
  if (body.near) return peak * strength / rays.scale * body.longest > least_depth;
  return set_ellipse_forms(body, value, outline, rays, strength, peak, quad);
}
