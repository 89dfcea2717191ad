// Inputs as streams of pieces: a partitioned mesh is never whole in memory.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/triangle_mesh.h"
#include "builder/mesh/boundary.h"
#include "builder/mesh/cell_census.h"
#include "builder/mesh/moments.h"
#include "builder/mesh/usable_numbers.h"
#include "builder/mesh/whole_cell.h"

namespace splatvol {

/// Most points in a piece of an input that has no pieces of its own.
inline constexpr std::size_t max_piece_points = std::size_t{1} << 18;

/// The material of points, from a source that knows it. The planes are as boundary_planes finds them, or none at all.
struct PointMaterial {
  std::vector<SpatialMoments> moments;                   // [point]
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute][point]
  std::vector<std::vector<dvec3>> gradients;             // [attribute][point], of any length; 0: no gradient
  std::vector<BoundaryPlane> planes;                     // [point]
};

/// Cells that are points of their own: each point stands for one cell, with one value in all of it.
struct PointCells {
  static constexpr std::uint32_t no_point = std::numeric_limits<std::uint32_t>::max();
  std::vector<dvec3> corners;           // of the mesh
  std::vector<Tetrahedron> tetrahedra;  // indices into corners, any orientation
  std::vector<std::uint32_t> points;    // [tetrahedron]: the point of its cell; no_point: a cell without volume
  std::vector<SpatialMoments> moments;  // [point], about the point's position
};

/// The values of a piece, where its reader has them: without a copy, and in their own type.
class LentValues {
 public:
  virtual ~LentValues() = default;

  /// Gets an attribute's values at some points of the piece, one for each; NaN: missing. Thread-safe.
  virtual void get(std::size_t attribute, std::span<const std::uint32_t> points, std::span<double> values) const = 0;

  /// Bytes held besides the reader's own arrays.
  [[nodiscard]] virtual std::uint64_t bytes() const { return 0; }
};

/// Names a point of a piece. Pieces count from 0 in the order in which they are read.
using PointTag = std::uint64_t;
[[nodiscard]] constexpr PointTag point_tag(std::uint32_t piece, std::uint32_t point) {
  return std::uint64_t{piece} << 32 | point;
}

/// A part of the input that is small enough to hold in memory.
struct Piece {
  std::uint64_t block = 0;  // of the input: its number (BlockNumbers) is the same in all files and steps; 0: none
  std::vector<dvec3> points;
  std::vector<std::vector<double>> values;               // [attribute][point]; NaN: missing
  std::shared_ptr<const LentValues> lent;                // instead of values; only after Source::lend_values()
  std::vector<std::array<std::uint32_t, 4>> tetrahedra;  // indices into points, any orientation
  std::vector<WholeCell> whole_cells;     // in the order of their tetrahedra; only after Source::tell_whole_cells()
  std::optional<PointMaterial> material;  // instead of tetrahedra; only if Source::brings_material()
  std::optional<PointCells> cells;        // instead of tetrahedra
  std::vector<std::uint64_t> fills;       // [attribute]: finite numbers that stood for none; may be empty
  std::vector<Patch> patches;             // of the boundary, if SourceOptions::patches asks for them
  CellCensus census;
};

/// Stands for a value that is not there.
inline constexpr double missing_value = std::numeric_limits<double>::quiet_NaN();

/// Tells values from missing ones. A number is missing if it is not finite, beyond `largest_value`, a plain fill value,
/// or one that the user names.
class MissingValues {
 public:
  MissingValues() = default;
  /// A number of `given` stands for itself and for its nearest number in single precision.
  explicit MissingValues(const std::vector<double>& given);

  [[nodiscard]] bool has(double value) const {
    return !(std::abs(value) <= largest_value) || is_fill_value(value) ||
           (!given_.empty() && std::ranges::find(given_, value) != given_.end());
  }

  /// Replaces the missing ones by `missing_value`. Returns how many of them were finite.
  std::uint64_t replace(std::span<double> values) const;

 private:
  std::vector<double> given_;
};

/// One of the time steps that an input holds.
struct TimeStep {
  double time = 0;
  std::size_t index = 0;
  std::vector<double> times = {};  // of all steps of the input
};

/// Which points of cells at one position are copies of a vertex. Copies become one point, with the material of all.
enum class VertexCopies {
  same_values,  // those with the same values
  same_place,   // all, if each attribute has a value at all of them or at none
  same_block,   // of these, those of one block
  none
};

/// A stream of pieces. Not thread-safe.
class Source {
 public:
  virtual ~Source() = default;

  /// The attributes of every piece, in the order of Piece::values. A vector U gives "U" (its magnitude), then "U[0]",
  /// "U[1]", ... With a selection, only the selected ones, in the order of the selection.
  [[nodiscard]] virtual const std::vector<std::string>& attributes() const = 0;

