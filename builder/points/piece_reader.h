// The pieces of an input as records.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
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
        slice_bytes_(std::min(memory, std::size_t{1} << 23) / 2),
        watch_(std::move(watch)),
        facts_(source.attributes().size()) {}

  /// Gets the records of some points.
  using Visit = std::function<Status(std::span<const std::byte>)>;

  /// Calls visit(records) for the points of each piece, some at a time, and progress(share of the points that are done,
  /// if all pieces are alike). If the input turns out to be one piece, calls only(box round its points) before the
  /// records; `only` may be empty. Fails if no point is left.
  [[nodiscard]] Status run(const std::function<void(double)>& progress, const std::function<Status(const Box&)>& only,
                           const Visit& visit);

  /// Calls visit(records) for the points of one piece, some at a time. For callers that choose the pieces themselves.
  /// `progress` gets the share of the piece that is done; it may be empty.
  [[nodiscard]] Status read(const Piece& piece, const Visit& visit, const std::function<void(double)>& progress = {});

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
  // Lists that the records of a piece are made of.
  struct Prepared {
    std::vector<std::uint32_t> kept;  // points
    bool has_mesh = false;            // the points have their material from tetrahedra
    VertexMaterial mesh;
    std::vector<double> heights;   // [point]: least_heights
    Box box, in_cells_box;         // round the points that are kept, and those of them that cells use
    std::uint64_t in_no_cell = 0;  // points that are kept

    [[nodiscard]] bool in_cells(const Piece& piece, std::size_t point) const {
      return piece.cells || (has_mesh && !mesh.incident()[point].empty());
    }
  };

  // Some points of a piece, and the values that decide on their material. Values are never those of the whole piece.
  struct Block {
    std::span<const std::uint32_t> points;
    VertexBlock vertices;  // of the mesh: the points, and then their neighbours
    ValueTable values;     // [vertex of the block, or point]
  };

  // The values of some records.
  struct ValueFacts {
    PointRanges ranges, in_cells;
    std::vector<format::PartsHash> hashes;  // [attribute]

    explicit ValueFacts(std::size_t attributes) : ranges(attributes), in_cells(attributes), hashes(attributes) {}
  };

  [[nodiscard]] bool may_be_joined(std::size_t attribute, const JoinedAttributes& joined) const;
  [[nodiscard]] double deviation_of(const Piece& piece) const;
  [[nodiscard]] Status prepare(const Piece& piece);
  [[nodiscard]] Status read_prepared(const Piece& piece, const Visit& visit,
                                     const std::function<void(double)>& progress);
  [[nodiscard]] std::vector<ValueFacts> make_records(const Piece& piece, std::span<const std::uint32_t> slice,
                                                     std::vector<std::byte>& records);
  void include(const ValueFacts& values);
  void load_values(const Piece& piece, Block& block) const;
  void make_block(const Piece& piece, const Block& block, std::byte* record) const;
  void find_facts(const Piece& piece, const Block& block, ValueFacts& facts) const;
  void set_mesh_material(const Piece& piece, const Block& block, std::byte* record) const;
  void set_known_material(const Piece& piece, std::size_t point, std::byte* record) const;
  void set_whole_cell(const Piece& piece, const Block& block, std::size_t number, std::byte* record) const;
  [[nodiscard]] Status add_faces(const Piece& piece, bool has_mesh, std::span<const OuterFace> outer);
  [[nodiscard]] bool has_cells() const { return facts_.in_cells.box.low.x <= facts_.in_cells.box.high.x; }

  Source& source_;
  PointRecords layout_;
  PieceFaces& faces_;
  std::size_t slice_bytes_;
  WatchPiece watch_;
  std::uint32_t piece_ = 0;                        // number of the present piece
  Prepared prepared_;                              // for it
  std::array<std::vector<std::byte>, 2> records_;  // some of it: the ones that are visited, and the next ones
  tbb::enumerable_thread_specific<Block> blocks_;
  InputFacts facts_;
};

}  // namespace splatvol
