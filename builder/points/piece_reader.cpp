#include "builder/points/piece_reader.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <string_view>
#include <utility>

#include "base/interruption.h"
#include "builder/mesh/heights.h"
#include "builder/mesh/usable_numbers.h"

namespace splatvol {
namespace {

constexpr std::size_t slice_tasks = 16;  // records that are made at a time are shared out to so many tasks

// Values of a block's points, about. Those of their neighbours are some times as many; together they fit into a cache.
constexpr std::size_t block_values = 4096;

// A value that is too large for arithmetic is taken for some program's fill value, and so for missing.
double present_or_nan(double value) {
  return std::abs(value) <= largest_value ? value : std::numeric_limits<double>::quiet_NaN();
}

// Gets an attribute's values at some points; NaN: missing.
void get_values(const Piece& piece, std::size_t attribute, std::span<const std::uint32_t> points,
                std::span<double> values) {
  if (piece.lent) {
    piece.lent->get(attribute, points, values);
  } else {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = piece.values[attribute][points[i]];
  }
  for (double& value : values) value = present_or_nan(value);
}

// Bytes of a piece, and of what finds the material and the outer faces of its tetrahedra.
std::uint64_t bytes_to_read(const Piece& piece) {
  const std::size_t points = piece.points.size(), tetrahedra = piece.tetrahedra.size();
  std::uint64_t bytes = points * (sizeof(dvec3) + sizeof(double) + sizeof(std::uint32_t)) +
                        tetrahedra * sizeof(Tetrahedron) + piece.whole_cells.size() * sizeof(WholeCell) +
                        VertexMaterial::bytes(points, tetrahedra) + (piece.lent ? piece.lent->bytes() : 0);
  for (const std::vector<double>& values : piece.values) bytes += values.size() * sizeof(double);
  if (piece.cells) {
    const std::size_t corners = piece.cells->corners.size(), parts = piece.cells->tetrahedra.size();
    bytes += points * sizeof(SpatialMoments) + corners * (sizeof(dvec3) + sizeof(double)) +
             parts * (sizeof(Tetrahedron) + sizeof(std::uint32_t)) + VertexMaterial::bytes(corners, parts);
  }
  if (piece.material) {
    const std::uint64_t of_attribute = sizeof(ValueMoments) + sizeof(dvec3);
    bytes += points * (sizeof(SpatialMoments) + sizeof(BoundaryPlane) + piece.values.size() * of_attribute);
  }
  return bytes;
}

}  // namespace

Status PieceReader::run(const std::function<void(double)>& progress, const std::function<Status(const Box&)>& only,
                        const Visit& visit) {
  SPLATVOL_TRY_ASSIGN(piece, source_.next());
  std::unique_ptr<Piece> second;
  bool ended = !piece, is_only = false;
  if (piece && only && source_.piece_count() == 1) {
    SPLATVOL_TRY_SET(second, source_.next());
    is_only = ended = !second;
  }
  for (std::size_t pieces = 0; piece; ++pieces) {
    const auto tell = [&](double of_piece) {
      progress((static_cast<double>(pieces) + of_piece) /
               static_cast<double>(std::max(source_.piece_count(), pieces + 1)));
    };
    tell(0);
    facts_.most_piece_bytes =
        std::max(facts_.most_piece_bytes, bytes_to_read(*piece) + (second ? bytes_to_read(*second) : 0));
    if (watch_) SPLATVOL_TRY(watch_(*piece));
    SPLATVOL_TRY(prepare(*piece));
    const Box round =
        grown_for_material(prepared_.has_mesh ? prepared_.in_cells_box : prepared_.box, deviation_of(*piece));
    if (is_only && round.low.x <= round.high.x) SPLATVOL_TRY(only(round));
    SPLATVOL_TRY(read_prepared(*piece, visit, tell));
    piece = std::move(second);
    if (piece || ended) continue;
    SPLATVOL_TRY_SET(piece, source_.next());
  }
  count_left_out();
  return check_any();
}

Status PieceReader::check_any() const {
  if (box().low.x <= box().high.x) return {};
  return fail(ErrorCode::invalid_data, "no point has coordinates that are finite and within 1e50");
}

// The largest deviation of material that the points of a piece bring along.
double PieceReader::deviation_of(const Piece& piece) const {
  if (!layout_.has_material() || !(piece.cells || piece.material)) return 0;
  const std::vector<SpatialMoments>& moments = piece.cells ? piece.cells->moments : piece.material->moments;
  double largest = 0;
  for (std::size_t i = 0; i < moments.size(); ++i)
    if (is_usable_position(piece.points[i])) largest = std::max(largest, deviation_bound(moments[i]));
  return largest;
}

// Says whether an attribute is stored once with another of the same values: its material follows from values and cells.
bool PieceReader::may_be_joined(std::size_t attribute, const JoinedAttributes& joined) const {
  const std::string& name = source_.attributes()[attribute];
  const auto is_name = [&](const std::string& apart) { return name == apart || name.starts_with(apart + "["); };
  return joined.join && !facts_.brings_value_moments && std::ranges::none_of(joined.apart, is_name);
}

InputSummary PieceReader::summary(const JoinedAttributes& joined) const {
  InputSummary summary;
  const PointRanges& ranges = facts_.census.left_out > 0 ? facts_.in_cells : facts_.ranges;
  summary.box = box();
  const std::vector<std::string> units = source_.units();
  std::map<std::pair<std::uint64_t, std::string_view>, std::size_t> first_of;  // by values and unit
  for (std::size_t a = 0; a < layout_.attributes(); ++a) {
    const auto [first, is_new] = first_of.try_emplace({facts_.values[a].value(), units[a]}, summary.attributes.size());
    const bool same = !is_new && may_be_joined(a, joined);
    summary.stored.push_back(same ? first->second : summary.attributes.size());
    if (same) {
      summary.aliases.push_back({source_.attributes()[a], static_cast<int>(first->second)});
      continue;
    }
    summary.attributes.push_back(describe_attribute(source_.attributes()[a], ranges.low[a], ranges.high[a]));
    summary.attributes.back().unit = units[a];
    summary.least.push_back(ranges.least[a]);
    summary.fills.push_back(facts_.fills[a]);
  }
  summary.cells = facts_.cells;
  summary.census = facts_.census;
  summary.has_material = facts_.has_material;
  summary.bytes_to_read = facts_.most_piece_bytes;
  if (facts_.cells.tetrahedra == 0) summary.census.in_no_cell = 0;
  return summary;
}

Status PieceReader::read(const Piece& piece, const Visit& visit, const std::function<void(double)>& progress) {
  SPLATVOL_TRY(prepare(piece));
  return read_prepared(piece, visit, progress);
}

// Finds the points that are kept, and the lists of their tetrahedra.
Status PieceReader::prepare(const Piece& piece) {
  if (piece.tetrahedra.size() > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::unsupported, "a piece has {} tetrahedra, which is too many: split it",
                piece.tetrahedra.size());
  prepared_.kept.resize(piece.points.size());
  std::size_t count = 0;
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    prepared_.kept[count] = static_cast<std::uint32_t>(i);
    count += is_usable_position(piece.points[i]) ? 1 : 0;
  }
  prepared_.kept.resize(count);
  prepared_.has_mesh = layout_.has_material() && !piece.material && !piece.cells && !piece.tetrahedra.empty();
  if (prepared_.has_mesh)
    tbb::parallel_invoke([&] { prepared_.mesh = VertexMaterial(piece.points, piece.tetrahedra); },
                         [&] { prepared_.heights = least_heights(piece.points, piece.tetrahedra); });
  prepared_.box = prepared_.in_cells_box = {};
  prepared_.in_no_cell = 0;
  for (const std::uint32_t i : prepared_.kept) {
    prepared_.box.include(piece.points[i]);
    if (prepared_.in_cells(piece, i))
      prepared_.in_cells_box.include(piece.points[i]);
    else
      ++prepared_.in_no_cell;
  }
  return {};
}

