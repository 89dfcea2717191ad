#include "streamer/splats/step_prefetch.h"

#include <algorithm>
#include <new>
#include <utility>

#include "base/interruption.h"

namespace splatvol {

using format::DirectoryPage;

StepPrefetch::StepPrefetch(std::shared_ptr<const format::Volume> from, std::size_t step,
                           const format::SummaryAttributes& attributes, std::vector<PartLoad> pages,
                           std::vector<PartLoad> rows, Reservation working)
    : from_(std::move(from)),
      step_(step),
      attributes_(attributes),
      pages_(std::move(pages)),
      rows_(std::move(rows)),
      working_(std::move(working)),
      thread_([this] { run(); }) {}

StepPrefetch::~StepPrefetch() {
  stop_.request_stop();
  if (thread_.joinable()) thread_.join();
}

StepPrefetch::Result StepPrefetch::extract() {
  thread_.join();
  return std::move(result_);
}

void StepPrefetch::run() {
  const Interruptible interruptible(stop_.get_token());
  try {
    read_step();
  } catch (const std::bad_alloc&) {
    result_ = {};  // the step is read when it is shown
  }
  done_ = true;
}

void StepPrefetch::read_step() {
  auto opened = from_->at_step(step_);
  if (!opened) return;
  result_.volume = std::move(*opened);
  if (!has_same_layout()) return;
  read_parts(std::move(pages_));
  std::erase_if(rows_, [&](PartLoad& row) { return !find_locations(row); });
  read_parts(std::move(rows_));
  working_ = Reservation();
}

// Steps may have their columns in another order; a writer has no reason to.
bool StepPrefetch::has_same_layout() const {
  const auto same = [](const format::Column& a, const format::Column& b) {
    return a.kind == b.kind && a.scope == b.scope && a.attribute == b.attribute;
  };
  return std::ranges::equal(from_->info().columns, result_.volume->info().columns, same) &&
         from_->directory_page_count() == result_.volume->directory_page_count();
}

void StepPrefetch::read_parts(std::vector<PartLoad> parts) {
  for (LoadRun& run : runs_of(*result_.volume, std::move(parts), run_bytes)) {
    if (stop_.stop_requested()) return;
    read_run(*result_.volume, attributes_, run);
    for (PartLoad& part : run)
      if (part.data && held_bytes(*part.data) <= part.decoded.bytes()) result_.parts.push_back(std::move(part));
  }
}

const DirectoryPage* StepPrefetch::find_page(std::uint64_t number) const {
  for (const PartLoad& part : result_.parts)
    if (part.key.kind == format::directory_page && part.key.number == number)
      return &std::get<DirectoryPage>(*part.data);
  return nullptr;
}

bool StepPrefetch::find_locations(PartLoad& row) const {
  const format::Volume& volume = *result_.volume;
  for (ChunkLoad& chunk : std::get<RowLoad>(row.what).chunks) {
    const DirectoryPage* page = find_page(volume.directory_page_of_row(chunk.row, chunk.column));
    if (!page) return false;
    chunk.location = volume.find_chunk(*page, chunk.row, chunk.column);
  }
  return true;
}

}  // namespace splatvol
