// The ellipsoid is well in front of the eye, or the projection orthographic: its outline is the ellipse |s| = 1.
noperspective in vec2 s;
flat in vec4 form[far_form_count];
layout(location = 0) out vec4 pixel;

void main() {
  float g = form[0].x + s.x * (form[0].y + form[0].w * s.x + form[1].x * s.y) + s.y * (form[0].z + form[1].y * s.y);
  float v = form[2].x + s.x * (form[2].y + form[2].w * s.x + form[3].x * s.y) + s.y * (form[2].z + form[3].y * s.y);
  float r = 1.0 / g;
  float q = max(1.0 - dot(s, s), 0.0) * r;
  float depth = form[1].z * sqrt(ray_length_squared() * r) * q * q;
  vec4 material = transfer(form[3].z + v * r, int(form[3].w));
  float alpha = opacity(depth * material.a);
  pixel = vec4(material.rgb * (alpha * form[1].w), alpha);
}
