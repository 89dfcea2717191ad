// Reads .svol files: what they hold, their points, and values between the points. Component `read`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "splatvol/error.h"
#include "splatvol/export.h"
#include "splatvol/geometry.h"
#include "splatvol/integrals.h"
#include "splatvol/meshes.h"
#include "splatvol/streamlines.h"

namespace splatvol {

/// An attribute of a file: a named number at each point.
struct Attribute {
  std::string name;
  std::string unit;           // such as "m/s"; empty: not known
  double low = 0, high = 0;   // range of the values; NaN if no point has a value
  std::uint64_t missing = 0;  // points without a value
  double error = 0;           // no stored value differs by more from that of the input
};

/// The points to read.
struct PointsRequest {
  /// 0 is the coarsest. None: the finest with at most `max_points` points; if there is none, the coarsest.
  std::optional<std::size_t> resolution = std::nullopt;
  std::uint64_t max_points = std::numeric_limits<std::uint64_t>::max();

  std::vector<std::string> attributes = {};  // empty: all
  std::optional<Box> box = std::nullopt;     // points outside are left out
  bool material = false;                     // also Points::volumes and the vectors after it
};

/// Points of one resolution. A point of a coarse resolution stands for those near it that the resolution lacks.
struct Points {
  std::size_t resolution = 0;
  std::vector<std::string> names;           // [attribute]
  std::vector<dvec3> positions;             // [point]
  std::vector<std::vector<double>> values;  // [attribute][point], at the position; NaN: missing

  // The material that each point stands for, if it was asked for.
  std::vector<double> volumes;                     // [point]
  std::vector<dvec3> centroids;                    // [point]
  std::vector<std::array<double, 6>> covariances;  // [point]: xx, yy, zz, xy, yz, xz
  std::vector<std::vector<double>> means;          // [attribute][point]: of the values in the material; NaN: missing
  std::vector<std::vector<double>> deviations;     // [attribute][point]: standard deviations
};

/// The part of a mesh to read.
struct MeshRequest {
  std::vector<std::string> attributes = {};  // empty: all
  std::optional<Box> box = std::nullopt;     // only cells that meet it
};

/// Values along a line.
struct LineSamples {
  std::vector<std::string> names;           // [attribute]
  std::vector<double> arc_lengths;          // [row]: from the start, world units; they do not fall
  std::vector<dvec3> positions;             // [row]
  std::vector<std::vector<double>> values;  // [attribute][row]; NaN: no cell, or no value
};

/// An open file; of a time series, at one of its steps. Each byte is checked before it is used. Errors name the file.
/// Thread-safe, except for `show_step`.
class SPLATVOL_EXPORT File {
 public:
  /// Opens a .svol file, or an index of files (.svols), by its path or its address (http://, https:// or ssh://). Of a
  /// time series, the last step is shown. Reads the preamble only.
  [[nodiscard]] static Result<File> open(const std::string& path);
  File(File&&) noexcept;
  File& operator=(File&&) noexcept;
  ~File();

  /// Returns the name for messages: the path, or the address without user, password and query.
  [[nodiscard]] const std::string& name() const;
  [[nodiscard]] const std::vector<Attribute>& attributes() const;

  /// Returns the number of points of each resolution, which rises.
  [[nodiscard]] const std::vector<std::uint64_t>& resolution_counts() const;
  [[nodiscard]] std::uint64_t point_count() const { return resolution_counts().back(); }

  /// Returns the box round the mesh: round its cells, if the file keeps them, else round its points; of more than 2^20
  /// points round those of a coarser resolution. Reads it from the file at the first call. Where that fails, the box is
  /// a cube round all points.
  [[nodiscard]] Box bounds() const;

  /// Returns the times of the steps, which rise; none if the file is no time series.
  [[nodiscard]] const std::vector<double>& times() const;

  /// Returns the number of the step that is shown; 0 if the file is no time series.
  [[nodiscard]] std::size_t step() const;

  /// Returns the number of the step nearest to a time; of two, the earlier. 0 if the file is no time series.
  [[nodiscard]] std::size_t nearest_step(double time) const;

  /// Returns the least and the largest value of an attribute over all steps, for pictures with the same colours. NaN if
  /// no value is present, or there is no such attribute.
  [[nodiscard]] std::pair<double, double> range_of(const std::string& attribute) const;

  /// Changes to another step. If it fails, all stays as it was.
  [[nodiscard]] Status show_step(std::size_t step);

  /// Reads points. Reads only chunks that it needs: of parts outside of the box, the positions alone. Fails if the
  /// file lacks the resolution or an attribute.
  [[nodiscard]] Result<Points> points(const PointsRequest& request = {}) const;

  /// Returns the values of an attribute at positions, in world units; NaN where no material is, or no value. Requires
  /// fewer than 2^32 - 1 positions, and takes about 64 bytes for each.
  ///
  /// Of a file that keeps cells, they are the mesh's own: linear in each tetrahedron of a cell, or the value of the
  /// cell where cells have values of their own. Where cells overlap, the first of the file counts. A position outside
  /// of all cells, but nearer than the file rounds positions, has the value of the nearest point of a cell. Reads the
  /// chunks of cells round the positions, and holds at most 128 MiB of them.
  ///
  /// Of other files, or with a `resolution`, they are the means of the splats' linear fields, weighted by their
  /// densities. Reads the whole resolution (none: the finest), chunk by chunk.
  [[nodiscard]] Result<std::vector<double>> sample(std::span<const dvec3> positions, const std::string& attribute,
                                                   std::optional<std::size_t> resolution = std::nullopt) const;

