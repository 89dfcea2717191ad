#include "tests/support/test_volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numeric>
#include <random>
#include <tuple>

#include "tests/support/random.h"
#include "tests/support/temp_folder.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

constexpr std::size_t key_levels = 42;

using Indices = std::vector<std::uint32_t>;

// Follows spec 7 literally.
NodePath path_of(const dvec3& point, const Cube& cube) {
  std::array<std::uint64_t, 3> index{};
  for (int axis = 0; axis < 3; ++axis) {
    const double scaled = std::floor((point[axis] - cube.origin[axis]) / cube.edge * 0x1p42);
    index[static_cast<std::size_t>(axis)] = static_cast<std::uint64_t>(std::clamp(scaled, 0.0, 0x1p42 - 1));
  }
  NodePath path;
  for (std::size_t level = key_levels; level-- > 0;)
    path.push_back(static_cast<std::uint8_t>(((index[0] >> level) & 1) | ((index[1] >> level) & 1) << 1 |
                                             ((index[2] >> level) & 1) << 2));
  return path;
}

bool begins_with(const NodePath& path, const NodePath& node) {
  return std::equal(node.begin(), node.end(), path.begin());
}

struct Leaf {
  NodePath node;
  Indices points;
};

// Appends the leaves, in Morton order, of the octree over `points` with at most `most` points in a leaf.
void collect_leaves(const std::vector<NodePath>& paths, const Indices& points, const NodePath& node, std::size_t most,
                    std::vector<Leaf>& leaves) {
  if (points.empty()) return;
  if (points.size() <= most || node.size() == key_levels) return leaves.push_back({node, points});
  for (std::uint8_t octant = 0; octant < 8; ++octant) {
    Indices inside;
    std::ranges::copy_if(points, std::back_inserter(inside),
                         [&](std::uint32_t i) { return paths[i][node.size()] == octant; });
    NodePath child = node;
    child.push_back(octant);
    collect_leaves(paths, inside, child, most, leaves);
  }
}

std::uint32_t nearest_to_center(const std::vector<dvec3>& positions, const Leaf& leaf, const Cube& root) {
  const Cube cube = cube_of(root, leaf.node);
  const dvec3 center = cube.origin + 0.5 * cube.edge;
  return *std::ranges::min_element(leaf.points, {}, [&](std::uint32_t i) {
    return std::pair(glm::dot(positions[i] - center, positions[i] - center), i);
  });
}

// One resolution, while points are still in input order.
struct Level {
  Indices points;
  Indices representatives;                   // [input point]
  std::vector<std::uint8_t> depths, counts;  // [input point], of those in `points`
};

std::vector<Level> reduce(const std::vector<dvec3>& positions, const std::vector<NodePath>& paths,
                          const TestVolumeOptions& options) {
  Level level;
  level.points.resize(positions.size());
  std::iota(level.points.begin(), level.points.end(), 0u);
  level.representatives = level.points;
  std::vector<Level> levels;
  for (;;) {
    std::vector<Leaf> leaves;
    collect_leaves(paths, level.points, {}, options.leaf_points, leaves);
    level.depths.assign(positions.size(), 0);
    level.counts.assign(positions.size(), 0);
    Level next;
    Indices kept(positions.size());
    for (const Leaf& leaf : leaves) {
      next.points.push_back(nearest_to_center(positions, leaf, options.cube));
      for (const std::uint32_t i : leaf.points) {
        kept[i] = next.points.back();
        level.depths[i] = static_cast<std::uint8_t>(leaf.node.size());
        level.counts[i] = static_cast<std::uint8_t>(std::min<std::size_t>(leaf.points.size(), 255));
      }
    }
    next.representatives = level.representatives;
    for (std::uint32_t& i : next.representatives) i = kept[i];
    const bool last = level.points.size() <= options.coarsest_points || next.points.size() == level.points.size();
    levels.insert(levels.begin(), std::move(level));
    if (last) return levels;
    level = std::move(next);
  }
}