Status PieceReader::read_prepared(const Piece& piece, const Visit& visit, const std::function<void(double)>& progress) {
  const std::span<const std::uint32_t> kept = prepared_.kept;
  facts_.most_piece_bytes = std::max(facts_.most_piece_bytes, bytes_to_read(piece));
  facts_.census.read += piece.points.size();
  facts_.census.not_finite += piece.points.size() - kept.size();
  facts_.cells += piece.census;
  facts_.deviation = std::max(facts_.deviation, deviation_of(piece));
  facts_.brings_value_moments = facts_.brings_value_moments || piece.material.has_value();
  for (std::size_t a = 0; a < piece.fills.size(); ++a) facts_.fills[a] += piece.fills[a];
  facts_.ranges.box.include(prepared_.box);
  facts_.in_cells.box.include(prepared_.in_cells_box);
  const bool has_material = prepared_.has_mesh || (layout_.has_material() && (piece.material || piece.cells));
  facts_.census.in_no_cell += prepared_.has_mesh ? prepared_.in_no_cell : has_material ? 0 : kept.size();
  facts_.has_material = facts_.has_material || (has_material && (!piece.cells || !piece.points.empty()));

  // Meshes take about as long as the records of their points.
  const double begun = prepared_.has_mesh ? 0.5 : 0;
  if (progress) progress(begun);
  const std::size_t most = std::max<std::size_t>(slice_bytes_ / layout_.bytes(), slice_tasks);
  // Some records are made while the ones before them are visited.
  Status visited;
  tbb::task_group visiting;
  for (std::size_t first = 0; first < kept.size(); first += most) {
    const std::size_t count = std::min(most, kept.size() - first);
    std::vector<ValueFacts> values = make_records(piece, kept.subspan(first, count), records_[1]);
    visiting.wait();
    SPLATVOL_TRY(visited);
    SPLATVOL_TRY(check_interruption());
    for (const ValueFacts& of_task : values) include(of_task);
    std::swap(records_[0], records_[1]);
    visiting.run([&] { visited = visit(records_[0]); });
    if (progress) progress(begun + (1 - begun) * static_cast<double>(first + count) / static_cast<double>(kept.size()));
  }
  visiting.wait();
  SPLATVOL_TRY(visited);
  ++piece_;
  std::vector<OuterFace> outer;
  if (prepared_.has_mesh) outer = find_outer_faces(piece.points, piece.tetrahedra, prepared_.mesh.incident());
  const bool has_mesh = prepared_.has_mesh;
  prepared_ = {};  // what follows takes memory of its own
  return add_faces(piece, has_mesh, outer);
}

