// Builds a .svol file from a source.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "builder/cells/cell_section.h"
#include "builder/output/group_sizes.h"
#include "builder/output/row_packer.h"
#include "builder/points/input_summary.h"
#include "builder/points/point_stream.h"
#include "builder/reduction/clusters.h"
#include "builder/scattered/scattered.h"
#include "builder/sources/source.h"

namespace splatvol {

class BoundaryFaces;

struct BuildOptions {
  Reduction reduction = Reduction::octree;              // how coarser resolutions are chosen
  std::uint32_t leaf_points = 8;                        // N of the octree or k-d tree; at least 8 (see build_volume)
  GroupSizes points_per_chunk = {};                     // of each segment; with more, a coarse view reads more in vain
  std::uint64_t index_leaf_points = 512;                // the index splits nodes with more points; at least 255
  std::uint64_t memory = std::uint64_t{1} << 30;        // bytes to hold, beside a piece of the input as it is read
  std::uint64_t held_points = std::uint64_t{1} << 20;   // most scattered points that are joined all at once
  std::string temp_folder = {};                         // for what memory cannot hold; empty: the output's folder
  ExactColumns exact = {};                              // what is stored as it is given
  bool join_attributes = true;                          // with the same values: stored once, with an alias
  bool gradients = false;                               // the column `gradient`: lights the kernel octant
  Connectivity connectivity = Connectivity::automatic;  // only the first two use the input's cells
  std::vector<std::string> inputs = {};                 // names for the provenance
  std::vector<std::pair<std::string, std::string>> units = {};  // attribute, unit: instead of the source's
  std::string builder = "splatvol";                             // name and version of the program
  int up = -1;                                                  // format::VolumeInfo::up
  bool strict = false;                                          // fail if the input would change (check_unchanged)
  std::uint64_t boundary_triangles = 0;                         // most triangles of the mesh's boundary; 0: none
  bool boundary_if_any = false;  // no failure if the input has no cells, and so no boundary
  bool keep_cells = false;       // the file keeps the mesh's cells, or Delaunay tetrahedra, if there are any
};

/// Values so near to 0 that the file has 0 for them.
struct LostValues {
  std::set<std::string> attributes;
  double below = 0;    // the largest that may be lost, in size
  double largest = 0;  // of all values of these attributes, in size
};

/// The boundary that a file holds.
struct BoundaryReport {
  std::vector<std::pair<std::string, std::uint64_t>> patches;  // and their triangles
  std::uint64_t kept = 0;                                      // triangles
  std::uint64_t triangles = 0;                                 // of the mesh's boundary
  double error = 0;                                            // no point of it is farther from those that are kept
  std::uint64_t bytes = 0;                                     // in the file
};

struct BuildReport {
  std::vector<std::uint64_t> resolution_counts;
  std::uint64_t file_bytes = 0;
  Connectivity connectivity = Connectivity::mesh;  // that was used
  PointCensus points;
  CellCensus cells;
  std::uint64_t uncertain = 0;                                      // DelaunaySubdomains::uncertain()
  std::uint64_t disputed = 0;                                       // DelaunaySubdomains::disputed(), if cells are kept
  std::uint64_t least_memory = 0;                                   // held even if BuildOptions::memory grants less
  std::vector<std::pair<std::string, std::string>> aliases = {};    // attribute of the input, the same one in the file
  std::vector<std::pair<std::string, std::uint64_t>> missing = {};  // attribute, points without a value
  std::vector<std::pair<std::string, std::uint64_t>> fills = {};    // attribute, fill values among the numbers read
  std::vector<std::string> warnings = {};                           // lines: precision_warnings(), and others
  LostValues lost = {};
  std::optional<BoundaryReport> boundary = {};
  std::optional<CellReport> kept_cells = {};
};

/// The name as in options and provenance: "auto", "mesh", "delaunay", "none".
[[nodiscard]] const char* connectivity_name(Connectivity connectivity);

/// The reverse of connectivity_name.
[[nodiscard]] Result<Connectivity> parse_connectivity(const std::string& name);

/// Gets the stage's name, and the share of the stage that is done, in [0, 1].
using BuildProgress = std::function<void(const char* stage, double fraction)>;

/// Reads the whole source, reduces it and writes `output`, which appears whole or not at all. Bytes depend on the
/// points, their order and the options, never on threads or memory. Fails if leaf_points is under 8 (a node that is
/// split must lose points even if each of its octants keeps one), and if cells are asked for and there are none. Fails
/// also if a unit is given for an attribute that is not there, or if a boundary is asked for and no cell has a volume.
/// The unit of a vector is that of its components too.
[[nodiscard]] Result<BuildReport> build_volume(Source& source, const std::string& output, const BuildOptions& options,
                                               const BuildProgress& progress);

/// Fails as build_volume does before it reads anything.
[[nodiscard]] Status check_units(const Source& source, const BuildOptions& options);

/// The folder for temporary files of an output.
[[nodiscard]] std::string temp_folder_of(const std::string& output, const BuildOptions& options);

/// The same as build_volume for points that are sorted. `file`: gets all. `faces`, `cells`: of all pieces; null if the
/// file gets no boundary, or no cells.
[[nodiscard]] Result<BuildReport> build_from_points(PointStream points, AtomicFile file, const std::string& folder,
                                                    const BuildOptions& options, const BuildProgress& progress,
                                                    BoundaryFaces* faces = nullptr, MeshCells* cells = nullptr);

}  // namespace splatvol
