#include "builder/cells/cell_section.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <memory>
#include <utility>
#include <vector>

#include "base/interruption.h"
#include "base/temp_file.h"
#include "builder/mesh/tetrahedra.h"
#include "format/cells.h"
#include "format/directory_writer.h"
#include "format/octree.h"
#include "format/ranked_points.h"

namespace splatvol {
namespace {

using Append = std::function<Status(std::span<const std::byte>)>;

// A chunk on its way into the file.
struct MadeChunk {
  format::PackedCells packed;
  std::vector<format::ValueSummary> summaries;  // [attribute]
};

// The packed form of the cells that MeshCells::next_chunk returns: one chunk, or more if their corners are in too many
// groups.
struct Item {
  SortedCells cells;
  std::vector<MadeChunk> chunks;
  CellReport report;
  Status status;
};

// The pages of ranks, of which chunks need some again.
class RankPages {
 public:
  RankPages(const format::VolumeInfo& info, TempFile file)
      : counts_(info.segment_counts()), points_(info.resolution_counts.back()), file_(std::move(file)) {}

  // Makes all pages, and calls visit(ref, packed) for each.
  template <class Visit>
  Status make(MeshCells& cells, const Visit& visit) {
    format::RankPage page{0, std::vector<std::uint64_t>(counts_.size()), {}};
    for (; page.first < points_; page.first += page.segments.size()) {
      SPLATVOL_TRY(cells.next_segments(ranks_of(page.first), counts_.size(), page.segments));
      format::PackedPageRef ref{};
      const format::Bytes packed = format::pack_rank_page(page, ref);
      SPLATVOL_TRY(visit(ref, packed));
      ref.offset = file_.size();
      refs_.push_back(ref);
      SPLATVOL_TRY(file_.append(packed));
      for (const std::uint8_t segment : page.segments) ++page.before[segment];
    }
    return {};
  }

  // Thread-safe.
  [[nodiscard]] Result<format::RankPage> read(std::size_t page) const {
    const format::PackedPageRef& ref = refs_[page];
    format::Bytes packed(ref.packed_bytes);
    SPLATVOL_TRY(file_.read(ref.offset, packed));
    if (format::hash_bytes(packed) != ref.hash) return fail_changed_temporary();
    const std::uint64_t first = page * std::uint64_t{format::rank_page_points};
    return format::unpack_rank_page(ref, packed, first, ranks_of(first), counts_, "a page of ranks");
  }

 private:
  [[nodiscard]] std::size_t ranks_of(std::uint64_t first) const {
    return std::min<std::uint64_t>(points_ - first, format::rank_page_points);
  }

  std::vector<std::uint64_t> counts_;  // [segment]
  std::uint64_t points_;
  TempFile file_;
  std::vector<format::PackedPageRef> refs_;
};

// Makes chunks. Each thread has one.
class ChunkMaker {
 public:
  ChunkMaker(const format::VolumeInfo& info, const format::RankedPoints& points, const format::CellVertices& vertices)
      : info_(info), points_(points), vertices_(vertices) {
    for (const format::Attribute& attribute : info_.attributes) bins_.push_back(format::bins_of(attribute));
  }

  void make(Item& item) {
    item.chunks.clear();
    item.report = {};
    item.status = make(item.cells.records, item);
  }

