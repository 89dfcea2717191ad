#include "tests/support/volume_dump.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <span>
#include <vector>

#include "format/cell_reader.h"

namespace splatvol::test {
namespace {

using format::ColumnKind;

// Bytes of the text of the first numbers that stand beside a hash.
constexpr std::size_t shown_bytes = 120;

std::string number(double x) { return fmt::format("{:.9g}", x); }

// A number of at most 1, which rounding may have moved by its last digits of double precision.
std::string share(double x) { return fmt::format("{:.6f}", std::abs(x) < 5e-7 ? 0.0 : x); }

std::string vector(const dvec3& v) { return fmt::format("{} {} {}", number(v.x), number(v.y), number(v.z)); }

class Dump {
 public:
  Dump(const format::Volume& volume, bool all) : volume_(&volume), all_(all) {}

  Result<std::string> run() {
    const format::VolumeInfo& info = volume_->file_info();
    line("cube: {}, edge {}", vector(info.cube.origin), number(info.cube.edge));
    line("points: {}", fmt::join(info.resolution_counts, " "));
    line("points in a chunk: {}", info.points_per_chunk);
    line("reduction: {} {}", info.reduction_method, info.leaf_points);
    line("error of positions: {}", number(info.position_error));
    line("size bounds: {}", fmt::join(info.size_bounds, " "));
    line("up: {}", info.up);
    line("provenance: {}", info.provenance);
    SPLATVOL_TRY(add_boundary());
    if (!volume_->series()) {
      SPLATVOL_TRY(add_columns());
      SPLATVOL_TRY(add_cells());
      return text_;
    }
    for (const format::SeriesAttribute& attribute : *info.series)
      line("attribute of all steps: {} [{}]", attribute.name, attribute.unit);
    for (const format::StepRange& range : volume_->series()->ranges)
      line("range of all steps: {} {}", number(range.min), number(range.max));
    const format::Volume& series = *volume_;
    for (std::size_t step = 0; step < series.series()->steps.size(); ++step) {
      SPLATVOL_TRY_ASSIGN(at_step, series.at_step(step));
      volume_ = at_step.get();
      line("step {}: time {}", step, number(at_step->time()));
      SPLATVOL_TRY(add_columns());
    }
    return text_;
  }

 private:
  template <class... Args>
  void line(fmt::format_string<Args...> format, Args&&... args) {
    fmt::format_to(std::back_inserter(text_), format, std::forward<Args>(args)...);
    text_ += '\n';
  }

  // Adds a text as a whole, or its hash and its beginning.
  void add(const std::string& what, const std::string& numbers) {
    if (all_) return line("{}:\n{}", what, numbers);
    const std::string first = numbers.substr(0, numbers.find('\n')).substr(0, shown_bytes);
    line("{}: {:016x}, first {}", what, format::hash_bytes(std::as_bytes(std::span(numbers))), first);
  }

  Status add_boundary() {
    const auto& boundary = volume_->info().boundary;
    if (!boundary) return {};
    line("boundary: origin {}, step {}, error {}", vector(boundary->origin), number(boundary->quantisation_step),
         number(boundary->error));
    for (std::size_t patch = 0; patch < boundary->patches.size(); ++patch) {
      SPLATVOL_TRY_ASSIGN(mesh, volume_->read_boundary({&patch, 1}));
      std::string numbers;
      for (const dvec3& point : mesh.points) numbers += vector(point) + "\n";
      for (const auto& [a, b, c] : mesh.triangles) numbers += fmt::format("{} {} {}\n", a, b, c);
      std::string counts = fmt::format("{} points, {} triangles", mesh.points.size(), mesh.triangles.size());
      if (const auto count = std::ranges::count(mesh.two_sided, true)) counts += fmt::format(", {} two-sided", count);
      add(fmt::format("patch {}, {}", boundary->patches[patch].name, counts), numbers);
    }
    return {};
  }

  Status add_columns() {
    const format::VolumeInfo& info = volume_->info();
    for (const format::Attribute& a : info.attributes)
      line("attribute: {} [{}], offset {}, scale {}, from {} to {}, {} missing, error {}", a.name, a.unit,
           number(a.offset), number(a.scale), number(a.min), number(a.max), a.missing, number(a.error));
    for (const format::Alias& alias : info.aliases) line("alias: {} of attribute {}", alias.name, alias.attribute);
    for (const format::Column& column : info.columns)
      line("column: {} of attribute {}", format::column_kind_name(column.kind), column.attribute);
    SPLATVOL_TRY_ASSIGN(histograms, volume_->read_histograms());
    for (const format::Histogram& histogram : histograms) line("histogram: {}", fmt::join(histogram, " "));
    for (int attribute = -1; attribute < static_cast<int>(info.attributes.size()); ++attribute)
      SPLATVOL_TRY(add_index(attribute));
    for (std::uint64_t row = 0; row < volume_->rows().row_count(); ++row)
      for (const int column : volume_->rows().columns_of_row(row)) SPLATVOL_TRY(add_chunk(row, column));
    return {};
  }

