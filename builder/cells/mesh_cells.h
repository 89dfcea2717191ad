// The cells of a mesh on their way into a file: out of memory, and in the order of the ranks of their corners.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/cells/cell_sort.h"
#include "builder/cells/cell_spool.h"
#include "builder/cells/ranked_spool.h"
#include "builder/cells/tag_sort.h"
#include "builder/cells/vertex_sort.h"
#include "builder/mesh/ranked_tetrahedron.h"
#include "builder/output/block_spool.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Collects cells, and what a build finds out about their corners. The rank of a point is its number among all points
/// of the file in Morton order. add_rank() and add_joined() may run beside add_stay(); nothing else is thread-safe.
class MeshCells {
 public:
  /// `memory`: bytes to hold, before sort() an eighth of them; as much again for corners of cells of their own.
  /// `folder`: for what memory cannot hold. `exact`: whether these corners are stored as they are given.
  [[nodiscard]] static Result<std::unique_ptr<MeshCells>> create(std::uint64_t memory, const std::string& folder,
                                                                 bool exact);

  /// Adds the cells of the next piece. Pieces come in PieceReader's order.
  [[nodiscard]] Status add(const Piece& piece);

  /// Adds tetrahedra that join the points of an input without cells, in any order.
  [[nodiscard]] Status add_joined(std::span<const RankedTetrahedron> tetrahedra);

  /// Tells the rank of the point that a point of a piece has become.
  [[nodiscard]] Status add_rank(PointTag tag, std::uint64_t rank);

  /// Tells that a level besides level 0 has a point, and no coarser level. Called for each level with ascending ranks.
  [[nodiscard]] Status add_stay(std::size_t level, std::uint64_t rank);

  /// Finds the ranks of all corners, and sorts the cells. Called once, after the last point. Two corners of a
  /// cell may have become one point. Then those of its tetrahedra are kept that have a volume.
  [[nodiscard]] Status sort();

  /// Finds the ranks of all corners, for hash() alone. Called instead of sort().
  [[nodiscard]] Status hash_only();

  /// The cells of pieces, for ranks that do sort() together. Each calls number_corners(), then translate() for the
  /// cells that it has read, once it was told their ranks. One of them sorts what take(shape, records) gets on all. All
  /// of their ranks are below the sum of rank_end().
  [[nodiscard]] CellSpool& spool() { return spool_; }
  using TakeRecords = std::function<Status(format::CellShape, std::span<const CellWord>)>;
  [[nodiscard]] Status number_corners();
  [[nodiscard]] std::uint64_t rank_end() const { return rank_end_; }
  void set_rank_end(std::uint64_t rank_end) { rank_end_ = rank_end; }
  [[nodiscard]] Status translate(const TakeRecords& take);
  [[nodiscard]] Status start_sorts(const CellSpool::Counts& counts);
  [[nodiscard]] Status add_records(format::CellShape shape, std::span<const CellWord> records) {
    return sort_of(shape)->add(records);
  }
  [[nodiscard]] Status finish_sorts();
  void set_sums(std::uint64_t collapsed, std::uint64_t hash) {
    collapsed_ = collapsed;
    hash_ = hash;
  }

  /// Tells the number of points of the next index leaf. Requires sort().
  [[nodiscard]] Status add_leaf(std::uint64_t points);

  /// Cells to write, tetrahedra that were left out, and a hash of the cells to write, which does not depend on their
  /// order. Require sort(); the hash, or hash_only().
  [[nodiscard]] std::uint64_t count() const;
  [[nodiscard]] std::uint64_t collapsed() const { return collapsed_; }
  [[nodiscard]] std::uint64_t hash() const { return hash_; }

  /// Replaces `cells` by those of the next chunk: those whose lowest corner is in one index leaf, or in a few if they
  /// are few. Chunks of one shape follow each other. Returns false after the last. Requires all leaves.
  [[nodiscard]] Result<bool> next_chunk(SortedCells& cells);

  /// Corners of cells of their own; null if the cells are not such. Require sort().
  [[nodiscard]] const VertexSort* vertices() const { return vertices_.get(); }

  /// Replaces `segments` by those of the next points, [rank], at most `count`. `levels`: of all points.
  [[nodiscard]] Status next_segments(std::size_t count, std::size_t levels, std::vector<std::uint8_t>& segments);

 private:
  // Numbers that are read once, in the order in which they were added.
  class NumberQueue {
   public:
    explicit NumberQueue(std::string folder) : spool_(std::move(folder)) {}
    [[nodiscard]] Status add(std::uint64_t number) { return spool_.append(std::as_bytes(std::span(&number, 1))); }
    /// Returns the next number, none after the last.
    [[nodiscard]] Result<std::optional<std::uint64_t>> next();

   private:
    BlockSpool spool_;
    std::span<const std::byte> left_;
  };

  // Cells of one shape, cut into index leaves.
  struct OfShape {
    CellSort sort;
    NumberQueue leaves;          // points of each
    std::uint64_t leaf_end = 0;  // rank, of the present one
    SortedCells leaf_cells;      // of one index leaf, not yet returned
  };

  MeshCells(TagSort tags, std::uint64_t memory, const std::string& folder, bool exact)
      : memory_(memory), folder_(folder), exact_(exact), spool_(folder), joined_(folder), tags_(std::move(tags)) {}
  [[nodiscard]] CellSort* sort_of(format::CellShape shape);
  [[nodiscard]] Status load_ranks(const CellBlock& block);
  [[nodiscard]] Status add_ranked(std::span<const CellBlock> blocks, const TakeRecords& take);
  [[nodiscard]] Status add_joined_to(const TakeRecords& take);
  [[nodiscard]] static Status gather_leaf(OfShape& of_shape);
  [[nodiscard]] static Result<bool> next_chunk(OfShape& of_shape, SortedCells& cells);

  std::uint64_t memory_;
  std::string folder_;
  bool exact_;
  CellSpool spool_;
  RankedSpool joined_;
  std::uint64_t collapsed_ = 0;
  std::uint64_t hash_ = 0;
  std::uint64_t rank_end_ = 0;  // all ranks, and numbers of vertices, are below it

  TagSort tags_;
  std::unique_ptr<VertexSort> vertices_;  // null: no piece has had cells of their own
  std::optional<std::uint32_t> piece_;    // the present one
  std::vector<std::uint64_t> ranks_;      // [point of it]
  std::vector<std::uint64_t> numbers_;    // [corner of its cells of their own]

  std::vector<std::unique_ptr<NumberQueue>> stays_;       // [level], from 1 on
  std::vector<std::optional<std::uint64_t>> next_stays_;  // [level]
  std::uint64_t next_rank_ = 0;                           // of next_segments()

  std::vector<std::unique_ptr<OfShape>> shapes_;  // those that there may be cells of
  std::size_t next_shape_ = 0;                    // of next_chunk()
};

}  // namespace splatvol
