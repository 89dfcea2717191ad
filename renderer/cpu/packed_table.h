// The transfer function's table as the tiles read it. Internal to the tiles.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "renderer/cpu/frame.h"
#include "renderer/transfer_table.h"

namespace splatvol::tiles {

/// A transfer table in planes, with coarser levels and their errors.
class PackedTable {
 public:
  PackedTable() = default;
  explicit PackedTable(const TransferTable& table);

  /// Returns a view of this table; valid until it changes.
  [[nodiscard]] TableView view() const;

  [[nodiscard]] std::uint64_t memory_bytes() const;

 private:
  void set_level(const TransferTable& table, int level);
  void set_errors(const TransferTable& table);

  int columns_ = 0, rows_ = 0, blocks_ = 0;
  std::array<std::vector<float>, TableView::level_count> levels_;
  std::vector<float> row_spreads_, errors_;
};

}  // namespace splatvol::tiles
