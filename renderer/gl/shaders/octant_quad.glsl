// A splat of the kernel `octant` on the screen: a rectangle of whole pixels, and its position on the Gaussian. Lengths
// are in half widths at half maximum, so that alpha falls as 2^-(distance^2).
struct Quad {
  vec4 color;    // premultiplied, at the centre
  vec2 corner;   // from the splat's centre to the rectangle's lower left corner
  float pixel;   // size of a pixel
  uint columns;  // the first | the one after the last << 16
  uint rows;
  float depth;  // of its centre
};

layout(std430, binding = 4) restrict buffer QuadBlock { Quad quads[]; };

uint form_of(Quad quad) { return 0u; }

Quad empty_quad() { return Quad(vec4(0.0), vec2(0.0), 0.0, 0u, 0u, 0.0); }
