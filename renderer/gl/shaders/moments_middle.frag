// The middle form: the eye's plane does not cut the ellipsoid, so its outline is the ellipse |s| = 1.
noperspective in vec2 s;
flat in vec4 form[middle_form_count];
layout(location = 0) out vec4 pixel;

void main() {
  float r = 1.0 / at_s(s, form[0].x, form[0].yz, form[1].xyz);  // kappa / |d'|^2
  float w = max(1.0 - dot(s, s), 0.0);

  // The boundary cuts the chord: the sign of `towards` says which side counts.
  float towards = form[6].x + dot(form[6].yz, s);
  vec2 part =
      part_of_chord(at_s(s, form[4].x, form[4].yz, form[5].xyz) * inversesqrt(max(w * towards * towards, 1e-24)));

  // The value in the middle of the chord and its change along it, in columns.
  float along = (form[4].w + form[5].w * s.x + form[6].w * s.y) * sqrt(w) * part.y;
  float column = form[3].w + (at_s(s, form[2].x, form[2].yz, form[3].xyz) + (towards < 0.0 ? -along : along)) * r;
  vec4 material = transfer(column, form[2].w);

  float q = w * r;  // 1 - b^2
  float alpha = opacity(form[0].w * sqrt(ray_length_squared() * r) * q * q * part.x * material.a);
  pixel = vec4(material.rgb * (alpha * form[1].w), alpha);
}
