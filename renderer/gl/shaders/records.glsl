// Drawing records as splat/record.h lays them out, in one page of the device's memory. A splat's number is 32 times
// the number of its entry, plus its index in the entry.
const uint records_of_entry = 32u;

// Consecutive records of a range.
struct Entry {
  uint first;           // record in its page
  uint count_and_page;  // count | page << 6
  uint range;
};

// Records with one origin and the same scales.
struct Range {
  vec3 origin;            // view coordinates
  float step;             // of positions, drawing units
  float mass_scale;       // of log codes, drawing units
  float deviation_scale;  //
  float value_scale;      // of log codes, stored values
  float opacity_scale;    // the same of the opacity values
};

layout(std430, binding = 0) restrict readonly buffer ShapeBlock { uint shape_words[]; };
layout(std430, binding = 1) restrict readonly buffer ValueBlock { uint value_words[]; };
layout(std430, binding = 6) restrict readonly buffer EntryBlock { Entry entries[]; };
layout(std430, binding = 7) restrict readonly buffer RangeBlock { Range ranges[]; };

layout(location = 6) uniform uint opacity_offset;             // word of value_words; 0: there is no opacity
layout(binding = 5) uniform sampler1DArray opacity_table;  // mean factors, as transfer_table of moments_common.glsl

bool is_in_entry(uint number) {
  return number % records_of_entry < (entries[number / records_of_entry].count_and_page & 63u);
}
uint page_of(uint number) { return entries[number / records_of_entry].count_and_page >> 6; }
uint record_of(uint number) { return entries[number / records_of_entry].first + number % records_of_entry; }
Range range_of(uint number) { return ranges[entries[number / records_of_entry].range]; }

// Returns the number of a log code. Its factor is squared, because single precision holds its root only.
float log_number(uint code, float scale) {
  float root = exp2((float(code) - 65535.0) / 256.0);
  return code == 0u ? 0.0 : scale * root * root;
}

// Returns where a record is, in view coordinates. `at`: its first word.
vec3 position_of(uint at, Range range) {
  uint low = shape_words[at], high = shape_words[at + 1u];
  ivec3 biased = ivec3(low & 0x1fffffu, (low >> 21) | ((high & 0x3ffu) << 11), (high >> 10) & 0x1fffffu);
  return range.origin + rotate_to_view(range.step * vec3(biased - 1048576));
}

// Returns the factor on a splat's extinction: the mean over its values of the opacity attribute.
float opacity_factor(uint number) {
  if (opacity_offset == 0u) return 1.0;
  uint at = opacity_offset + 2u * record_of(number), codes = value_words[at + 1u];
  float mean = uintBitsToFloat(value_words[at]);
  if ((value_words[at] & 0x7f800000u) == 0x7f800000u) return 0.0;  // no number
  Axis axis = Axis(frame.opacity_kind, frame.opacity_low, frame.opacity_start, frame.opacity_inverse_domain,
                   frame.opacity_zero, frame.opacity_unit);
  vec2 t = axis_moments(axis, mean, log_number(codes & 0xffffu, range_of(number).opacity_scale));
  ivec2 last = textureSize(opacity_table, 0) - 1;
  float scale;
  int row = int(table_row(t.y, last, scale));
  float column = clamp((clamp(t.x, -farthest_t, farthest_t) - 0.5) * scale + 0.5 * float(last.x), 0.0, float(last.x));
  int left = min(int(column), last.x - 1);
  float factor = mix(texelFetch(opacity_table, ivec2(left, row), 0).r,
                     texelFetch(opacity_table, ivec2(left + 1, row), 0).r, column - float(left));
  return clamp(factor, 0.0, 1.0) * float((codes >> 16) & 0xffu) / 255.0;
}
