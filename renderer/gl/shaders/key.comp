// Computes each splat's key for sorting back to front: it falls with the distance. A splat that draws nothing gets the
// largest key.
layout(local_size_x = 64) in;
layout(std430, binding = 2) restrict readonly buffer PageBlock { uint entries_of_page[]; };
layout(std430, binding = 3) restrict writeonly buffer KeyBlock { uint keys[]; };
layout(location = 0) uniform uint first;     // of entries_of_page
layout(location = 1) uniform uint count;     // keys
layout(location = 2) uniform bool by_depth;  // for every splat, seen or not

void main() {
  uint i = gl_GlobalInvocationID.x;
  if (i >= count) return;
  uint number = entries_of_page[first + i / records_of_entry] * records_of_entry + i % records_of_entry;
  uint key = 0xffffffffu;
  if (is_in_entry(number)) {
    Quad quad;
    float distance_to_eye = by_depth ? position_in_view(number).z : 0.0;
    vec2 depths;
    if (by_depth || project(number, quad, distance_to_eye, depths)) {
      uint bits = floatBitsToUint(distance_to_eye);
      key = (bits >> 31) != 0u ? bits : bits ^ 0x7fffffffu;
    }
  }
  keys[i] = key;
}
