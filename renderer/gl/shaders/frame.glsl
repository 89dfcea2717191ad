// The frame's constants, for every program. Comes first in each shader.
#version 450 core

// View coordinates: x to the right, y up, z forwards, in world units, the eye at the origin. Pixels count from the
// lower left corner.
layout(std140, binding = 0) uniform FrameBlock {
  vec4 rotation[3];      // rows: from world directions to view coordinates
  vec2 image_size;       // pixels
  float focal;           // pixels (perspective), or pixels per world unit (orthographic)
  float orthographic;    // 1 or 0
  float value_low;       // the beginning of the transfer function's domain, on its axis
  float inverse_domain;  // 1 / (high - low), on the axis
  float ambient;         // factor on colours: ambient + diffuse * cosine; 1 and 0 without a light
  float diffuse;
  float value_axis;  // 0: the stored value x itself; 1: log(x - value_zero); 2: asinh((x - value_zero) * value_unit)
  float value_zero;  // the stored value of 0
  float value_unit;
  float value_start;     // t of value_low
  float opacity_low;     // the same of the opacity's function
  float opacity_inverse_domain;
  float opacity_kind;
  float opacity_zero;
  float opacity_unit;
  float opacity_start;
} frame;

// The axis of a function of stored values.
struct Axis {
  float kind, low, start, inverse_domain, zero, unit;
};

Axis value_axis() {
  return Axis(frame.value_axis, frame.value_low, frame.value_start, frame.inverse_domain, frame.value_zero,
              frame.value_unit);
}

const int table_margin = 16;  // TransferTable::margin
@SPLAT_CONSTANTS@
// Returns t of a stored value.
float axis_position(Axis axis, float stored) {
  float x = stored;
  if (axis.kind == 1.0) {
    x -= axis.zero;
    if (!(x > 0.0)) return -1.0;
    x = log(x);
  } else if (axis.kind == 2.0) {
    x = (x - axis.zero) * axis.unit;
    float size = min(abs(x), 1e38);
    x = sign(x) * (size > 1e4 ? log(2.0 * size) : log(size + sqrt(size * size + 1.0)));
  }
  return axis.start + (x - axis.low) * axis.inverse_domain;
}

// Returns mean and deviation of t of normally distributed stored values: TransferFunction::moments_of.
vec2 axis_moments(Axis axis, float mean, float deviation) {
  if (axis.kind == 0.0) {
    float from_low = mean - axis.low;
    float factor = min(axis.inverse_domain, largest_t_deviation / max(deviation, 1e-22));
    return vec2(axis.start + clamp(from_low * factor, -farthest_t, farthest_t), deviation * factor);
  }
  float t = axis_position(axis, mean);
  if (axis.kind == 1.0) {
    float x = mean - axis.zero;
    if (!(x > 0.0)) return vec2(-1.0, 0.0);
    float share = min(deviation / x, 1e9);
    float variance = log(1.0 + share * share);
    if (share < 0.01) variance = share * share;
    return vec2(t - 0.5 * variance * axis.inverse_domain, sqrt(variance) * axis.inverse_domain);
  }
  float low = axis_position(axis, mean - 1.73205081 * deviation);
  float high = axis_position(axis, mean + 1.73205081 * deviation);
  float average = (low + 4.0 * t + high) / 6.0;
  vec3 away = vec3(low, t, high) - average;
  return vec2(average, sqrt(dot(away * away, vec3(1.0, 4.0, 1.0)) / 6.0));
}

// Returns the row of a table of averages (transfer_table.h) for a spread; `scale` gets the columns that a unit of the
// mean takes there. A spread beyond the last row uses this row on a larger scale. `last`: column and row of the table.
float table_row(float spread, ivec2 last, out float scale) {
  int row = int(min(log2(1.0 + 64.0 * spread) / log2(513.0), 1.0) * float(last.y) + 0.5);
  float row_spread = (exp2(float(row) / float(last.y) * log2(513.0)) - 1.0) / 64.0;
  scale = float(last.x - 2 * table_margin) / (1.0 + 8.0 * (row == last.y ? max(spread, row_spread) : row_spread));
  return float(row);
}

vec3 rotate_to_view(vec3 direction) {
  return vec3(dot(frame.rotation[0].xyz, direction), dot(frame.rotation[1].xyz, direction),
              dot(frame.rotation[2].xyz, direction));
}
