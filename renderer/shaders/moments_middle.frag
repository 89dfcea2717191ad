// The eye's plane does not cut the ellipsoid: its outline is the ellipse |s| = 1.
noperspective in vec2 s;
flat in vec4 form[middle_form_count];
layout(location = 0) out vec4 pixel;

void main() {
  // |d'|^2 / kappa; what the boundary leaves of the chord; how far its middle is along the gradient, in columns.
  float r = 1.0 / at_s(s, form[0].x, form[0].yz, form[1].xyz);
  float w = max(1.0 - dot(s, s), 1e-12);
  float towards = form[6].x + dot(form[6].yz, s);
  vec2 part = part_of_chord(at_s(s, form[4].x, form[4].yz, form[5].xyz) * inversesqrt(w) / max(abs(towards), 1e-12));
  float along = (form[4].w + form[5].w * s.x + form[6].w * s.y) * sqrt(w) * part.y * (towards < 0.0 ? -1.0 : 1.0);
  float column = form[3].w + (at_s(s, form[2].x, form[2].yz, form[3].xyz) + along) * r;

  float q = w * r;
  float depth = form[0].w * sqrt(ray_length_squared() * r) * q * q * part.x;
  vec4 material = transfer(column, form[2].w);
  float alpha = opacity(depth * material.a);
  pixel = vec4(material.rgb * (alpha * form[1].w), alpha);
}
