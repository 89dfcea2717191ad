// The pieces of an input as records.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/moments.h"
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

  /// Calls visit(records) for the points of each piece, some at a time, and progress(share of the pieces that are
  /// done). If the input turns out to be one piece, calls only(box round its points) before the records; `only` may be
  /// empty. Fails if no point is left.
  [[nodiscard]] Status run(const std::function<void(double)>& progress, const std::function<Status(const Box&)>& only,
                           const std::function<Status(std::span<const std::byte>)>& visit);

  /// Box round the points so far.
  [[nodiscard]] const Box& box() const { return ranges_.box; }

  /// All but the cube.
  [[nodiscard]] InputSummary summary() const;

 private:
  // The values and the mesh of the present piece, if its points have their material from tetrahedra.
  struct PieceMaterial {
    std::vector<bool> used;  // [point]: by a tetrahedron
    std::optional<ValueTable> values;
    std::optional<VertexMaterial> mesh;

    [[nodiscard]] double value(const Piece& piece, std::size_t attribute, std::size_t point) const {
      return values ? values->at(point, attribute) : piece.values[attribute][point];
    }
  };

  [[nodiscard]] Status read(Piece& piece, const std::function<Status(std::span<const std::byte>)>& visit);
  [[nodiscard]] std::vector<std::size_t> find_finite(const Piece& piece);
  [[nodiscard]] PieceMaterial prepare_material(Piece& piece, std::span<const std::size_t> kept);
  void make_records(const Piece& piece, const PieceMaterial& material, std::span<const std::size_t> slice);
  void make_part(const Piece& piece, const PieceMaterial& material, std::span<const std::size_t> part,
                 std::byte* record) const;
  void find_ranges(const Piece& piece, const PieceMaterial& material, std::span<const std::size_t> part,
                   PointRanges& ranges) const;
  void set_material(const Piece& piece, const PieceMaterial& material, std::size_t point, std::span<VertexValue> values,
                    std::byte* record) const;
  void set_known_material(const PointMaterial& material, std::size_t point, std::byte* record) const;
  void set_whole_cell(const Piece& piece, std::size_t point, std::byte* record) const;
  void set_vertex_material(const PieceMaterial& material, std::size_t point, std::span<VertexValue> values,
                           std::byte* record) const;
  [[nodiscard]] Status add_faces(const Piece& piece, const PieceMaterial& material);

  Source& source_;
  PointRecords layout_;
  PieceFaces& faces_;
  std::vector<std::byte> records_;  // some of the present piece
  PointRanges ranges_;
  CellCensus cells_;
  PointCensus census_;
  bool has_material_ = false;
};

}  // namespace splatvol
