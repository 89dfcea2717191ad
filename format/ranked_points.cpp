#include "format/ranked_points.h"

#include <algorithm>
#include <string>
#include <utility>

#include "format/part_kinds.h"
#include "format/volume_chunks.h"

namespace splatvol::format {
namespace {

// The segments of consecutive ranks, and the number of each point among those of its segment.
struct RankTable {
  std::vector<std::uint8_t> segments;
  std::vector<std::uint16_t> numbers;  // less `before`
  std::vector<std::uint64_t> before;   // [segment]
};

RankTable table_of(RankPage page) {
  RankTable table{std::move(page.segments), {}, std::move(page.before)};
  std::vector<std::uint16_t> next(table.before.size());
  table.numbers.reserve(table.segments.size());
  for (const std::uint8_t segment : table.segments) table.numbers.push_back(next[segment]++);
  return table;
}

template <class Number>
std::uint64_t bytes_of(const std::vector<Number>& numbers) {
  return numbers.capacity() * sizeof(Number);
}

}  // namespace

struct RankedPoints::Held {
  PartRoom room;
  std::shared_ptr<const ChunkSource> chunks;
  ReadRankPage read_rank_page;
  const CellReader* cells = nullptr;  // of a file
  const VolumeChunks* chunks_of_file = nullptr;

  [[nodiscard]] PartKey key_of_rank_page(std::size_t page) const { return {room.file, rank_page, page}; }
  [[nodiscard]] PartKey key_of_positions(std::uint64_t group) const { return {room.file, group_positions, group}; }
  [[nodiscard]] PartKey key_of_values(int attribute, std::uint64_t group) const {
    return {room.file, group_values, group, attribute, cells ? cells->volume().step_key() : 0};
  }

  [[nodiscard]] Result<std::shared_ptr<const RankTable>> table(std::size_t page) const {
    constexpr std::uint64_t bytes = rank_page_points * (sizeof(std::uint8_t) + sizeof(std::uint16_t));
    const auto read = [&]() -> Result<RankTable> {
      SPLATVOL_TRY_ASSIGN(packed, read_rank_page(page));
      return table_of(std::move(packed));
    };
    return room.table->get<RankTable>(key_of_rank_page(page), *room.share, bytes, read, [](const RankTable& table) {
      return bytes_of(table.segments) + bytes_of(table.numbers) + bytes_of(table.before);
    });
  }

  [[nodiscard]] Result<std::shared_ptr<const std::vector<dvec3>>> positions_of(std::uint64_t group) const {
    const std::uint32_t count = chunks->rows().group(group).count;
    const auto read = [&]() -> Result<std::vector<dvec3>> {
      SPLATVOL_TRY_ASSIGN(chunk, chunks->read_chunk(ColumnKind::position, -1, group));
      std::vector<dvec3> positions(count);
      SPLATVOL_TRY(unpack_positions(chunk.entry, chunk.bytes, positions, chunks->info().cube, what("positions")));
      return positions;
    };
    return room.table->get<std::vector<dvec3>>(key_of_positions(group), *room.share, count * sizeof(dvec3), read,
                                               bytes_of<dvec3>);
  }

  [[nodiscard]] Result<std::shared_ptr<const std::vector<float>>> values_of(int attribute, std::uint64_t group) const {
    const std::uint32_t count = chunks->rows().group(group).count;
    const auto read = [&]() -> Result<std::vector<float>> {
      SPLATVOL_TRY_ASSIGN(chunk, chunks->read_chunk(ColumnKind::value, attribute, group));
      std::vector<float> values(count);
      SPLATVOL_TRY(unpack_values(chunk.entry, chunk.bytes, values, what("values")));
      return values;
    };
    return room.table->get<std::vector<float>>(key_of_values(attribute, group), *room.share, count * sizeof(float),
                                               read, bytes_of<float>);
  }

  [[nodiscard]] std::string what(const char* numbers) const {
    return (cells ? cells->volume().name() + ": " : std::string()) + numbers + " of cells' corners";
  }

