// The cells that a file keeps, as a mesh.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "extractor/output_arrays.h"
#include "format/cell_reader.h"
#include "format/splat_reader.h"
#include "format/volume.h"
#include "splatvol/meshes.h"

namespace splatvol {

struct CellCounts {
  std::uint64_t cells = 0;
  std::uint64_t points = 0;   // corners of these cells
  std::uint64_t corners = 0;  // of all cells: a point counts for each cell that it is a corner of
};

struct CellExtractionReport {
  CellCounts counts;
  std::uint64_t left_out = 0;  // cells of chunks that meet the box, of a shape or field that this program does not know
  std::uint64_t split = 0;     // cells that come as their tetrahedra: a reader would split them otherwise
  double volume = 0;           // of the cells: each counts as positive
};

/// Where cells go, part by part: into a file, or into memory. Calls come from one thread.
class CellOutput {
 public:
  virtual ~CellOutput() = default;

  /// First, in order: the corners of cells, in VTK's order. They are ranks of points.
  [[nodiscard]] virtual Status write_corners(std::uint64_t first, std::span<const std::uint64_t> corners) = 0;

  /// Beside them, if values are of cells: for each cell the point that has its values. Gives them back later.
  [[nodiscard]] virtual Status append_sources(std::span<const std::uint64_t> points) = 0;
  [[nodiscard]] virtual Status read_sources(std::uint64_t first_cell, std::span<std::uint64_t> points) = 0;

  /// Once all cells are known.
  [[nodiscard]] virtual Status set_counts(const CellCounts& counts) = 0;

  /// Then positions, and the numbers of each array, from a point or cell on.
  [[nodiscard]] virtual Status write_points(std::uint64_t first, std::span<const dvec3> points) = 0;
  [[nodiscard]] virtual Status write_values(std::size_t array, std::uint64_t first,
                                            std::span<const double> numbers) = 0;

  /// Then corners come back as ranks, and are written again as numbers of points.
  [[nodiscard]] virtual Status read_corners(std::uint64_t first, std::span<std::uint64_t> corners) = 0;

  /// Last, where the corners of each cell end, and VTK's number of its type.
  [[nodiscard]] virtual Status write_kinds(std::uint64_t first_cell, std::span<const std::uint64_t> ends,
                                           std::span<const std::uint8_t> types) = 0;
};

/// Cells that meet the box of a selection, in the order of the file, with their corners as points, in the order of
/// their ranks, and values of the selected attributes there, in double precision (NaN: missing). A cell meets the box
/// if the box round its corners does, as they are stored. The corners of a cell stand in an order that gives it a
/// positive volume. Polyhedra come as their tetrahedra. So do cells whose positions, as they are stored, make svbuild
/// choose other diagonals than the file has. The selection's resolution does not matter. Cells of their own (svbuild
/// --cells own) have values themselves, and their corners have none.
class CellExtraction {
 public:
  /// The volume and the selection must outlive the result. Fails if the file keeps no cells, or has cells of their own
  /// and others.
  [[nodiscard]] static Result<CellExtraction> open(const format::Volume& volume,
                                                   const format::SplatSelection& selection);

  [[nodiscard]] const std::vector<OutputArray>& arrays() const { return arrays_; }

  /// Whether the arrays are of cells; else they are of points.
  [[nodiscard]] bool has_cell_values() const { return field_ == format::CellField::constant; }

  /// Reads nothing of chunks of cells and pages outside of the box. Reads each chunk of cells once. Holds about 200
  /// MiB, 2 MiB for each attribute, and 1.25 bits for each point of those pages of ranks that the cells name, besides
  /// what the output holds. The output does not depend on `threads`. Heeds an Interruptible. Fails if no cell meets the
  /// box.
  [[nodiscard]] Result<CellExtractionReport> write(CellOutput& output, const std::function<void(double)>& progress,
                                                   std::size_t threads = usual_threads()) const;

 private:
  CellExtraction(std::unique_ptr<const format::CellReader> cells, format::CellField field,
                 const format::SplatSelection& selection);
  [[nodiscard]] static std::size_t usual_threads();

  std::unique_ptr<const format::CellReader> cells_;
  format::CellField field_;
  const format::SplatSelection* selection_;
  std::vector<OutputArray> arrays_;
};

/// Returns these cells in memory.
[[nodiscard]] Result<CellMesh> extract_cells(const format::Volume& volume, const format::SplatSelection& selection);

}  // namespace splatvol
