#include "streamer/splats/occlusion.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "format/columns.h"

namespace splatvol {
namespace {

using format::ColumnKind;
using format::IndexPage;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double smallest_edge = 6;  // of cubes that may hide others, in distances between rays

// Share of a cube's volume. A point owns the space nearest to it, also beyond the border of its node: so a little mass
// may be missing by chance.
constexpr double least_filling = 0.95;

// Returns the finest resolution whose rows are all in the preamble.
std::optional<std::size_t> find_finest_held(const format::Volume& volume, const format::DirectoryPage& directory) {
  const format::RowLayout& rows = volume.rows();
  std::optional<std::size_t> finest;
  for (std::size_t r = 0; r < volume.info().resolutions(); ++r) {
    const std::uint64_t last = rows.first_row(r + 1) - 1;
    if (volume.directory_page_of_row(last) > 0) break;
    const format::ChunkLocation& location =
        volume.find_chunk(directory, last, volume.columns_of_row(directory, last).back());
    if (location.offset + location.entry.packed_bytes > volume.preamble_bytes()) break;
    finest = r;
  }
  return finest;
}

// Returns sums: [i] is the mass of the first i splats of a resolution.
Result<std::vector<double>> sum_masses(const format::Volume& volume, const format::DirectoryPage& directory,
                                       std::size_t resolution, int column) {
  const format::RowLayout& rows = volume.rows();
  std::vector<double> sums{0};
  std::vector<SplatShape> shapes;
  for (std::uint64_t row = rows.first_row(resolution); row < rows.first_row(resolution + 1); ++row) {
    const format::ChunkLocation& location = volume.find_chunk(directory, row, column);
    SPLATVOL_TRY_ASSIGN(packed, volume.read_bytes(location.offset, location.entry.packed_bytes));
    shapes.resize(rows.group(rows.group_of_row(row)).count);
    SPLATVOL_TRY(format::unpack_moments(location.entry, packed, shapes, volume.info().cube.edge, volume.name()));
    for (const SplatShape& shape : shapes) sums.push_back(sums.back() + shape.mass);
  }
  return sums;
}

// The masses of a resolution: of the finest in the preamble.
struct Masses {
  std::size_t resolution;
  std::vector<double> sums;  // as of sum_masses

