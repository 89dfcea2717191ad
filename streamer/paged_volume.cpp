#include "streamer/paged_volume.h"

namespace splatvol {

using format::DirectoryPage;
using format::IndexPage;

// The size of a page in memory is known only after unpacking. Until then, its packed bytes are reserved.
template <class Page, class Read>
Result<std::shared_ptr<const Page>> PagedVolume::page(CacheKey key, std::uint64_t packed_bytes, Read read) {
  const auto typed = [](const Cache::Pointer& held) {
    return std::shared_ptr<const Page>(held, &std::get<Page>(*held));
  };
  if (const Cache::Pointer held = cache_.find(key)) return typed(held);
  const auto too_large = [&](std::uint64_t bytes) {
    return fail(ErrorCode::out_of_budget, "{}: no memory for a page of {} bytes", volume_->name(), bytes);
  };
  auto reservation = cache_.reserve(packed_bytes);
  if (!reservation) return too_large(packed_bytes);
  SPLATVOL_TRY_ASSIGN(fetched, read());
  const std::uint64_t bytes = fetched.memory_bytes();
  reservation.reset();
  reservation = cache_.reserve(bytes);
  if (!reservation) return too_large(bytes);
  return typed(cache_.insert(key, std::move(fetched), std::move(*reservation)));
}

Result<IndexPage> PagedVolume::read_root() const {
  const auto structure = structure_of(root_key());
  return structure ? volume_->with_summaries(*structure, attributes_) : volume_->read_index_root(attributes_);
}

std::shared_ptr<const IndexPage> PagedVolume::structure_of(CacheKey key) const {
  key.step = step_before_;
  const Cache::Pointer held = step_before_ > 0 ? cache_.find(key) : nullptr;
  return held ? std::shared_ptr<const IndexPage>(held, &std::get<IndexPage>(*held)) : nullptr;
}

Result<std::shared_ptr<const IndexPage>> PagedVolume::root() {
  return note_used(root_key(), page<IndexPage>(root_key(), 0, [&] { return read_root(); }));
}

Result<std::shared_ptr<const IndexPage>> PagedVolume::note_used(const CacheKey& key,
                                                                Result<std::shared_ptr<const IndexPage>> page) {
  if (page && used_.keys.insert(key).second) used_.bytes += (*page)->memory_bytes();
  return page;
}

Result<std::shared_ptr<const IndexPage>> PagedVolume::linked(const IndexPage& parent, std::uint32_t node) {
  const format::IndexPageRef& ref = parent.pages[parent.links[node]];
  const CacheKey key = index_key(ref.offset);
  const auto read = [&] {
    const auto structure = structure_of(key);
    if (structure) return volume_->with_summaries(*structure, attributes_);
    return volume_->read_index_page(ref, parent.nodes.child_masks[node], parent.nodes.counts_of(node), attributes_);
  };
  return note_used(key, page<IndexPage>(key, ref.page_bytes, read));
}

Result<std::shared_ptr<const DirectoryPage>> PagedVolume::directory_page(std::uint64_t number) {
  const std::uint64_t bytes = directory_page_chunks(number) * sizeof(format::ChunkEntry) + directory_page_bytes(number);
  return page<DirectoryPage>(directory_key(number), bytes, [&] { return volume_->read_directory_page(number); });
}

std::uint64_t PagedVolume::directory_page_chunks(std::uint64_t number) const {
  return volume_->chunks_of_directory_page(number);
}

Result<format::ChunkLocation> PagedVolume::find_chunk(std::uint64_t row, int column) {
  SPLATVOL_TRY_ASSIGN(page, directory_page(volume_->directory_page_of_row(row, column)));
  return volume_->find_chunk(*page, row, column);
}

}  // namespace splatvol
