#include "extractor/cell_extraction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <thread>
#include <utility>

#include "base/interruption.h"
#include "base/run_tasks.h"
#include "base/temp_file.h"
#include "builder/mesh/tetrahedra.h"
#include "extractor/used_ranks.h"
#include "format/ranked_points.h"
#include "sampler/cell_tetrahedra.h"

namespace splatvol {
namespace {

using format::CellChunkEntry;
using format::CellField;
using format::CellShape;

constexpr std::uint64_t held_bytes = std::uint64_t{128} << 20;  // of parts of the file that were read
constexpr std::size_t chunks_at_once = 64;
constexpr std::uint64_t cells_at_once = std::uint64_t{1} << 17;  // of these chunks, unless one has more
constexpr std::size_t slice_points = std::size_t{1} << 14;
constexpr std::size_t slices_at_once = 16;
constexpr std::uint64_t numbers_at_once = std::uint64_t{1} << 17;

// The shape that cells have in the output: polyhedra are written as their tetrahedra.
CellShape written_shape(CellShape shape) { return shape == CellShape::polyhedron ? CellShape::tetrahedron : shape; }

std::uint8_t vtk_type(CellShape shape) {
  switch (shape) {
    case CellShape::tetrahedron:
      return 10;
    case CellShape::hexahedron:
      return 12;
    case CellShape::wedge:
      return 13;
    case CellShape::pyramid:
      return 14;
    case CellShape::polyhedron:
      break;
  }
  return 0;
}

// Requires boxes that are not empty; they meet if they touch.
bool meets(const Box& box, const Box& other) {
  return glm::all(glm::lessThanEqual(box.low, other.high)) && glm::all(glm::lessThanEqual(other.low, box.high));
}

bool is_within(const Box& box, const Box& other) {
  return glm::all(glm::lessThanEqual(other.low, box.low)) && glm::all(glm::lessThanEqual(box.high, other.high));
}

double volume_of(const std::array<std::uint8_t, 4>& tetrahedron, std::span<const dvec3> corners) {
  const auto& [a, b, c, d] = tetrahedron;
  return glm::dot(corners[b] - corners[a], glm::cross(corners[c] - corners[a], corners[d] - corners[a])) / 6;
}

double volume_of(const format::CellChunk& cells, std::size_t cell, std::span<const dvec3> corners) {
  double volume = 0;
  format::for_each_tetrahedron(cells, cell,
                               [&](const std::array<std::uint8_t, 4>& at) { volume += volume_of(at, corners); });
  return volume;
}

// Mirrors a cell, so that its volume has the other sign in VTK's order.
template <class Corner>
void mirror(CellShape shape, std::span<Corner> corners) {
  switch (shape) {
    case CellShape::tetrahedron:
      return std::swap(corners[2], corners[3]);
    case CellShape::pyramid:
      return std::swap(corners[1], corners[3]);
    case CellShape::wedge:
    case CellShape::hexahedron: {
      const std::size_t half = corners.size() / 2;
      std::swap_ranges(corners.begin(), corners.begin() + static_cast<std::ptrdiff_t>(half),
                       corners.begin() + static_cast<std::ptrdiff_t>(half));
    }
    case CellShape::polyhedron:
      break;
  }
}

// Cells of one shape.
struct CellList {
  std::vector<std::uint64_t> corners;  // [cell][corner]: ranks or numbers of vertices, in VTK's order
  std::vector<std::uint64_t> points;   // [cell]: rank of the point whose value it has, if the field is constant
  std::vector<double> volumes;         // [cell]

  void add(CellShape shape, std::span<std::uint64_t> ranks, double volume) {
    if (volume < 0) mirror(shape, ranks);
    volumes.push_back(std::abs(volume));
    corners.insert(corners.end(), ranks.begin(), ranks.end());
  }
};

// Cells of a chunk that meet a box.
struct ChunkCells {
  CellList cells;           // of written_shape()
  CellList tetrahedra;      // of cells that a reader would split otherwise
  std::uint64_t split = 0;  // these cells
};

// Tells whether a reader of the output would split a cell as the file does. Rounding may have moved the corners of a
// face past each other, or apart in one chunk and not in the next: the lowest of them decides on the face's diagonal.
class SplitCheck {
 public:
  // `corners`: of the cells of a chunk. `positions`: of its ranks. Both must outlive this.
  SplitCheck(const format::LocalCells& corners, std::span<const dvec3> positions)
      : corners_(corners), splitter_(positions, found_, census_) {}

