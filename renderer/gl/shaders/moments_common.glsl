// Shared by all stages of the kernel `moments`.
const int far_form_count = 5;
const int middle_form_count = 7;
const int near_form_count = 8;
const float half_axis = 3.29089653;  // moments_half_width of base/splat_kernel.h

// The transfer function averaged over normally distributed values: rows by their spread, columns by their mean, up to 4
// spreads beyond the domain (transfer_table.h). Means and spreads are in units of the domain.
layout(binding = 0) uniform sampler1DArray transfer_table;  // r, g, b, extinction

// Returns the row for a spread; `scale` gets the columns that a unit of the mean takes there. A spread beyond the last
// row uses this row on a larger scale.
float transfer_row(float spread, out float scale) {
  ivec2 last = textureSize(transfer_table, 0) - 1;
  int row = int(min(log2(1.0 + 64.0 * spread) / log2(513.0), 1.0) * float(last.y) + 0.5);
  float row_spread = (exp2(float(row) / float(last.y) * log2(513.0)) - 1.0) / 64.0;
  scale = float(last.x) / (1.0 + 8.0 * (row == last.y ? max(spread, row_spread) : row_spread));
  return float(row);
}

float transfer_columns() { return float(textureSize(transfer_table, 0).x - 1); }