// Returns the file order: by the first resolution that has the point, then in Morton order.
Indices file_order(const std::vector<Level>& levels, const std::vector<NodePath>& paths) {
  std::vector<std::size_t> segment(paths.size());
  for (std::size_t r = levels.size(); r-- > 0;)
    for (const std::uint32_t i : levels[r].points) segment[i] = r;
  Indices order(paths.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::sort(order, [&](std::uint32_t a, std::uint32_t b) {
    return std::tie(segment[a], paths[a], a) < std::tie(segment[b], paths[b], b);
  });
  return order;
}

void fill_attributes(const std::vector<std::vector<double>>& values, const Indices& order, double offset,
                     TestVolume& volume) {
  for (std::size_t a = 0; a < values.size(); ++a) {
    format::Attribute attribute;
    attribute.name = fmt::format("a{}", a);
    attribute.offset = offset;
    std::vector<float> stored;
    for (const std::uint32_t i : order) {
      stored.push_back(static_cast<float>(values[a][i] - offset));
      if (std::isnan(stored.back())) {
        ++attribute.missing;
        continue;
      }
      const double value = offset + static_cast<double>(stored.back());
      attribute.min = std::isnan(attribute.min) ? value : std::min(attribute.min, value);
      attribute.max = std::isnan(attribute.max) ? value : std::max(attribute.max, value);
    }
    volume.info.attributes.push_back(attribute);
    volume.stored.push_back(std::move(stored));
  }
}

void fill_gradients(TestVolume& volume) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> uniform(-1, 1);
  for (std::size_t a = 0; a < volume.stored.size(); ++a) {
    auto& gradients = volume.gradients.emplace_back();
    for (std::size_t i = 0; i < volume.positions.size(); ++i)
      gradients.push_back(i % 23 == 5 ? vec3(0) : 10.0f * random_vector<vec3>(uniform, random));
  }
}

// The ellipsoid is as large as a node with one point. Every 7th point has material in a plane, every 11th at one
// position, every 13th none. Values stay in the range of the attribute, and are missing if the point's value is.
void fill_parcels(TestVolume& volume) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.1, 1);
  const std::size_t finest = volume.info.resolutions() - 1;
  for (std::size_t i = 0; i < volume.positions.size(); ++i) {
    const double size = 0.5 * volume.splat_size(finest, i);
    const double thickness = i % 7 == 3 ? 0 : uniform(random), height = uniform(random), width = uniform(random);
    const dvec3 axes = size * dvec3(width, height, thickness);
    auto& parcels = volume.parcels.emplace_back(i % 11 == 5 ? 1 : 6);
    for (Parcel& parcel : parcels) {
      parcel.offset = axes * glm::clamp(random_vector(normal, random), -1.5, 1.5);
      parcel.mass = i % 13 == 7 ? 0 : size * size * size * uniform(random);
      for (std::size_t a = 0; a < volume.stored.size(); ++a) {
        const format::ValueBins bins = bins_of(volume.info.attributes[a]);
        const double value = static_cast<double>(volume.stored[a][i]) +
                             0.05 * (bins.max - bins.min) * (parcel.offset.x / size + 0.3 * normal(random));
        parcel.stored.push_back(static_cast<float>(std::isnan(value) ? value : std::clamp(value, bins.min, bins.max)));
      }
    }
  }
}

// Computes the eigenvalues, descending, and eigenvectors of a symmetric matrix, by Jacobi rotations.
std::pair<dvec3, dmat3> eigensystem(dmat3 m) {
  dmat3 vectors(1);
  for (int sweep = 0; sweep < 30; ++sweep)
    for (const auto& [p, q] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)}) {
      const double angle = 0.5 * std::atan2(2 * m[p][q], m[q][q] - m[p][p]);
      dmat3 turn(1);
      turn[p][p] = turn[q][q] = std::cos(angle);
      turn[q][p] = std::sin(angle);
      turn[p][q] = -std::sin(angle);
      m = glm::transpose(turn) * m * turn;
      vectors = vectors * turn;
    }
  std::array<int, 3> order{0, 1, 2};
  std::ranges::sort(order, std::greater(), [&](int k) { return m[k][k]; });
  dvec3 values;
  dmat3 sorted;
  for (int k = 0; k < 3; ++k) {
    const int from = order[static_cast<std::size_t>(k)];
    values[k] = std::max(0.0, m[from][from]);
    sorted[k] = vectors[from];
  }
  if (glm::determinant(sorted) < 0) sorted[2] = -sorted[2];
  return {values, sorted};
}

