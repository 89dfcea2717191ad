// Shared by all stages of the kernel `moments`.
const int far_form_count = 5;
const int middle_form_count = 7;
const int near_form_count = 8;
const float half_axis = 3.29089653;  // moments_half_width of splat/kernel.h

// The transfer function averaged over normally distributed values: rows by their spread, columns by their mean, up to 4
// spreads beyond the domain (transfer_table.h). Means and spreads are in units of the domain.
layout(binding = 0) uniform sampler1DArray transfer_table;  // r, g, b, extinction

// Returns the row for a spread, as table_row.
float transfer_row(float spread, out float scale) {
  return table_row(spread, textureSize(transfer_table, 0) - 1, scale);
}

float transfer_columns() { return float(textureSize(transfer_table, 0).x - 1); }

// Returns the variance of the gradients in a splat, along an axis, over the square of their mean. `unexplained`: the
// variance of the value that a linear field leaves; `explained`: the rest. If a normally distributed material has a
// field x^T H x / 2, the first is tr((H S)^2) / 2; the gradients' variance is tr(H S H) / 3 along an axis.
float scatter_of(float unexplained, float explained) {
  return min(unexplained / max(1.5 * explained, 1e-30), 1e6);
}

// Returns the mean |cos| with the line of sight of gradients that scatter normally round their mean. `cosine`: the mean
// gradient's. Exact for a scatter of 0 or infinity, and where the mean lies across the line of sight.
float mean_cosine(float cosine, float scatter) {
  float across = sqrt(scatter * 0.636619772);  // 2 / pi
  return pow(cosine * cosine * cosine + across * across * across, 1.0 / 3.0) / sqrt(1.0 + 2.54647909 * scatter);
}
