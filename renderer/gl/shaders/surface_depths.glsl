// For the fragment shaders with opaque surfaces.
layout(binding = 3) uniform sampler2D surface_depths;

// Returns the depth of the surface in the pixel.
float surface_depth() { return texelFetch(surface_depths, ivec2(gl_FragCoord.xy), 0).r; }
