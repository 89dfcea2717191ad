#include "tests/support/test_volume.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numeric>
#include <random>
#include <tuple>

#include "base/file.h"
#include "format/volume_writer.h"

namespace splatvol::test {
namespace {

constexpr std::size_t key_levels = 42;

using Indices = std::vector<std::uint32_t>;

// Spec 7, word for word.
CellPath path_of(const dvec3& point, const Cube& cube) {
  std::array<std::uint64_t, 3> cell{};
  for (int axis = 0; axis < 3; ++axis) {
    const double scaled = std::floor((point[axis] - cube.origin[axis]) / cube.edge * 0x1p42);
    cell[static_cast<std::size_t>(axis)] = static_cast<std::uint64_t>(std::clamp(scaled, 0.0, 0x1p42 - 1));
  }
  CellPath path;
  for (std::size_t level = key_levels; level-- > 0;)
    path.push_back(static_cast<std::uint8_t>(((cell[0] >> level) & 1) | ((cell[1] >> level) & 1) << 1 |
                                             ((cell[2] >> level) & 1) << 2));
  return path;
}

bool begins_with(const CellPath& path, const CellPath& cell) {
  return std::equal(cell.begin(), cell.end(), path.begin());
}

struct Leaf {
  CellPath cell;
  Indices points;
};

// Leaves, in Morton order, of the octree over `points` with at most `most` points in a leaf.
void collect_leaves(const std::vector<CellPath>& paths, const Indices& points, const CellPath& cell, std::size_t most,
                    std::vector<Leaf>& leaves) {
  if (points.empty()) return;
  if (points.size() <= most || cell.size() == key_levels) return leaves.push_back({cell, points});
  for (std::uint8_t octant = 0; octant < 8; ++octant) {
    Indices inside;
    std::ranges::copy_if(points, std::back_inserter(inside),
                         [&](std::uint32_t i) { return paths[i][cell.size()] == octant; });
    CellPath child = cell;
    child.push_back(octant);
    collect_leaves(paths, inside, child, most, leaves);
  }
}

std::uint32_t nearest_to_centre(const std::vector<dvec3>& positions, const Leaf& leaf, const Cube& root) {
  const Cube cube = cell_cube(root, leaf.cell);
  const dvec3 centre = cube.origin + 0.5 * cube.edge;
  return *std::ranges::min_element(leaf.points, {}, [&](std::uint32_t i) {
    return std::pair(glm::dot(positions[i] - centre, positions[i] - centre), i);
  });
}

// One resolution while the order of points is still the input's.
struct Level {
  Indices points;
  Indices representatives;                   // [input point]
  std::vector<std::uint8_t> depths, counts;  // [input point], of those in `points`
};

std::vector<Level> reduce(const std::vector<dvec3>& positions, const std::vector<CellPath>& paths,
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
      next.points.push_back(nearest_to_centre(positions, leaf, options.cube));
      for (const std::uint32_t i : leaf.points) {
        kept[i] = next.points.back();
        level.depths[i] = static_cast<std::uint8_t>(leaf.cell.size());
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

// File order: by the first resolution that has the point, then along the Morton curve.
Indices file_order(const std::vector<Level>& levels, const std::vector<CellPath>& paths) {
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
    volume.info.columns.push_back({format::ColumnKind::value, format::ColumnScope::segment, static_cast<int>(a)});
    volume.stored.push_back(std::move(stored));
  }
}

// The coarsest resolution from which on every cluster is wholly inside or wholly outside.
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

void add_node(const CellPath& cell, const Indices& points, std::size_t most, TestVolume& volume) {
  const std::size_t resolutions = volume.info.resolutions();
  const auto& ends = volume.info.resolution_counts;
  format::NodeArrays& tree = volume.tree;
  std::vector<bool> inside(volume.positions.size());
  for (const std::uint32_t i : points) inside[i] = true;

  const std::size_t node = tree.size();
  volume.cells.push_back(cell);
  tree.child_masks.push_back(0);
  tree.first_resolutions.push_back(static_cast<std::uint8_t>(first_resolution(volume, inside)));
  tree.counts.resize((node + 1) * resolutions);
  tree.size_codes.resize((node + 1) * resolutions);
  for (const std::uint32_t i : points) {
    const auto segment = static_cast<std::size_t>(std::ranges::upper_bound(ends, i) - ends.begin());
    ++tree.counts[node * resolutions + segment];
  }
  for (std::size_t r = tree.first_resolutions.back(); r < resolutions; ++r) {
    std::uint8_t& code = tree.size_codes[node * resolutions + r] = 255;
    for (const std::uint32_t i : points)
      if (i < ends[r]) code = std::min(code, format::size_code(volume.splat_size(r, i), volume.info.cube.edge));
  }
  for (std::size_t a = 0; a < volume.stored.size(); ++a) {
    std::vector<float> values;
    for (const std::uint32_t i : points) values.push_back(volume.stored[a][i]);
    tree.summaries.push_back(bins_of(volume.info.attributes[a]).summarize(values));
  }

  if (points.size() <= most || cell.size() == key_levels) return;
  for (std::uint8_t octant = 0; octant < 8; ++octant) {
    CellPath child = cell;
    child.push_back(octant);
    Indices part;
    std::ranges::copy_if(points, std::back_inserter(part),
                         [&](std::uint32_t i) { return begins_with(volume.point_cells[i], child); });
    if (part.empty()) continue;
    tree.child_masks[node] = static_cast<std::uint8_t>(tree.child_masks[node] | 1u << octant);
    add_node(child, part, most, volume);
  }
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
      chunks.push_back(format::pack_values(part(volume.stored[a]), bins_of(volume.info.attributes[a])));
    if (column.kind == format::ColumnKind::octant)
      chunks.push_back(format::pack_octants(part(volume.depths[resolution]), part(volume.counts[resolution])));
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

double TestVolume::splat_size(std::size_t resolution, std::size_t point) const {
  return info.cube.edge * std::exp2(-static_cast<double>(depths[resolution][point])) /
         std::cbrt(counts[resolution][point]);
}

bool TestVolume::holds(std::size_t node, std::size_t point) const {
  return begins_with(point_cells[point], cells[node]);
}

Cube cell_cube(const Cube& root, const CellPath& path) {
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
    dvec3 p(uniform(random), uniform(random), uniform(random));
    if (i % 2 == 1)
      p = glm::clamp(dvec3(0.2, 0.3, 0.25) + dvec3(normal(random), normal(random), normal(random)), 0.0, 1.0);
    points.push_back(p);
  }
  return points;
}

TestVolume make_test_volume(const std::vector<dvec3>& positions, const std::vector<std::vector<double>>& values,
                            const TestVolumeOptions& options) {
  std::vector<CellPath> paths;
  for (const dvec3& p : positions) paths.push_back(path_of(p, options.cube));
  const std::vector<Level> levels = reduce(positions, paths, options);
  const Indices order = file_order(levels, paths);
  Indices place(order.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) place[order[i]] = i;

  TestVolume volume;
  volume.position_error = options.position_error;
  volume.info.cube = options.cube;
  volume.info.points_per_chunk = options.points_per_chunk;
  volume.info.leaf_points = options.leaf_points;
  volume.info.columns.push_back({format::ColumnKind::position, format::ColumnScope::segment, -1});
  volume.info.columns.push_back({format::ColumnKind::octant, format::ColumnScope::resolution, -1});
  for (const std::uint32_t i : order) {
    volume.positions.push_back(positions[i]);
    volume.point_cells.push_back(paths[i]);
  }
  for (const Level& level : levels) {
    volume.info.resolution_counts.push_back(level.points.size());
    auto& representatives = volume.representatives.emplace_back();
    for (const std::uint32_t i : order) representatives.push_back(place[level.representatives[i]]);
    auto& depths = volume.depths.emplace_back();
    auto& counts = volume.counts.emplace_back();
    for (std::size_t i = 0; i < level.points.size(); ++i) {
      depths.push_back(level.depths[order[i]]);
      counts.push_back(level.counts[order[i]]);
    }
  }
  fill_attributes(values, order, options.value_offset, volume);

  volume.tree.shape = {volume.info.resolutions(), 1, values.size()};
  Indices all(positions.size());
  std::iota(all.begin(), all.end(), 0u);
  add_node({}, all, options.node_points, volume);
  return volume;
}

Status write_test_volume(const TestVolume& volume, const std::string& path) {
  SPLATVOL_TRY_ASSIGN(writer, format::VolumeWriter::create(path, volume.info, volume.tree));
  for (std::uint64_t row = 0; row < writer->rows().row_count(); ++row)
    SPLATVOL_TRY(writer->append_row(pack_row(volume, writer->rows(), row)));
  return writer->finish(histograms_of(volume));
}

format::Bytes test_volume_bytes(const TestVolume& volume) {
  static int serial = 0;
  const auto path =
      std::filesystem::temp_directory_path() / fmt::format("splatvol_test_{}_{}.svol", ::getpid(), serial++);
  if (!write_test_volume(volume, path.string())) return {};
  const auto text = read_text_file(path.string());
  std::filesystem::remove(path);
  if (!text) return {};
  const auto bytes = std::as_bytes(std::span(*text));
  return {bytes.begin(), bytes.end()};
}

}  // namespace splatvol::test