  // `volume`: of the cell.
  bool agrees(const format::CellChunk& cells, std::size_t cell, double volume) {
    if (cells.shape == CellShape::tetrahedron || cells.shape == CellShape::polyhedron) return true;
    const auto numbers = std::span(corners_.corners).subspan(cells.begin_of(cell), format::corners_of(cells.shape));
    std::vector<std::uint32_t> written(numbers.begin(), numbers.end());
    if (volume < 0) mirror(cells.shape, std::span(written));
    found_.clear();
    splitter_.split(shape_of(cells.shape), written);
    expected_.clear();
    format::for_each_tetrahedron(cells, cell, [&](const std::array<std::uint8_t, 4>& at) {
      expected_.push_back({numbers[at[0]], numbers[at[1]], numbers[at[2]], numbers[at[3]]});
    });
    for (auto* tetrahedra : {&found_, &expected_}) {
      for (auto& tetrahedron : *tetrahedra) std::ranges::sort(tetrahedron);
      std::ranges::sort(*tetrahedra);
    }
    return found_ == expected_;
  }

 private:
  static splatvol::CellShape shape_of(CellShape shape) {
    using Shape = splatvol::CellShape;
    return shape == CellShape::hexahedron ? Shape::hexahedron
           : shape == CellShape::wedge    ? Shape::wedge
                                          : Shape::pyramid;
  }

  const format::LocalCells& corners_;
  std::vector<TetrahedronSplitter::Tetrahedron> found_, expected_;
  CellCensus census_;
  TetrahedronSplitter splitter_;
};

// Some consecutive points of the output, or some of its cells.
struct Slice {
  std::vector<std::uint64_t> numbers;  // of points of the file or vertices; of cells, the points with their values
  std::vector<dvec3> positions = {};
  std::vector<std::vector<double>> values = {};  // [attribute of the selection]
};

// Reads chunks of cells and slices. Each thread has one.
class PartReader {
 public:
  PartReader(const format::CellReader& cells, CellField field, const format::SplatSelection& selection,
             const format::RankedPoints& points, const format::CellVertices& vertices)
      : cells_(cells),
        selection_(selection),
        are_vertices_(field == CellField::constant),
        points_(points),
        vertices_(vertices) {}

  Status read(const CellChunkEntry& entry, ChunkCells& chunk) {
    SPLATVOL_TRY_ASSIGN(cells, cells_.read_chunk(entry));
    const format::LocalCells local = format::number_corners(cells.corners);
    SPLATVOL_TRY(read_positions(local.ranks, positions_));
    const bool is_whole = is_within(box_of_cells(entry), selection_.box);
    SplitCheck splits(local, positions_);
    std::vector<dvec3> corners;
    std::vector<std::uint64_t> ranks;
    for (std::size_t cell = 0; cell < cells.size(); ++cell) {
      const auto of_cell = cells.corners_at(cell);
      ranks.assign(of_cell.begin(), of_cell.end());
      corners.resize(ranks.size());
      Box box;
      for (std::size_t k = 0; k < corners.size(); ++k)
        box.include(corners[k] = positions_[local.corners[cells.begin_of(cell) + k]]);
      if (!is_whole && !meets(box, selection_.box)) continue;
      const double volume = volume_of(cells, cell, corners);
      const bool is_split = !splits.agrees(cells, cell, volume);
      CellList& list = is_split ? chunk.tetrahedra : chunk.cells;
      if (is_split || entry.shape == CellShape::polyhedron)
        format::for_each_tetrahedron(cells, cell, [&](const std::array<std::uint8_t, 4>& at) {
          std::array part = {ranks[at[0]], ranks[at[1]], ranks[at[2]], ranks[at[3]]};
          list.add(CellShape::tetrahedron, part, volume_of(at, corners));
        });
      else
        list.add(entry.shape, ranks, volume);
      chunk.split += is_split ? 1 : 0;
      if (are_vertices_) list.points.resize(list.volumes.size(), cells.points[cell]);
    }
    return {};
  }

