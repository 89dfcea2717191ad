#include "builder/sources/process/messages.h"

#include <algorithm>
#include <numeric>
#include <string_view>
#include <tuple>
#include <utility>

#include "base/printable.h"
#include "builder/sources/process/held_values.h"

namespace splatvol {

template <class Options>
auto members_of(Options& options) requires std::is_same_v<std::remove_const_t<Options>, SourceOptions> {
  return std::tie(options.selection, options.columns, options.time, options.cells, options.missing, options.patches,
                  options.may_lack, options.may_round, options.displacements);
}

template <class Step>
auto members_of(Step& step) requires std::is_same_v<std::remove_const_t<Step>, TimeStep> {
  return std::tie(step.time, step.index, step.times);
}

template <class State>
auto members_of(State& state) requires std::is_same_v<std::remove_const_t<State>, SourceState> {
  return std::tie(state.attributes, state.units, state.components, state.pieces, state.number, state.points, state.step,
                  state.time, state.left_out_cells, state.copies, state.averages_by_piece, state.may_have_cells,
                  state.brings_material, state.single_precision, state.files.opened, state.files.missing,
                  state.files.are_all);
}

template <class Shape>
auto members_of(Shape& array) requires std::is_same_v<std::remove_const_t<Shape>, ArrayShape> {
  return std::tie(array.name, array.components, array.of_cells, array.unit);
}

template <class Census>
auto members_of(Census& census) requires std::is_same_v<std::remove_const_t<Census>, CellCensus> {
  return std::tuple_cat(std::tie(census.cells, census.rounded_by), numbers_of(census));
}

template <class Material>
auto members_of(Material& material) requires std::is_same_v<std::remove_const_t<Material>, PointMaterial> {
  return std::tie(material.moments, material.value_moments, material.gradients, material.planes);
}

template <class Cells>
auto members_of(Cells& cells) requires std::is_same_v<std::remove_const_t<Cells>, PointCells> {
  return std::tie(cells.corners, cells.tetrahedra, cells.points, cells.moments);
}

template <class Mesh>
auto members_of(Mesh& mesh) requires std::is_same_v<std::remove_const_t<Mesh>, TriangleMesh> {
  return std::tie(mesh.points, mesh.triangles, mesh.open_end);
}

template <class OfPatch>
auto members_of(OfPatch& patch) requires std::is_same_v<std::remove_const_t<OfPatch>, Patch> {
  return std::tie(patch.name, patch.mesh);
}

namespace {

/// Texts that are printed have at most so many bytes.
constexpr std::size_t most_line_bytes = 4096;

std::string cut(const std::string& line) {
  constexpr std::string_view end = "...";
  if (line.size() <= most_line_bytes) return line;
  return line.substr(0, most_line_bytes - end.size()).append(end);
}

/// What a file made of the reader process may not write to the terminal.
Status get_line(Channel& channel, std::string& line) {
  SPLATVOL_TRY(channel.get(line, most_line_bytes));
  line = one_line(line);
  return {};
}

Status put_lines(Channel& channel, const auto& lines) {
  SPLATVOL_TRY(channel.put(std::uint64_t{lines.size()}));
  for (const std::string& line : lines) SPLATVOL_TRY(channel.put(cut(line)));
  return {};
}

template <class Add>
Status get_lines(Channel& channel, const Add& add) {
  std::uint64_t count = 0;
  SPLATVOL_TRY(channel.get(count));
  for (std::string line; count > 0; --count) {
    SPLATVOL_TRY(get_line(channel, line));
    add(line);
  }
  return {};
}

/// Sends an array, and frees it.
template <class T>
Status put_away(Channel& channel, std::vector<T>& values) {
  Status sent = channel.put(values);
  values = {};
  return sent;
}

Status put_column(Channel& channel, const PackedColumn& column) {
  SPLATVOL_TRY(channel.put(column.index()));
  return std::visit([&](const auto& values) { return channel.put(values); }, column);
}

Result<PackedColumn> get_column(Channel& channel) {
  std::size_t kind = 0;
  SPLATVOL_TRY(channel.get(kind));
  PackedColumn column;
  if (kind > 0) column.emplace<1>();
  SPLATVOL_TRY(std::visit([&](auto& values) { return channel.get(values); }, column));
  return column;
}

/// Values of one attribute after the other: all of them at once would take twice their memory.
Status put_lent(Channel& channel, const LentValues& lent, std::size_t points, std::size_t attributes) {
  std::vector<std::uint32_t> all(points);
  std::iota(all.begin(), all.end(), 0u);
  std::vector<double> values(points);
  for (std::size_t a = 0; a < attributes; ++a) {
    lent.get(a, all, values);
    SPLATVOL_TRY(put_column(channel, pack_column(values)));
  }
  return {};
}

tl::unexpected<Error> fail_piece(const char* what) {
  return fail(ErrorCode::invalid_data, "the reader process sent a piece whose {}", what);
}

bool all_below(const std::vector<Tetrahedron>& tetrahedra, std::size_t points) {
  return std::ranges::all_of(tetrahedra,
                             [&](const Tetrahedron& corners) { return std::ranges::max(corners) < points; });
}

Status check_material(const PointMaterial& material, std::size_t points, std::size_t attributes) {
  const auto fits = [&](const auto& of_points) { return of_points.size() == points; };
  if (!fits(material.moments) || !(material.planes.empty() || fits(material.planes)) ||
      material.value_moments.size() != attributes || !std::ranges::all_of(material.value_moments, fits) ||
      !(material.gradients.empty() || material.gradients.size() == attributes) ||
      !std::ranges::all_of(material.gradients, fits))
    return fail_piece("material is not that of its points");
  return {};
}

Status check_cells(const PointCells& cells, std::size_t points) {
  const bool in_range = std::ranges::all_of(
      cells.points, [&](std::uint32_t point) { return point < points || point == PointCells::no_point; });
  if (!in_range || cells.points.size() != cells.tetrahedra.size() || cells.moments.size() != points ||
      !all_below(cells.tetrahedra, cells.corners.size()))
    return fail_piece("cells are not those of its points");
  return {};
}

Status check_surface(const TriangleMesh& mesh) {
  const bool fits = std::ranges::all_of(
      mesh.triangles, [&](const auto& corners) { return std::ranges::max(corners) < mesh.points.size(); });
  if (!fits || !std::ranges::all_of(mesh.points, is_usable_position))
    return fail(ErrorCode::invalid_data, "the reader process sent a surface whose points do not fit");
  return {};
}

// Whole cells are in the order of their tetrahedra.
Status check_whole_cells(const Piece& piece) {
  const std::size_t points = piece.cells ? piece.cells->corners.size() : piece.points.size();
  const std::size_t tetrahedra = piece.cells ? piece.cells->tetrahedra.size() : piece.tetrahedra.size();
  std::uint64_t next = 0;
  for (const WholeCell& cell : piece.whole_cells) {
    const auto corners = std::span(cell.corners).first(format::corners_of(cell.shape));
    const bool fits = cell.shape == format::CellShape::polyhedron ||
                      (!corners.empty() && format::is_split(cell.shape, cell.split) &&
                       std::ranges::all_of(corners, [&](std::uint32_t corner) { return corner < points; }));
    if (!fits || cell.count == 0 || cell.first < next || cell.count > tetrahedra ||
        cell.first > tetrahedra - cell.count)
      return fail_piece("cells are not those of its tetrahedra");
    next = std::uint64_t{cell.first} + cell.count;
  }
  return {};
}

Status check_piece(const Piece& piece, std::size_t attributes) {
  const std::size_t points = piece.points.size();
  SPLATVOL_TRY(check_whole_cells(piece));
  if (!all_below(piece.tetrahedra, points)) return fail_piece("tetrahedra name points that are not there");
  const auto fits = [&](const auto& of_points) { return of_points.size() == points; };
  if (!piece.lent && (piece.values.size() != attributes || !std::ranges::all_of(piece.values, fits)))
    return fail_piece("values are not those of its points");
  if (!piece.fills.empty() && piece.fills.size() != attributes) return fail_piece("counts are not of its attributes");
  if (piece.material) SPLATVOL_TRY(check_material(*piece.material, points, attributes));
  if (piece.cells) SPLATVOL_TRY(check_cells(*piece.cells, points));
  for (const Patch& patch : piece.patches) SPLATVOL_TRY(check_surface(patch.mesh));
  return {};
}

}  // namespace

SourceState state_of(const Source& source) {
  SourceState state;
  state.attributes = source.attributes();
  state.units = source.units();
  state.conversions = source.conversions();
  state.components = source.components();
  state.pieces = source.piece_count();
  state.number = source.piece_number();
  state.points = source.point_count();
  state.step = source.time_step();
  state.time = source.stated_time();
  state.left_out_cells = source.left_out_cells();
  state.copies = source.copies();
  state.averages_by_piece = source.averages_by_piece();
  state.may_have_cells = source.may_have_cells();
  state.brings_material = source.brings_material();
  state.single_precision = source.single_precision();
  return state;
}

Status put(Channel& channel, const Error& error) { return channel.put_all(error.code, cut(error.message)); }

Status get(Channel& channel, Error& error) {
  SPLATVOL_TRY(channel.get(error.code));
  SPLATVOL_TRY(get_line(channel, error.message));
  return error.code <= ErrorCode::cancelled ? Status{} : fail(ErrorCode::invalid_data, "an error of no kind");
}

Status put(Channel& channel, const SourceOptions& options) { return channel.put(options); }
Status get(Channel& channel, SourceOptions& options) { return channel.get(options); }

Status put(Channel& channel, const SourceState& state) {
  SPLATVOL_TRY(channel.put(state));
  return put_lines(channel, state.conversions);
}

Status get(Channel& channel, SourceState& state) {
  SPLATVOL_TRY(channel.get(state));
  return get_lines(channel, [&](std::string line) { state.conversions.push_back(std::move(line)); });
}

Status put(Channel& channel, const std::optional<std::vector<ArrayShape>>& arrays) { return channel.put(arrays); }

Status get(Channel& channel, std::optional<std::vector<ArrayShape>>& arrays) {
  SPLATVOL_TRY(channel.get(arrays));
  const auto has_numbers = [](const ArrayShape& array) { return array.components > 0; };
  if (!arrays || std::ranges::all_of(*arrays, has_numbers)) return {};
  return fail(ErrorCode::invalid_data, "the reader process sent an array without numbers");
}

Status put(Channel& channel, const TriangleMesh& mesh) { return channel.put(mesh); }

Status get(Channel& channel, TriangleMesh& mesh) {
  SPLATVOL_TRY(channel.get(mesh));
  return check_surface(mesh);
}

Status put(Channel& channel, std::unique_ptr<Piece> piece, std::size_t attributes) {
  const std::size_t points = piece->points.size();
  SPLATVOL_TRY(channel.put_all(piece->block, piece->census, piece->fills, piece->lent != nullptr));
  SPLATVOL_TRY(put_lines(channel, piece->census.losses));
  SPLATVOL_TRY(put_away(channel, piece->points));
  SPLATVOL_TRY(put_away(channel, piece->tetrahedra));
  SPLATVOL_TRY(put_away(channel, piece->whole_cells));
  SPLATVOL_TRY(channel.put(std::uint64_t{piece->values.size()}));
  for (std::vector<double>& values : piece->values) SPLATVOL_TRY(put_away(channel, values));
  if (piece->lent) {
    SPLATVOL_TRY(put_lent(channel, *piece->lent, points, attributes));
    piece->lent.reset();
  }
  return channel.put_all(piece->material, piece->cells, piece->patches);
}

Status get(Channel& channel, Piece& piece, std::size_t attributes) {
  bool is_lent = false;
  SPLATVOL_TRY(channel.get_all(piece.block, piece.census, piece.fills, is_lent));
  SPLATVOL_TRY(get_lines(channel, [&](std::string line) { piece.census.losses.insert(std::move(line)); }));
  SPLATVOL_TRY(channel.get_all(piece.points, piece.tetrahedra, piece.whole_cells, piece.values));
  if (is_lent) {
    std::vector<PackedColumn> columns;
    for (std::size_t a = 0; a < attributes; ++a) {
      SPLATVOL_TRY_ASSIGN(column, get_column(channel));
      if (std::visit([](const auto& values) { return values.size(); }, column) != piece.points.size())
        return fail_piece("values are not those of its points");
      columns.push_back(std::move(column));
    }
    piece.lent = std::make_shared<HeldValues>(std::move(columns));
  }
  SPLATVOL_TRY(channel.get_all(piece.material, piece.cells, piece.patches));
  return check_piece(piece, attributes);
}

}  // namespace splatvol