bool PieceReader::leave_out(const std::byte* record) {
  if (!has_cells() || layout_.block(record) != 0) return false;
  const dvec3 position = layout_.position(record);
  if (squared_distance(facts_.in_cells.box, position) > 0) {
    ++facts_.census.left_out;
    --facts_.census.in_no_cell;
    return true;
  }
  for (std::size_t a = 0; a < layout_.attributes(); ++a) facts_.in_cells.include_value(a, layout_.value(record, a));
  return false;
}

// Makes records, and finds the ranges: in order, as 0 and -0 are equal.
std::vector<PieceReader::ValueFacts> PieceReader::make_records(const Piece& piece, std::span<const std::uint32_t> slice,
                                                               std::vector<std::byte>& records) {
  const std::size_t count = slice.size(), task_points = (count + slice_tasks - 1) / slice_tasks;
  const std::size_t block_points = std::clamp<std::size_t>(block_values / layout_.attributes(), 16, 1024);
  records.resize(count * layout_.bytes());
  const std::size_t tasks = (count + task_points - 1) / task_points;
  std::vector<ValueFacts> facts(tasks, ValueFacts(layout_.attributes()));
  tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t r) {
    Block& block = blocks_.local();
    const std::size_t end = std::min((r + 1) * task_points, count);
    for (std::size_t first = r * task_points; first < end; first += block_points) {
      block.points = slice.subspan(first, std::min(block_points, end - first));
      load_values(piece, block);
      make_block(piece, block, records.data() + first * layout_.bytes());
      find_facts(piece, block, facts[r]);
    }
  });
  return facts;
}

void PieceReader::include(const ValueFacts& values) {
  facts_.ranges.include(values.ranges);
  facts_.in_cells.include(values.in_cells);
  for (std::size_t a = 0; a < layout_.attributes(); ++a) facts_.values[a].add(values.hashes[a].value());
}

void PieceReader::find_facts(const Piece& piece, const Block& block, ValueFacts& facts) const {
  for (std::size_t a = 0; a < layout_.attributes(); ++a) {
    const std::span<const double> values = block.values.column(a).first(block.points.size());
    for (const double value : values) facts.ranges.include_value(a, value);
    for (std::size_t i = 0; i < values.size(); ++i)
      if (prepared_.in_cells(piece, block.points[i])) facts.in_cells.include_value(a, values[i]);
    // The hash serves to compare attributes.
    if (layout_.attributes() > 1) facts.hashes[a].add(std::as_bytes(values));
  }
}

