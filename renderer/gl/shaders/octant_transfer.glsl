layout(binding = 0) uniform sampler1DArray transfer_table;  // one row: r, g, b, extinction

// Interpolates in the shader: a texture unit's weights have only eight bits, and its coordinate misses the entries a
// little.
vec4 transfer(float value) {
  int last = textureSize(transfer_table, 0).x - 1;
  float column = clamp(axis_position(value_axis(), value), -1.0, 2.0) * float(last - 2 * table_margin) + float(table_margin);
  column = clamp(column, 0.0, float(last));
  int left = min(int(column), last - 1);
  return mix(texelFetch(transfer_table, ivec2(left, 0), 0), texelFetch(transfer_table, ivec2(left + 1, 0), 0),
             column - float(left));
}
