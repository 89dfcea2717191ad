// Compares splats with opaque surfaces (renderer/depth_pyramid.h).
layout(binding = 4) uniform sampler2D surface_ranges;  // level k: nearest and farthest in cells of 4 * 2^k pixels
layout(location = 5) uniform int surface_levels;       // 0: there are no surfaces

// Returns the nearest and the farthest surface in cells round the pixels from `low` to `high`: at most two of them
// along an axis. The numbers are positions in the picture, in pixels.
vec2 surface_range(vec2 low, vec2 high) {
  ivec2 first = ivec2(clamp(low, vec2(0.0), frame.image_size - 1.0));
  ivec2 last = ivec2(clamp(high, vec2(0.0), frame.image_size - 1.0));
  int extent = max(last.x - first.x, last.y - first.y);  // of pixels, less 1
  int level = clamp(findMSB(extent) - 1, 0, surface_levels - 1);
  first >>= level + 2;
  last >>= level + 2;
  vec2 range = vec2(1.0, -1.0) * uintBitsToFloat(0x7f800000u);
  for (int y = first.y; y <= last.y; ++y)
    for (int x = first.x; x <= last.x; ++x) {
      vec2 cell = texelFetch(surface_ranges, ivec2(x, y), level).rg;
      range = vec2(min(range.x, cell.x), max(range.y, cell.y));
    }
  return range;
}
