#include "streamer/loader.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <iterator>
#include <new>
#include <system_error>
#include <utility>

#include "base/interruption.h"
#include "base/low_priority.h"
#include "format/columns.h"
#include "streamer/decode.h"
#include "streamer/row_bytes.h"

namespace splatvol {
namespace {

// Bytes of the file.
struct Extent {
  std::uint64_t begin, end;
};

Extent extent_of(const ChunkLoad& chunk) {
  return {chunk.location.offset, chunk.location.offset + chunk.location.entry.packed_bytes};
}

std::vector<Extent> extents_of(const PartLoad& part) {
  std::vector<Extent> extents;
  std::ranges::transform(part.row().chunks, std::back_inserter(extents), extent_of);
  std::ranges::sort(extents, {}, &Extent::begin);
  return extents;
}

std::string name_of(const format::Volume& volume, const ChunkLoad& chunk) {
  const format::ColumnKind kind = volume.info().columns[static_cast<std::size_t>(chunk.column)].kind;
  return fmt::format("chunk '{}' of row {}", column_kind_name(kind), chunk.row);
}

std::string describe(const format::Volume& volume, const PartLoad& part) {
  if (const auto* row = std::get_if<RowLoad>(&part.what)) {
    std::string text = fmt::format("{}: {}", volume.name(), name_of(volume, row->chunks.front()));
    for (const ChunkLoad& chunk : std::span(row->chunks).subspan(1)) text += " or " + name_of(volume, chunk);
    return text;
  }
  const bool of_index = part.key.kind == CacheKey::Kind::index_page;
  return fmt::format("{}: {} page {}", volume.name(), of_index ? "index" : "directory", part.key.number);
}

// Puts the name of the part in front of the reason, unless the reader did.
tl::unexpected<Error> fail_in_part(const format::Volume& volume, const PartLoad& part, const Error& error) {
  const std::string what = describe(volume, part);
  if (error.message.starts_with(what)) return tl::unexpected(error);
  return fail(error.code, "{}: {}", what, error.message);
}

Result<format::IndexPage> read_index_page(const format::Volume& volume, const format::SummaryAttributes& attributes,
                                          const IndexPageLoad& load) {
  if (load.structure) return volume.with_summaries(*load.structure, attributes);
  return volume.read_index_page(load.ref, load.child_mask, load.parent_counts, attributes);
}

template <class Page>
Result<CacheData> as_data(const format::Volume& volume, const PartLoad& part, Result<Page> page) {
  if (!page) return fail_in_part(volume, part, page.error());
  return CacheData(std::move(*page));
}

// Reads the chunks of a load run, and joins reads where the gap between them costs less than another read.
class RunBytes {
 public:
  RunBytes(const format::Volume& volume, const LoadRun& run) {
    for (const PartLoad& part : run) std::ranges::copy(extents_of(part), std::back_inserter(extents_));
    std::ranges::sort(extents_, {}, &Extent::begin);
    std::size_t joined = 0;
    for (const Extent& extent : extents_)
      if (joined > 0 && extent.begin <= extents_[joined - 1].end + volume.cheap_gap())
        extents_[joined - 1].end = std::max(extents_[joined - 1].end, extent.end);
      else
        extents_[joined++] = extent;
    extents_.resize(joined);
    for (const Extent& extent : extents_) read_.push_back(volume.read_bytes(extent.begin, extent.end - extent.begin));
  }

  // Fails if the chunk could not be read.
  Result<ChunkBytes> of(const ChunkLoad& chunk) const {
    const auto after = std::ranges::upper_bound(extents_, chunk.location.offset, {}, &Extent::begin);
    const auto i = static_cast<std::size_t>(after - extents_.begin()) - 1;
    if (!read_[i]) return tl::unexpected(read_[i].error());
    return ChunkBytes{chunk.location.entry, std::span(*read_[i]).subspan(chunk.location.offset - extents_[i].begin,
                                                                         chunk.location.entry.packed_bytes)};
  }

