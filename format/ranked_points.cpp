#include "format/ranked_points.h"

#include <fmt/format.h>

#include <algorithm>
#include <list>
#include <map>
#include <string>
#include <utility>

namespace splatvol::format {
namespace {

// What was used last, of different kinds. An item is kept until others of `memory` bytes have been used after it.
template <class Key, class Item>
class LastUsed {
 public:
  // Returns null if the item is not held.
  Item* find(const Key& key) {
    const auto found = items_.find(key);
    if (found == items_.end()) return nullptr;
    order_.splice(order_.begin(), order_, found->second.at);
    return &found->second.item;
  }

  Item& add(const Key& key, Item item, std::uint64_t bytes, std::uint64_t memory) {
    while (!order_.empty() && held_ + bytes > memory) {
      held_ -= items_.at(order_.back()).bytes;
      items_.erase(order_.back());
      order_.pop_back();
    }
    order_.push_front(key);
    held_ += bytes;
    return items_.emplace(key, Entry{std::move(item), bytes, order_.begin()}).first->second.item;
  }

 private:
  struct Entry {
    Item item;
    std::uint64_t bytes;
    typename std::list<Key>::iterator at;
  };
  std::list<Key> order_;  // last used first
  std::map<Key, Entry> items_;
  std::uint64_t held_ = 0;
};

// A page of ranks, and the number of each point among those of its segment.
struct RankTable {
  std::vector<std::uint8_t> segments;
  std::vector<std::uint64_t> numbers;
};

RankTable table_of(RankPage page) {
  RankTable table{std::move(page.segments), {}};
  table.numbers.reserve(table.segments.size());
  for (const std::uint8_t segment : table.segments) table.numbers.push_back(page.before[segment]++);
  return table;
}

}  // namespace

struct RankedPoints::Held {
  const Volume& volume;
  ReadRankPage read_rank_page;
  std::uint64_t memory;
  LastUsed<std::size_t, RankTable> ranks = {};
  LastUsed<std::uint64_t, DirectoryPage> directory = {};
  LastUsed<std::uint64_t, std::vector<dvec3>> positions = {};               // group
  LastUsed<std::pair<int, std::uint64_t>, std::vector<float>> values = {};  // attribute, group

  Result<const RankTable*> table(std::size_t page) {
    if (const RankTable* held = ranks.find(page)) return held;
    SPLATVOL_TRY_ASSIGN(read, read_rank_page(page));
    return &ranks.add(page, table_of(std::move(read)), rank_page_points * 9, memory / 4);
  }

  // Reads and unpacks a chunk of a group by unpack(entry, packed, what).
  template <class Unpack>
  Status read_chunk(std::uint64_t group, ColumnKind kind, int attribute, const Unpack& unpack) {
    const int column = volume.info().find_column(kind, attribute);
    if (column < 0)
      return fail(ErrorCode::invalid_argument, "{}: attribute {} has no values", volume.name(), attribute);
    const std::uint64_t row = volume.rows().row(volume.rows().group(group).segment, group);
    const std::uint64_t number = volume.directory_page_of_row(row, column);
    const DirectoryPage* page = directory.find(number);
    if (!page) {
      SPLATVOL_TRY_ASSIGN(read, volume.read_directory_page(number));
      const std::uint64_t bytes = read.memory_bytes();
      page = &directory.add(number, std::move(read), bytes, memory / 8);
    }
    const ChunkLocation& location = volume.find_chunk(*page, row, column);
    SPLATVOL_TRY_ASSIGN(packed, volume.read_bytes(location.offset, location.entry.packed_bytes));
    return unpack(location.entry, packed, fmt::format("{}: chunk at {}", volume.name(), location.offset));
  }

  Result<const std::vector<dvec3>*> positions_of(std::uint64_t group) {
    if (const auto* held = positions.find(group)) return held;
    const VolumeInfo& info = volume.info();
    std::vector<dvec3> read(volume.rows().group(group).count);
    SPLATVOL_TRY(
        read_chunk(group, ColumnKind::position, -1, [&](const auto& entry, const auto& packed, const auto& what) {
          return unpack_positions(entry, packed, read, info.cube, what);
        }));
    const std::uint64_t bytes = read.size() * sizeof(dvec3);
    return &positions.add(group, std::move(read), bytes, memory / 2);
  }

  Result<const std::vector<float>*> values_of(int attribute, std::uint64_t group) {
    if (const auto* held = values.find({attribute, group})) return held;
    std::vector<float> read(volume.rows().group(group).count);
    SPLATVOL_TRY(
        read_chunk(group, ColumnKind::value, attribute, [&](const auto& entry, const auto& packed, const auto& what) {
          return unpack_values(entry, packed, read, what);
        }));
    const std::uint64_t bytes = read.size() * sizeof(float);
    return &values.add({attribute, group}, std::move(read), bytes, memory / 4);
  }
};

RankedPoints::RankedPoints(const Volume& volume, ReadRankPage read_rank_page, std::uint64_t memory)
    : held_(std::make_unique<Held>(Held{volume, std::move(read_rank_page), memory})) {}
RankedPoints::~RankedPoints() = default;

Status RankedPoints::find(std::span<const std::uint64_t> ranks, std::vector<Place>& places) {
  const RowLayout& rows = held_->volume.rows();
  const VolumeInfo& info = held_->volume.info();
  places.clear();
  places.reserve(ranks.size());
  const RankTable* table = nullptr;
  std::uint64_t present = 0;
  for (const std::uint64_t rank : ranks) {
    const std::uint64_t page = rank / rank_page_points;
    if (!table || page != present) {
      SPLATVOL_TRY_ASSIGN(found, held_->table(page));
      table = found;
      present = page;
    }
    const std::size_t at = rank % rank_page_points, segment = table->segments[at];
    const std::uint64_t number = table->numbers[at];
    places.push_back(
        {rows.group_at(segment, number), static_cast<std::uint32_t>(number % info.points_per_chunk[segment])});
  }
  return {};
}

namespace {

// Copies numbers of places, group by group. `get(group)` returns a group's numbers.
template <class Number, class Get>
Status gather(std::span<const RankedPoints::Place> places, std::vector<Number>& numbers, const Get& get) {
  std::vector<std::uint32_t> order(places.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  std::ranges::stable_sort(order, {}, [&](std::uint32_t i) { return places[i].group; });
  numbers.resize(places.size());
  for (std::size_t k = 0; k < order.size();) {
    const std::uint64_t group = places[order[k]].group;
    SPLATVOL_TRY_ASSIGN(of_group, get(group));
    for (; k < order.size() && places[order[k]].group == group; ++k)
      numbers[order[k]] = (*of_group)[places[order[k]].index];
  }
  return {};
}

}  // namespace

Status RankedPoints::read_positions(std::span<const Place> places, std::vector<dvec3>& positions) {
  return gather(places, positions, [&](std::uint64_t group) { return held_->positions_of(group); });
}

Status RankedPoints::read_values(std::span<const Place> places, int attribute, std::vector<float>& values) {
  return gather(places, values, [&](std::uint64_t group) { return held_->values_of(attribute, group); });
}

}  // namespace splatvol::format
