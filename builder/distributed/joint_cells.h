// The cells of a mesh whose pieces several ranks read.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "builder/cells/cell_section.h"
#include "builder/cells/mesh_cells.h"
#include "builder/distributed/ranks.h"
#include "builder/output/block_spool.h"
#include "builder/output/index_stream.h"
#include "builder/pipeline/build.h"
#include "builder/sources/source.h"

namespace splatvol {

/// The cells of this rank's pieces; in the end, at rank 0, those of all ranks. Ranks of points go to the rank that read
/// the piece: it translates its cells. Rank 0 sorts the cells of all and writes their section. A cell's bytes depend
/// neither on the numbers of pieces nor on who read them.
class JointCells {
 public:
  /// Returns null as start_cells() does.
  [[nodiscard]] static Result<std::unique_ptr<JointCells>> create(Ranks& ranks, const Source& source,
                                                                  const BuildOptions& options,
                                                                  const std::string& folder);

  /// The number of this rank's first piece, in tags. The pieces of a rank have lower numbers than those of the next.
  [[nodiscard]] std::uint32_t first_piece() const;

  /// Adds the cells of this rank's next piece.
  [[nodiscard]] Status add(const Piece& piece) { return cells_->add(piece); }

  /// Collective: gives rank 0 the cells of all ranks, for build_from_points(). Then cells() is whole there.
  [[nodiscard]] Status give_to_first();
  [[nodiscard]] MeshCells& cells() { return *cells_; }

  /// As MeshCells, for the points of this rank's range, and at rank 0 for the coarser levels too. May run beside each
  /// other.
  [[nodiscard]] Status add_rank(PointTag tag, std::uint64_t rank);
  [[nodiscard]] Status add_stay(std::size_t level, std::uint64_t rank);

  /// Collective: finds the ranks of all corners, and sorts the cells at rank 0.
  [[nodiscard]] Status sort();

  /// Tells of the next index leaf; returns the metadata of the cells; returns what writes them. All at rank 0, after
  /// sort().
  [[nodiscard]] Status add_leaf(const IndexLeaf& leaf);
  [[nodiscard]] format::CellsInfo info() const { return {cells_->hash()}; }
  [[nodiscard]] format::WriteCells writer(const BuildProgress& progress);

  /// Has a value at rank 0, once the file is written.
  [[nodiscard]] const std::optional<CellReport>& report() const { return report_; }

 private:
  JointCells(Ranks& ranks, std::unique_ptr<MeshCells> cells, std::uint64_t memory, const std::string& folder)
      : ranks_(ranks), cells_(std::move(cells)), memory_(memory), folder_(folder), tags_(folder), stays_(folder) {}
  [[nodiscard]] Status send_tags();
  [[nodiscard]] Status send_cells();
  [[nodiscard]] Status send_stays();
  [[nodiscard]] CellSpool::Counts sum_counts();

  Ranks& ranks_;
  std::unique_ptr<MeshCells> cells_;
  std::uint64_t memory_;  // as BuildOptions::memory
  std::string folder_;
  BlockSpool tags_, stays_;
  std::optional<CellReport> report_;
};

}  // namespace splatvol