 private:
  // NOLINTNEXTLINE(misc-no-recursion): halves at each call.
  Status make(std::span<const CellWord> records, Item& item) {
    const CellForm& form = *item.cells.form;
    const RankedCells cells = form.read(records);
    const format::CellChunk& chunk = cells.chunk;
    const bool is_constant = form.field() == format::CellField::constant;
    format::LocalCells local = format::number_corners(chunk.corners);
    SPLATVOL_TRY(points_.find(is_constant ? chunk.points : local.ranks, places_));
    if (chunk.size() > 1 && format::RankedPoints::groups_of(places_).size() > format::max_chunk_groups) {
      std::size_t half = 0;
      for (std::size_t i = 0; i < chunk.size() / 2; ++i) half += form.records_of(&records[half]) * form.words();
      SPLATVOL_TRY(make(records.first(half), item));
      return make(records.subspan(half), item);
    }
    MadeChunk& made = item.chunks.emplace_back();
    made.packed = format::pack_cells(chunk, local.ranks.size(), cells.permutations);
    if (is_constant)
      SPLATVOL_TRY(vertices_.read_positions(local.ranks, positions_));
    else
      SPLATVOL_TRY(points_.read_positions(places_, positions_));
    restore_order(cells, local);
    const format::CellExtent extent = format::measure_cells(chunk, local, positions_);
    for (int axis = 0; axis < 3; ++axis) {
      made.packed.entry.low[axis] = extent.box.low[axis];
      made.packed.entry.high[axis] = extent.box.high[axis];
    }
    made.packed.entry.area = extent.area;
    count_turned(cells, local, item.report);
    for (std::size_t a = 0; a < info_.attributes.size(); ++a) {
      SPLATVOL_TRY(points_.read_values(places_, static_cast<int>(a), values_));
      made.summaries.push_back(is_constant ? bins_[a].summarize(values_)
                                           : format::summarize_cells(chunk, local, values_, bins_[a]));
    }
    return {};
  }

  // Splits are of the order in which the corners came. Sums depend on it, too.
  static void restore_order(const RankedCells& cells, format::LocalCells& local) {
    if (cells.permutations.empty()) return;
    const auto permutations = format::permutations_of(cells.chunk.shape);
    const std::size_t count = format::corners_of(cells.chunk.shape);
    std::array<std::uint32_t, format::max_cell_corners> ascending{};
    for (std::size_t i = 0; i < cells.chunk.size(); ++i) {
      const auto corners = std::span(local.corners).subspan(i * count, count);
      std::ranges::copy(corners, ascending.begin());
      for (std::size_t k = 0; k < count; ++k) corners[k] = ascending[permutations[cells.permutations[i]][k]];
    }
  }

  void count_turned(const RankedCells& cells, const format::LocalCells& local, CellReport& report) {
    for (std::size_t i = 0; i < cells.chunk.size(); ++i) {
      bool is_turned = false;
      const std::size_t begin = cells.chunk.begin_of(i);
      format::for_each_tetrahedron(cells.chunk, i, [&](const std::array<std::uint8_t, 4>& at) {
        const auto corner = [&](std::size_t k) { return positions_[local.corners[begin + at[k]]]; };
        const double volume = signed_volume_6(corner(0), corner(1), corner(2), corner(3)) / 6;
        report.volume += std::abs(volume);
        if (!(volume * cells.signs[i] < 0)) return;
        is_turned = true;
        report.turned_volume += std::abs(volume);
      });
      report.turned += is_turned ? 1 : 0;
    }
  }

  const format::VolumeInfo& info_;
  const format::RankedPoints& points_;
  const format::CellVertices& vertices_;
  std::vector<format::ValueBins> bins_;  // [attribute]
  std::vector<format::RankedPoints::Place> places_;
  std::vector<dvec3> positions_;
  std::vector<float> values_;
};

// Lays the parts of the section out.
class SectionWriter {
 public:
  // `waiting`: an empty file for the pages of chunks, which follow the last chunk.
  SectionWriter(std::size_t attributes, TempFile waiting, const Append& append)
      : summaries_(attributes), page_bytes_(std::move(waiting)), append_(append) {}

  Status add(MadeChunk chunk) {
    format::CellChunkEntry& entry = chunk.packed.entry;
    if (chunks_.size() == format::max_page_chunks) SPLATVOL_TRY(close_page());
    entry.offset = offset_;
    SPLATVOL_TRY(append(chunk.packed.bytes));
    chunks_.push_back(entry);
    for (std::size_t a = 0; a < summaries_.size(); ++a) summaries_[a].push_back(chunk.summaries[a]);
    ++chunk_count_;
    if (kinds_.empty() || kinds_.back().shape != entry.shape || kinds_.back().field != entry.field)
      kinds_.push_back({entry.shape, entry.field, {}, 0, 0, 0});
    kinds_.back().cells += entry.cells;
    kinds_.back().packed_bytes += entry.packed_bytes;
    return {};
  }

