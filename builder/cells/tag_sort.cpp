#include "builder/cells/tag_sort.h"

#include <algorithm>

namespace splatvol {
namespace {

struct Record {
  PointTag tag;
  std::uint64_t number;
};

}  // namespace

Result<TagSort> TagSort::create(std::uint64_t memory, const std::string& folder) {
  const auto key = [](std::span<const std::byte> records, std::span<MortonKey> keys) {
    for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = {record_at<Record>(records, i).tag, 0};
  };
  const std::size_t held = std::max<std::size_t>(memory, ExternalSorter::least_memory(sizeof(Record)));
  SPLATVOL_TRY_ASSIGN(sorter, ExternalSorter::create({sizeof(Record), key, held, held, folder}));
  return TagSort(std::move(sorter));
}

Status TagSort::add(PointTag tag, std::uint64_t number) {
  const Record record{tag, number};
  return sorter_.add(std::as_bytes(std::span(&record, 1)));
}

// Those of pieces that no one asks for are passed over.
Status TagSort::load(std::uint32_t piece, std::uint32_t points, std::vector<std::uint64_t>& numbers) {
  numbers.assign(points, none);
  while (!ended_) {
    for (; next_ < read_.keys.size(); ++next_) {
      const Record record = record_at<Record>(read_.records, next_);
      if (record.tag >> 32 > piece) return {};
      if (record.tag >> 32 == piece) numbers[static_cast<std::uint32_t>(record.tag)] = record.number;
    }
    SPLATVOL_TRY_ASSIGN(more, sorter_.next());
    ended_ = more.keys.empty();
    read_ = more;
    next_ = 0;
  }
  return {};
}

}  // namespace splatvol
