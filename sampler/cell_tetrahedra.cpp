#include "sampler/cell_tetrahedra.h"

#include <array>
#include <cmath>
#include <utility>

#include "sampler/tetrahedron.h"

namespace splatvol {
namespace {

std::array<std::uint32_t, 4> sorted(std::array<std::uint32_t, 4> corners) {
  const auto order = [&](std::size_t a, std::size_t b) {
    const std::uint32_t low = std::min(corners[a], corners[b]), high = std::max(corners[a], corners[b]);
    corners[a] = low;
    corners[b] = high;
  };
  order(0, 1), order(2, 3), order(0, 2), order(1, 3), order(1, 2);
  return corners;
}

// Gives each tetrahedron the value of its cell.
std::vector<double> spread(const std::vector<double>& values, std::span<const std::uint32_t> cells) {
  std::vector<double> spread;
  spread.reserve(cells.size());
  for (const std::uint32_t cell : cells) spread.push_back(values[cell]);
  return spread;
}

}  // namespace

tl::unexpected<Error> fail_without_cells(const format::Volume& volume) {
  return fail(
      ErrorCode::invalid_argument,
      "{}: keeps no cells: build it from a mesh, or from points by --connectivity delaunay, without --drop-cells",
      volume.name());
}

Result<std::unique_ptr<const CellTetrahedra>> CellTetrahedra::open(const format::Volume& volume,
                                                                   std::vector<std::size_t> attributes,
                                                                   const PartRoom& room,
                                                                   const format::SummaryAttributes& summaries) {
  for (const std::size_t a : attributes)
    if (volume.info().find_column(format::ColumnKind::value, static_cast<int>(a)) < 0)
      return fail(ErrorCode::unsupported, "{}: no values of attribute \"{}\"", volume.name(),
                  volume.info().attributes[a].name);
  SPLATVOL_TRY_ASSIGN(reader, format::CellReader::open(volume));
  if (!reader) return nullptr;
  return std::unique_ptr<const CellTetrahedra>(
      new CellTetrahedra(std::move(reader), std::move(attributes), room, summaries));
}

CellTetrahedra::CellTetrahedra(std::unique_ptr<const format::CellReader> reader, std::vector<std::size_t> attributes,
                               const PartRoom& room, const format::SummaryAttributes& summaries)
    : reader_(std::move(reader)),
      attributes_(std::move(attributes)),
      summaries_(summaries),
      room_(room),
      points_(*reader_, room),
      vertices_([this](std::size_t page) { return reader_->read_vertex_page(page); }, room),
      moved_(1.01 * std::sqrt(3.0) * reader_->volume().info().position_error),
      rounding_(std::max(rounding_of(reader_->volume().info().cube.origin),
                         rounding_of(reader_->volume().info().cube.origin + reader_->volume().info().cube.edge))) {}

std::uint64_t CellTetrahedra::unknown_cells() const {
  std::uint64_t unknown = 0;
  for (const format::CellKind& kind : reader_->kinds())
    if (!format::is_known(kind.shape, kind.field)) unknown += kind.cells;
  return unknown;
}

bool CellTetrahedra::has_constant() const {
  return std::ranges::any_of(reader_->kinds(),
                             [](const format::CellKind& kind) { return kind.field == format::CellField::constant; });
}

Result<std::vector<format::CellChunkEntry>> CellTetrahedra::chunks(
    const std::function<bool(const Box&)>& meets,
    const std::function<bool(const format::CellPage&, std::size_t)>& shows) const {
  std::vector<std::size_t> numbers, missing;
  for (std::size_t number = 0; number < reader_->pages().size(); ++number) {
    if (!meets(box_of_cells(reader_->pages()[number]))) continue;
    numbers.push_back(number);
    if (!room_.table->holds(key_of_page(number))) missing.push_back(number);
  }
  SPLATVOL_TRY_ASSIGN(ahead, reader_->read_pages_ahead(missing, *room_.share));
  std::vector<format::CellChunkEntry> chunks;
  for (const std::size_t number : numbers) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(page, read_page(number));
    for (std::size_t i = 0; i < page->chunks.size(); ++i) {
      const format::CellChunkEntry& entry = page->chunks[i];
      if (format::is_known(entry.shape, entry.field) && meets(box_of_cells(entry)) && (!shows || shows(*page, i)))
        chunks.push_back(entry);
    }
  }
  return chunks;
}

