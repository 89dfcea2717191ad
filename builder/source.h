// Where points come from: any input as a stream of pieces, so that a partitioned mesh is never whole in memory.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/boundary.h"
#include "builder/moments.h"

namespace splatvol {

/// What the cells of an input were, counted; shown to the user after a build.
struct CellCensus {
  std::map<std::string, std::uint64_t> cells;  // by type name: "tetrahedron", "hexahedron", "polyhedron", ...
  std::uint64_t tetrahedra = 0;                // after splitting
  std::uint64_t inverted = 0;                  // tetrahedra with negative volume as their cell orders them
  std::uint64_t flat = 0;                      // tetrahedra with volume exactly 0
  std::uint64_t without_volume = 0;   // vertices, lines and surface cells: their points are kept, they fill nothing
  std::uint64_t hidden = 0;           // blanked cells, and ghost copies of cells that another piece owns
  std::uint64_t non_finite = 0;       // cells left out: a corner's position is not finite
  std::uint64_t not_star_shaped = 0;  // cells that no vertex sees whole: split with some inverted tetrahedra

  CellCensus& operator+=(const CellCensus& other);
};

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

struct SourceOptions {
  std::vector<std::string> selection;  // attributes to read; empty: all point data
  std::vector<std::string> columns;    // names of the columns of .npy files; empty: theirs, or the default
  std::optional<double> time = {};     // the step nearest to it is read; nothing: the last
};

/// Opens an input by what is in it: VTK files (.vtu, .pvtu, .vts, .vtr, .vti, .vtp, legacy .vtk), several of which are
/// pieces of one data set; .npy files, several of which are one point set (builder/npy_source.h); a PLOT3D grid and its
/// solution as two paths in this order; OpenVDB files (builder/vdb_source.h); or "gen:..." for one that is made up
/// (builder/generator.h). Exodus, EnSight, OpenFOAM and CGNS files count as VTK's and are told by their extensions;
/// their blocks are pieces (builder/vtk_blocks.h). A folder is an OpenFOAM case, or stands for the files in it that can
/// be read by their extensions, in the order of their names, numbers in these by size; pieces that a .pvtu names are
/// read once.
///
/// Cells become tetrahedra (builder/tetrahedra.h). Hidden cells and ghost copies are left out, with the points that
/// only they use. String arrays, ghost flags and ids are no attributes. Values that are not finite become NaN;
/// positions that are not finite stay, but no tetrahedron uses them.
///
/// Fails where a file is missing, damaged, of a kind or version that cannot be read right, has no point data, or lacks
/// a selected attribute (the message lists those that are there), and where columns are named, or a time is, of files
/// that have none.
/// Safe on untrusted files as far as VTK's and OpenVDB's readers are.
[[nodiscard]] Result<std::unique_ptr<Source>> open_source(const std::vector<std::string>& inputs,
                                                          const SourceOptions& options);

}  // namespace splatvol
