#include "builder/points/point_stream.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "base/interruption.h"
#include "base/temp_file.h"
#include "builder/points/piece_faces.h"
#include "builder/points/piece_reader.h"
#include "builder/points/point_ranges.h"
#include "builder/sorting/record_spool.h"

namespace splatvol {
namespace {

// Most points of one key that are compared with each other at a time. No vertex belongs to more pieces.
constexpr std::size_t longest_run(bool of_vertices) { return of_vertices ? std::size_t{1} << 16 : 4096; }

// The least that a point takes in the finished file, which grows while the sorted points are still in their folder.
constexpr std::uint64_t least_file_bytes = 20;

// A sort that has all points.
struct PointSort {
  Cube cube;
  ExternalSorter points;
};

// Reads an input's points into a sort.
class InputSorter {
 public:
  InputSorter(Source& source, const PointRecords& layout, std::size_t memory, const std::string& folder)
      : source_(source), layout_(layout), memory_(memory), folder_(folder) {}

  Result<PointSort> run(PieceReader& reader, const std::function<void(double)>& progress) const {
    SPLATVOL_TRY_ASSIGN(bounds, source_.bounds());
    return bounds ? sort_within(*bounds, reader, progress) : sort_after_reading(reader, progress);
  }

 private:
  Result<PointSort> sort_within(const Box& bounds, PieceReader& reader,
                                const std::function<void(double)>& progress) const {
    SPLATVOL_TRY_ASSIGN(cube, bounding_cube(bounds));
    SPLATVOL_TRY_ASSIGN(points, start_sort(cube, memory_));
    SPLATVOL_TRY(reader.run(progress, {}, [&](std::span<const std::byte> records) { return points.add(records); }));
    return PointSort{cube, std::move(points)};
  }

  // Keys need the bounds of all points: the points of several pieces wait until these are known.
  Result<PointSort> sort_after_reading(PieceReader& reader, const std::function<void(double)>& progress) const {
    RecordSpool spool(layout_.bytes(), memory_ / 4, folder_);
    std::optional<PointSort> only;
    const auto start_only = [&](const Box& box) -> Status {
      SPLATVOL_TRY_ASSIGN(cube, bounding_cube(box));
      SPLATVOL_TRY_ASSIGN(points, start_sort(cube, memory_));
      only.emplace(PointSort{cube, std::move(points)});
      return {};
    };
    SPLATVOL_TRY(reader.run(progress, start_only, [&](std::span<const std::byte> records) {
      return only ? add_kept(records, reader, only->points) : spool.append(records);
    }));
    if (only) return std::move(*only);
    SPLATVOL_TRY_ASSIGN(cube, bounding_cube(reader.box()));
    SPLATVOL_TRY_ASSIGN(points, start_sort(cube, memory_ / 2));
    for (;;) {
      SPLATVOL_TRY_ASSIGN(records, spool.next());
      if (records.empty()) break;
      SPLATVOL_TRY(add_kept(records, reader, points));
    }
    return PointSort{cube, std::move(points)};
  }

  // Adds the records that the reader does not leave out, in as few parts as possible.
  Status add_kept(std::span<const std::byte> records, PieceReader& reader, ExternalSorter& points) const {
    const std::size_t bytes = layout_.bytes();
    std::size_t begin = 0;
    for (std::size_t end = 0; end < records.size(); end += bytes) {
      if (!reader.leave_out(records.data() + end)) continue;
      if (end > begin) SPLATVOL_TRY(points.add(records.subspan(begin, end - begin)));
      begin = end + bytes;
    }
    return begin < records.size() ? points.add(records.subspan(begin)) : Status{};
  }

  Result<ExternalSorter> start_sort(const Cube& cube, std::size_t memory) const {
    SPLATVOL_TRY_ASSIGN(sorter, PointStream::sort_of_points(layout_, cube, memory, memory_ / 4, folder_));
    SPLATVOL_TRY(PointStream::check_room(folder_, source_.point_count().value_or(0), sorter));
    return sorter;
  }

