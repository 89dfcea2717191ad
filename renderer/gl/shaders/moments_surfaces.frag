// Draws each splat in the form that it needs, and ends it at surfaces if they may hide a part of it. A run with such
// splats has whole ones too, which are to look as without surfaces.
noperspective in vec2 s;
flat in uint index;
layout(location = 0) out vec4 pixel;

// Returns s at the pixel's centre. OpenGL rounds the corners of quads to 1/256 of a pixel. Along a needle that leads
// away from the eye, this is a long way.
vec2 exact_s() {
  vec2 away = gl_FragCoord.xy - quads[index].center;
  vec4 axes = quads[index].axes;
  float x = away.x / axes.x;
  return vec2(x, (away.y - x * axes.y) / axes.w);
}

void main() {
  if (quads[index].form == 0u)
    pixel = draw_far(s, quads[index].far_form);
  else if (quads[index].form == 3u)
    pixel = draw_near(exact_s(), quads[index].near_form, surface_depth() * quads[index].far_form[0].w);
  else
    pixel = draw_near(s, quads[index].near_form, 1e30);
}
