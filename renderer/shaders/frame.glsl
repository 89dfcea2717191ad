// The frame's constants, for every program. Comes first in each shader.
#version 450 core

// View coordinates: x to the right, y up, z forwards, in world units, the eye at the origin. Pixels count from the
// lower left corner.
layout(std140, binding = 0) uniform FrameBlock {
  vec4 rotation[3];      // rows: from world directions to view coordinates
  vec2 image_size;       // pixels
  float focal;           // pixels (perspective), or pixels per world unit (orthographic)
  float orthographic;    // 1 or 0
  float value_low;       // the beginning of the transfer function's domain
  float inverse_domain;  // 1 / (high - low)
  float ambient;         // factor on colours: ambient + diffuse * cosine; 1 and 0 without a light
  float diffuse;
} frame;

vec3 rotate_to_view(vec3 direction) {
  return vec3(dot(frame.rotation[0].xyz, direction), dot(frame.rotation[1].xyz, direction),
              dot(frame.rotation[2].xyz, direction));
}
