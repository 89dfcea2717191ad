#include "player/cell_points.h"

#include <algorithm>
#include <utility>

namespace splatvol {
namespace {

// Kinds of parts; from first_values on: values of attributes.
enum Kind : int { rank_page, vertex_page, positions_of_group, first_values };

// The share of the memory for pages of the directory.
constexpr std::uint64_t directory_share = 16;

}  // namespace

CellPoints::CellPoints(const format::CellReader& cells, const format::SummaryAttributes& attributes,
                       std::uint64_t memory)
    : cells_(cells),
      info_(cells.volume().info()),
      attributes_(attributes),
      chunks_(cells.volume(), memory / directory_share),
      parts_(memory - memory / directory_share) {}

Result<std::shared_ptr<const CellPoints::Ranks>> CellPoints::ranks(std::uint64_t page) const {
  constexpr std::uint64_t bytes = format::rank_page_points * (sizeof(Ranks::segments[0]) + sizeof(Ranks::numbers[0]));
  const auto read = [&]() -> Result<Ranks> {
    SPLATVOL_TRY_ASSIGN(of_page, cells_.read_rank_page(page));
    Ranks ranks{std::move(of_page.segments), {}, std::move(of_page.before)};
    std::vector<std::uint16_t> next(ranks.before.size());
    ranks.numbers.reserve(ranks.segments.size());
    for (const std::uint8_t segment : ranks.segments) ranks.numbers.push_back(next[segment]++);
    return ranks;
  };
  return parts_.get<Ranks>({rank_page, page}, bytes, read);
}

Result<std::shared_ptr<const CellPoints::Positions>> CellPoints::positions_of(std::uint64_t group,
                                                                              std::uint32_t count) const {
  const auto read = [&]() -> Result<Positions> {
    SPLATVOL_TRY_ASSIGN(chunk, chunks_.read_chunk(format::ColumnKind::position, -1, group));
    Positions positions(count);
    SPLATVOL_TRY(format::unpack_positions(chunk.entry, chunk.bytes, positions, info_.cube,
                                          cells_.volume().name() + ": positions of cells' corners"));
    return positions;
  };
  return parts_.get<Positions>({positions_of_group, group}, count * sizeof(dvec3), read);
}

Result<std::shared_ptr<const CellPoints::Values>> CellPoints::values_of(int attribute, std::uint64_t group,
                                                                        std::uint32_t count) const {
  const auto read = [&]() -> Result<Values> {
    SPLATVOL_TRY_ASSIGN(chunk, chunks_.read_chunk(format::ColumnKind::value, attribute, group));
    Values values(count);
    SPLATVOL_TRY(
        format::unpack_values(chunk.entry, chunk.bytes, values, cells_.volume().name() + ": values of cells' corners"));
    return values;
  };
  return parts_.get<Values>({first_values + attribute, group}, count * sizeof(float), read);
}

Result<CellPoints::Points> CellPoints::points_at(std::size_t segment, std::uint64_t number, bool with_positions) const {
  const format::RowLayout& rows = chunks_.rows();
  const std::uint64_t group = rows.group_at(segment, number);
  const std::uint32_t count = rows.group(group).count;
  Points points{number - number % info_.points_per_chunk[segment], count, {}, {}, {}};
  if (with_positions) SPLATVOL_TRY_SET(points.positions, positions_of(group, count));
  SPLATVOL_TRY_SET(points.values, values_of(attributes_.values, group, count));
  if (attributes_.opacity >= 0) SPLATVOL_TRY_SET(points.opacity_values, values_of(attributes_.opacity, group, count));
  return points;
}

// The points of each segment have ascending ranks. So each group of points is looked up once.
Status CellPoints::read(std::span<const std::uint64_t> ranks, std::vector<dvec3>* positions,
                        std::vector<double>& values, std::vector<double>& opacity_values) const {
  const auto attribute = [&](int number) {
    return number < 0 ? nullptr : &info_.attributes[static_cast<std::size_t>(number)];
  };
  const format::Attribute &shown = *attribute(attributes_.values), *const opacity = attribute(attributes_.opacity);
  if (positions) positions->resize(ranks.size());
  values.resize(ranks.size());
  opacity_values.resize(opacity ? ranks.size() : 0);
  std::vector<Points> of_segments(info_.resolutions());
  std::shared_ptr<const Ranks> page;
  std::uint64_t page_number = 0;
  for (std::size_t i = 0; i < ranks.size(); ++i) {
    if (const std::uint64_t number = ranks[i] / format::rank_page_points; !page || number != page_number) {
      SPLATVOL_TRY_SET(page, this->ranks(number));
      page_number = number;
    }
    const std::size_t at = ranks[i] % format::rank_page_points, segment = page->segments[at];
    const std::uint64_t number = page->before[segment] + page->numbers[at];
    Points& points = of_segments[segment];
    if (number - points.begin >= points.count)
      SPLATVOL_TRY_SET(points, points_at(segment, number, positions != nullptr));
    const std::uint64_t index = number - points.begin;
    if (positions) (*positions)[i] = (*points.positions)[index];
    values[i] = shown.value(double{(*points.values)[index]});
    if (opacity) opacity_values[i] = opacity->value(double{(*points.opacity_values)[index]});
  }
  return {};
}

Status CellPoints::read_vertices(std::span<const std::uint64_t> vertices, std::vector<dvec3>& positions) const {
  positions.resize(vertices.size());
  std::shared_ptr<const Positions> page;
  std::uint64_t page_number = 0;
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    if (const std::uint64_t number = vertices[i] / format::vertex_page_points; !page || number != page_number) {
      const auto read = [&] { return cells_.read_vertex_page(number); };
      SPLATVOL_TRY_SET(page,
                       parts_.get<Positions>({vertex_page, number}, format::vertex_page_points * sizeof(dvec3), read));
      page_number = number;
    }
    positions[i] = (*page)[vertices[i] % format::vertex_page_points];
  }
  return {};
}

}  // namespace splatvol
