// The eye's plane does not cut the ellipsoid: its outline is the ellipse |s| = 1.
noperspective in vec2 s;
flat in vec4 form[middle_form_count];
layout(location = 0) out vec4 pixel;

void main() {
  // |d'|^2 / kappa, and how far the middle of the chord is along the gradient, times this, in columns.
  float g = at_s(s, form[0].x, form[0].yz, form[1].xyz);
  float along = at_s(s, form[2].x, form[2].yz, form[3].xyz);
  float r = 1.0 / g;
  float q = max(1.0 - dot(s, s), 0.0) * r;
  float depth = form[0].w * sqrt(ray_length_squared() * r) * q * q;
  vec4 material = transfer(form[3].w + along * r, form[2].w);
  float alpha = opacity(depth * material.a);
  pixel = vec4(material.rgb * (alpha * form[1].w), alpha);
}
