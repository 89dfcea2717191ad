// Where points come from: any input as a stream of pieces, so that a partitioned mesh is never whole in memory.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/boundary.h"
#include "builder/mesh/cell_census.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// Most points in a piece of an input that is not partitioned by itself.
inline constexpr std::size_t max_piece_points = std::size_t{1} << 18;

/// What points stand for, where their source knows it; planes as boundary_planes finds them, or none at all.
struct PointMaterial {
  std::vector<SpatialMoments> moments;                   // [point]
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute][point]
  std::vector<std::vector<dvec3>> gradients;             // [attribute][point], of any length; 0: none
  std::vector<BoundaryPlane> planes;                     // [point]
};

/// A part of the input, small enough to hold.
struct Piece {
  std::vector<dvec3> points;
  std::vector<std::vector<double>> values;               // [attribute][point]; NaN: missing
  std::vector<std::array<std::uint32_t, 4>> tetrahedra;  // indices into points, any orientation
  std::optional<PointMaterial> material;                 // instead of tetrahedra; only where Source::brings_material()
  CellCensus census;
};

/// One of the moments that an input holds.
struct TimeStep {
  double time = 0;
  std::size_t index = 0;
  std::size_t count = 1;  // of the input's steps
};

/// A stream of pieces. Not thread-safe.
class Source {
 public:
  virtual ~Source() = default;

  /// The scalars of every piece, in the order of Piece::values. A vector U gives "U" (its magnitude), then "U[0]",
  /// "U[1]", ...; with a selection, only those that were asked for, in the order of asking.
  [[nodiscard]] virtual const std::vector<std::string>& attributes() const = 0;

  /// Pieces in all, for progress; a file of several that is not open yet counts as one.
  [[nodiscard]] virtual std::size_t piece_count() const = 0;

  /// The next piece, in an order that does not depend on threads; an empty pointer after the last.
  [[nodiscard]] virtual Result<std::unique_ptr<Piece>> next() = 0;

  /// The smallest box round all points whose coordinates are finite, by a pass of its own that is much cheaper than
  /// next() over all pieces; nothing where there is no such pass, or no such point. Does not move next().
  [[nodiscard]] virtual Result<std::optional<Box>> bounds() { return std::optional<Box>(); }

  /// Points in all; nothing where only reading tells.
  [[nodiscard]] virtual std::optional<std::uint64_t> point_count() const { return std::nullopt; }

  /// The step that the pieces are of; nothing where the input has no time.
  [[nodiscard]] virtual std::optional<TimeStep> time_step() const { return std::nullopt; }

  /// Whether a piece may have tetrahedra or bring its material.
  [[nodiscard]] virtual bool may_have_cells() const { return true; }

  /// Whether every piece brings its material.
  [[nodiscard]] virtual bool brings_material() const { return false; }

  /// Whether single precision holds every coordinate and value exactly.
  [[nodiscard]] virtual bool single_precision() const { return false; }
};

/// What to read of an input.
struct SourceOptions {
  std::vector<std::string> selection;  // attributes to read; empty: all point data
  std::vector<std::string> columns;    // names of the columns of .npy files; empty: theirs, or the default
  std::optional<double> time = {};     // the step nearest to it is read; nothing: the last
};

}  // namespace splatvol
