#include "tests/support/explorer.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "format/cell_reader.h"
#include "format/ranked_points.h"

namespace splatvol::test {

using namespace format;

namespace {

constexpr std::uint64_t most_rows = 500;
constexpr std::size_t most_patches = 20;

class Explorer {
 public:
  explicit Explorer(const Volume& volume) : volume_(volume) {}

  Exploration read_everything() {
    for (int attribute = -1; attribute < static_cast<int>(volume_.info().attributes.size()); ++attribute) {
      const auto root = volume_.read_index_root({attribute});
      note(root.has_value());
      if (root) walk(*root, attribute, 0);
    }
    note(volume_.read_histograms().has_value());
    read_patches();
    read_cells();
    const std::uint64_t rows = std::min(volume_.rows().row_count(), most_rows);
    for (std::uint64_t row = 0; row < rows; ++row)
      for (const int column : volume_.rows().columns_of_row(row)) read_chunk(row, column);
    return result_;
  }

 private:
  void note(bool read) { result_.all_read = result_.all_read && read; }
  void require(bool holds, const char* promise) {
    if (!holds) result_.broken = promise;
  }

  void read_patches() {
    const std::size_t count = volume_.info().boundary ? volume_.info().boundary->patches.size() : 0;
    for (std::size_t patch = 0; patch < std::min<std::size_t>(count, most_patches); ++patch) {
      const auto mesh = volume_.read_boundary({&patch, 1});
      note(mesh.has_value());
      if (!mesh) continue;
      require(std::ranges::all_of(mesh->triangles,
                                  [&](const auto& corners) { return std::ranges::max(corners) < mesh->points.size(); }),
              "triangles name points that are there");
      require(std::ranges::all_of(mesh->points,
                                  [](const dvec3& p) { return std::abs(p.x) <= 1e50 && std::abs(p.y) <= 1e50; }),
              "positions are in range");
    }
  }

  void read_cells() {
    const auto cells = CellReader::open(volume_);
    note(cells.has_value());
    if (!cells || !*cells) return;
    const CellReader& reader = **cells;
    require(reader.memory_bytes() <= volume_.file_bytes(), "a root takes no more memory than bytes");
    require(reader.directory_bytes() + reader.rank_bytes() <= reader.section_bytes(), "parts are in the section");
    RankedPoints points(reader, own_room(std::uint64_t{1} << 20));
    std::uint64_t chunks = 0;
    for (std::size_t page = 0; page < std::min<std::size_t>(reader.rank_page_count(), most_rows); ++page)
      note(reader.read_rank_page(page).has_value());
    for (std::size_t page = 0; page < std::min<std::size_t>(reader.vertex_page_count(), most_rows); ++page)
      note(reader.read_vertex_page(page).has_value());
    for (std::size_t page = 0; page < std::min<std::size_t>(reader.pages().size(), most_rows); ++page) {
      for (int attribute = 0; attribute < static_cast<int>(volume_.info().attributes.size()); ++attribute) {
        const auto read = reader.read_page(page, {attribute, attribute});
        note(read.has_value());
        if (!read) continue;
        require(read->summaries.size() == read->chunks.size(), "a summary for each chunk");
        require(read->opacity_summaries.size() == read->chunks.size(), "a summary of the opacity for each chunk");
      }
      const auto read = reader.read_page(page, {});
      note(read.has_value());
      if (!read) continue;
      require(read->chunks.size() == reader.pages()[page].chunks, "a page has its chunks");
      require(read->summaries.empty(), "no summaries that no one asks for");
      for (const CellChunkEntry& entry : read->chunks)
        if (++chunks <= most_rows) read_cells(reader, entry, points);
    }
  }

  void read_cells(const CellReader& reader, const CellChunkEntry& entry, RankedPoints& points) {
    note(reader.check_bytes(entry).has_value());
    if (!is_known(entry.shape, entry.field)) return;
    const auto cells = reader.read_chunk(entry);
    note(cells.has_value());
    if (!cells) return;
    const bool is_constant = entry.field == CellField::constant;
    const std::uint64_t points_end = volume_.info().resolution_counts.back();
    require(cells->size() == entry.cells, "a chunk has its cells");
    require(cells->points.size() == (is_constant ? entry.cells : 0), "cells of a constant field have a point");
    for (const std::uint64_t point : cells->points) require(point < points_end, "cells have points of the file");
    for (std::size_t cell = 0; cell < cells->size(); ++cell) {
      const auto corners = cells->corners_at(cell);
      if (cells->shape == CellShape::polyhedron) {
        require(cells->splits[cell] < corners.size(), "apexes exist");
        for (const auto& [a, b, c] : cells->triangles_at(cell))
          require(std::max({a, b, c}) < corners.size(), "triangles have corners of the polyhedron");
      } else {
        require(is_split(cells->shape, cells->split_at(cell)), "splits exist");
      }
      for (std::size_t k = 0; k < corners.size(); ++k) {
        require(corners[k] < (is_constant ? reader.vertex_count() : points_end), "corners are there");
        require(std::ranges::find(corners.subspan(k + 1), corners[k]) == corners.end(), "no corner appears twice");
      }
    }
    const LocalCells local = number_corners(cells->corners);
    if (is_constant) return read_values(cells->points, points);
    std::vector<RankedPoints::Place> places;
    std::vector<dvec3> positions;
    std::vector<float> values;
    const Status found = points.find(local.ranks, places);
    note(found.has_value());
    if (!found) return;
    for (const RankedPoints::Place& place : places)
      require(place.index < volume_.rows().group(place.group).count, "points are in their groups");
    const Status read = points.read_positions(places, positions);
    note(read.has_value());
    if (read) require(std::isfinite(measure_cells(*cells, local, positions).area), "areas are finite");
    for (std::size_t a = 0; a < volume_.info().attributes.size(); ++a) {
      if (volume_.info().find_column(ColumnKind::value, static_cast<int>(a)) < 0) continue;
      const Status got = points.read_values(places, static_cast<int>(a), values);
      note(got.has_value());
      if (!got) continue;
      const ValueSummary summary = summarize_cells(*cells, local, values, bins_of(volume_.info().attributes[a]));
      require(summary.is_valid(), "ranges are valid");
    }
  }