// Loads the values at the block's points, and at the vertices round them if these are in a mesh.
void PieceReader::load_values(const Piece& piece, Block& block) const {
  std::span<const std::uint32_t> indices = block.points;
  if (prepared_.has_mesh) {
    prepared_.mesh.make_block(block.points, block.vertices);
    indices = block.vertices.vertices();
  }
  block.values.resize(indices.size(), layout_.attributes());
  for (std::size_t a = 0; a < layout_.attributes(); ++a) get_values(piece, a, indices, block.values.column(a));
}

void PieceReader::make_block(const Piece& piece, const Block& block, std::byte* records) const {
  if (layout_.has_material()) std::memset(records, 0, block.points.size() * layout_.bytes());
  for (std::size_t number = 0; number < block.points.size(); ++number) {
    const std::uint32_t point = block.points[number];
    std::byte* record = records + number * layout_.bytes();
    layout_.set_position(record, piece.points[point]);
    if (layout_.has_tags()) layout_.set_tag(record, point_tag(piece_, point));
    for (std::size_t a = 0; a < layout_.attributes(); ++a) layout_.set_value(record, a, block.values.column(a)[number]);
    if (!layout_.has_material() || prepared_.has_mesh) continue;
    if (piece.material)
      set_known_material(piece, point, record);
    else if (piece.cells)
      set_whole_cell(piece, block, number, record);
    else
      layout_.set_vertex(record, {});
  }
  if (prepared_.has_mesh) set_mesh_material(piece, block, records);
}

void PieceReader::set_mesh_material(const Piece& piece, const Block& block, std::byte* records) const {
  block.vertices.find_values(
      block.values, layout_.has_gradients(),
      [&](std::size_t number, const SpatialMoments& moments, std::span<const VertexValue> values) {
        const std::uint32_t point = block.points[number];
        std::byte* record = records + number * layout_.bytes();
        const std::uint64_t of_block = prepared_.in_cells(piece, point) ? PointRecords::block_of(piece) : 0;
        layout_.set_vertex(record, {of_block, moments, prepared_.heights[point]});
        for (std::size_t a = 0; a < values.size(); ++a)
          layout_.set_value_part(record, a, {values[a].moments, values[a].gradient});
      });
}

void PieceReader::set_known_material(const Piece& piece, std::size_t point, std::byte* record) const {
  const PointMaterial& material = *piece.material;
  layout_.set_vertex(record, {PointRecords::block_of(piece), material.moments[point]});
  for (std::size_t a = 0; a < layout_.attributes(); ++a)
    layout_.set_value_part(record, a, {material.value_moments[a][point], material.gradients[a][point]});
  if (!material.planes.empty()) layout_.set_plane(record, material.planes[point]);
}

// The point has a whole cell, and one value in it.
void PieceReader::set_whole_cell(const Piece& piece, const Block& block, std::size_t number, std::byte* record) const {
  const SpatialMoments& moments = piece.cells->moments[block.points[number]];
  layout_.set_vertex(record, {PointRecords::block_of(piece), moments});
  for (std::size_t a = 0; a < layout_.attributes(); ++a) {
    const double value = block.values.column(a)[number];
    if (std::isnan(value)) continue;
    PointRecords::ValuePart part{.moments = {.mass = moments.mass, .centroid = moments.centroid}};
    part.moments.mean = part.moments.min = part.moments.max = value;
    layout_.set_value_part(record, a, part);
  }
}

Status PieceReader::add_faces(const Piece& piece, bool has_mesh, std::span<const OuterFace> outer) {
  const auto hash = [&](std::size_t point) {
    thread_local std::vector<std::byte> record;
    record.resize(layout_.bytes());
    if (layout_.has_material()) layout_.set_block(record.data(), PointRecords::block_of(piece));
    const auto index = static_cast<std::uint32_t>(point);
    for (std::size_t a = 0; a < layout_.attributes(); ++a) {
      double value = 0;
      get_values(piece, a, {&index, 1}, {&value, 1});
      layout_.set_value(record.data(), a, value);
    }
    return hash_values(layout_, record.data());
  };
  if (layout_.has_material() && piece.cells && !piece.material) return faces_.add_cells(piece, hash);
  return has_mesh ? faces_.add(piece, outer, hash) : Status{};
}

}  // namespace splatvol
