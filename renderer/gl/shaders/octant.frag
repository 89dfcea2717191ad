flat in vec4 color;
#ifdef SURFACES
flat in float depth;
#endif
noperspective in vec2 offset;
layout(location = 0) out vec4 pixel;

void main() {
#ifdef SURFACES
  if (depth >= surface_depth()) discard;
#endif
  pixel = color * exp2(-dot(offset, offset));
}