  // Positions of points, and their values unless they are vertices.
  Status read_points(Slice& slice) {
    SPLATVOL_TRY(read_positions(slice.numbers, slice.positions));
    return are_vertices_ ? Status{} : read_values(slice.values);
  }

  Status read_cells(Slice& slice) {
    SPLATVOL_TRY(points_.find(slice.numbers, places_));
    return read_values(slice.values);
  }

 private:
  Status read_positions(std::span<const std::uint64_t> numbers, std::vector<dvec3>& positions) {
    if (are_vertices_) return vertices_.read_positions(numbers, positions);
    SPLATVOL_TRY(points_.find(numbers, places_));
    return points_.read_positions(places_, positions);
  }

  // Of `places_`.
  Status read_values(std::vector<std::vector<double>>& all) {
    for (const std::size_t a : selection_.attributes) {
      SPLATVOL_TRY(points_.read_values(places_, static_cast<int>(a), stored_));
      const format::Attribute& attribute = cells_.volume().info().attributes[a];
      std::vector<double>& values = all.emplace_back();
      values.reserve(stored_.size());
      for (const float value : stored_) values.push_back(attribute.value(static_cast<double>(value)));
    }
    return {};
  }

  const format::CellReader& cells_;
  const format::SplatSelection& selection_;
  bool are_vertices_;  // corners
  const format::RankedPoints& points_;
  const format::CellVertices& vertices_;
  std::vector<format::RankedPoints::Place> places_;
  std::vector<dvec3> positions_;
  std::vector<float> stored_;
};

class Writer {
 public:
  Writer(const format::CellReader& cells, CellField field, const format::SplatSelection& selection,
         std::span<const OutputArray> arrays, CellOutput& output, const std::function<void(double)>& progress,
         std::size_t threads)
      : cells_(cells),
        has_sources_(field == CellField::constant),
        selection_(selection),
        arrays_(arrays),
        output_(output),
        progress_(progress),
        used_(has_sources_ ? cells.vertex_count() : cells.volume().info().resolution_counts.back()),
        held_points_(cells, own_room(has_sources_ ? held_bytes / 2 : held_bytes)),
        held_vertices_([&cells](std::size_t page) { return cells.read_vertex_page(page); }, own_room(held_bytes / 2)) {
    for (std::size_t thread = 0; thread < threads; ++thread)
      readers_.emplace_back(cells, field, selection, held_points_, held_vertices_);
  }

  Result<CellExtractionReport> run() {
    SPLATVOL_TRY(write_ranks());
    SPLATVOL_TRY(check_any());
    counts_.points = used_.number();
    SPLATVOL_TRY(output_.set_counts(counts_));
    SPLATVOL_TRY(write_points());
    if (has_sources_) SPLATVOL_TRY(write_cell_values());
    SPLATVOL_TRY(renumber_corners());
    SPLATVOL_TRY(write_kinds());
    return report_;
  }

 private:
  // Cells of one shape that follow each other.
  struct Run {
    CellShape shape;
    std::uint64_t cells;
  };

  // Writes the ranks of the corners of all cells that meet the box.
  Status write_ranks() {
    const std::vector<format::CellPageRef>& pages = cells_.pages();
    for (std::size_t p = 0; p < pages.size(); ++p) {
      if (meets(box_of_cells(pages[p]), selection_.box)) SPLATVOL_TRY(write_page(p));
      progress_(0.6 * static_cast<double>(p + 1) / static_cast<double>(pages.size()));
    }
    return {};
  }

  Status write_page(std::size_t number) {
    SPLATVOL_TRY_ASSIGN(page, cells_.read_page(number, {}));
    std::erase_if(page.chunks,
                  [&](const CellChunkEntry& entry) { return !meets(box_of_cells(entry), selection_.box); });
    std::erase_if(page.chunks, [&](const CellChunkEntry& entry) {
      const bool is_known = format::is_known(entry.shape, entry.field) && vtk_type(written_shape(entry.shape)) != 0;
      if (!is_known) report_.left_out += entry.cells;
      return !is_known;
    });
    const CellField field = has_sources_ ? CellField::constant : CellField::corners;
    if (std::ranges::any_of(page.chunks, [&](const CellChunkEntry& entry) { return entry.field != field; }))
      return fail(ErrorCode::invalid_data, "{}: a chunk of cells has another field than the root states [R23]",
                  cells_.volume().name());
    for (std::span<const CellChunkEntry> left = page.chunks; !left.empty();) {
      std::size_t count = 1;
      for (std::uint64_t cells = cells_of(left[0]); count < std::min(left.size(), chunks_at_once); ++count)
        if ((cells += cells_of(left[count])) > cells_at_once) break;
      SPLATVOL_TRY(write_chunks(left.first(count)));
      left = left.subspan(count);
    }
    return {};
  }

