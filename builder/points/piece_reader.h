// The pieces of an input as records.
#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/points/input_summary.h"
#include "builder/points/piece_faces.h"
#include "builder/points/point_ranges.h"
#include "builder/points/point_records.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Reads an input's pieces into records, with the material that each piece gives its points.
class PieceReader {
 public:
  /// `faces`: gets the outer faces of pieces with cells. References must outlive this.
  PieceReader(Source& source, const PointRecords& layout, PieceFaces& faces)
      : source_(source), layout_(layout), faces_(faces), ranges_(source.attributes().size()) {}

  /// Calls visit(records) for each piece, and progress(share of the pieces that are done). Fails if no point is left.
  [[nodiscard]] Status run(const std::function<void(double)>& progress,
                           const std::function<Status(std::span<const std::byte>)>& visit);

  /// Box round the points so far.
  [[nodiscard]] const Box& box() const { return ranges_.box; }

  /// All but the cube.
  [[nodiscard]] InputSummary summary() const;

 private:
  [[nodiscard]] Status read(const Piece& piece);
  [[nodiscard]] std::vector<std::size_t> find_finite(const Piece& piece);
  void make_records(const Piece& piece, std::span<const std::size_t> kept);
  void make_part(const Piece& piece, std::span<const std::size_t> kept, std::byte* record) const;
  void find_ranges(const Piece& piece, std::span<const std::size_t> kept, PointRanges& ranges) const;
  [[nodiscard]] Status add_material(const Piece& piece, std::span<const std::size_t> kept);
  void add_known_material(const PointMaterial& material, std::span<const std::size_t> kept);
  [[nodiscard]] Status add_whole_cells(const Piece& piece, std::span<const std::size_t> kept);
  [[nodiscard]] Status add_cell_material(const Piece& piece, std::span<const std::size_t> kept);
  [[nodiscard]] std::byte* record_of(std::size_t i) { return records_.data() + i * layout_.bytes(); }

  Source& source_;
  PointRecords layout_;
  PieceFaces& faces_;
  std::vector<std::byte> records_;  // of the present piece
  PointRanges ranges_;
  CellCensus cells_;
  PointCensus census_;
  bool has_material_ = false;
};

}  // namespace splatvol