  // Counts cells of the chunks that were added last.
  void count_turned(std::uint64_t cells) { kinds_.back().turned += cells; }

  // Adds a page: all pages of ranks, then those of vertices. Called before the first chunk.
  Status add(format::PackedPageRef page, std::span<const std::byte> packed) {
    page.offset = offset_;
    packed_pages_.push_back(page);
    return append(packed);
  }
  void set_vertices(std::uint64_t count) { vertex_count_ = count; }

  // Adds the pages of chunks and the root. Returns the bytes of the section.
  Result<std::uint64_t> finish() {
    if (!chunks_.empty()) SPLATVOL_TRY(close_page());
    for (format::CellPageRef& page : pages_) page.offset += offset_;
    SPLATVOL_TRY(format::move_bytes(page_bytes_, [&](std::span<const std::byte> bytes) { return append(bytes); }));
    format::Bytes root;
    for (const format::CellKind& kind : kinds_) format::append_record(root, kind);
    for (const format::CellPageRef& page : pages_) format::append_record(root, page);
    for (const format::PackedPageRef& page : packed_pages_) format::append_record(root, page);
    const format::CellsTail tail{.hash = format::hash_bytes(root),
                                 .chunks = chunk_count_,
                                 .pages = pages_.size(),
                                 .vertices = vertex_count_,
                                 .kinds = static_cast<std::uint32_t>(kinds_.size()),
                                 .version = format::cells_version};
    format::append_record(root, tail);
    SPLATVOL_TRY(append(root));
    return offset_;
  }

 private:
  Status append(std::span<const std::byte> bytes) {
    offset_ += bytes.size();
    return append_(bytes);
  }

  Status close_page() {
    format::CellPageRef ref{};
    Box box;
    format::Bytes table, parts;
    for (const format::CellChunkEntry& entry : chunks_) {
      box.include(dvec3(entry.low[0], entry.low[1], entry.low[2]));
      box.include(dvec3(entry.high[0], entry.high[1], entry.high[2]));
      ref.area += entry.area;
    }
    format::append_part(table, parts, std::as_bytes(std::span(chunks_)));
    for (std::vector<format::ValueSummary>& summaries : summaries_) {
      format::append_part(table, parts, format::pack_summaries(summaries));
      summaries.clear();
    }
    ref.offset = page_bytes_.size();  // more when all chunks are there
    ref.page_bytes = static_cast<std::uint32_t>(table.size() + parts.size());
    ref.chunks = static_cast<std::uint32_t>(chunks_.size());
    ref.hash = format::hash_bytes(table);
    ref.chunks_offset = chunks_.front().offset;
    for (int axis = 0; axis < 3; ++axis) {
      ref.low[axis] = box.low[axis];
      ref.high[axis] = box.high[axis];
    }
    pages_.push_back(ref);
    chunks_.clear();
    SPLATVOL_TRY(page_bytes_.append(table));
    return page_bytes_.append(parts);
  }

  std::vector<std::vector<format::ValueSummary>> summaries_;  // [attribute][chunk of the page]
  TempFile page_bytes_;
  const Append& append_;
  std::uint64_t offset_ = 0;
  std::uint64_t chunk_count_ = 0;
  std::vector<format::CellKind> kinds_;
  std::vector<format::CellChunkEntry> chunks_;  // of the page
  std::vector<format::CellPageRef> pages_;
  std::vector<format::PackedPageRef> packed_pages_;  // of ranks, then of vertices
  std::uint64_t vertex_count_ = 0;
};

// Makes chunks on several threads, and writes them in order.
class ChunkPipeline {
 public:
  ChunkPipeline(MeshCells& cells, const std::shared_ptr<const format::ChunkSource>& chunks, const RankPages& ranks,
                std::uint64_t memory, SectionWriter& writer, const std::function<void(double)>& progress)
      : cells_(cells),
        writer_(writer),
        progress_(progress),
        threads_(static_cast<std::size_t>(tbb::this_task_arena::max_concurrency())),
        points_(
            chunks, [&ranks](std::size_t page) { return ranks.read(page); }, own_room(memory)),
        vertices_([vertices = cells.vertices(),
                   &cube = chunks->info().cube](std::size_t page) { return vertices->read(page, cube); },
                  own_room(memory / 2)),
        makers_([this, &info = chunks->info()] { return ChunkMaker(info, points_, vertices_); }) {}