PartKey CellTetrahedra::key_of_page(std::size_t page) const {
  const std::array of_summaries{summaries_.values, summaries_.opacity};
  return {room_.file, format::cell_page, page, format::columns_key(of_summaries), reader_->volume().step_key()};
}

Result<std::shared_ptr<const format::CellPage>> CellTetrahedra::read_page(std::size_t page) const {
  const auto bytes_of = [](const format::CellPage& entries) {
    return entries.chunks.capacity() * sizeof(format::CellChunkEntry) +
           (entries.summaries.capacity() + entries.opacity_summaries.capacity()) * sizeof(format::ValueSummary);
  };
  return room_.table->get<format::CellPage>(
      key_of_page(page), *room_.share, 0, [&] { return reader_->read_page(page, summaries_); }, bytes_of);
}

// Returns how many chunks are read together: all threads have work, and the tetrahedra take little memory.
std::size_t CellTetrahedra::count_at_once(std::span<const format::CellChunkEntry> entries) {
  constexpr std::uint64_t cells_at_once = std::uint64_t{1} << 17, of_polyhedron = 20;
  std::uint64_t cells = 0;
  std::size_t count = 0;
  for (; count < entries.size() && (count == 0 || cells < cells_at_once); ++count)
    cells += entries[count].cells * (entries[count].shape == format::CellShape::polyhedron ? of_polyhedron : 1);
  return count;
}

Result<format::CellsAhead> CellTetrahedra::read_ahead(std::span<const format::CellChunkEntry> entries) const {
  const std::vector<int> attributes(attributes_.begin(), attributes_.end());
  return format::read_cells_ahead(*reader_, points_, entries, attributes, *room_.share);
}

Result<Tetrahedra> CellTetrahedra::read(const format::CellChunkEntry& entry) const {
  SPLATVOL_TRY_ASSIGN(cells, reader_->read_chunk(entry));
  format::LocalCells local = format::number_corners(cells.corners);
  Tetrahedra tetrahedra;
  tetrahedra.constant = entry.field == format::CellField::constant;
  tetrahedra.corners.reserve(cells.size());
  for (std::size_t cell = 0; cell < cells.size(); ++cell) {
    const std::uint32_t* const corners = local.corners.data() + cells.begin_of(cell);
    format::for_each_tetrahedron(cells, cell, [&](const std::array<std::uint8_t, 4>& at) {
      tetrahedra.corners.push_back(sorted({corners[at[0]], corners[at[1]], corners[at[2]], corners[at[3]]}));
      if (tetrahedra.constant) tetrahedra.cells.push_back(static_cast<std::uint32_t>(cell));
    });
  }
  tetrahedra.ranks = std::move(local.ranks);
  if (tetrahedra.constant) SPLATVOL_TRY(vertices_.read_positions(tetrahedra.ranks, tetrahedra.points));
  SPLATVOL_TRY(read_values(tetrahedra.constant ? cells.points : tetrahedra.ranks, tetrahedra));
  return tetrahedra;
}

Status CellTetrahedra::read_values(std::span<const std::uint64_t> ranks, Tetrahedra& tetrahedra) const {
  std::vector<format::RankedPoints::Place> places;
  SPLATVOL_TRY(points_.find(ranks, places));
  if (!tetrahedra.constant) SPLATVOL_TRY(points_.read_positions(places, tetrahedra.points));
  std::vector<float> stored;
  for (const std::size_t a : attributes_) {
    SPLATVOL_TRY(points_.read_values(places, static_cast<int>(a), stored));
    const format::Attribute& attribute = reader_->volume().info().attributes[a];
    std::vector<double>& values = tetrahedra.values.emplace_back();
    values.reserve(stored.size());
    for (const float value : stored) values.push_back(attribute.value(double{value}));
    if (tetrahedra.constant) values = spread(values, tetrahedra.cells);
  }
  return {};
}

}  // namespace splatvol