  // As many as the file may get of a chunk, about.
  static std::uint64_t cells_of(const CellChunkEntry& entry) {
    constexpr std::uint64_t tetrahedra = 40;  // of a polyhedron
    return entry.shape == CellShape::polyhedron ? entry.cells * tetrahedra : entry.cells;
  }

  Status write_chunks(std::span<const CellChunkEntry> entries) {
    SPLATVOL_TRY(check_interruption());
    std::vector<ChunkCells> chunks(entries.size());
    const auto read = [&](std::size_t i, std::size_t thread) { return readers_[thread].read(entries[i], chunks[i]); };
    SPLATVOL_TRY(run_tasks(chunks.size(), readers_.size(), read));
    for (std::size_t i = 0; i < chunks.size(); ++i) {
      SPLATVOL_TRY(write_list(written_shape(entries[i].shape), chunks[i].cells));
      SPLATVOL_TRY(write_list(CellShape::tetrahedron, chunks[i].tetrahedra));
      report_.split += chunks[i].split;
    }
    return {};
  }

  Status write_list(CellShape shape, const CellList& list) {
    if (list.volumes.empty()) return {};
    used_.add(list.corners);
    if (has_sources_) SPLATVOL_TRY(output_.append_sources(list.points));
    SPLATVOL_TRY(output_.write_corners(counts_.corners, list.corners));
    counts_.corners += list.corners.size();
    counts_.cells += list.volumes.size();
    for (const double volume : list.volumes) report_.volume += volume;
    if (runs_.empty() || runs_.back().shape != shape) runs_.push_back({shape, 0});
    runs_.back().cells += list.volumes.size();
    return {};
  }

  [[nodiscard]] Status check_any() const {
    const std::string& name = cells_.volume().name();
    if (counts_.cells > 0) return {};
    if (report_.left_out > 0)
      return fail(ErrorCode::unsupported,
                  "{}: its {} cells have shapes that this program does not know: take a later version", name,
                  report_.left_out);
    return fail(ErrorCode::invalid_argument, "{}: no cells{}", name, cells_.pages().empty() ? " in it" : " in the box");
  }

  Status write_points() {
    SliceQueue slices;
    for (std::size_t page = 0; page < used_.page_count(); ++page) {
      const std::vector<std::uint64_t> ranks = used_.ranks_of_page(page);
      for (std::span<const std::uint64_t> left = ranks; !left.empty();) {
        const auto slice = left.first(std::min(left.size(), slice_points));
        SPLATVOL_TRY(add({slice.begin(), slice.end()}, &PartReader::read_points, slices));
        left = left.subspan(slice.size());
      }
    }
    return write_slices(&PartReader::read_points, slices);
  }

  Status write_cell_values() {
    SliceQueue slices;
    for (std::uint64_t first = 0; first < counts_.cells;) {
      std::vector<std::uint64_t> points(std::min<std::uint64_t>(slice_points, counts_.cells - first));
      SPLATVOL_TRY(output_.read_sources(first, points));
      first += points.size();
      SPLATVOL_TRY(add(std::move(points), &PartReader::read_cells, slices));
    }
    return write_slices(&PartReader::read_cells, slices);
  }

  struct SliceQueue {
    std::vector<Slice> slices;
    std::uint64_t first = 0;  // number of the first point or cell
  };
  using ReadSlice = Status (PartReader::*)(Slice&);

  Status add(std::vector<std::uint64_t> numbers, ReadSlice read, SliceQueue& queue) {
    queue.slices.push_back({.numbers = std::move(numbers)});
    return queue.slices.size() == slices_at_once ? write_slices(read, queue) : Status{};
  }

