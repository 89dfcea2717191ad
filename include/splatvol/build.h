// Writes .svol files from arrays in memory. Component `build`: a program that links it is under the GPL, version 3 or
// later, as it holds CGAL's triangulations.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "splatvol/error.h"
#include "splatvol/export.h"

namespace splatvol {

/// Numbers of the caller, in single or double precision. They are read where they lie.
using Numbers = std::variant<std::span<const double>, std::span<const float>>;

/// An array of values at the points, or in the cells.
struct ValueArray {
  std::string name;
  Numbers values;      // [point or cell][component]; NaN: missing
  int components = 1;  // more: a vector. Its magnitude is an attribute `name`, its components are `name[0]`, ...
  std::string unit = {};
};

/// A mesh, or scattered points if it has no cells. Arrays are as in VTK's vtkUnstructuredGrid. Nothing of them needs to
/// be valid: each index is checked.
struct MeshArrays {
  Numbers points = {};                              // [point][x, y, z]
  std::span<const std::int64_t> connectivity = {};  // numbers of points, cell by cell
  std::span<const std::int64_t> offsets = {};       // [cell + 1]: where cells begin in `connectivity`, and its end
  std::span<const std::uint8_t> types = {};         // [cell]: VTK's numbers of cell types, such as 10 for a tetrahedron

  // Of polyhedra (type 42): for each its number of faces, then for each face its number of points and these.
  // `locations` tells where each cell begins in `faces`; -1: no polyhedron. May be empty if there are none.
  std::span<const std::int64_t> faces = {};
  std::span<const std::int64_t> face_locations = {};

  std::vector<ValueArray> point_values = {};
  std::vector<ValueArray> cell_values = {};
};

struct MeshBuildOptions {
  /// Each cell becomes a point, with one value in all of it. Else values of cells are averaged to points.
  bool own_cells = false;

  /// How points are joined: "auto", "mesh", "delaunay", "none" (Voronoi cells), "boxes".
  std::string connectivity = "auto";
  std::string reduction = "octree";  // or "mis", "kdtree": how coarser resolutions are chosen
  std::vector<double> missing = {};  // numbers that stand for values that are not there, such as -9999
  bool exact = false;                // rounds nothing but values, to single precision
  bool strict = false;               // fails if the file would not be the input as it is
  std::uint64_t memory = 0;          // bytes to hold besides the arrays; 0: a quarter of the machine's
  std::string temp_folder = {};      // empty: the output's folder
  char up = 0;                       // 'x', 'y' or 'z': the axis that points upwards in pictures
  std::string name = "arrays";       // of the input, for messages and the file's provenance
  std::function<void(const char* stage, double share)> progress = {};  // share of the stage that is done, in [0, 1]

  /// Most triangles of the mesh's boundary, which the file then holds: all faces that one cell has, for scenes that
  /// draw it (SceneSurface::boundary). Those on a side of the mesh's box are the patches "side x-" to "side z+", and
  /// all others the patches "outer 1", "outer 2", ..., which are not connected, the largest first. "outer" is all of
  /// them. If there are more triangles, they are simplified. 0: none.
  std::uint64_t boundary_triangles = 0;

  /// The file keeps the cells of the mesh, or the Delaunay tetrahedra that join its points, if there are any. By them
  /// pictures are exact (Quality::exact). An append does as its file does.
  bool keep_cells = true;
};

/// What was built.
struct MeshBuildReport {
  std::vector<std::uint64_t> resolution_counts;  // points of each resolution; the last one has all
  std::uint64_t file_bytes = 0;
  std::string connectivity;                                   // that was used
  std::vector<std::pair<std::string, std::uint64_t>> census;  // what was counted or left out, in words
  std::vector<std::string> warnings;
  std::vector<std::string> conversions;  // attributes that are not as in the input
  std::uint64_t kept_cells = 0;          // in the file; of an append 0
};

/// Builds a .svol file, which appears whole or not at all. The same arrays give the same bytes, whatever the memory and
/// the threads. Fails if the arrays do not fit each other, name points that are not there, or hold cells that are not
/// supported (VTK's Lagrange and Bezier cells are not); then the file that was there stays. The message begins with
/// `options.name` or the output. Uses all processors.
[[nodiscard]] SPLATVOL_EXPORT Result<MeshBuildReport> build(const MeshArrays& mesh, const std::string& output,
                                                            const MeshBuildOptions& options = {});

/// A step of a time series: the values at a time. All steps have the same names, with the same components.
struct MeshStep {
  double time = 0;
  std::vector<ValueArray> point_values = {};
  std::vector<ValueArray> cell_values = {};
};

/// Builds a time series: one .svol file, with one mesh and the values of all steps. It appears whole or not at all.
/// Times must be finite and rise. `mesh` must have no values. Without cells, the points are joined once for as many
/// steps as fit into memory together. The report is that of the first of these; warnings and missing values are of all
/// steps. Fails also as `build` does.
[[nodiscard]] SPLATVOL_EXPORT Result<MeshBuildReport> build_series(const MeshArrays& mesh,
                                                                   std::span<const MeshStep> steps,
                                                                   const std::string& output,
                                                                   const MeshBuildOptions& options = {});

/// Appends steps to a time series that was built from the same mesh, with the same `own_cells` and `connectivity`.
/// Times must be later than those of the file. `reduction` and `up` are those of the file, and `exact` if all of it is
/// exact. The file stays as it was if this fails, unless the disk does not confirm the last write: then the message
/// says that the steps are in the file. Fails if the file is no series, if its mesh or its attributes are others, and
/// as `build_series`.
[[nodiscard]] SPLATVOL_EXPORT Result<MeshBuildReport> append_to_series(const MeshArrays& mesh,
                                                                       std::span<const MeshStep> steps,
                                                                       const std::string& path,
                                                                       const MeshBuildOptions& options = {});

}  // namespace splatvol