  Status add_cells() {
    SPLATVOL_TRY_ASSIGN(cells, format::CellReader::open(*volume_));
    if (!cells) return {};
    line("cells: hash {:016x}", volume_->file_info().cells->hash);
    for (const format::CellKind& kind : cells->kinds())
      line("kind: {}, {}, {} cells, {} turned", format::cell_shape_name(kind.shape),
           format::cell_field_name(kind.field), kind.cells, kind.turned);
    std::string segments;
    for (std::size_t page = 0; page < cells->rank_page_count(); ++page) {
      SPLATVOL_TRY_ASSIGN(ranks, cells->read_rank_page(page));
      for (const std::uint8_t segment : ranks.segments) segments += fmt::format("{}\n", segment);
    }
    add("segments by rank", segments);
    for (std::size_t page = 0; page < cells->pages().size(); ++page) SPLATVOL_TRY(add_cell_page(*cells, page));
    return {};
  }

  Status add_cell_page(const format::CellReader& cells, std::size_t number_of_page) {
    const format::CellPageRef& ref = cells.pages()[number_of_page];
    line("page of cells: {} chunks, area {}", ref.chunks, number(ref.area));
    SPLATVOL_TRY_ASSIGN(page, cells.read_page(number_of_page, {}));
    std::vector<std::string> ranges(page.chunks.size());
    for (int a = 0; a < static_cast<int>(volume_->info().attributes.size()); ++a) {
      SPLATVOL_TRY_ASSIGN(read, cells.read_page(number_of_page, {a, -1}));
      for (std::size_t chunk = 0; chunk < ranges.size(); ++chunk) {
        const format::ValueSummary& summary = read.summaries[chunk];
        ranges[chunk] +=
            fmt::format(", from {:.9g} to {:.9g}, bins {:016x}", summary.min, summary.max, summary.occupancy);
      }
    }
    for (std::size_t chunk = 0; chunk < page.chunks.size(); ++chunk) {
      const format::CellChunkEntry& entry = page.chunks[chunk];
      const std::string what = fmt::format(
          "chunk of cells: {}, {} cells, {} points, low {}, high {}, area {}{}", format::cell_shape_name(entry.shape),
          entry.cells, entry.points, vector({entry.low[0], entry.low[1], entry.low[2]}),
          vector({entry.high[0], entry.high[1], entry.high[2]}), number(entry.area), ranges[chunk]);
      if (!format::is_known(entry.shape, entry.field)) {
        line("{}", what);
        continue;
      }
      SPLATVOL_TRY_ASSIGN(read, cells.read_chunk(entry));
      std::string numbers;
      for (std::size_t i = 0; i < read.size(); ++i) {
        numbers += fmt::format("{}", fmt::join(read.corners_at(i), " "));
        if (read.shape == format::CellShape::polyhedron)
          for (const auto& [a, b, c] : read.triangles_at(i)) numbers += fmt::format(" {}-{}-{}", a, b, c);
        if (!read.splits.empty()) numbers += fmt::format(" split {}", read.splits[i]);
        if (!read.points.empty()) numbers += fmt::format(" of point {}", read.points[i]);
        numbers += '\n';
      }
      add(what, numbers);
    }
    return {};
  }

  Status add_index(int attribute) {
    SPLATVOL_TRY_ASSIGN(root, volume_->read_index_root({attribute}));
    std::string nodes;
    std::size_t count = 0;
    SPLATVOL_TRY(add_nodes(root, 0, attribute, nodes, count));
    add(fmt::format("index with attribute {}, {} nodes", attribute, count), nodes);
    return {};
  }

  // Walks the tree depth first, whatever its pages.
  Status add_nodes(const format::IndexPage& page, std::uint32_t node, int attribute, std::string& nodes,
                   std::size_t& count) {
    const format::NodeArrays& arrays = page.nodes;
    ++count;
    nodes += fmt::format("mask {} first {} counts {}", arrays.child_masks[node], arrays.first_resolutions[node],
                         fmt::join(arrays.counts_of(node), " "));
    for (std::size_t bound = 0; bound < arrays.shape.size_bounds; ++bound)
      for (std::size_t r = 0; r < arrays.shape.resolutions; ++r)
        nodes += fmt::format(" {}", arrays.size_code_at(node, bound, r));
    if (attribute >= 0) {
      const format::ValueSummary& summary = arrays.summaries[node];
      nodes += fmt::format(" from {:.9g} to {:.9g} bins {:016x}", summary.min, summary.max, summary.occupancy);
    }
    nodes += '\n';
    const auto children = static_cast<std::uint32_t>(std::popcount(arrays.child_masks[node]));
    if (page.links[node] == format::IndexPage::no_node) {
      for (std::uint32_t c = 0; c < children; ++c)
        SPLATVOL_TRY(add_nodes(page, page.first_children[node] + c, attribute, nodes, count));
      return {};
    }
    SPLATVOL_TRY_ASSIGN(linked, volume_->read_index_page(page.pages[page.links[node]], arrays.child_masks[node],
                                                         arrays.counts_of(node), {attribute}));
    for (std::uint32_t c = 0; c < children; ++c) SPLATVOL_TRY(add_nodes(linked, c, attribute, nodes, count));
    return {};
  }

