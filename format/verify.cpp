// Volume::verify: the whole-file check of spec/svol-1.md, section 10.
#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "format/volume.h"

namespace splatvol::format {

class Volume::Verifier {
 public:
  Verifier(const Volume& volume, const std::function<void(double)>& progress)
      : volume_(volume),
        info_(volume.info_),
        progress_(progress),
        present_(info_.attributes.size()),
        missing_(info_.attributes.size()) {}

  Status run() {
    SPLATVOL_TRY(check_footer());
    SPLATVOL_TRY(check_sections());
    SPLATVOL_TRY(check_index());
    SPLATVOL_TRY(check_rows());
    return check_counted_values();
  }

 private:
  Status check_footer() const {
    SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(volume_.file_bytes() - sizeof(Footer), sizeof(Footer)));
    const auto footer = read_record<Footer>(bytes, 0);
    const std::uint64_t table_bytes = sizeof(Superblock) + volume_.sections_.size() * sizeof(SectionEntry);
    if (!std::ranges::equal(footer.magic, footer_magic) || footer.file_bytes != volume_.file_bytes() ||
        footer.table_hash != hash_bytes(std::span(volume_.preamble_).first(table_bytes)) ||
        footer.hash != hash_bytes(std::span(bytes).first(offsetof(Footer, hash))))
      return volume_.broken("footer: checksum mismatch");
    return {};
  }