  // Copies numbers of places. The points of each segment have ascending ranks, so each group is looked up once.
  // `get(group)` returns a group's numbers.
  template <class Number, class Get>
  [[nodiscard]] Status gather(std::span<const Place> places, std::vector<Number>& numbers, const Get& get) const {
    struct Present {
      std::uint64_t group = 0;
      std::shared_ptr<const std::vector<Number>> numbers = nullptr;
    };
    std::vector<Present> of_segments(chunks->info().resolutions());
    numbers.resize(places.size());
    for (std::size_t i = 0; i < places.size(); ++i) {
      const Place& place = places[i];
      Present& present = of_segments[place.segment];
      if (!present.numbers || present.group != place.group) {
        SPLATVOL_TRY_SET(present.numbers, get(place.group));
        present.group = place.group;
      }
      numbers[i] = (*present.numbers)[place.index];
    }
    return {};
  }
};

RankedPoints::RankedPoints(std::shared_ptr<const ChunkSource> chunks, ReadRankPage read_rank_page, const PartRoom& room)
    : held_(new Held{room, std::move(chunks), std::move(read_rank_page)}) {}

RankedPoints::RankedPoints(const CellReader& cells, const PartRoom& room) {
  auto chunks = std::make_shared<const VolumeChunks>(cells.volume(), room);
  const VolumeChunks* const of_file = chunks.get();
  held_.reset(new Held{room, std::move(chunks), [&cells](std::size_t page) { return cells.read_rank_page(page); },
                       &cells, of_file});
}

RankedPoints::~RankedPoints() = default;

Status RankedPoints::find(std::span<const std::uint64_t> ranks, std::vector<Place>& places) const {
  const RowLayout& rows = held_->chunks->rows();
  const VolumeInfo& info = held_->chunks->info();
  places.clear();
  places.reserve(ranks.size());
  std::shared_ptr<const RankTable> table;
  std::uint64_t present = 0;
  for (const std::uint64_t rank : ranks) {
    const std::uint64_t page = rank / rank_page_points;
    if (!table || page != present) {
      SPLATVOL_TRY_SET(table, held_->table(static_cast<std::size_t>(page)));
      present = page;
    }
    const std::size_t at = rank % rank_page_points, segment = table->segments[at];
    const std::uint64_t number = table->before[segment] + table->numbers[at];
    places.push_back({rows.group_at(segment, number),
                      static_cast<std::uint32_t>(number % info.points_per_chunk[segment]),
                      static_cast<std::uint32_t>(segment)});
  }
  return {};
}

std::vector<std::uint64_t> RankedPoints::groups_of(std::span<const Place> places) {
  std::vector<std::uint64_t> groups;
  for (const Place& place : places)
    if (groups.empty() || place.group != groups.back()) groups.push_back(place.group);
  std::ranges::sort(groups);
  groups.erase(std::ranges::unique(groups).begin(), groups.end());
  return groups;
}

Status RankedPoints::read_positions(std::span<const Place> places, std::vector<dvec3>& positions) const {
  return held_->gather(places, positions, [&](std::uint64_t group) { return held_->positions_of(group); });
}

Status RankedPoints::read_values(std::span<const Place> places, int attribute, std::vector<float>& values) const {
  return held_->gather(places, values, [&](std::uint64_t group) { return held_->values_of(attribute, group); });
}

Result<std::shared_ptr<const BytesAhead>> RankedPoints::read_ahead(std::span<const std::uint64_t> ranks,
                                                                   std::span<const int> attributes,
                                                                   bool positions) const {
  if (!held_->cells || !held_->cells->volume().is_far()) return nullptr;
  const Volume& volume = held_->cells->volume();
  std::vector<std::uint64_t> pages;
  for (const std::uint64_t rank : ranks)
    if (pages.empty() || rank / rank_page_points != pages.back()) pages.push_back(rank / rank_page_points);
  std::ranges::sort(pages);
  pages.erase(std::ranges::unique(pages).begin(), pages.end());
  std::vector<ByteRange> ranges;
  for (const std::uint64_t page : pages)
    if (!held_->room.table->holds(held_->key_of_rank_page(static_cast<std::size_t>(page))))
      ranges.push_back(held_->cells->range_of_rank_page(static_cast<std::size_t>(page)));
  SPLATVOL_TRY_ASSIGN(rank_pages, volume.read_ahead(std::move(ranges), *held_->room.share));
  std::vector<Place> places;
  SPLATVOL_TRY(find(ranks, places));
  std::vector<ChunkName> chunks;
  const auto add = [&](ColumnKind kind, int attribute, std::uint64_t group, const PartKey& key) -> Status {
    if (held_->room.holds(key)) return {};
    SPLATVOL_TRY_ASSIGN(chunk, held_->chunks_of_file->find(kind, attribute, group));
    chunks.push_back(chunk);
    return {};
  };
  for (const std::uint64_t group : groups_of(places)) {
    if (positions) SPLATVOL_TRY(add(ColumnKind::position, -1, group, held_->key_of_positions(group)));
    for (const int attribute : attributes)
      SPLATVOL_TRY(add(ColumnKind::value, attribute, group, held_->key_of_values(attribute, group)));
  }
  SPLATVOL_TRY_ASSIGN(bytes, held_->chunks_of_file->ranges_of(chunks));
  return volume.read_ahead(std::move(bytes), *held_->room.share);
}

struct CellVertices::Held {
  PartRoom room;
  ReadPage read_page;
};

CellVertices::CellVertices(ReadPage read_page, const PartRoom& room) : held_(new Held{room, std::move(read_page)}) {}

CellVertices::~CellVertices() = default;

Status CellVertices::read_positions(std::span<const std::uint64_t> vertices, std::vector<dvec3>& positions) const {
  positions.resize(vertices.size());
  std::shared_ptr<const std::vector<dvec3>> page;
  std::uint64_t present = 0;
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const std::uint64_t number = vertices[i] / vertex_page_points;
    if (!page || number != present) {
      const PartRoom& room = held_->room;
      SPLATVOL_TRY_SET(page, room.table->get<std::vector<dvec3>>(
                                 {room.file, vertex_page, number}, *room.share, vertex_page_points * sizeof(dvec3),
                                 [&] { return held_->read_page(static_cast<std::size_t>(number)); }, bytes_of<dvec3>));
      present = number;
    }
    positions[i] = (*page)[vertices[i] % vertex_page_points];
  }
  return {};
}

}  // namespace splatvol::format
