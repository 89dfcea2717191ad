// Projects a run of splats, in the order in which they are drawn.
layout(local_size_x = 64) in;
layout(std430, binding = 2) restrict readonly buffer OrderBlock { uint order[]; };
layout(location = 0) uniform uint first;
layout(location = 1) uniform uint count;
layout(location = 2) uniform bool ordered;

void main() {
  uint i = gl_GlobalInvocationID.x;
  if (i >= count) return;
  Quad quad;
  float distance_to_eye;
  bool visible = project(ordered ? order[first + i] : first + i, quad, distance_to_eye);
  if (!visible) quad = empty_quad;
  quads[i] = quad;
}