// Mass, mean and covariance of (x, y, z, v). v: value of an attribute, then only of material that has one; or 0.
struct Moments {
  double mass = 0;
  std::array<double, 4> mean{};
  std::array<std::array<double, 4>, 4> covariance{};
};

struct Sample {
  double mass;
  std::array<double, 4> position;
};

Moments moments_of(const std::vector<Sample>& samples) {
  Moments moments;
  for (const Sample& s : samples) moments.mass += s.mass;
  if (moments.mass == 0) return moments;
  for (const Sample& s : samples)
    for (std::size_t i = 0; i < 4; ++i) moments.mean[i] += s.mass / moments.mass * s.position[i];
  for (const Sample& s : samples)
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = 0; j < 4; ++j)
        moments.covariance[i][j] +=
            s.mass / moments.mass * (s.position[i] - moments.mean[i]) * (s.position[j] - moments.mean[j]);
  return moments;
}

// Returns all parcels of a cluster, with positions relative to the representative.
std::vector<Sample> samples_of(const TestVolume& volume, const Indices& cluster, const dvec3& from, int attribute) {
  std::vector<Sample> samples;
  for (const std::uint32_t i : cluster)
    for (const Parcel& parcel : volume.parcels[i]) {
      const float value = attribute < 0 ? 0 : parcel.stored[static_cast<std::size_t>(attribute)];
      if (std::isnan(value)) continue;
      const dvec3 p = volume.positions[i] - from + parcel.offset;
      samples.push_back({parcel.mass, {p.x, p.y, p.z, static_cast<double>(value)}});
    }
  return samples;
}