  void read_values(std::span<const std::uint64_t> ranks, RankedPoints& points) {
    std::vector<RankedPoints::Place> places;
    std::vector<float> values;
    const Status found = points.find(ranks, places);
    note(found.has_value());
    for (std::size_t a = 0; found && a < volume_.info().attributes.size(); ++a)
      note(points.read_values(places, static_cast<int>(a), values).has_value());
  }

  void walk(const IndexPage& page, int attribute, int pages_deep) {
    require(page.nodes.summaries.size() == (attribute < 0 ? 0 : page.nodes.size()), "a summary for each node");
    require(page.memory_bytes() > 0, "a page takes memory");
    for (std::size_t node = 0; node < page.nodes.size(); ++node) {
      const auto children = static_cast<std::uint32_t>(std::popcount(page.nodes.child_masks[node]));
      if (page.first_children[node] != IndexPage::no_node) {
        require(page.first_children[node] > node, "children follow their parent");
        require(page.first_children[node] + children <= page.nodes.size(), "children are in the page");
      }
      if (page.links[node] == IndexPage::no_node || pages_deep > 100 || ++pages_ > 200) continue;
      const auto child = volume_.read_index_page(page.pages[page.links[node]], page.nodes.child_masks[node],
                                                 page.nodes.counts_of(node), {attribute});
      note(child.has_value());
      if (child) walk(*child, attribute, pages_deep + 1);
    }
  }

  void read_chunk(std::uint64_t row, int column) {
    const std::uint64_t number = volume_.directory_page_of_row(row, column);
    if (number != page_number_) {
      page_number_ = number;
      page_ = volume_.read_directory_page(number);
      note(page_.has_value());
    }
    if (!page_) return;
    const ChunkLocation& location = volume_.find_chunk(*page_, row, column);
    const auto packed = volume_.read_bytes(location.offset, location.entry.packed_bytes);
    note(packed.has_value());
    if (!packed) return;
    const Group group = volume_.rows().group(volume_.rows().group_of_row(row));
    const ColumnKind kind = volume_.info().columns[static_cast<std::size_t>(column)].kind;
    note(unpack_chunk(kind, location.entry, *packed, group.count).has_value());
  }

  Status unpack_chunk(ColumnKind kind, const ChunkEntry& entry, const Bytes& packed, std::size_t points) const {
    const Cube& cube = volume_.info().cube;
    const auto into_lengths = [&](auto element, auto unpack, const auto& bound) {
      std::vector<decltype(element)> out(points);
      return unpack(entry, packed, out, bound, "test");
    };
    const auto into = [&](auto element, auto unpack) {
      std::vector<decltype(element)> out(points);
      return unpack(entry, packed, out, "test");
    };
    std::vector<std::uint8_t> depths(points), counts(points);
    switch (kind) {
      case ColumnKind::position:
        return into_lengths(dvec3(), unpack_positions, cube);
      case ColumnKind::centroid:
        return into_lengths(dvec3(), unpack_centroids, cube);
      case ColumnKind::value:
        return into(float(), unpack_values);
      case ColumnKind::octant:
        return unpack_octants(entry, packed, depths, counts, "test");
      case ColumnKind::moments:
        return into_lengths(SplatShape(), unpack_moments, cube.edge);
      case ColumnKind::value_moments:
        return into(SplatValue(), unpack_value_moments);
      case ColumnKind::gradient:
        return into(vec3(), unpack_gradients);
      case ColumnKind::unknown:
        break;
    }
    return {};
  }

  const Volume& volume_;
  Exploration result_;
  int pages_ = 0;
  std::uint64_t page_number_ = ~std::uint64_t{0};
  Result<DirectoryPage> page_ = DirectoryPage();
};

}  // namespace

Exploration explore_volume(const Volume& volume) {
  if (!volume.series()) return Explorer(volume).read_everything();
  Exploration all;
  const std::size_t steps = std::min<std::size_t>(volume.series()->steps.size(), 4);
  for (std::size_t step = 0; step < steps; ++step) {
    const auto at_step = volume.at_step(step);
    const Exploration one = at_step ? Explorer(**at_step).read_everything() : Exploration{false, ""};
    all.all_read = all.all_read && one.all_read;
    if (!one.broken.empty()) all.broken = one.broken;
  }
  return all;
}

}  // namespace splatvol::test