  /// Returns the values of attributes (empty: all) along the line from `start` to `end`, of a file that keeps cells: a
  /// row at each crossing from a tetrahedron of the cells to another, and at both ends. Between two rows, all values
  /// are linear: nothing is left out. Where values jump, two rows have one position: at borders of blocks and of cells
  /// that have values of their own, and where the line enters or leaves the mesh. Outside, values are NaN.
  ///
  /// With `samples`, returns so many rows in equal steps instead, from `start` to `end`. Values are as `sample` returns
  /// them. Reads the chunks of cells that the line meets. Fails if the file keeps no cells or has some of a shape that
  /// this version does not know, unless the line is finite and longer than 0, or if there is one sample.
  [[nodiscard]] Result<LineSamples> sample_line(const dvec3& start, const dvec3& end,
                                                const std::vector<std::string>& attributes = {},
                                                std::optional<std::size_t> samples = std::nullopt) const;

  /// Returns the cells that the file keeps, with their corners as points, and their values. A cell meets a box if the
  /// box round its corners does. Corners stand in an order that gives cells a positive volume. Polyhedra come as their
  /// tetrahedra. So do cells that a reader of rounded positions would split along other diagonals than the file. The
  /// components `U[0]`, `U[1]` and `U[2]` of a vector are one array `U`, which stands for its magnitude, too. Cells
  /// that have values of their own have them in `cell_values`, else corners have them in `point_values`. All is held at
  /// once. Fails if the file keeps no cells, or none meets the box.
  [[nodiscard]] Result<CellMesh> cells(const MeshRequest& request = {}) const;

  /// Returns the surface on which an attribute has a value, in the cells that the file keeps: that of the linear
  /// interpolation in each tetrahedron, exact up to rounding. It has the values of the attribute and of those of the
  /// request, vectors as in `cells`. It ends at the border of the mesh, of the box, and of cells with a missing value.
  /// Fails if the file keeps no cells, if they have values of their own, or if the attribute has the value nowhere.
  [[nodiscard]] Result<ContourMesh> contour(double value, const std::string& attribute,
                                            const MeshRequest& request = {}) const;

  /// Returns volume, integral, mean, and the least and the greatest value of attributes, over the cells that the file
  /// keeps. They are cut exactly by the box, the planes, and where the linear values of a tetrahedron leave a range.
  /// All volumes count as positive. Tetrahedra with a missing value at a corner are left out, and their volume is told.
  /// Where cells have values of their own, these hold in all of the cell; the position of an extreme is one in the
  /// cell. A vector has integrals of its components and its magnitude. Reads chunk by chunk what the region meets, and
  /// holds at most 128 MiB. Sums do not depend on the number of threads. Fails if the file keeps no cells or lacks an
  /// attribute, and if the region is none.
  [[nodiscard]] Result<Integrals> integrate(const IntegralRequest& request = {}) const;

  /// Returns the same over a surface in the cells: a contour, or a slice, with its area, the flux of a vector through
  /// it, and the volume inside of a closed contour. It is that of `contour`, and of the distance from a plane; the
  /// region of the request cuts it exactly. A face of cells in the plane of a slice counts once. Fails also if a
  /// contour's cells have values of their own.
  [[nodiscard]] Result<SurfaceIntegrals> integrate_surface(const SurfaceRequest& request) const;

  /// Returns the streamlines of a vector through the seeds of the request, in the cells that the file keeps, with the
  /// values of its attributes. The vector is linear in each tetrahedron; where cells overlap, the first of the file
  /// counts. Steps are those of Dormand and Prince, of order 5: no longer than a tetrahedron, and each is estimated to
  /// be off by at most 1e-5 of it. A line ends at the mesh's end, at a missing value, where nothing moves, or at a
  /// limit of the request, and tells which. Lines have the same bits for any number of threads and order of seeds.
  /// Reads the chunks of cells on their way, and holds at most 64 MiB of them, besides the lines. Fails if the file
  /// keeps no cells or if they have values of their own, without a vector of three components, and if no seed has a
  /// line.
  [[nodiscard]] Result<Streamlines> streamlines(const StreamlineRequest& request) const;

  /// Checks every byte of the file; of an index, of the files of all steps, and its units and ranges. Calls `progress`
  /// with the share done, in [0, 1].
  [[nodiscard]] Status verify(const std::function<void(double)>& progress = {}) const;

  [[nodiscard]] std::uint64_t file_bytes() const;

  /// Returns the bytes read of the file so far.
  [[nodiscard]] std::uint64_t bytes_read() const;

 private:
  struct Contents;
  explicit File(std::unique_ptr<Contents> contents);
  std::unique_ptr<Contents> contents_;
};

}  // namespace splatvol