SplatShape shape_of(const Moments& moments) {
  dmat3 covariance;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      covariance[i][j] = moments.covariance[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
  auto [variances, axes] = eigensystem(covariance);
  for (int k = 1; k < 3; ++k)
    if (variances[k] < 1e-12 * variances[0]) variances[k] = 0;  // rounding
  return {moments.mass, glm::sqrt(variances), glm::normalize(glm::quat_cast(axes))};
}

SplatValue value_of(const Moments& moments, const SplatShape& shape) {
  if (moments.mass == 0) return {};
  SplatValue value{moments.mean[3], std::sqrt(moments.covariance[3][3]), dvec3(0), 1, moments.mass / shape.mass};
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  const dvec3 covariance(moments.covariance[0][3], moments.covariance[1][3], moments.covariance[2][3]);
  for (int k = 0; k < 3; ++k) {
    const double scale = shape.deviations[k] * value.deviation;
    if (scale > 0) value.correlation[k] = std::clamp(glm::dot(axes[k], covariance) / scale, -1.0, 1.0);
  }
  value.residual = std::sqrt(std::max(0.0, 1 - glm::dot(value.correlation, value.correlation)));
  return value;
}

void fill_moments(TestVolume& volume) {
  const std::size_t attributes = volume.stored.size();
  volume.signals.resize(attributes);
  volume.materials.resize(attributes);
  for (std::size_t r = 0; r < volume.info.resolutions(); ++r) {
    std::vector<Indices> clusters(volume.info.resolution_counts[r]);
    for (std::uint32_t i = 0; i < volume.positions.size(); ++i) clusters[volume.representatives[r][i]].push_back(i);
    auto& centroids = volume.centroids.emplace_back();
    auto& shapes = volume.shapes.emplace_back();
    for (std::size_t a = 0; a < attributes; ++a) {
      volume.signals[a].emplace_back();
      volume.materials[a].emplace_back();
    }
    for (std::size_t i = 0; i < clusters.size(); ++i) {
      const dvec3& from = volume.positions[i];
      const Moments space = moments_of(samples_of(volume, clusters[i], from, -1));
      centroids.push_back(from + dvec3(space.mean[0], space.mean[1], space.mean[2]));
      shapes.push_back(shape_of(space));
      for (std::size_t a = 0; a < attributes; ++a) {
        const std::vector<Sample> samples = samples_of(volume, clusters[i], from, static_cast<int>(a));
        volume.signals[a][r].push_back(value_of(moments_of(samples), shapes.back()));
        std::vector<float> taken;
        for (const Sample& s : samples)
          if (s.mass > 0) taken.push_back(static_cast<float>(s.position[3]));
        volume.materials[a][r].push_back(bins_of(volume.info.attributes[a]).summarize(taken));
      }
    }
  }
}

// Returns the coarsest resolution from which on every cluster is inside or outside as a whole.
std::size_t first_resolution(const TestVolume& volume, const std::vector<bool>& inside) {
  std::size_t first = volume.info.resolutions() - 1;
  const auto respects = [&](std::size_t r) {
    for (std::size_t i = 0; i < inside.size(); ++i)
      if (inside[i] != inside[volume.representatives[r][i]]) return false;
    return true;
  };
  while (first > 0 && respects(first - 1)) --first;
  return first;
}

void add_node(const NodePath& path, const Indices& points, std::size_t most, TestVolume& volume) {
  const std::size_t resolutions = volume.info.resolutions();
  const auto& ends = volume.info.resolution_counts;
  format::NodeArrays& tree = volume.tree;
  std::vector<bool> inside(volume.positions.size());
  for (const std::uint32_t i : points) inside[i] = true;

  const std::size_t node = tree.size();
  const std::size_t bounds = volume.info.size_bounds.size();
  const Cube cube = cube_of(volume.info.cube, path);
  volume.node_paths.push_back(path);
  tree.child_masks.push_back(0);
  tree.first_resolutions.push_back(static_cast<std::uint8_t>(first_resolution(volume, inside)));
  tree.counts.resize((node + 1) * resolutions);
  tree.size_codes.resize((node + 1) * bounds * resolutions);
  for (const std::uint32_t i : points) {
    const auto segment = static_cast<std::size_t>(std::ranges::upper_bound(ends, i) - ends.begin());
    ++tree.counts[node * resolutions + segment];
  }
  for (std::size_t b = 0; b < bounds; ++b)
    for (std::size_t r = tree.first_resolutions.back(); r < resolutions; ++r) {
      std::uint8_t& code = tree.size_codes[(node * bounds + b) * resolutions + r] = 255;
      for (const std::uint32_t i : points) {
        if (i >= ends[r]) continue;
        const double size = b == 0 ? volume.splat_size(r, i) : volume.moments_size(r, i, cube);
        code = std::min(code, format::size_code(size, volume.info.cube.edge));
      }
    }
  for (std::size_t a = 0; a < volume.stored.size(); ++a) {
    std::vector<float> values;
    for (const std::uint32_t i : points) values.push_back(volume.stored[a][i]);
    format::ValueSummary& summary = tree.summaries.emplace_back(bins_of(volume.info.attributes[a]).summarize(values));
    if (volume.signals.empty()) continue;
    for (const std::uint32_t i : points) summary.include(volume.materials[a].back()[i]);
  }

  if (points.size() <= most || path.size() == key_levels) return;
  for (std::uint8_t octant = 0; octant < 8; ++octant) {
    NodePath child = path;
    child.push_back(octant);
    Indices part;
    std::ranges::copy_if(points, std::back_inserter(part),
                         [&](std::uint32_t i) { return begins_with(volume.point_paths[i], child); });
    if (part.empty()) continue;
    tree.child_masks[node] = static_cast<std::uint8_t>(tree.child_masks[node] | 1u << octant);
    add_node(child, part, most, volume);
  }
}

// Returns the metadata without counts and attributes.
format::VolumeInfo info_of(int attributes, const TestVolumeOptions& options) {
  format::VolumeInfo info;
  info.cube = options.cube;
  info.leaf_points = options.leaf_points;
  info.columns.push_back({format::ColumnKind::position, format::ColumnScope::segment, -1});
  info.columns.push_back({format::ColumnKind::octant, format::ColumnScope::resolution, -1});
  if (options.moments) {
    info.columns.push_back({format::ColumnKind::centroid, format::ColumnScope::resolution, -1});
    info.columns.push_back({format::ColumnKind::moments, format::ColumnScope::resolution, -1});
    info.size_bounds.push_back("moments");
  }
  for (int a = 0; a < attributes; ++a) {
    info.columns.push_back({format::ColumnKind::value, format::ColumnScope::segment, a});
    if (options.moments)
      info.columns.push_back({format::ColumnKind::value_moments, format::ColumnScope::resolution, a});
    if (options.gradients) info.columns.push_back({format::ColumnKind::gradient, format::ColumnScope::segment, a});
  }
  return info;
}

// Returns the largest error that spec 8 advises: under 1/64 of the smallest deviation.
double centroid_error(std::span<const SplatShape> shapes) {
  double smallest = std::numeric_limits<double>::infinity();
  for (const SplatShape& shape : shapes)
    for (int k = 0; k < 3; ++k)
      if (shape.deviations[k] > 0) smallest = std::min(smallest, shape.deviations[k]);
  return std::isfinite(smallest) ? smallest / 65 : 0;
}

std::vector<format::PackedChunk> pack_row(const TestVolume& volume, const format::RowLayout& rows, std::uint64_t row) {
  const format::Group group = rows.group(rows.group_of_row(row));
  const std::size_t resolution = rows.resolution_of_row(row);
  const auto part = [&](const auto& all) { return std::span(all).subspan(group.begin, group.count); };
  std::vector<format::PackedChunk> chunks;
  for (const int c : rows.columns_of_row(row)) {
    const format::Column& column = volume.info.columns[static_cast<std::size_t>(c)];
    const auto a = static_cast<std::size_t>(std::max(column.attribute, 0));
    if (column.kind == format::ColumnKind::position)
      chunks.push_back(format::pack_positions(part(volume.positions), volume.position_error));
    if (column.kind == format::ColumnKind::value)
      chunks.push_back(format::pack_values(part(volume.stored[a]), 0, bins_of(volume.info.attributes[a])));
    if (column.kind == format::ColumnKind::octant)
      chunks.push_back(format::pack_octants(part(volume.depths[resolution]), part(volume.counts[resolution])));
    if (column.kind == format::ColumnKind::centroid)
      chunks.push_back(format::pack_centroids(part(volume.centroids[resolution]),
                                              centroid_error(part(volume.shapes[resolution])), volume.info.cube));
    if (column.kind == format::ColumnKind::moments)
      chunks.push_back(format::pack_moments(part(volume.shapes[resolution]), volume.info.cube.edge));
    if (column.kind == format::ColumnKind::gradient)
      chunks.push_back(format::pack_gradients(part(volume.gradients[a])));
    if (column.kind == format::ColumnKind::value_moments) {
      format::ValueSummary summary;
      for (const format::ValueSummary& material : part(volume.materials[a][resolution])) summary.include(material);
      const auto values = part(volume.signals[a][resolution]);
      chunks.push_back(format::pack_value_moments(values, 0, summary));
    }
  }
  return chunks;
}

format::Histograms histograms_of(const TestVolume& volume) {
  format::Histograms histograms(volume.stored.size());
  for (std::size_t a = 0; a < volume.stored.size(); ++a)
    for (const float value : volume.stored[a])
      if (!std::isnan(value)) ++histograms[a][static_cast<std::size_t>(bins_of(volume.info.attributes[a]).bin(value))];
  return histograms;
}

}  // namespace

