// The far form: for an ellipsoid that is far away, or in orthographic projection, polynomials of s are exact enough.
vec4 draw_far(vec2 s, vec4 form[far_form_count]) {
  float w = max(1.0 - dot(s, s), 1e-12);
  float inverse_root = inversesqrt(w);
  vec2 part = part_of_chord((form[4].x + dot(form[4].yz, s)) * inverse_root);
  float depth = at_s(s, form[0].x, form[0].yz, form[1].xyz) * w * w * part.x;
  float column = at_s(s, form[2].x, form[2].yz, form[3].xyz) + form[4].w * w * inverse_root * part.y;
  vec4 material = transfer(column, form[2].w);
  float alpha = opacity(depth * material.a);
  return vec4(material.rgb * (alpha * form[1].w), alpha);
}