  // The hash covers sections of unknown kinds too. An extent has no hash: those of its parts cover it.
  Status check_sections() const {
    for (const SectionEntry& section : volume_.sections_) {
      if (section.codec == Codec::extent) continue;
      SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(section.offset, section.packed_bytes));
      if (hash_bytes(bytes) != section.hash)
        return fail(ErrorCode::invalid_data, "{}: section {}: checksum mismatch", volume_.name(),
                    static_cast<std::uint32_t>(section.kind));
    }
    return {};
  }

  Status check_index() {
    SPLATVOL_TRY_ASSIGN(root, volume_.read_index_root(-1));
    SPLATVOL_TRY(check_summaries(volume_.root_ref(), volume_.find_section(SectionKind::index_root)->offset, root));
    SPLATVOL_TRY(check_forest(root, 0));

    std::ranges::sort(pages_);
    std::uint64_t next = 0;
    for (const auto& [offset, bytes] : pages_) {
      if (offset != next) return volume_.broken(untiled_index);
      next += bytes;
    }
    if (next != index_section().packed_bytes) return volume_.broken(untiled_index);
    return {};
  }

  // The nodes of a page are in breadth-first order, so one pass finds the depth of each node before those of its
  // children.
  Status check_forest(const IndexPage& page, std::size_t depth) {
    std::vector<std::size_t> depths(page.nodes.size(), depth);
    for (std::size_t node = 0; node < page.nodes.size(); ++node) {
      if (depths[node] > max_node_depth)
        return fail(ErrorCode::invalid_data, "{}: the index is deeper than {}", volume_.name(), max_node_depth);
      const std::uint8_t mask = page.nodes.child_masks[node];
      if (page.links[node] != IndexPage::no_node)
        SPLATVOL_TRY(
            check_linked_page(page.pages[page.links[node]], mask, page.nodes.counts_of(node), depths[node] + 1));
      else if (mask != 0)
        std::fill_n(depths.begin() + page.first_children[node], std::popcount(mask), depths[node] + 1);
    }
    return {};
  }

  // Limits the walk to the bytes of the section: in a damaged file, many links to one page could make it endless.
  Status check_linked_page(const IndexPageRef& ref, std::uint8_t mask, std::span<const std::uint64_t> counts,
                           std::size_t depth) {
    pages_.emplace_back(ref.offset, ref.page_bytes);
    page_bytes_ += ref.page_bytes;
    if (page_bytes_ > index_section().packed_bytes) return volume_.broken(untiled_index);
    SPLATVOL_TRY_ASSIGN(forest, volume_.read_index_page(ref, mask, counts, -1));
    SPLATVOL_TRY(check_summaries(ref, index_section().offset + ref.offset, forest));
    return check_forest(forest, depth);
  }

  Status check_summaries(const IndexPageRef& ref, std::uint64_t offset, IndexPage& page) const {
    SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(offset, ref.page_bytes));
    for (std::size_t attribute = 0; attribute < info_.attributes.size(); ++attribute) {
      const auto [part_offset, part] = find_summary_part(bytes, attribute, volume_.node_shape());
      const auto packed = std::span<const std::byte>(bytes).subspan(part_offset, part.packed_bytes);
      SPLATVOL_TRY(unpack_summaries(part, packed, volume_.name() + ": index page", page));
    }
    return {};
  }

  Status check_rows() {
    const RowLayout& rows = volume_.rows_;
    const SectionEntry& section = *volume_.find_section(SectionKind::rows);
    std::uint64_t next = section.offset;
    for (std::uint64_t page_index = 0; page_index < volume_.directory_refs_.size(); ++page_index) {
      SPLATVOL_TRY_ASSIGN(page, volume_.read_directory_page(page_index));
      const std::uint64_t last_row = std::min(rows.row_count(), page.first_row + info_.rows_per_directory_page);
      std::size_t chunk = 0;
      for (std::uint64_t row = page.first_row; row < last_row; ++row) {
        const Group group = rows.group(rows.group_of_row(row));
        for (const int column : rows.columns_of_row(row)) {
          const ChunkLocation& location = page.chunks[chunk++];
          if (location.offset != next) return volume_.broken("chunks do not tile the rows [R12]");
          next += location.entry.packed_bytes;
          SPLATVOL_TRY(check_chunk(location, info_.columns[static_cast<std::size_t>(column)], group.count));
        }
        progress_(static_cast<double>(next - section.offset) / static_cast<double>(section.packed_bytes));
      }
    }
    if (next != section.offset + section.packed_bytes) return volume_.broken("chunks do not tile the rows [R12]");
    return {};
  }

  Status check_chunk(const ChunkLocation& location, const Column& column, std::uint32_t points) {
    SPLATVOL_TRY_ASSIGN(packed, volume_.read_bytes(location.offset, location.entry.packed_bytes));
    const std::string what = fmt::format("{}: chunk at {}", volume_.name(), location.offset);
    switch (column.kind) {
      case ColumnKind::position:
        return check_positions(location.entry, packed, points, what);
      case ColumnKind::value:
        return check_values(location.entry, packed, points, static_cast<std::size_t>(column.attribute), what);
      case ColumnKind::octant: {
        std::vector<std::uint8_t> depths(points), counts(points);
        return unpack_octants(location.entry, packed, depths, counts, what);
      }
      case ColumnKind::centroid: {
        std::vector<dvec3> centroids(points);
        return unpack_positions(location.entry, packed, centroids, what);
      }
      case ColumnKind::moments: {
        std::vector<SplatShape> shapes(points);
        return unpack_moments(location.entry, packed, shapes, what);
      }
      case ColumnKind::value_moments: {
        std::vector<SplatValue> values(points);
        return unpack_value_moments(location.entry, packed, values, what);
      }
      case ColumnKind::gradient: {
        std::vector<vec3> directions(points);
        return unpack_gradients(location.entry, packed, directions, what);
      }
      case ColumnKind::unknown:
        break;
    }
    // Chunks of unknown kinds cannot be decoded.
    if (hash_bytes(packed) != location.entry.hash) return fail(ErrorCode::invalid_data, "{}: checksum mismatch", what);
    return {};
  }

  Status check_positions(const ChunkEntry& entry, std::span<const std::byte> packed, std::uint32_t points,
                         const std::string& what) const {
    std::vector<dvec3> positions(points);
    SPLATVOL_TRY(unpack_positions(entry, packed, positions, what));
    SPLATVOL_TRY_ASSIGN(error, stated_position_error(entry, packed));
    const dvec3 low = info_.cube.origin - error;
    const dvec3 high = info_.cube.origin + info_.cube.edge + error;
    for (const dvec3& p : positions)
      for (int axis = 0; axis < 3; ++axis)
        if (p[axis] < low[axis] || p[axis] > high[axis])
          return fail(ErrorCode::invalid_data, "{}: a point lies outside of the cube", what);
    return {};
  }

  Status check_values(const ChunkEntry& entry, std::span<const std::byte> packed, std::uint32_t points,
                      std::size_t attribute, const std::string& what) {
    std::vector<float> values(points);
    SPLATVOL_TRY(unpack_values(entry, packed, values, what));
    const ValueBins bins = bins_of(info_.attributes[attribute]);
    const ValueSummary summary = bins.summarize(values);
    if (summary.min != entry.min || summary.max != entry.max || summary.occupancy != entry.occupancy)
      return fail(ErrorCode::invalid_data, "{}: range or occupancy is wrong", what);
    for (const float value : values) {
      if (std::isnan(value))
        ++missing_[attribute];
      else
        ++present_[attribute];
    }
    return {};
  }

  Status check_counted_values() const {
    SPLATVOL_TRY_ASSIGN(histograms, volume_.read_histograms());
    for (std::size_t attribute = 0; attribute < info_.attributes.size(); ++attribute) {
      if (info_.find_column(ColumnKind::value, static_cast<int>(attribute)) < 0) continue;
      // Rounding moves values between bins, but not into or out of all of them.
      const auto in_bins = [](const auto& bins) { return std::reduce(bins.begin(), bins.end()); };
      if (missing_[attribute] != info_.attributes[attribute].missing ||
          (!histograms.empty() && present_[attribute] != in_bins(histograms[attribute])))
        return fail(ErrorCode::invalid_data, "{}: histogram or number of missing values of '{}' is wrong",
                    volume_.name(), info_.attributes[attribute].name);
    }
    return {};
  }

  const SectionEntry& index_section() const { return *volume_.find_section(SectionKind::index_pages); }

  static constexpr const char* untiled_index = "index pages do not tile their section [R16]";

  const Volume& volume_;
  const VolumeInfo& info_;
  const std::function<void(double)>& progress_;
  std::vector<std::pair<std::uint64_t, std::uint64_t>> pages_;  // offset, bytes
  std::uint64_t page_bytes_ = 0;                                // of all in pages_
  std::vector<std::uint64_t> present_;                          // values that were read, by attribute
  std::vector<std::uint64_t> missing_;                          // by attribute
};

Status Volume::verify(const std::function<void(double)>& progress) const { return Verifier(*this, progress).run(); }

}  // namespace splatvol::format