dvec3 TestVolume::moments_extent(std::size_t resolution, std::size_t point) const {
  const SplatShape& shape = shapes[resolution][point];
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  dvec3 extent(0);
  for (int axis = 0; axis < 3; ++axis)
    for (int k = 0; k < 3; ++k) {
      const double part = axes[k][axis] * shape.deviations[k];
      extent[axis] += 12 * part * part;
    }
  return glm::sqrt(extent);
}

double TestVolume::moments_size(std::size_t resolution, std::size_t point, const Cube& cube) const {
  const dvec3 extent = moments_extent(resolution, point);
  const dvec3 from_low = centroids[resolution][point] - cube.origin;
  double size = std::sqrt(12.0) * shapes[resolution][point].deviations[0];
  for (int axis = 0; axis < 3; ++axis)
    size = std::max({size, 0.5 * (extent[axis] - from_low[axis]), 0.5 * (extent[axis] + from_low[axis] - cube.edge)});
  return size;
}

double TestVolume::splat_size(std::size_t resolution, std::size_t point) const {
  return info.cube.edge * std::exp2(-static_cast<double>(depths[resolution][point])) /
         std::cbrt(counts[resolution][point]);
}

bool TestVolume::holds(std::size_t node, std::size_t point) const {
  return begins_with(point_paths[point], node_paths[node]);
}

Cube cube_of(const Cube& root, const NodePath& path) {
  Cube cube = root;
  for (const std::uint8_t octant : path) {
    cube.edge /= 2;
    cube.origin += cube.edge * dvec3(octant & 1, octant >> 1 & 1, octant >> 2 & 1);
  }
  return cube;
}

