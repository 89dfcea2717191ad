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
  float value_start;  // t of value_low
} frame;

const int table_margin = 16;  // TransferTable::margin
const float largest_t_deviation = 1e16, farthest_t = 3e17;  // common.h

// Returns t of a stored value.
float axis_position(float stored) {
  float x = stored;
  if (frame.value_axis == 1.0) {
    x -= frame.value_zero;
    if (!(x > 0.0)) return -1.0;
    x = log(x);
  } else if (frame.value_axis == 2.0) {
    x = (x - frame.value_zero) * frame.value_unit;
    float size = min(abs(x), 1e38);
    x = sign(x) * (size > 1e4 ? log(2.0 * size) : log(size + sqrt(size * size + 1.0)));
  }
  return frame.value_start + (x - frame.value_low) * frame.inverse_domain;
}

// Returns mean and deviation of t of normally distributed stored values: TransferFunction::moments_of.
vec2 axis_moments(float mean, float deviation) {
  if (frame.value_axis == 0.0) {
    float from_low = mean - frame.value_low;
    float factor = min(frame.inverse_domain, largest_t_deviation / max(deviation, 1e-22));
    return vec2(frame.value_start + clamp(from_low * factor, -farthest_t, farthest_t), deviation * factor);
  }
  float t = axis_position(mean);
  if (frame.value_axis == 1.0) {
    float x = mean - frame.value_zero;
    if (!(x > 0.0)) return vec2(-1.0, 0.0);
    float share = min(deviation / x, 1e9);
    float variance = log(1.0 + share * share);
    if (share < 0.01) variance = share * share;
    return vec2(t - 0.5 * variance * frame.inverse_domain, sqrt(variance) * frame.inverse_domain);
  }
  float low = axis_position(mean - 1.73205081 * deviation), high = axis_position(mean + 1.73205081 * deviation);
  float average = (low + 4.0 * t + high) / 6.0;
  vec3 away = vec3(low, t, high) - average;
  return vec2(average, sqrt(dot(away * away, vec3(1.0, 4.0, 1.0)) / 6.0));
}

vec3 rotate_to_view(vec3 direction) {
  return vec3(dot(frame.rotation[0].xyz, direction), dot(frame.rotation[1].xyz, direction),
              dot(frame.rotation[2].xyz, direction));
}