  Source& source_;
  const PointRecords& layout_;
  std::size_t memory_;
  const std::string& folder_;
};

}  // namespace

PointStream::PointStream(const PointRecords& layout, InputSummary summary, ExternalSorter points,
                         std::optional<BoundaryCorners> corners)
    : layout_(layout),
      stored_layout_(summary.attributes.size(), layout.is_single_precision(), layout.has_material(),
                     layout.has_planes(), layout.has_gradients()),
      summary_(std::move(summary)),
      points_(std::move(points)),
      corners_(std::move(corners)),
      merger_(layout, summary_.has_material, summary_.stored) {}

PointRecords PointStream::layout_of(const Source& source, bool use_cells, bool gradients) {
  return PointRecords(source.attributes().size(), source.single_precision(), use_cells && source.may_have_cells(),
                      use_cells && source.brings_material(), gradients)
      .with_copies(source.copies());
}

Result<ExternalSorter> PointStream::sort_of_points(const PointRecords& layout, const Cube& cube, std::size_t memory,
                                                   std::size_t merge_memory, const std::string& folder, bool rewinds) {
  const auto key = [layout, cube](std::span<const std::byte> records, std::span<MortonKey> keys) {
    for (std::size_t i = 0; i < keys.size(); ++i)
      keys[i] = morton_key(layout.position(records.data() + i * layout.bytes()), cube);
  };
  const std::size_t least = ExternalSorter::least_memory(layout.bytes());
  return ExternalSorter::create(
      {layout.bytes(), key, std::max(memory, least), std::max(merge_memory, least), folder, rewinds});
}

Status PointStream::check_room(const std::string& folder, std::uint64_t points, const ExternalSorter& sort) {
  SPLATVOL_TRY_ASSIGN(room, free_disk_bytes(folder));
  const std::uint64_t needed = sort.temp_bytes(points) + points * least_file_bytes;
  if (needed > room)
    return fail(ErrorCode::io, "{}: {} points need at least {} bytes there, and {} are free", folder, points, needed,
                room);
  return {};
}

Result<PointStream> PointStream::create(Source& source, bool use_cells, std::size_t memory, const std::string& folder,
                                        const std::function<void(double)>& progress, bool gradients,
                                        const JoinedAttributes& joined, WatchPoints watch) {
  const PointRecords layout = layout_of(source, use_cells, gradients).with_tags(static_cast<bool>(watch.rank));
  PieceFaces faces(layout, std::max(memory / 8, PieceFaces::least_memory()), folder);
  source.lend_values();
  if (layout.has_tags()) source.tell_whole_cells();
  const std::size_t slice_memory = memory / 16;
  PieceReader reader(source, layout, faces, slice_memory, std::move(watch.piece));
  SPLATVOL_TRY_ASSIGN(sorted, InputSorter(source, layout, memory, folder).run(reader, progress));
  SPLATVOL_TRY(sorted.points.finish());
  SPLATVOL_TRY_ASSIGN(corners, faces.join(sorted.cube));
  InputSummary summary = reader.summary(joined);
  summary.cube = sorted.cube;
  summary.bytes_to_read += slice_memory + std::min<std::uint64_t>(memory, summary.census.read * layout.bytes());
  PointStream stream(layout, std::move(summary), std::move(sorted.points), std::move(corners));
  stream.watch_rank_ = std::move(watch.rank);
  return stream;
}

Status PointStream::rewind() {
  returned_ = 0;
  merger_ = SampleMerger(layout_, summary_.has_material, summary_.stored);
  summary_.census.merged = summary_.census.unlike = summary_.census.coincident = 0;
  return points_.rewind();
}

// Takes the next of the sorted records.
SortedRecords PointStream::take(std::size_t count) {
  const std::size_t bytes = count * layout_.bytes();
  const SortedRecords taken{sorted_.records.first(bytes), sorted_.keys.first(count)};
  sorted_ = {sorted_.records.subspan(bytes), sorted_.keys.subspan(count)};
  return taken;
}

// Returns the records of the next key; none at the end. A run that is too long comes in parts, which begin at the same
// points wherever the reads end.
Result<SortedRecords> PointStream::next_run() {
  if (sorted_.keys.size() > 1 && sorted_.keys[0] != sorted_.keys[1]) return take(1);  // most have one record
  const std::size_t longest = longest_run(layout_.has_material());
  run_.clear();
  run_keys_.clear();
  for (;;) {
    const std::span<const MortonKey> keys = sorted_.keys;
    const MortonKey key = !run_keys_.empty() ? run_keys_[0] : !keys.empty() ? keys[0] : MortonKey{};
    std::size_t count = 0;
    while (count < keys.size() && run_keys_.size() + count < longest && keys[count] == key) ++count;
    const bool is_whole = count < keys.size();
    const SortedRecords part = take(count);
    if (is_whole && run_keys_.empty()) return part;
    run_.insert(run_.end(), part.records.begin(), part.records.end());
    run_keys_.insert(run_keys_.end(), part.keys.begin(), part.keys.end());
    if (!is_whole) SPLATVOL_TRY_SET(sorted_, points_.next());
    if (is_whole || sorted_.keys.empty()) return SortedRecords{run_, run_keys_};
  }
}

// Keeps the blocks of points for their planes, if a vertex has copies in its own block only. `points`: of the records,
// numbers in a batch whose points from `first` on are new.
void PointStream::note_blocks(const std::byte* records, std::span<const std::size_t> points, std::size_t first) {
  if (!corners_ || layout_.copies() != VertexCopies::same_block) return;
  for (std::size_t i = 0; i < points.size(); ++i) {
    blocks_.resize(std::max(blocks_.size(), points[i] - first + 1));
    blocks_[points[i] - first] = layout_.block(records + i * layout_.bytes());
  }
}

Result<bool> PointStream::next(PointBatch& batch) {
  SPLATVOL_TRY(check_interruption());
  const std::size_t first = batch.size();
  blocks_.clear();
  while (batch.size() - first < points_at_once) {
    SPLATVOL_TRY_ASSIGN(run, next_run());
    if (run.keys.empty()) break;
    const std::byte* record = run.records.data();
    const auto points = merger_.append(record, run.keys.size(), run.keys[0], batch, summary_.census);
    note_blocks(record, points, first);
    for (std::size_t i = 0; watch_rank_ && i < points.size(); ++i)
      SPLATVOL_TRY(
          watch_rank_(layout_.tag(record + i * layout_.bytes()), first_rank_ + returned_ + (points[i] - first)));
  }
  if (batch.size() == first) return false;
  returned_ += batch.size() - first;
  if (corners_) SPLATVOL_TRY(corners_->append_planes(batch, first, summary_.stored, blocks_));
  return true;
}

}  // namespace splatvol
