// A small volume, made in the slow and obvious way: an oracle for readers and writers of .svol files.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/octree.h"
#include "format/volume_info.h"
#include "format/volume_writer.h"
#include "tests/support/packed_tree.h"
#include "tests/support/test_cells.h"

namespace splatvol::test {

/// Octants from the root down: the first d of them name the node of depth d that holds a point.
using NodePath = std::vector<std::uint8_t>;

struct TestVolumeOptions {
  std::uint32_t leaf_points = 8;     // N: most points in a leaf of the reduction's octree
  std::size_t coarsest_points = 20;  // the reduction stops at this many or fewer
  std::size_t node_points = 40;      // most points in a leaf of the index
  std::uint32_t points_per_chunk = 64;
  double position_error = 0;  // world units; 0: exact
  Cube cube{{0, 0, 0}, 1};
  double value_offset = 0;  // subtracted from each attribute's values before they are stored
  bool moments = true;      // with the columns centroid, moments and value_moments
  bool gradients = true;    // with the column gradient
};

/// A small part of a point's material, with one position and one value of each attribute.
struct Parcel {
  dvec3 offset;               // from the point
  double mass;                // 0: none
  std::vector<float> stored;  // [attribute]; NaN: no value
};

/// Everything in a file, in file order, and the clusters, which are not in the file.
struct TestVolume {
  format::VolumeInfo info;
  Tree tree;
  std::vector<NodePath> node_paths;                       // [node]
  std::vector<NodePath> point_paths;                      // [point]: 42 octants
  std::vector<dvec3> positions;                           // [point], file order
  std::vector<std::vector<float>> stored;                 // [attribute][point]
  std::vector<std::vector<std::uint8_t>> depths, counts;  // [resolution][point < n_r]: the octant column
  std::vector<std::vector<std::uint32_t>>
      representatives;  // [resolution][point]: the one of the first n_r that stands for it
  double position_error = 0;
  format::Bytes boundary;          // the section, if `info` has a boundary
  std::optional<TestCells> cells;  // add_cells()

  // The material of a point is a few parcels at random positions in an ellipsoid round the point. Some points have one
  // parcel, some have parcels in a plane, some have none. The numbers of a splat are those of all parcels of its
  // cluster.
  std::vector<std::vector<Parcel>> parcels;                   // [point]
  std::vector<std::vector<dvec3>> centroids;                  // [resolution][point < n_r]
  std::vector<std::vector<SplatShape>> shapes;                // [resolution][point < n_r]
  std::vector<std::vector<std::vector<SplatValue>>> signals;  // [attribute][resolution][point < n_r]
  std::vector<std::vector<std::vector<format::ValueSummary>>>
      materials;                             // likewise: summary of the values of the material
  std::vector<std::vector<vec3>> gradients;  // [attribute][point]: of any length, some 0

  /// Returns d of a splat: edge 2^-depth / cbrt(count).
  [[nodiscard]] double splat_size(std::size_t resolution, std::size_t point) const;

  /// Returns the size of a splat of the kernel moments in a node with this cube (spec 6).
  [[nodiscard]] double moments_size(std::size_t resolution, std::size_t point, const Cube& cube) const;

  /// Returns half of the extent along each axis of a splat's ellipsoid, whose half axes are sqrt(12) deviations.
  [[nodiscard]] dvec3 moments_extent(std::size_t resolution, std::size_t point) const;

  /// Whether the node holds the point.
  [[nodiscard]] bool holds(std::size_t node, std::size_t point) const;
};

/// Returns the cube of the node that a path names.
[[nodiscard]] Cube cube_of(const Cube& root, const NodePath& path);

/// Returns pseudo-random points in the unit cube: half of them uniform, half in a small ball near a corner.
[[nodiscard]] std::vector<dvec3> random_points(std::size_t count, std::uint32_t seed);

/// Builds a volume of points with values[attribute][point] (NaN: missing). Attributes are named "a0", "a1", ...
/// Requires at least one point; time grows with the square of the number of points.
[[nodiscard]] TestVolume make_test_volume(const std::vector<dvec3>& positions,
                                          const std::vector<std::vector<double>>& values,
                                          const TestVolumeOptions& options = {});

/// Builds a volume of random points, whose one attribute is x.
[[nodiscard]] TestVolume volume_of_x(std::size_t count, std::uint32_t seed = 1);

/// Makes a writer of the volume, with its index, before its first row.
[[nodiscard]] Result<std::unique_ptr<format::VolumeWriter>> create_writer(const TestVolume& volume,
                                                                          const std::string& path);

/// Writes the volume to `path` through format::VolumeWriter. `write_cells`: the section, if `info` has cells.
[[nodiscard]] Status write_test_volume(const TestVolume& volume, const std::string& path,
                                       format::WriteCells write_cells = {});

/// Returns the bytes that write_test_volume writes; none if it fails.
[[nodiscard]] format::Bytes test_volume_bytes(const TestVolume& volume);

}  // namespace splatvol::test
