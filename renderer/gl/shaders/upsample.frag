// Interpolates pixels between samples along one axis, by cubics that do not overshoot (renderer/cpu/samples.cpp).
#version 450 core

layout(binding = 2) uniform sampler2D samples;
layout(location = 0) uniform int axis;
layout(location = 1) uniform float spacing;      // of the samples along the axis, pixels
layout(location = 2) uniform float half_extent;  // of the picture along the axis, pixels
layout(location = 0) out vec4 pixel;

// The slope at a sample between two differences.
vec4 slope_between(vec4 before, vec4 after) {
  vec4 mean = 0.5 * (before + after);
  vec4 rise = min(mean, 3.0 * min(before, after)), fall = max(mean, 3.0 * max(before, after));
  return mix(vec4(0.0), mix(fall, rise, greaterThan(before, vec4(0.0))), greaterThan(before * after, vec4(0.0)));
}

void main() {
  ivec2 texel = ivec2(gl_FragCoord.xy);
  ivec2 extent = textureSize(samples, 0);
  float at = (gl_FragCoord[axis] - half_extent) / spacing + 0.5 * float(extent[axis]) - 0.5;
  float floor_at = floor(at);
  float f = at - floor_at;
  vec4 near[4];
  for (int k = 0; k < 4; ++k) {
    texel[axis] = clamp(int(floor_at) + k - 1, 0, extent[axis] - 1);
    near[k] = texelFetch(samples, texel, 0);
  }
  vec4 here = near[2] - near[1];
  vec4 first = slope_between(near[1] - near[0], here), last = slope_between(here, near[3] - near[2]);
  vec4 between = near[1] + f * (first + f * (3.0 * here - 2.0 * first - last + f * (first + last - 2.0 * here)));
  float alpha = clamp(between.a, 0.0, 1.0);
  pixel = vec4(clamp(between.rgb, vec3(0.0), vec3(alpha)), alpha);
}
