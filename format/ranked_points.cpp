#include "format/ranked_points.h"

#include <array>
#include <limits>
#include <numeric>
#include <string>
#include <unordered_map>
#include <utility>

#include "format/last_used.h"
#include "format/volume_chunks.h"

namespace splatvol::format {
namespace {

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
  std::shared_ptr<const ChunkSource> chunks;
  ReadRankPage read_rank_page;
  std::uint64_t memory;
  LastUsed<std::size_t, RankTable> ranks = {};
  LastUsed<std::uint64_t, std::vector<dvec3>> positions = {};               // group
  LastUsed<std::pair<int, std::uint64_t>, std::vector<float>> values = {};  // attribute, group

  Result<const RankTable*> table(std::size_t page) {
    if (const RankTable* held = ranks.find(page)) return held;
    SPLATVOL_TRY_ASSIGN(read, read_rank_page(page));
    return &ranks.add(page, table_of(std::move(read)), rank_page_points * 9, memory / 4);
  }

  Result<const std::vector<dvec3>*> positions_of(std::uint64_t group) {
    if (const auto* held = positions.find(group)) return held;
    SPLATVOL_TRY_ASSIGN(chunk, chunks->read_chunk(ColumnKind::position, -1, group));
    std::vector<dvec3> read(chunks->rows().group(group).count);
    SPLATVOL_TRY(unpack_positions(chunk.entry, chunk.bytes, read, chunks->info().cube, "positions of cells' corners"));
    const std::uint64_t bytes = read.size() * sizeof(dvec3);
    return &positions.add(group, std::move(read), bytes, memory / 2);
  }

  Result<const std::vector<float>*> values_of(int attribute, std::uint64_t group) {
    if (const auto* held = values.find({attribute, group})) return held;
    SPLATVOL_TRY_ASSIGN(chunk, chunks->read_chunk(ColumnKind::value, attribute, group));
    std::vector<float> read(chunks->rows().group(group).count);
    SPLATVOL_TRY(unpack_values(chunk.entry, chunk.bytes, read, "values of cells' corners"));
    const std::uint64_t bytes = read.size() * sizeof(float);
    return &values.add({attribute, group}, std::move(read), bytes, memory / 4);
  }
};

RankedPoints::RankedPoints(std::shared_ptr<const ChunkSource> chunks, ReadRankPage read_rank_page, std::uint64_t memory)
    : held_(std::make_unique<Held>(Held{std::move(chunks), std::move(read_rank_page), memory})) {}

RankedPoints::RankedPoints(const CellReader& cells, std::uint64_t memory)
    : RankedPoints(
          std::make_shared<VolumeChunks>(cells.volume(), memory / 8),
          [&cells](std::size_t page) { return cells.read_rank_page(page); }, memory) {}
RankedPoints::~RankedPoints() = default;

Status RankedPoints::find(std::span<const std::uint64_t> ranks, std::vector<Place>& places) {
  const RowLayout& rows = held_->chunks->rows();
  const VolumeInfo& info = held_->chunks->info();
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

// The places in the order of their groups. Neighbours have few groups: of each segment one or a few.
std::vector<std::uint32_t> order_by_group(std::span<const RankedPoints::Place> places) {
  struct Group {
    std::uint64_t group;
    std::uint32_t number;
  };
  // Numbers for the groups, as they come: of the last one that shares a slot, it is known at once.
  constexpr std::size_t slots = 64;
  std::array<Group, slots> last;
  last.fill({std::numeric_limits<std::uint64_t>::max(), 0});
  std::unordered_map<std::uint64_t, std::uint32_t> numbers;
  std::vector<std::uint32_t> number_of(places.size()), begins(1);
  for (std::size_t i = 0; i < places.size(); ++i) {
    Group& slot = last[places[i].group % slots];
    if (slot.group != places[i].group) {
      const auto found = numbers.try_emplace(places[i].group, static_cast<std::uint32_t>(numbers.size())).first;
      slot = {places[i].group, found->second};
    }
    number_of[i] = slot.number;
  }
  begins.resize(numbers.size() + 1);
  for (const std::uint32_t number : number_of) ++begins[number + 1];
  std::partial_sum(begins.begin(), begins.end(), begins.begin());
  std::vector<std::uint32_t> order(places.size());
  for (std::uint32_t i = 0; i < places.size(); ++i) order[begins[number_of[i]]++] = i;
  return order;
}

// Copies numbers of places, group by group. `get(group)` returns a group's numbers.
template <class Number, class Get>
Status gather(std::span<const RankedPoints::Place> places, std::vector<Number>& numbers, const Get& get) {
  const std::vector<std::uint32_t> order = order_by_group(places);
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

struct CellVertices::Held {
  ReadPage read_page;
  std::uint64_t memory;
  LastUsed<std::size_t, std::vector<dvec3>> pages = {};
};

CellVertices::CellVertices(ReadPage read_page, std::uint64_t memory)
    : held_(std::make_unique<Held>(Held{std::move(read_page), memory})) {}
CellVertices::~CellVertices() = default;

Status CellVertices::read_positions(std::span<const std::uint64_t> vertices, std::vector<dvec3>& positions) {
  positions.clear();
  positions.reserve(vertices.size());
  const std::vector<dvec3>* page = nullptr;
  std::size_t present = 0;
  for (const std::uint64_t vertex : vertices) {
    const std::size_t number = vertex / vertex_page_points;
    if (!page || number != present) {
      page = held_->pages.find(number);
      if (!page) {
        SPLATVOL_TRY_ASSIGN(read, held_->read_page(number));
        const std::uint64_t bytes = read.size() * sizeof(dvec3);
        page = &held_->pages.add(number, std::move(read), bytes, held_->memory);
      }
      present = number;
    }
    positions.push_back((*page)[vertex % vertex_page_points]);
  }
  return {};
}

}  // namespace splatvol::format
