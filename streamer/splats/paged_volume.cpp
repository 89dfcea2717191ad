#include "streamer/splats/paged_volume.h"

namespace splatvol {

using format::DirectoryPage;
using format::IndexPage;

// The size of a page in memory is known only after unpacking. Until then, its packed bytes are reserved.
template <class Page, class Read>
Result<std::shared_ptr<const Page>> PagedVolume::page(PartKey key, std::uint64_t packed_bytes, Read read) {
  if (auto held = room_.find<Page>(key)) return held;
  const auto too_large = [&](std::uint64_t bytes) {
    return fail(ErrorCode::out_of_budget, "{}: no memory for a page of {} bytes", volume_->name(), bytes);
  };
  auto reservation = room_.share->reserve(packed_bytes);
  if (!reservation) return too_large(packed_bytes);
  SPLATVOL_TRY_ASSIGN(fetched, read());
  const std::uint64_t bytes = fetched.memory_bytes();
  reservation.reset();
  reservation = room_.share->reserve(bytes);
  if (!reservation) return too_large(bytes);
  return room_.insert(key, std::move(fetched), std::move(*reservation));
}

Result<IndexPage> PagedVolume::read_root() const {
  const auto structure = structure_of(root_key());
  return structure ? volume_->with_summaries(*structure, attributes_) : volume_->read_index_root(attributes_);
}

std::shared_ptr<const IndexPage> PagedVolume::structure_of(PartKey key) const {
  key.step = step_before_;
  return step_before_ > 0 ? room_.find<IndexPage>(key) : nullptr;
}

Result<std::shared_ptr<const IndexPage>> PagedVolume::root() {
  return note_used(root_key(), page<IndexPage>(root_key(), 0, [&] { return read_root(); }));
}

Result<std::shared_ptr<const IndexPage>> PagedVolume::note_used(const PartKey& key,
                                                                Result<std::shared_ptr<const IndexPage>> page) {
  if (page && used_.keys.insert(key).second) used_.bytes += (*page)->memory_bytes();
  return page;
}

std::pair<PartKey, IndexPageLoad> PagedVolume::load_of_linked(const IndexPage& page, std::uint32_t node) const {
  const format::IndexPageRef& ref = page.pages[page.links[node]];
  const PartKey key = index_key(ref.offset);
  const auto counts = page.nodes.counts_of(node);
  return {key, {ref, page.nodes.child_masks[node], {counts.begin(), counts.end()}, structure_of(key)}};
}

Result<std::shared_ptr<const IndexPage>> PagedVolume::linked(const IndexPage& parent, std::uint32_t node) {
  const format::IndexPageRef& ref = parent.pages[parent.links[node]];
  const PartKey key = index_key(ref.offset);
  return note_used(key, page<IndexPage>(key, ref.page_bytes, [&] {
                     return read_index_page(*volume_, attributes_, load_of_linked(parent, node).second);
                   }));
}

Result<std::shared_ptr<const DirectoryPage>> PagedVolume::directory_page(std::uint64_t number) {
  const std::uint64_t packed = volume_->chunks_of_directory_page(number) * sizeof(format::ChunkEntry);
  return page<DirectoryPage>(directory_key(number), packed + directory_page_bytes(number),
                             [&] { return volume_->read_directory_page(number); });
}

Result<format::ChunkLocation> PagedVolume::find_chunk(std::uint64_t row, int column) {
  SPLATVOL_TRY_ASSIGN(page, directory_page(volume_->directory_page_of_row(row, column)));
  return volume_->find_chunk(*page, row, column);
}

Status PagedVolume::read_directory_pages(const std::set<std::uint64_t>& numbers) {
  std::vector<PartLoad> pages;
  for (const std::uint64_t number : numbers)
    if (!room_.holds(directory_key(number)))
      add_page(load_part(directory_key(number), DirectoryPageLoad()), directory_page_bytes(number), pages);
  return read_pages(std::move(pages));
}

// About the bytes of an unpacked page.
Status PagedVolume::read_index_pages(std::map<PartKey, IndexPageLoad> missing) {
  constexpr std::uint64_t unpacked = 4;
  std::vector<PartLoad> pages;
  for (auto& [key, load] : missing) {
    const std::uint64_t bytes = unpacked * load.ref.page_bytes;
    add_page(load_part(key, std::move(load)), bytes, pages);
  }
  return read_pages(std::move(pages));
}

// A page for which there is no room is read when it is needed.
void PagedVolume::add_page(PartLoad page, std::uint64_t bytes, std::vector<PartLoad>& pages) const {
  auto reservation = room_.share->reserve(bytes);
  if (!reservation) return;
  page.decoded = std::move(*reservation);
  pages.push_back(std::move(page));
}

Status PagedVolume::read_pages(std::vector<PartLoad> pages) {
  std::vector<LoadRun> runs = runs_of(*volume_, std::move(pages), most_part_bytes);
  read_runs(*volume_, attributes_, runs);
  for (LoadRun& run : runs)
    for (PartLoad& part : run) {
      SPLATVOL_TRY(part.data);
      if (part.decoded.grow(held_bytes(*part.data))) insert(room_, std::move(part));
    }
  return {};
}

}  // namespace splatvol
