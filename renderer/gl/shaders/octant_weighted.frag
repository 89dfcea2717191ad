// Draws a part `weight` of the splat's optical depth: alpha becomes 1 - (1 - alpha)^weight.
flat in vec4 color;
flat in float weight;
#ifdef SURFACES
flat in float depth;
#endif
noperspective in vec2 offset;
layout(location = 0) out vec4 pixel;

void main() {
#ifdef SURFACES
  if (depth >= surface_depth()) discard;
#endif
  float fall = exp2(-dot(offset, offset));
  float alpha = color.a * fall;
  float rest = 1.0 - weight;
  // The share of alpha that is drawn; by the binomial series where the subtraction would cancel.
  float share = alpha < 0.01 ? weight * (1.0 + alpha * rest / 2.0 * (1.0 + alpha * (1.0 + rest) / 3.0))
                             : (1.0 - pow(1.0 - alpha, weight)) / alpha;
  pixel = color * (fall * share);
}
