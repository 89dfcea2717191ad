#include "builder/cells/vertex_sort.h"

#include <algorithm>
#include <limits>
#include <tuple>
#include <utility>

#include "base/interruption.h"
#include "builder/mesh/heights.h"
#include "builder/sorting/external_sort.h"
#include "builder/sorting/morton.h"
#include "format/columns.h"

namespace splatvol {
namespace {

// How far the file may move a vertex, as a share of the distance to the nearest of its neighbours in Morton order.
constexpr double error_per_distance = 1.0 / 256;

struct VertexRecord {
  dvec3 position;
  double height;  // least_heights
  PointTag tag;
};

std::tuple<double, double, double, PointTag> order_of(const VertexRecord& record) {
  return {record.position.x, record.position.y, record.position.z, record.tag};
}

Cube cube_round(const Box& box) {
  const dvec3 extent = box.extent();
  return {box.low, std::max({extent.x, extent.y, extent.z, std::numeric_limits<double>::min()})};
}

double least_distance(std::span<const dvec3> vertices) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < vertices.size(); ++i) least = std::min(least, glm::length(vertices[i] - vertices[i - 1]));
  return vertices.size() > 1 ? least : 0;
}

}  // namespace

VertexSort::VertexSort(std::uint64_t memory, std::string folder, bool exact)
    : memory_(memory), folder_(std::move(folder)), exact_(exact), spool_(sizeof(VertexRecord), memory / 4, folder_) {}

Status VertexSort::add(std::uint32_t piece_number, const Piece& piece) {
  const PointCells& cells = *piece.cells;
  const std::vector<double> heights = least_heights(cells.corners, cells.tetrahedra);
  std::vector<bool> used(cells.corners.size());
  for (std::size_t i = 0; i < cells.tetrahedra.size(); ++i)
    if (cells.points[i] != PointCells::no_point)
      for (const std::uint32_t corner : cells.tetrahedra[i]) used[corner] = true;
  for (const WholeCell& cell : piece.whole_cells)
    if (cells.points[cell.first] != PointCells::no_point)
      for (const std::uint32_t corner : std::span(cell.corners).first(format::corners_of(cell.shape)))
        used[corner] = true;
  std::vector<VertexRecord> records;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (!used[i]) continue;
    box_.include(cells.corners[i]);
    records.push_back({cells.corners[i], heights[i], point_tag(piece_number, static_cast<std::uint32_t>(i))});
  }
  return records.empty() ? Status{} : spool_.append(std::as_bytes(std::span(records)));
}

Status VertexSort::sort() {
  SPLATVOL_TRY_ASSIGN(tags, TagSort::create(memory_ / 4, folder_));
  tags_.emplace(std::move(tags));
  SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
  file_.emplace(std::move(file));
  if (spool_.count() > 0) SPLATVOL_TRY(number_vertices(cube_round(box_)));
  return tags_->finish();
}

Status VertexSort::number_vertices(const Cube& cube) {
  const auto key = [cube](std::span<const std::byte> records, std::span<MortonKey> keys) {
    for (std::size_t i = 0; i < keys.size(); ++i)
      keys[i] = morton_key(record_at<VertexRecord>(records, i).position, cube);
  };
  const std::size_t held = std::max<std::size_t>(memory_ / 2, ExternalSorter::least_memory(sizeof(VertexRecord)));
  SPLATVOL_TRY_ASSIGN(sorter, ExternalSorter::create({sizeof(VertexRecord), key, held, held, folder_}));
  for (;;) {
    SPLATVOL_TRY_ASSIGN(records, spool_.next());
    if (records.empty()) break;
    SPLATVOL_TRY(sorter.add(records));
  }
  SPLATVOL_TRY(sorter.finish());

  std::vector<VertexRecord> run;  // of one key
  std::optional<MortonKey> key_of_run;
  std::vector<dvec3> page;
  double least = no_height;  // of the page
  const auto close_run = [&]() -> Status {
    std::ranges::sort(run, {}, order_of);
    for (std::size_t i = 0; i < run.size(); ++i) {
      if (i == 0 || run[i].position != run[i - 1].position) {
        if (page.size() == format::vertex_page_points) SPLATVOL_TRY(close_page(page, std::exchange(least, no_height)));
        page.push_back(run[i].position);
        ++count_;
      }
      least = std::min(least, run[i].height);
      SPLATVOL_TRY(tags_->add(run[i].tag, count_ - 1));
    }
    run.clear();
    return {};
  };
  for (;;) {
    SPLATVOL_TRY_ASSIGN(more, sorter.next());
    if (more.keys.empty()) break;
    for (std::size_t i = 0; i < more.keys.size(); ++i) {
      if (key_of_run != more.keys[i]) SPLATVOL_TRY(close_run());
      key_of_run = more.keys[i];
      run.push_back(record_at<VertexRecord>(more.records, i));
    }
    SPLATVOL_TRY(check_interruption());
  }
  SPLATVOL_TRY(close_run());
  return page.empty() ? Status{} : close_page(page, least);
}

Status VertexSort::close_page(std::vector<dvec3>& vertices, double height) {
  const double error = exact_ ? 0 : std::min(error_per_distance * least_distance(vertices), error_per_height * height);
  const format::PackedChunk packed = format::pack_positions(vertices, error);
  pages_.push_back({file_->size(), packed.entry.packed_bytes, packed.entry.unpacked_bytes, packed.entry.hash});
  vertices.clear();
  return file_->append(packed.bytes);
}

Result<format::Bytes> VertexSort::read_packed(std::size_t page) const {
  const format::PackedPageRef& ref = pages_[page];
  format::Bytes packed(ref.packed_bytes);
  SPLATVOL_TRY(file_->read(ref.offset, packed));
  if (format::hash_bytes(packed) != ref.hash) return fail_changed_temporary();
  return packed;
}

Result<std::vector<dvec3>> VertexSort::read(std::size_t page, const Cube& cube) const {
  SPLATVOL_TRY_ASSIGN(packed, read_packed(page));
  const format::PackedPageRef& ref = pages_[page];
  format::ChunkEntry entry{};
  entry.hash = ref.hash;
  entry.packed_bytes = ref.packed_bytes;
  entry.unpacked_bytes = ref.unpacked_bytes;
  const std::uint64_t first = page * std::uint64_t{format::vertex_page_points};
  std::vector<dvec3> vertices(std::min<std::uint64_t>(format::vertex_page_points, count_ - first));
  SPLATVOL_TRY(format::unpack_vertices(entry, packed, vertices, cube, "vertices of cells"));
  return vertices;
}

}  // namespace splatvol
