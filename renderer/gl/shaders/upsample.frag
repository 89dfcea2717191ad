// Interpolates pixels between samples along one axis, by the cubics of Catmull and Rom.
#version 450 core

layout(binding = 2) uniform sampler2D samples;
layout(location = 0) uniform int axis;
layout(location = 1) uniform float spacing;      // of the samples along the axis, pixels
layout(location = 2) uniform float half_extent;  // of the picture along the axis, pixels
layout(location = 0) out vec4 pixel;

void main() {
  ivec2 texel = ivec2(gl_FragCoord.xy);
  ivec2 extent = textureSize(samples, 0);
  float at = (gl_FragCoord[axis] - half_extent) / spacing + 0.5 * float(extent[axis]) - 0.5;
  float floor_at = floor(at);
  float f = at - floor_at;
  vec4 weights = 0.5 * vec4(f * (-1.0 + f * (2.0 - f)), 2.0 + f * f * (-5.0 + 3.0 * f),
                            f * (1.0 + f * (4.0 - 3.0 * f)), f * f * (f - 1.0));
  vec4 sum = vec4(0.0);
  for (int k = 0; k < 4; ++k) {
    texel[axis] = clamp(int(floor_at) + k - 1, 0, extent[axis] - 1);
    sum += weights[k] * texelFetch(samples, texel, 0);
  }
  float alpha = clamp(sum.a, 0.0, 1.0);
  pixel = vec4(clamp(sum.rgb, vec3(0.0), vec3(alpha)), alpha);
}
