// Kinds of decoded parts of a file.
#pragma once

#include <cstdint>
#include <span>

namespace splatvol::format {

/// PartKey::kind. The number is that of the page, of the row, of the group, or the offset of the chunk or index page.
enum PartKind : int {
  directory_page,
  index_root,
  index_page,
  row_shapes,
  row_values,
  rank_page,
  vertex_page,
  group_positions,
  group_values,
  cell_page,
  cell_chunk,
  cell_gradients,
  contour_gradients,
  field_chunk
};

/// PartKey::column of a part that is made of several columns or attributes, at most three, in this order. Their numbers
/// are below 2^18 (max_attributes); -1: none.
[[nodiscard]] inline std::int64_t columns_key(std::span<const int> columns) {
  std::int64_t key = 0;
  for (const int column : columns) key = key << 20 | (column + 1);
  return key;
}

}  // namespace splatvol::format