  /// The unit of each attribute, in the order of attributes(): "m/s", or empty if the input does not tell.
  [[nodiscard]] virtual std::vector<std::string> units() const { return std::vector<std::string>(attributes().size()); }

  /// The number of components of the vector whose magnitude each attribute is, in the order of attributes(). 1: it is
  /// no magnitude, but a number or a component.
  [[nodiscard]] virtual std::vector<int> components() const { return std::vector<int>(attributes().size(), 1); }

  /// Allows the pieces to lend their values. Not all sources do so.
  virtual void lend_values() {}

  /// Lets the pieces tell which of their tetrahedra make up a cell. Not all sources do so.
  virtual void tell_whole_cells() {}

  /// Number of pieces, for progress. A file that is not open yet counts as one piece.
  [[nodiscard]] virtual std::size_t piece_count() const = 0;

  /// Returns the next piece, a null pointer after the last. The order does not depend on threads.
  [[nodiscard]] virtual Result<std::unique_ptr<Piece>> next() = 0;

  /// Returns the sizes of the parts that can be read by themselves, pieces or whole files, as far as they are known:
  /// in any unit, or 0. None if the source has to read all of the input anyway.
  [[nodiscard]] virtual std::vector<std::uint64_t> part_sizes() { return {}; }

  /// Lets next() return only the pieces of these parts: the others are read elsewhere. Called before the first next().
  /// Requires ascending numbers of parts that part_sizes() returns.
  [[nodiscard]] virtual Status select(const std::vector<std::uint64_t>& /*parts*/) { return {}; }

  /// The place of the last piece in the order of the input, whatever is selected: its file, and its number there.
  struct PieceNumber {
    std::uint32_t file = 0, in_file = 0;
    auto operator<=>(const PieceNumber&) const = default;
  };
  [[nodiscard]] virtual PieceNumber piece_number() const { return {}; }

  /// Finds the smallest box round all points with finite coordinates, in a pass that is much cheaper than next() over
  /// all pieces. Empty if there is no such pass, or no such point. Does not move next().
  [[nodiscard]] virtual Result<std::optional<Box>> bounds() { return std::optional<Box>(); }

  /// Number of points; empty if only reading all pieces would tell.
  [[nodiscard]] virtual std::optional<std::uint64_t> point_count() const { return std::nullopt; }

  /// The time step of the pieces; empty if the input has no time steps.
  [[nodiscard]] virtual std::optional<TimeStep> time_step() const { return std::nullopt; }

  /// The time of the pieces, if the input states one.
  [[nodiscard]] virtual std::optional<double> stated_time() const {
    const auto step = time_step();
    return step ? std::optional(step->time) : std::nullopt;
  }

  /// The attributes of the pieces so far that are not as in the input: "density: of cells, averaged to points".
  [[nodiscard]] virtual std::vector<std::string> conversions() const { return {}; }

  /// Number of cells of blocks that were left out so far, because they are surfaces and no patches.
  [[nodiscard]] virtual std::uint64_t left_out_cells() const { return 0; }

  /// Whether values of cells are averaged in each piece by itself, so that copies of a vertex differ from piece to
  /// piece.
  [[nodiscard]] virtual bool averages_by_piece() const { return false; }

  [[nodiscard]] virtual VertexCopies copies() const { return VertexCopies::same_values; }

  /// Whether a piece may have tetrahedra or bring its material.
  [[nodiscard]] virtual bool may_have_cells() const { return true; }

  /// Whether every piece brings its material.
  [[nodiscard]] virtual bool brings_material() const { return false; }

  /// Whether single precision holds every coordinate and value exactly.
  [[nodiscard]] virtual bool single_precision() const { return false; }
};

/// The points that a mesh gives.
enum class CellValues {
  averaged,  // the points of the mesh. Arrays of cells become means of the cells round each point
  own,       // the cells, each with one value. Arrays of points become means over each cell
};

/// The part of an input to read, and the names of its columns.
struct SourceOptions {
  std::vector<std::string> selection = {};  // attributes to read; empty: all
  std::vector<std::string> columns = {};  // names of the columns of .npy files; empty: the file's names, or the default
  std::optional<double> time = {};        // the step nearest to it is read; empty: the last
  CellValues cells = CellValues::averaged;
  std::vector<double> missing = {};  // values that stand for none, besides the plain fill values
  bool patches = false;              // pieces bring the patches that the input names
  bool may_lack = false;             // values of selected attributes that are not there are missing
  bool may_round = false;            // coordinates of OpenFOAM lose noise in their last bits (PointRounding)
  bool displacements = true;         // of Exodus: they move the points
};

/// Opens an input. Contract as open_source (builder/opening/open_source.h).
using OpenSource = std::function<Result<std::unique_ptr<Source>>(const std::vector<std::string>& inputs,
                                                                 const SourceOptions& options)>;

}  // namespace splatvol