  Status write_slices(ReadSlice read, SliceQueue& queue) {
    SPLATVOL_TRY(check_interruption());
    std::vector<Slice>& slices = queue.slices;
    const auto read_slice = [&](std::size_t i, std::size_t thread) { return (readers_[thread].*read)(slices[i]); };
    SPLATVOL_TRY(run_tasks(slices.size(), readers_.size(), read_slice));
    std::vector<double> joined;
    for (const Slice& slice : slices) {
      if (!slice.positions.empty()) SPLATVOL_TRY(output_.write_points(queue.first, slice.positions));
      for (std::size_t a = 0; a < arrays_.size() && !slice.values.empty(); ++a)
        SPLATVOL_TRY(output_.write_values(a, queue.first, numbers_of(arrays_[a], slice.values, joined)));
      queue.first += slice.numbers.size();
      written_ += slice.numbers.size();
    }
    slices.clear();
    const std::uint64_t all = counts_.points + (has_sources_ ? counts_.cells : 0);
    progress_(0.6 + 0.3 * static_cast<double>(written_) / static_cast<double>(all));
    return {};
  }

  // Replaces the ranks in the output by the numbers of the points.
  Status renumber_corners() {
    std::vector<std::uint64_t> numbers;
    for (std::uint64_t first = 0; first < counts_.corners; first += numbers.size()) {
      SPLATVOL_TRY(check_interruption());
      numbers.resize(std::min(numbers_at_once, counts_.corners - first));
      SPLATVOL_TRY(output_.read_corners(first, numbers));
      for (std::uint64_t& number : numbers) {
        if (!used_.has(number)) return fail_changed_temporary();
        number = used_.number_of(number);
      }
      SPLATVOL_TRY(output_.write_corners(first, numbers));
      progress_(0.9 + 0.1 * static_cast<double>(first) / static_cast<double>(counts_.corners));
    }
    return {};
  }

  // Writes where the corners of each cell end, and its type.
  Status write_kinds() {
    std::uint64_t first = 0, end = 0;
    for (const Run& run : runs_)
      for (std::uint64_t left = run.cells; left > 0;) {
        std::vector<std::uint64_t> ends(std::min(numbers_at_once, left));
        const std::vector<std::uint8_t> types(ends.size(), vtk_type(run.shape));
        for (std::uint64_t& cell_end : ends) cell_end = end += format::corners_of(run.shape);
        SPLATVOL_TRY(output_.write_kinds(first, ends, types));
        first += ends.size();
        left -= ends.size();
      }
    report_.counts = counts_;
    return {};
  }

  const format::CellReader& cells_;
  bool has_sources_;  // values are of cells
  const format::SplatSelection& selection_;
  std::span<const OutputArray> arrays_;
  CellOutput& output_;
  const std::function<void(double)>& progress_;
  UsedRanks used_;
  CellCounts counts_;
  std::uint64_t written_ = 0;  // of slices: points and cells
  std::vector<Run> runs_;
  CellExtractionReport report_;
  format::RankedPoints held_points_;
  format::CellVertices held_vertices_;
  std::vector<PartReader> readers_;  // [thread]
};

// The field of all cells whose shape and field are known. In a mesh, values are of points or of cells.
Result<CellField> field_of(const format::CellReader& cells) {
  std::optional<CellField> field;
  for (const format::CellKind& kind : cells.kinds()) {
    if (!format::is_known(kind.shape, kind.field)) continue;
    if (field.value_or(kind.field) != kind.field)
      return fail(ErrorCode::unsupported,
                  "{}: has values of cells and cells with values of points, and a mesh takes one of both",
                  cells.volume().name());
    field = kind.field;
  }
  return field.value_or(CellField::corners);
}

// Arrays in memory.
class MemoryOutput final : public CellOutput {
 public:
  explicit MemoryOutput(const CellExtraction& extraction)
      : arrays_(extraction.has_cell_values() ? mesh_.cell_values : mesh_.point_values) {
    for (const OutputArray& array : extraction.arrays())
      arrays_.push_back({array.name, array.unit, array.components(), {}});
    are_of_cells_ = extraction.has_cell_values();
  }

