// The pieces of an input as records.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/material_box.h"
#include "builder/mesh/moments.h"
#include "builder/points/input_summary.h"
#include "builder/points/piece_faces.h"
#include "builder/points/point_ranges.h"
#include "builder/points/point_records.h"
#include "builder/sources/source.h"
#include "format/codec.h"

namespace splatvol {

/// Facts of all pieces of an input, or of some.
struct InputFacts {
  PointRanges ranges;
  PointRanges in_cells;                   // of the points that cells use; at the end, of all that are not left out
  std::vector<std::uint64_t> fills;       // [attribute]
  std::vector<format::PartsHash> values;  // [attribute]: hash of the values of all points, in the order of the input
  bool brings_value_moments = false;      // which could differ where values are equal
  CellCensus cells;
  PointCensus census;
  bool has_material = false;
  std::uint64_t most_piece_bytes = 0;
  double deviation = 0;  // the largest of material that points bring along

  explicit InputFacts(std::size_t attributes)
      : ranges(attributes), in_cells(attributes), fills(attributes), values(attributes) {}
};

/// Reads an input's pieces into records, with the material that each piece gives its points.
class PieceReader {
 public:
  /// `faces`: gets the outer faces of pieces with cells. References must outlive this. `memory`: bytes to hold beside
  /// the piece and its mesh (VertexMaterial), at least some records. `watch`: for run(); may be empty.
  PieceReader(Source& source, const PointRecords& layout, PieceFaces& faces, std::size_t memory, WatchPiece watch = {})
      : source_(source),
        layout_(layout),
        faces_(faces),
        slice_bytes_(std::min(memory, std::size_t{1} << 23)),
        watch_(std::move(watch)),
        facts_(source.attributes().size()) {}

  /// Calls visit(records) for the points of each piece, some at a time, and progress(share of the points that are done,
  /// if all pieces are alike). If the input turns out to be one piece, calls only(box round its points) before the
  /// records; `only` may be empty. Fails if no point is left.
  [[nodiscard]] Status run(const std::function<void(double)>& progress, const std::function<Status(const Box&)>& only,
                           const std::function<Status(std::span<const std::byte>)>& visit);

  /// Calls visit(records) for the points of one piece, some at a time. For callers that choose the pieces themselves.
  /// `progress` gets the share of the piece that is done; it may be empty.
  [[nodiscard]] Status read(Piece& piece, const std::function<Status(std::span<const std::byte>)>& visit,
                            const std::function<void(double)>& progress = {});

  /// Numbers the pieces from `first` on, in tags. Without this, from 0.
  void number_pieces(std::uint32_t first) { piece_ = first; }

  /// Counts what the source has left out. Call it after the last piece.
  void count_left_out() { facts_.cells.left_out += source_.left_out_cells(); }

  /// Fails if no point is left.
  [[nodiscard]] Status check_any() const;

  /// The facts of the pieces so far. Whoever reads the other pieces elsewhere adds theirs.
  [[nodiscard]] const InputFacts& facts() const { return facts_; }
  void set_facts(InputFacts facts) { facts_ = std::move(facts); }

  /// Box round the points so far: if there are cells, round those in cells. Large enough for the material that points
  /// bring along.
  [[nodiscard]] Box box() const {
    return grown_for_material(has_cells() ? facts_.in_cells.box : facts_.ranges.box, facts_.deviation);
  }

  /// Whether a record's point is to be left out: no cell uses it, though there are cells, and it lies outside of `box`.
  /// It owns nothing, and should not widen the cube. Call it for all records once these have been read: counts those
  /// left out, and takes the values of the others into the ranges.
  [[nodiscard]] bool leave_out(const std::byte* record);

  /// All but the cube. Of attributes with the same values and unit, only the first is listed, unless they are to be
  /// kept apart.
  [[nodiscard]] InputSummary summary(const JoinedAttributes& joined) const;

 private:
  // The mesh of the present piece, if its points have their material from tetrahedra.
  struct PieceMaterial {
    std::vector<bool> used;       // [point]: by a tetrahedron
    std::vector<double> heights;  // [point]: least_heights
    std::optional<VertexMaterial> mesh;

    [[nodiscard]] bool in_cells(const Piece& piece, std::size_t point) const {
      return piece.cells || (!used.empty() && used[point]);
    }
  };

  // Some points of a piece, and the values that decide on their material. Values are never those of the whole piece.
  struct Block {
    std::span<const std::uint32_t> points;
    VertexBlock vertices;            // of the mesh: the points, and then their neighbours
    ValueTable values;               // [vertex of the block, or point]
    std::vector<double> column;      // scratch: of an attribute
    std::vector<VertexValue> found;  // scratch: of a point
  };

  [[nodiscard]] bool may_be_joined(std::size_t attribute, const JoinedAttributes& joined) const;
  [[nodiscard]] std::vector<std::uint32_t> find_finite(const Piece& piece);
  [[nodiscard]] Box box_of(const Piece& piece) const;
  [[nodiscard]] double deviation_of(const Piece& piece) const;
  [[nodiscard]] PieceMaterial prepare_material(const Piece& piece, std::span<const std::uint32_t> kept);
  void make_records(const Piece& piece, const PieceMaterial& material, std::span<const std::uint32_t> slice);
  void load_values(const Piece& piece, const PieceMaterial& material, Block& block) const;
  void make_block(const Piece& piece, const PieceMaterial& material, Block& block, std::byte* record) const;
  void hash_block(Block& block, std::span<format::PartsHash> hashes) const;
  void find_ranges(const Piece& piece, const Block& block, PointRanges& ranges) const;
  void find_ranges_in_cells(const Piece& piece, const PieceMaterial& material, const Block& block,
                            PointRanges& ranges) const;
  void set_material(const Piece& piece, const PieceMaterial& material, Block& block, std::size_t number,
                    std::byte* record) const;
  void set_known_material(const Piece& piece, std::size_t point, std::byte* record) const;
  void set_whole_cell(const Piece& piece, const Block& block, std::size_t number, std::byte* record) const;
  [[nodiscard]] Status add_faces(const Piece& piece, bool has_mesh);
  [[nodiscard]] bool has_cells() const { return facts_.in_cells.box.low.x <= facts_.in_cells.box.high.x; }

  Source& source_;
  PointRecords layout_;
  PieceFaces& faces_;
  std::size_t slice_bytes_;
  WatchPiece watch_;
  std::uint32_t piece_ = 0;         // number of the present piece
  std::vector<std::byte> records_;  // some of it
  tbb::enumerable_thread_specific<Block> blocks_;
  InputFacts facts_;
};

}  // namespace splatvol
