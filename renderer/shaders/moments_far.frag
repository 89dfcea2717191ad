// The ellipsoid is so far away that polynomials of s will do.
noperspective in vec2 s;
flat in vec4 form[far_form_count];
layout(location = 0) out vec4 pixel;

void main() {
  float q = max(1.0 - dot(s, s), 0.0);
  float depth = at_s(s, form[0].x, form[0].yz, form[1].xyz) * q * q;
  vec4 material = transfer(at_s(s, form[2].x, form[2].yz, form[3].xyz), form[2].w);
  float alpha = opacity(depth * material.a);
  pixel = vec4(material.rgb * (alpha * form[1].w), alpha);
}