  Status add_chunk(std::uint64_t row, int number_of_column) {
    const format::Column& column = volume_->info().columns[static_cast<std::size_t>(number_of_column)];
    const std::uint64_t page_number = volume_->directory_page_of_row(row, number_of_column);
    SPLATVOL_TRY_ASSIGN(page, volume_->read_directory_page(page_number));
    const format::ChunkLocation& chunk = volume_->find_chunk(page, row, number_of_column);
    SPLATVOL_TRY_ASSIGN(packed, volume_->read_bytes(chunk.offset, chunk.entry.packed_bytes));
    const std::uint32_t points = volume_->rows().group(volume_->rows().group_of_row(row)).count;
    SPLATVOL_TRY_ASSIGN(numbers, numbers_of(column.kind, chunk.entry, packed, points));
    std::string what = fmt::format("row {}: {}", row, format::column_kind_name(column.kind));
    if (column.attribute >= 0) what += fmt::format(" of attribute {}", column.attribute);
    what += fmt::format(", {} points", points);
    if (column.kind == ColumnKind::value || column.kind == ColumnKind::value_moments)
      what +=
          fmt::format(", from {:.9g} to {:.9g}, bins {:016x}", chunk.entry.min, chunk.entry.max, chunk.entry.occupancy);
    add(what, numbers);
    return {};
  }

  // Unpacks `points` elements with unpack(span), and writes each as a line.
  template <class Element, class Unpack, class Write>
  static Result<std::string> lines_of(std::size_t points, const Unpack& unpack, const Write& write) {
    std::vector<Element> elements(points);
    SPLATVOL_TRY(unpack(std::span(elements)));
    std::string lines;
    for (const Element& element : elements) lines += write(element) + "\n";
    return lines;
  }

  [[nodiscard]] Result<std::string> numbers_of(ColumnKind kind, const format::ChunkEntry& entry,
                                               const format::Bytes& packed, std::size_t points) const {
    const Cube& cube = volume_->info().cube;
    switch (kind) {
      case ColumnKind::position:
        return lines_of<dvec3>(
            points, [&](auto out) { return format::unpack_positions(entry, packed, out, cube, "dump"); }, vector);
      case ColumnKind::centroid:
        return lines_of<dvec3>(
            points, [&](auto out) { return format::unpack_centroids(entry, packed, out, cube, "dump"); }, vector);
      case ColumnKind::value:
        return lines_of<float>(
            points, [&](auto out) { return format::unpack_values(entry, packed, out, "dump"); },
            [](float value) { return number(double{value}); });
      case ColumnKind::moments:
        return lines_of<SplatShape>(
            points, [&](auto out) { return format::unpack_moments(entry, packed, out, cube.edge, "dump"); },
            [](const SplatShape& shape) { return text_of(shape); });
      case ColumnKind::value_moments:
        return lines_of<SplatValue>(
            points, [&](auto out) { return format::unpack_value_moments(entry, packed, out, "dump"); },
            [](const SplatValue& value) { return text_of(value); });
      case ColumnKind::gradient:
        return lines_of<vec3>(
            points, [&](auto out) { return format::unpack_gradients(entry, packed, out, "dump"); },
            [](const vec3& v) { return vector(dvec3(v)); });
      case ColumnKind::octant:
        return octants_of(entry, packed, points);
      case ColumnKind::unknown:
        break;
    }
    return std::string("unknown");
  }

  static Result<std::string> octants_of(const format::ChunkEntry& entry, const format::Bytes& packed,
                                        std::size_t points) {
    std::vector<std::uint8_t> depths(points), counts(points);
    SPLATVOL_TRY(format::unpack_octants(entry, packed, depths, counts, "dump"));
    std::string lines;
    for (std::size_t i = 0; i < points; ++i) lines += fmt::format("{} {}\n", depths[i], counts[i]);
    return lines;
  }

  static std::string text_of(const SplatShape& shape) {
    const glm::dquat& q = shape.orientation;
    return fmt::format("{} deviations {} turn {} {} {} {} boundary {} density {}", number(shape.mass),
                       vector(shape.deviations), share(q.w), share(q.x), share(q.y), share(q.z), vector(shape.boundary),
                       number(shape.density));
  }

  static std::string text_of(const SplatValue& value) {
    const dvec3& c = value.correlation;
    return fmt::format("{} deviation {} correlation {} {} {} residual {} coverage {}", number(value.mean),
                       number(value.deviation), share(c.x), share(c.y), share(c.z), share(value.residual),
                       share(value.coverage));
  }

  const format::Volume* volume_;  // at the step that is written
  bool all_;
  std::string text_;
};

}  // namespace

Result<std::string> dump_volume(const format::Volume& volume, bool all) { return Dump(volume, all).run(); }

}  // namespace splatvol::test