  double of(std::span<const std::uint64_t> begins, std::span<const std::uint64_t> counts) const {
    double mass = 0;
    for (std::size_t s = 0; s < begins.size(); ++s)
      mass += sums[static_cast<std::size_t>(begins[s] + counts[s])] - sums[static_cast<std::size_t>(begins[s])];
    return mass;
  }
};

// Returns nothing if the preamble lacks a whole resolution or is damaged.
std::optional<Masses> find_masses(const format::Volume& volume, int column) {
  const auto directory = volume.read_directory_page(0);
  if (!directory) return std::nullopt;
  const auto resolution = find_finest_held(volume, *directory);
  if (!resolution) return std::nullopt;
  auto sums = sum_masses(volume, *directory, *resolution, column);
  if (!sums) return std::nullopt;
  return Masses{*resolution, std::move(*sums)};
}

}  // namespace

FilledNodes FilledNodes::find(const format::Volume& volume, const format::IndexPage& root,
                              const format::SummaryAttributes& attributes) {
  const format::VolumeInfo& info = volume.info();
  const int column = info.find_column(ColumnKind::moments);
  if (column < 0) return {};
  for (const int attribute : {attributes.values, attributes.opacity})
    if (attribute >= 0 && info.attributes[static_cast<std::size_t>(attribute)].missing > 0) return {};
  const std::optional<Masses> masses = find_masses(volume, column);
  if (!masses) return {};

  // Down the page, as NodeTree goes: the points of a child begin behind those of the siblings before it.
  const format::NodeArrays& nodes = root.nodes;
  const std::size_t segments = masses->resolution + 1;
  FilledNodes found;
  found.filled_.resize(nodes.size());
  std::vector<double> volumes(nodes.size());
  std::vector<std::uint64_t> begins(nodes.size() * segments);
  volumes[0] = info.cube.edge * info.cube.edge * info.cube.edge;
  for (std::size_t s = 1; s < segments; ++s) begins[s] = info.resolution_counts[s - 1];
  for (std::uint32_t node = 0; node < nodes.size(); ++node) {
    const auto begin = std::span(begins).subspan(node * segments, segments);
    if (nodes.first_resolutions[node] <= masses->resolution)
      found.filled_[node] = masses->of(begin, nodes.counts_of(node)) >= least_filling * volumes[node];
    std::uint32_t child = root.first_children[node];
    if (child == IndexPage::no_node) continue;
    std::vector<std::uint64_t> next(begin.begin(), begin.end());
    for (int left = std::popcount(nodes.child_masks[node]); left > 0; --left, ++child) {
      volumes[child] = volumes[node] / 8;
      found.filled_[child] = found.filled_[node];  // kept if its own splats are too coarse to tell
      for (std::size_t s = 0; s < segments; ++s) {
        begins[child * segments + s] = next[s];
        next[s] += nodes.counts_of(child)[s];
      }
    }
  }
  return found;
}

Occlusion::Occlusion(const View& view)
    : view_(view), spacing_(std::max(1.0, 1.0 * std::max(view.width, view.height) / most_rays)) {
  columns_ = static_cast<int>(view.width / spacing_) + 1;
  rows_ = static_cast<int>(view.height / spacing_) + 1;
}

Occlusion::Rays Occlusion::rays_through(const Cube& cube, int margin) const {
  Rays rays{0, -1, 0, -1, infinity};
  dvec2 low(infinity), high(-infinity);  // pixels
  for (unsigned corner = 0; corner < 8; ++corner) {
    const dvec3 p = view_.to_view(cube.origin + cube.edge * dvec3(corner & 1, corner >> 1 & 1, corner >> 2));
    rays.near = std::min(rays.near, p.z);
    if (!(p.z > 0)) return rays;
    const double scale = view_.orthographic ? view_.focal : view_.focal / p.z;
    low = glm::min(low, scale * dvec2(p));
    high = glm::max(high, scale * dvec2(p));
  }
  const dvec2 middle = 0.5 * dvec2(view_.width, view_.height);
  const auto first = [&](double pixel) {
    return std::max(static_cast<int>(std::ceil(std::clamp(pixel / spacing_, -1e6, 1e6))) - margin, 0);
  };
  const auto last = [&](double pixel, int count) {
    return std::min(static_cast<int>(std::floor(std::clamp(pixel / spacing_, -1e6, 1e6))) + margin, count - 1);
  };
  rays.left = first(low.x + middle.x);
  rays.right = last(high.x + middle.x, columns_);
  rays.bottom = first(low.y + middle.y);
  rays.top = last(high.y + middle.y, rows_);
  return rays;
}

bool Occlusion::is_small(const Cube& cube) const {
  const double depth = view_.to_view(cube.origin + 0.5 * cube.edge).z;
  return cube.edge * (view_.orthographic ? view_.focal : view_.focal / depth) < smallest_edge * spacing_;
}

void Occlusion::add(const Cube& cube, double extinction) {
  const Rays rays = rays_through(cube, 0);
  if (rays.empty()) return;
  if (depths_.empty()) {
    depths_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), 0);
    closed_.assign(depths_.size(), infinity);
  }
  const dvec3 low = cube.origin - view_.eye, high = low + cube.edge;
  const dvec2 middle = 0.5 * dvec2(view_.width, view_.height);
  for (int row = rays.bottom; row <= rays.top; ++row) {
    const dvec3 upwards = (row * spacing_ - middle.y) / view_.focal * view_.up;
    for (int column = rays.left; column <= rays.right; ++column) {
      const auto ray = static_cast<std::size_t>(row * columns_ + column);
      if (depths_[ray] >= closed) continue;
      // The ray is origin + s direction, and s is the depth.
      const dvec3 across = (column * spacing_ - middle.x) / view_.focal * view_.right + upwards;
      const dvec3 origin = view_.orthographic ? across : dvec3(0);
      const dvec3 direction = view_.orthographic ? view_.forward : across + view_.forward;
      const dvec3 inverse = 1.0 / direction;
      const dvec3 a = (low - origin) * inverse, b = (high - origin) * inverse;
      const dvec3 enters = glm::min(a, b), leaves = glm::max(a, b);
      const double enter = std::max({enters.x, enters.y, enters.z}), leave = std::min({leaves.x, leaves.y, leaves.z});
      if (!(enter > 0 && leave > enter)) continue;
      const double rate = extinction * glm::length(direction), left = closed - depths_[ray];
      depths_[ray] += rate * (leave - enter);
      if (depths_[ray] < closed) continue;
      closed_[ray] = enter + left / rate;
      any_ = true;
    }
  }
}

bool Occlusion::hides(const Cube& cube) const {
  if (!any_) return false;
  const Rays rays = rays_through(cube, 1);
  if (rays.empty()) return false;
  for (int row = rays.bottom; row <= rays.top; ++row)
    for (int column = rays.left; column <= rays.right; ++column)
      if (!(closed_[static_cast<std::size_t>(row * columns_ + column)] <= rays.near)) return false;
  return true;
}

}  // namespace splatvol
