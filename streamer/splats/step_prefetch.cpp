#include "streamer/splats/step_prefetch.h"

#include <algorithm>
#include <new>
#include <utility>

#include "base/interruption.h"

namespace splatvol {
namespace {

using format::DirectoryPage;

// Steps may have their columns in another order; a writer has no reason to.
bool have_same_layout(const format::Volume& one, const format::Volume& other) {
  const auto same = [](const format::Column& a, const format::Column& b) {
    return a.kind == b.kind && a.scope == b.scope && a.attribute == b.attribute;
  };
  return std::ranges::equal(one.info().columns, other.info().columns, same) &&
         one.directory_page_count() == other.directory_page_count();
}

void read_parts(const format::SummaryAttributes& attributes, std::vector<PartLoad> parts, StepParts& read) {
  for (LoadRun& run : runs_of(*read.volume, std::move(parts), step_run_bytes)) {
    if (is_interrupted()) return;
    read_run(*read.volume, attributes, run);
    for (PartLoad& part : run)
      if (part.data && held_bytes(*part.data) <= part.decoded.bytes()) read.parts.push_back(std::move(part));
  }
}

const DirectoryPage* find_page(const StepParts& read, std::uint64_t number) {
  for (const PartLoad& part : read.parts)
    if (part.key.kind == format::directory_page && part.key.number == number)
      return &std::get<DirectoryPage>(*part.data);
  return nullptr;
}

bool find_locations(const StepParts& read, PartLoad& row) {
  const format::Volume& volume = *read.volume;
  for (ChunkLoad& chunk : std::get<RowLoad>(row.what).chunks) {
    const DirectoryPage* page = find_page(read, volume.directory_page_of_row(chunk.row, chunk.column));
    if (!page) return false;
    chunk.location = volume.find_chunk(*page, chunk.row, chunk.column);
  }
  return true;
}

}  // namespace

StepParts read_step_parts(const format::Volume& from, std::size_t step, const format::SummaryAttributes& attributes,
                          std::vector<PartLoad> pages, std::vector<PartLoad> rows, Reservation /*working*/) {
  try {
    StepParts read;
    auto opened = from.at_step(step);
    if (!opened) return read;
    read.volume = std::move(*opened);
    if (!have_same_layout(from, *read.volume)) return read;
    read_parts(attributes, std::move(pages), read);
    std::erase_if(rows, [&](PartLoad& row) { return !find_locations(read, row); });
    read_parts(attributes, std::move(rows), read);
    return read;
  } catch (const std::bad_alloc&) {
    return {};  // the step is read when it is shown
  }
}

}  // namespace splatvol