std::vector<dvec3> random_points(std::size_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal(0, 0.02);
  std::vector<dvec3> points;
  for (std::size_t i = 0; i < count; ++i) {
    dvec3 p = random_vector(uniform, random);
    if (i % 2 == 1) p = glm::clamp(dvec3(0.2, 0.3, 0.25) + random_vector(normal, random), 0.0, 1.0);
    points.push_back(p);
  }
  return points;
}

TestVolume make_test_volume(const std::vector<dvec3>& positions, const std::vector<std::vector<double>>& values,
                            const TestVolumeOptions& options) {
  std::vector<NodePath> paths;
  for (const dvec3& p : positions) paths.push_back(path_of(p, options.cube));
  const std::vector<Level> levels = reduce(positions, paths, options);
  const Indices order = file_order(levels, paths);
  Indices index_of(order.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) index_of[order[i]] = i;

  TestVolume volume;
  volume.position_error = options.position_error;
  volume.info = info_of(static_cast<int>(values.size()), options);
  volume.info.position_error = options.position_error;
  for (const std::uint32_t i : order) {
    volume.positions.push_back(positions[i]);
    volume.point_paths.push_back(paths[i]);
  }
  for (const Level& level : levels) {
    volume.info.resolution_counts.push_back(level.points.size());
    volume.info.points_per_chunk.push_back(options.points_per_chunk);
    auto& representatives = volume.representatives.emplace_back();
    for (const std::uint32_t i : order) representatives.push_back(index_of[level.representatives[i]]);
    auto& depths = volume.depths.emplace_back();
    auto& counts = volume.counts.emplace_back();
    for (std::size_t i = 0; i < level.points.size(); ++i) {
      depths.push_back(level.depths[order[i]]);
      counts.push_back(level.counts[order[i]]);
    }
  }
  fill_attributes(values, order, options.value_offset, volume);

  if (options.gradients) fill_gradients(volume);
  if (options.moments) {
    fill_parcels(volume);
    fill_moments(volume);
  }

  volume.tree.shape = {volume.info.resolutions(), volume.info.size_bounds.size(), values.size()};
  Indices all(positions.size());
  std::iota(all.begin(), all.end(), 0u);
  add_node({}, all, options.node_points, volume);
  return volume;
}

TestVolume volume_of_x(std::size_t count, std::uint32_t seed) {
  const auto points = random_points(count, seed);
  std::vector<double> values;
  for (const dvec3& p : points) values.push_back(p.x);
  return make_test_volume(points, {values});
}

Result<std::unique_ptr<format::VolumeWriter>> create_writer(const TestVolume& volume, const std::string& path) {
  SPLATVOL_TRY_ASSIGN(index, pack_tree(volume.tree));
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path));
  auto writer = format::VolumeWriter::create(std::move(file), 0, volume.info, std::move(index),
                                             std::filesystem::temp_directory_path());
  if (writer) (*writer)->set_boundary(volume.boundary);
  if (writer && volume.cells)
    (*writer)->set_cells(
        [cells = *volume.cells](std::shared_ptr<const format::ChunkSource> chunks, const format::AppendBytes& append) {
          return write_test_cells(cells, std::move(chunks), append);
        });
  return writer;
}

Status write_test_volume(const TestVolume& volume, const std::string& path, format::WriteCells write_cells) {
  SPLATVOL_TRY_ASSIGN(writer, create_writer(volume, path));
  if (write_cells) writer->set_cells(std::move(write_cells));
  for (std::uint64_t row = 0; row < writer->rows().row_count(); ++row) {
    std::vector<format::ChunkEntry> entries;
    format::Bytes bytes;
    for (const format::PackedChunk& chunk : pack_row(volume, writer->rows(), row)) {
      entries.push_back(chunk.entry);
      bytes.insert(bytes.end(), chunk.bytes.begin(), chunk.bytes.end());
    }
    SPLATVOL_TRY(writer->append_row(entries, bytes));
  }
  return writer->finish(histograms_of(volume));
}

format::Bytes test_volume_bytes(const TestVolume& volume) {
  const TempFolder folder;
  if (!write_test_volume(volume, folder.path("a.svol"))) return {};
  return bytes_of(folder.read("a.svol"));
}

}  // namespace splatvol::test
