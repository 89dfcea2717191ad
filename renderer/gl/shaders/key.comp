// Computes each splat's key for sorting back to front: it falls with the distance. A splat that draws nothing gets the
// largest key.
layout(local_size_x = 64) in;
layout(std430, binding = 3) restrict writeonly buffer KeyBlock { uint keys[]; };
layout(location = 0) uniform uint first;
layout(location = 1) uniform uint count;
layout(location = 2) uniform bool by_depth;  // for every splat, seen or not

void main() {
  if (gl_GlobalInvocationID.x >= count) return;
  uint index = first + gl_GlobalInvocationID.x;
  Quad quad;
  float distance_to_eye = by_depth ? position_in_view(index).z : 0.0;
  bool visible = by_depth || project(index, quad, distance_to_eye);
  uint bits = floatBitsToUint(distance_to_eye);
  keys[index] = visible ? (bits >> 31) != 0u ? bits : bits ^ 0x7fffffffu : 0xffffffffu;
}
