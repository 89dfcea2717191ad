#include "streamer/loader.h"

#include <algorithm>
#include <atomic>
#include <iterator>
#include <utility>

#include "streamer/decode.h"

namespace splatvol {
namespace {

std::uint64_t end_of(const PartLoad& part) {
  return part.chunk().location.offset + part.chunk().location.entry.packed_bytes;
}

std::string describe(const format::Volume& volume, const PartLoad& part) {
  if (const auto* chunk = std::get_if<ChunkLoad>(&part.what))
    return fmt::format("{}: chunk '{}' of row {}", volume.name(), column_kind_name(chunk->kind), part.key.number);
  const bool of_index = part.key.kind == CacheKey::Kind::index_page;
  return fmt::format("{}: {} page {}", volume.name(), of_index ? "index" : "directory", part.key.number);
}

// Puts the name of the part in front of the reason, unless the reader did.
tl::unexpected<Error> fail_in_part(const format::Volume& volume, const PartLoad& part, const Error& error) {
  const std::string what = describe(volume, part);
  if (error.message.starts_with(what)) return tl::unexpected(error);
  return fail(error.code, "{}: {}", what, error.message);
}

Result<format::IndexPage> read_index_page(const format::Volume& volume, int attribute, const IndexPageLoad& load) {
  if (load.structure) return volume.with_summaries(*load.structure, attribute);
  return volume.read_index_page(load.ref, load.child_mask, load.parent_counts, attribute);
}

template <class Page>
Result<CacheData> as_data(const format::Volume& volume, const PartLoad& part, Result<Page> page) {
  if (!page) return fail_in_part(volume, part, page.error());
  return CacheData(std::move(*page));
}

}  // namespace

PartLoad chunk_load(const CacheKey& key, const ChunkLoad& what) { return {key, what, {}, {}, CacheData()}; }

std::uint64_t decoded_bytes(const ChunkLoad& chunk) { return decoded_bytes(chunk.kind, chunk.points); }

std::uint64_t working_bytes(const format::Volume& volume, const ChunkLoad& chunk) {
  const format::ChunkEntry& entry = chunk.location.entry;
  return volume.cheap_gap() + entry.packed_bytes + decoding_bytes(chunk.kind, chunk.points, entry.unpacked_bytes);
}

std::vector<LoadRun> runs_of(const format::Volume& volume, std::vector<PartLoad> chunks, std::uint64_t run_bytes) {
  std::ranges::sort(chunks, {}, [](const PartLoad& part) { return part.chunk().location.offset; });
  std::vector<LoadRun> runs;
  for (PartLoad& part : chunks) {
    const bool joins = !runs.empty() &&
                       part.chunk().location.offset - end_of(runs.back().back()) <= volume.cheap_gap() &&
                       end_of(part) - runs.back().front().chunk().location.offset <= run_bytes;
    if (!joins) runs.emplace_back();
    runs.back().push_back(std::move(part));
  }
  return runs;
}

void read_run(const format::Volume& volume, int attribute, LoadRun& run) {
  PartLoad& first = run.front();
  if (const auto* page = std::get_if<IndexPageLoad>(&first.what)) {
    first.data = as_data(volume, first, read_index_page(volume, attribute, *page));
    return;
  }
  if (std::holds_alternative<DirectoryPageLoad>(first.what)) {
    first.data = as_data(volume, first, volume.read_directory_page(first.key.number));
    return;
  }

  const std::uint64_t begin = first.chunk().location.offset;
  const auto bytes = volume.read_bytes(begin, end_of(run.back()) - begin);
  for (PartLoad& part : run) {
    if (!bytes) {
      part.data = fail_in_part(volume, part, bytes.error());
      continue;
    }
    const ChunkLoad& chunk = part.chunk();
    const auto packed = std::span(*bytes).subspan(chunk.location.offset - begin, chunk.location.entry.packed_bytes);
    auto decoded = decode_chunk(chunk.kind, chunk.location.entry, packed, chunk.points, volume.info().cube,
                                describe(volume, part));
    if (decoded)
      part.data = CacheData(std::move(*decoded));
    else
      part.data = tl::unexpected(decoded.error());
  }
}

void read_runs(const format::Volume& volume, int attribute, std::span<LoadRun> runs) {
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t i = next++; i < runs.size(); i = next++) read_run(volume, attribute, runs[i]);
  };
  std::vector<std::jthread> others;
  for (std::size_t t = 1; t < std::min<std::size_t>(read_threads, runs.size()); ++t) others.emplace_back(work);
  work();
}

Loader::Loader(const format::Volume& volume, int attribute, unsigned threads) : volume_(volume), attribute_(attribute) {
  for (unsigned i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

Loader::~Loader() {
  {
    const std::scoped_lock lock(mutex_);
    stopping_ = true;
  }
  submitted_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void Loader::submit(LoadRun run) {
  {
    const std::scoped_lock lock(mutex_);
    queue_.push_back(std::move(run));
  }
  submitted_.notify_one();
}

std::vector<LoadRun> Loader::withdraw() {
  const std::scoped_lock lock(mutex_);
  std::vector<LoadRun> runs(std::make_move_iterator(queue_.begin()), std::make_move_iterator(queue_.end()));
  queue_.clear();
  return runs;
}

std::vector<LoadRun> Loader::extract_done() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(done_, {});
}

void Loader::wait_until(std::chrono::steady_clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  finished_.wait_until(lock, deadline, [this] { return !done_.empty() || (queue_.empty() && begun_ == 0); });
}

void Loader::work() {
  std::unique_lock lock(mutex_);
  for (;;) {
    submitted_.wait(lock, [this] { return stopping_ || !queue_.empty(); });
    if (stopping_) return;
    LoadRun run = std::move(queue_.front());
    queue_.pop_front();
    ++begun_;
    lock.unlock();
    read_run(volume_, attribute_, run);
    for (PartLoad& part : run) part.working = Reservation();
    lock.lock();
    --begun_;
    done_.push_back(std::move(run));
    finished_.notify_all();
  }
}

}  // namespace splatvol