 private:
  std::vector<Extent> extents_;
  std::vector<Result<format::Bytes>> read_;
};

Result<CacheData> decode(const format::Volume& volume, const PartLoad& part, std::span<const ChunkBytes> chunks,
                         std::string_view what) {
  const RowLoad& row = part.row();
  if (part.key.kind == CacheKey::Kind::shapes) {
    SPLATVOL_TRY_ASSIGN(shapes, decode_shapes(row.kernel, chunks[0], chunks[1], row.points, volume.info().cube, what));
    return CacheData(std::make_shared<const ShapeRow>(std::move(shapes)));
  }
  ValueChunks of_values{chunks[0]};
  if (row.opacity) of_values.opacity = &chunks.back();
  if (chunks.size() > (row.opacity ? 2 : 1)) of_values.gradients = &chunks[1];
  SPLATVOL_TRY_ASSIGN(values, decode_values(row.kernel, of_values, row.points, what));
  return CacheData(std::make_shared<const ValueRow>(std::move(values)));
}

// Decoding names all chunks of the part. If one of them is damaged, names this one.
Result<CacheData> read_row(const format::Volume& volume, const PartLoad& part, const RunBytes& bytes) {
  std::vector<ChunkBytes> chunks;
  for (const ChunkLoad& chunk : part.row().chunks) {
    auto read = bytes.of(chunk);
    if (!read)
      return fail(read.error().code, "{}: {}: {}", volume.name(), name_of(volume, chunk), read.error().message);
    chunks.push_back(*read);
  }
  auto data = decode(volume, part, chunks, describe(volume, part));
  if (data) return data;
  for (std::size_t i = 0; i < chunks.size(); ++i)
    if (format::hash_bytes(chunks[i].packed) != chunks[i].entry.hash)
      return fail(ErrorCode::invalid_data, "{}: {}: checksum mismatch", volume.name(),
                  name_of(volume, part.row().chunks[i]));
  return data;
}

}  // namespace

PartLoad row_load(const CacheKey& key, RowLoad what) { return {key, std::move(what), {}, {}, CacheData()}; }

std::uint64_t decoded_bytes(const PartLoad& part) {
  const RowLoad& row = part.row();
  return part.key.kind == CacheKey::Kind::shapes ? shape_row_bytes(row.kernel, row.points)
                                                 : value_row_bytes(row.kernel, row.points, row.opacity);
}

std::uint64_t working_bytes(const format::Volume& volume, const PartLoad& part) {
  const RowLoad& row = part.row();
  std::uint64_t unpacked = 0, packed = 0;
  for (const ChunkLoad& chunk : row.chunks) {
    unpacked += chunk.location.entry.unpacked_bytes;
    packed += chunk.location.entry.packed_bytes + volume.cheap_gap();
  }
  return packed + (part.key.kind == CacheKey::Kind::shapes ? shape_decoding_bytes(row.kernel, row.points, unpacked)
                                                           : value_decoding_bytes(row.kernel, row.points, unpacked));
}

std::uint64_t held_bytes(const CacheData& data) {
  struct Held {
    std::uint64_t operator()(const format::IndexPage& page) const { return page.memory_bytes(); }
    std::uint64_t operator()(const format::DirectoryPage& page) const { return page.memory_bytes(); }
    std::uint64_t operator()(const std::shared_ptr<const ShapeRow>& row) const { return held_bytes(*row); }
    std::uint64_t operator()(const std::shared_ptr<const ValueRow>& row) const { return held_bytes(*row); }
  };
  return std::visit(Held(), data);
}

// A run goes on along the chunks that are near the end of those before. Other chunks of its parts only add bytes.
std::vector<LoadRun> runs_of(const format::Volume& volume, std::vector<PartLoad> parts, std::uint64_t run_bytes) {
  std::vector<std::pair<std::vector<Extent>, PartLoad*>> sorted;
  for (PartLoad& part : parts) sorted.emplace_back(extents_of(part), &part);
  std::ranges::sort(sorted, {},
                    [](const auto& part) { return std::pair(part.first.front().begin, part.first.back().begin); });
  std::vector<LoadRun> runs;
  std::uint64_t end = 0, bytes = 0;  // of the last run
  for (auto& [extents, part] : sorted) {
    std::uint64_t new_end = extents.front().begin, added = 0;
    for (const Extent& extent : extents) {
      if (extent.begin <= new_end + volume.cheap_gap())
        new_end = std::max(new_end, extent.end);
      else
        added += extent.end - extent.begin;
    }
    const std::uint64_t begin = extents.front().begin;
    const bool joins =
        !runs.empty() && begin <= end + volume.cheap_gap() && bytes + added + std::max(new_end, end) - end <= run_bytes;
    if (!joins) {
      runs.emplace_back();
      bytes = 0;
    }
    bytes += added + (joins ? std::max(new_end, end) - end : new_end - begin);
    end = joins ? std::max(new_end, end) : new_end;
    runs.back().push_back(std::move(*part));
  }
  return runs;
}

namespace {

void read_parts(const format::Volume& volume, const format::SummaryAttributes& attributes, LoadRun& run) {
  PartLoad& first = run.front();
  if (const auto* page = std::get_if<IndexPageLoad>(&first.what)) {
    first.data = as_data(volume, first, read_index_page(volume, attributes, *page));
    return;
  }
  if (std::holds_alternative<DirectoryPageLoad>(first.what)) {
    first.data = as_data(volume, first, volume.read_directory_page(first.key.number));
    return;
  }

  const RunBytes bytes(volume, run);
  for (PartLoad& part : run) part.data = read_row(volume, part, bytes);
}

}  // namespace

// The system may have less memory than the budget grants. An exception must not leave a thread.
void read_run(const format::Volume& volume, const format::SummaryAttributes& attributes, LoadRun& run) {
  try {
    read_parts(volume, attributes, run);
  } catch (const std::bad_alloc&) {
    // Of so few letters that they need no memory.
    for (PartLoad& part : run) part.data = tl::unexpected(Error{ErrorCode::out_of_budget, "out of memory"});
  }
}

namespace {

void cancel(LoadRun& run) {
  for (PartLoad& part : run) part.data = fail(ErrorCode::cancelled, "cancelled");
}

}  // namespace

void read_runs(const format::Volume& volume, const format::SummaryAttributes& attributes, std::span<LoadRun> runs) {
  std::atomic<std::size_t> next = 0;
  const std::stop_token stop = stop_of_thread();
  const auto work = [&] {
    const Interruptible interruptible(stop);
    for (std::size_t i = next++; i < runs.size(); i = next++)
      stop.stop_requested() ? cancel(runs[i]) : read_run(volume, attributes, runs[i]);
  };
  std::vector<std::jthread> others;
  try {
    for (std::size_t t = 1; t < std::min<std::size_t>(read_threads, runs.size()); ++t) others.emplace_back(work);
  } catch (const std::system_error&) {
    // Fewer threads do the same.
  }
  work();
}

Loader::Loader(const format::Volume& volume, const format::SummaryAttributes& attributes, unsigned threads,
               std::function<void()> on_data)
    : volume_(volume), attributes_(attributes), on_data_(std::move(on_data)) {
  threads_.reserve(threads);
  try {
    for (unsigned i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
  } catch (const std::system_error&) {
    if (threads_.empty()) throw;  // fewer threads do the same, none do not
  }
}

Loader::~Loader() {
  {
    const std::scoped_lock lock(mutex_);
    stop_.request_stop();
  }
  submitted_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

namespace {

std::vector<LoadRun> take_all(std::list<LoadRun>& runs) {
  std::vector<LoadRun> taken(std::make_move_iterator(runs.begin()), std::make_move_iterator(runs.end()));
  runs.clear();
  return taken;
}

}  // namespace

void Loader::submit(LoadRun run) {
  {
    const std::scoped_lock lock(mutex_);
    queue_.push_back(std::move(run));
  }
  submitted_.notify_one();
}

std::vector<LoadRun> Loader::withdraw() {
  const std::scoped_lock lock(mutex_);
  return take_all(queue_);
}

std::vector<LoadRun> Loader::extract_done() {
  const std::scoped_lock lock(mutex_);
  return take_all(done_);
}

void Loader::wait_until(std::chrono::steady_clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  const auto is_over = [this] { return !done_.empty() || (queue_.empty() && begun_ == 0); };
  for (auto now = std::chrono::steady_clock::now(); now < deadline && !is_interrupted() && !is_over();
       now = std::chrono::steady_clock::now())
    finished_.wait_until(lock, std::min(deadline, now + interruption_delay), is_over);
}

void Loader::work() {
  lower_thread_priority();
  const Interruptible interruptible(stop_.get_token());
  std::unique_lock lock(mutex_);
  for (;;) {
    submitted_.wait(lock, [this] { return stop_.stop_requested() || !queue_.empty(); });
    if (stop_.stop_requested()) return;
    std::list<LoadRun> run;
    run.splice(run.begin(), queue_, queue_.begin());
    ++begun_;
    lock.unlock();
    read_run(volume_, attributes_, run.front());
    for (PartLoad& part : run.front()) part.working = Reservation();
    lock.lock();
    --begun_;
    done_.splice(done_.end(), run);
    finished_.notify_all();
    if (!on_data_) continue;
    lock.unlock();
    on_data_();
    lock.lock();
  }
}

}  // namespace splatvol