  Result<CellReport> run() {
    constexpr auto in_order = tbb::filter_mode::serial_in_order, parallel = tbb::filter_mode::parallel;
    tbb::parallel_pipeline(
        2 * threads_,
        tbb::make_filter<void, std::shared_ptr<Item>>(in_order, [&](tbb::flow_control& control) {
          return take(control);
        }) & tbb::make_filter<std::shared_ptr<Item>, std::shared_ptr<Item>>(parallel, [&](std::shared_ptr<Item> item) {
          if (!failed_) makers_.local().make(*item);
          return item;
        }) & tbb::make_filter<std::shared_ptr<Item>, void>(in_order, [&](const std::shared_ptr<Item>& item) {
          write(*item);
        }));
    SPLATVOL_TRY(taken_);
    SPLATVOL_TRY(written_);
    return report_;
  }

 private:
  std::shared_ptr<Item> take(tbb::flow_control& control) {
    auto item = std::make_shared<Item>();
    const auto more = cells_.next_chunk(item->cells);
    if (!more) taken_ = tl::unexpected(more.error());
    if (stop_.stop_requested()) taken_ = fail(ErrorCode::cancelled, "cancelled");
    if (taken_ && *more && !failed_) return item;
    control.stop();
    return nullptr;
  }

  void write(Item& item) {
    if (failed_) return;
    written_ = item.status;
    for (MadeChunk& chunk : item.chunks)
      if (written_) written_ = writer_.add(std::move(chunk));
    failed_ = !written_;
    if (failed_) return;
    writer_.count_turned(item.report.turned);
    report_.cells += item.cells.cells;
    report_.turned += item.report.turned;
    report_.volume += item.report.volume;
    report_.turned_volume += item.report.turned_volume;
    progress_(static_cast<double>(report_.cells) / static_cast<double>(cells_.count()));
  }

  MeshCells& cells_;
  SectionWriter& writer_;
  const std::function<void(double)>& progress_;
  const std::stop_token stop_ = stop_of_thread();  // of the caller: any thread may take
  std::size_t threads_;
  format::RankedPoints points_;
  format::CellVertices vertices_;  // none is read if the corners are points
  tbb::enumerable_thread_specific<ChunkMaker> makers_;
  CellReport report_;
  Status taken_, written_;
  std::atomic<bool> failed_ = false;
};

}  // namespace

Result<CellReport> write_cells(MeshCells& cells, const std::shared_ptr<const format::ChunkSource>& chunks,
                               std::uint64_t memory, const std::string& folder,
                               const std::function<Status(std::span<const std::byte>)>& append,
                               const std::function<void(double)>& progress) {
  SPLATVOL_TRY_ASSIGN(waiting, TempFile::create(folder));
  SectionWriter writer(chunks->info().attributes.size(), std::move(waiting), append);
  SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder));
  RankPages ranks(chunks->info(), std::move(file));
  SPLATVOL_TRY(ranks.make(cells, [&](const format::PackedPageRef& page, std::span<const std::byte> packed) {
    return writer.add(page, packed);
  }));
  if (const VertexSort* vertices = cells.vertices()) {
    writer.set_vertices(vertices->count());
    for (std::size_t page = 0; page < vertices->pages().size(); ++page) {
      SPLATVOL_TRY_ASSIGN(packed, vertices->read_packed(page));
      SPLATVOL_TRY(writer.add(vertices->pages()[page], packed));
    }
  }
  SPLATVOL_TRY_ASSIGN(report, ChunkPipeline(cells, chunks, ranks, memory, writer, progress).run());
  report.collapsed = cells.collapsed();
  SPLATVOL_TRY_SET(report.bytes, writer.finish());
  return report;
}

}  // namespace splatvol
