// Shared by all stages of the kernel `moments`.
const int far_form_count = 5;
const int middle_form_count = 7;
const int near_form_count = 8;

// The transfer function averaged over normally distributed values: rows by their spread, columns by their mean, up to 4
// spreads beyond the domain (transfer_table.h). Means and spreads are in units of the domain.
layout(binding = 0) uniform sampler1DArray transfer_table;  // r, g, b, extinction

// Returns the row for a spread, as table_row.
float transfer_row(float spread, out float scale) {
  return table_row(spread, textureSize(transfer_table, 0) - 1, scale);
}

float transfer_columns() { return float(textureSize(transfer_table, 0).x - 1); }

// Returns the scatter of a splat's gradients. `unexplained`: the variance of the value that a linear field leaves;
// `explained`: the rest.
float scatter_of(float unexplained, float explained) {
  return min(unexplained / max(1.5 * explained, 1e-30), 1e6);
}

// Returns the mean |cos| with the line of sight of gradients that scatter round their mean. `cosine`: the mean gradient's.
float mean_cosine(float cosine, float scatter) {
  float across = sqrt(scatter * scatter_across);
  return pow(cosine * cosine * cosine + across * across * across, 1.0 / 3.0) / sqrt(1.0 + scatter_length * scatter);
}
