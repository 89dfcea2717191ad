// The cells of all pieces, until the points have their ranks.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/output/block_spool.h"
#include "builder/output/byte_streams.h"
#include "builder/sources/source.h"
#include "format/cell_shapes.h"

namespace splatvol {

struct SpooledCell {
  std::array<std::uint32_t, format::max_cell_corners> corners{};  // points of the piece, or PointCells::corners
  std::uint32_t point = 0;                                        // of the piece: of a constant field
  format::CellSplit split = 0;
  int sign = 0;  // of the volumes of its tetrahedra (format::tetrahedra_of); 0: not all have the same, or one is flat
};

/// Cells of one piece and shape that follow each other, packed.
struct CellBlock {
  std::uint32_t piece = 0;          // pieces count from 0 in the order in which they are read
  std::uint32_t piece_points = 0;   // points of the piece
  std::uint32_t piece_corners = 0;  // PointCells::corners
  format::CellShape shape{};
  format::CellField field{};
  std::span<const std::byte> bytes = {};
};

/// Unpacks a block of CellSpool, but none of polyhedra: get_polyhedron() takes these. Thread-safe.
void unpack(const CellBlock& block, std::vector<SpooledCell>& cells);

/// A queue of cells in a temporary file, which is made when the first MiB is full.
class CellSpool {
 public:
  explicit CellSpool(std::string folder) : spool_(std::move(folder)) {}

  /// Adds the cells of the next piece, which may have none: with a constant field if they are points of their own.
  /// Works on all of TBB's threads.
  [[nodiscard]] Status add(const Piece& piece);

  /// Calls visit(blocks) for all cells, some blocks of one piece at a time, and gives their disk space back. Called
  /// once.
  [[nodiscard]] Status read(const std::function<Status(std::span<const CellBlock>)>& visit);

  /// The number of pieces that were added.
  [[nodiscard]] std::uint32_t pieces() const { return pieces_; }

  /// For cells that another rank has read: numbers pieces from `first` on; calls visit(bytes) as read() does, for
  /// add_packed() elsewhere. Pieces' numbers must ascend there too.
  void number_pieces(std::uint32_t first) { pieces_ = first; }
  [[nodiscard]] Status read_packed(const std::function<Status(std::span<const std::byte>)>& visit) {
    return spool_.read(visit);
  }
  [[nodiscard]] Status add_packed(std::span<const std::byte> bytes) { return spool_.append(bytes); }

  /// [shape]: the number of cells that were added. Whoever adds packed ones adds theirs.
  using Counts = std::array<std::uint64_t, 8>;
  [[nodiscard]] const Counts& counts() const { return counts_; }
  void set_counts(const Counts& counts) { counts_ = counts; }

  /// The number of cells of a shape that were added.
  [[nodiscard]] std::uint64_t count(format::CellShape shape) const { return counts_[static_cast<std::size_t>(shape)]; }

 private:
  [[nodiscard]] Status append_blocks(std::size_t count,
                                     const std::function<void(std::size_t, std::vector<std::byte>&)>& pack);

  BlockSpool spool_;
  std::uint32_t pieces_ = 0;
  Counts counts_{};
};

}  // namespace splatvol