  Status write_corners(std::uint64_t first, std::span<const std::uint64_t> corners) override {
    mesh_.connectivity.resize(std::max<std::size_t>(mesh_.connectivity.size(), first + corners.size()));
    std::ranges::transform(corners, mesh_.connectivity.begin() + static_cast<std::ptrdiff_t>(first),
                           [](std::uint64_t corner) { return static_cast<std::int64_t>(corner); });
    return {};
  }
  Status read_corners(std::uint64_t first, std::span<std::uint64_t> corners) override {
    std::ranges::transform(std::span(mesh_.connectivity).subspan(first, corners.size()), corners.begin(),
                           [](std::int64_t corner) { return static_cast<std::uint64_t>(corner); });
    return {};
  }
  Status append_sources(std::span<const std::uint64_t> points) override {
    sources_.insert(sources_.end(), points.begin(), points.end());
    return {};
  }
  Status read_sources(std::uint64_t first_cell, std::span<std::uint64_t> points) override {
    std::ranges::copy(std::span(sources_).subspan(first_cell, points.size()), points.begin());
    return {};
  }
  Status set_counts(const CellCounts& counts) override {
    mesh_.connectivity.shrink_to_fit();
    mesh_.points.reserve(counts.points);
    mesh_.offsets.reserve(counts.cells + 1);
    mesh_.offsets.push_back(0);
    mesh_.types.reserve(counts.cells);
    for (MeshValues& array : arrays_)
      array.numbers.reserve((are_of_cells_ ? counts.cells : counts.points) * array.components);
    return {};
  }
  Status write_points(std::uint64_t /*first*/, std::span<const dvec3> points) override {
    mesh_.points.insert(mesh_.points.end(), points.begin(), points.end());
    return {};
  }
  Status write_values(std::size_t array, std::uint64_t /*first*/, std::span<const double> numbers) override {
    arrays_[array].numbers.insert(arrays_[array].numbers.end(), numbers.begin(), numbers.end());
    return {};
  }
  Status write_kinds(std::uint64_t /*first_cell*/, std::span<const std::uint64_t> ends,
                     std::span<const std::uint8_t> types) override {
    for (const std::uint64_t end : ends) mesh_.offsets.push_back(static_cast<std::int64_t>(end));
    mesh_.types.insert(mesh_.types.end(), types.begin(), types.end());
    return {};
  }

  CellMesh take(const CellExtractionReport& report) {
    mesh_.left_out = report.left_out;
    mesh_.split = report.split;
    return std::move(mesh_);
  }

 private:
  CellMesh mesh_;
  std::vector<MeshValues>& arrays_;  // of mesh_
  bool are_of_cells_ = false;
  std::vector<std::uint64_t> sources_;
};

}  // namespace

CellExtraction::CellExtraction(std::unique_ptr<const format::CellReader> cells, CellField field,
                               const format::SplatSelection& selection)
    : cells_(std::move(cells)),
      field_(field),
      selection_(&selection),
      arrays_(output_arrays(cells_->volume().info(), selection)) {}

std::size_t CellExtraction::usual_threads() { return std::max(1u, std::thread::hardware_concurrency()); }

Result<CellExtraction> CellExtraction::open(const format::Volume& volume, const format::SplatSelection& selection) {
  SPLATVOL_TRY_ASSIGN(cells, format::CellReader::open(volume));
  if (!cells) return fail_without_cells(volume);
  SPLATVOL_TRY_ASSIGN(field, field_of(*cells));
  for (const std::size_t a : selection.attributes)
    if (volume.info().find_column(format::ColumnKind::value, static_cast<int>(a)) < 0)
      return fail(ErrorCode::unsupported, "{}: no values of attribute \"{}\"", volume.name(),
                  volume.info().attributes[a].name);
  return CellExtraction(std::move(cells), field, selection);
}

Result<CellExtractionReport> CellExtraction::write(CellOutput& output, const std::function<void(double)>& progress,
                                                   std::size_t threads) const {
  return Writer(*cells_, field_, *selection_, arrays_, output, progress, threads).run();
}

Result<CellMesh> extract_cells(const format::Volume& volume, const format::SplatSelection& selection) {
  SPLATVOL_TRY_ASSIGN(extraction, CellExtraction::open(volume, selection));
  MemoryOutput output(extraction);
  SPLATVOL_TRY_ASSIGN(report, extraction.write(output, [](double) {}));
  return output.take(report);
}

}  // namespace splatvol
