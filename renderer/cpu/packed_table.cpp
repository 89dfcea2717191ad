#include "renderer/cpu/packed_table.h"

#include <algorithm>
#include <cmath>

namespace splatvol::tiles {
namespace {

int level_columns(int columns, int level) { return ((columns - 1) >> level) + 1; }
int plane_of(int columns, int level) { return level_columns(columns, level) + 2 * table_margin; }

/// The error of `guess`, relative to what can be seen: clear material counts as a little opaque.
float relative_error(const vec4& entry, const vec4& guess, float peak) {
  const float by_size = 1 / (entry.a + 0.02F * peak);
  const vec4 away = glm::abs(entry - guess);
  return (away.a + std::max({away.r, away.g, away.b}) * entry.a) * by_size;
}

}  // namespace

PackedTable::PackedTable(const TransferTable& table)
    : columns_(static_cast<int>(table.columns)), rows_(static_cast<int>(table.rows)) {
  for (int level = 0; level < TableView::level_count; ++level)
    if (level == 0 || (columns_ - 1) % (1 << level) == 0) set_level(table, level);
  for (std::size_t row = 0; row < table.rows; ++row) row_spreads_.push_back(static_cast<float>(table.spread(row)));
  set_errors(table);
}

void PackedTable::set_level(const TransferTable& table, int level) {
  const int plane = plane_of(columns_, level), last = level_columns(columns_, level) - 1;
  std::vector<float>& entries = levels_[static_cast<std::size_t>(level)];
  entries.resize(std::size_t{4} * plane * rows_);
  for (int row = 0; row < rows_; ++row)
    for (int channel = 0; channel < 4; ++channel) {
      float* to = entries.data() + (std::size_t{4} * row + channel) * plane;
      for (int i = 0; i < plane; ++i) {
        const int column = std::clamp(i - table_margin, 0, last) << level;
        to[i] = table.entries[static_cast<std::size_t>(row) * columns_ + column][channel];
      }
    }
}

void PackedTable::set_errors(const TransferTable& table) {
  float peak = 1e-30F;
  for (const vec4& entry : table.entries) peak = std::max(peak, entry.a);
  blocks_ = (columns_ - 1) / TableView::columns_per_block + 1;
  errors_.assign(static_cast<std::size_t>(rows_) * blocks_ * TableView::level_count, 0);
  for (int row = 0; row < rows_; ++row)
    for (int column = 0; column < columns_; ++column) {
      const vec4* entries = table.entries.data() + static_cast<std::size_t>(row) * columns_;
      for (int level = 1; level < TableView::level_count; ++level) {
        const int step = 1 << level, left = column & -step, right = std::min(left + step, columns_ - 1);
        const float share = static_cast<float>(column - left) / static_cast<float>(step);
        const vec4 guess = entries[left] + share * (entries[right] - entries[left]);
        float& error = errors_[(static_cast<std::size_t>(row) * blocks_ + column / TableView::columns_per_block) *
                                   TableView::level_count +
                               level];
        error = std::max(error, relative_error(entries[column], guess, peak));
      }
    }
}

TableView PackedTable::view() const {
  TableView view;
  view.columns = columns_;
  view.rows = rows_;
  for (int level = 0; level < TableView::level_count; ++level)
    view.levels[static_cast<std::size_t>(level)] = {levels_[static_cast<std::size_t>(level)].data() + table_margin,
                                                    plane_of(columns_, level)};
  view.row_spreads = row_spreads_.data();
  view.errors = errors_.data();
  view.blocks = blocks_;
  return view;
}

std::uint64_t PackedTable::memory_bytes() const {
  std::uint64_t numbers = row_spreads_.capacity() + errors_.capacity();
  for (const std::vector<float>& level : levels_) numbers += level.capacity();
  return sizeof(float) * numbers;
}

}  // namespace splatvol::tiles
