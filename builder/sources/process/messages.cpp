#include "builder/sources/process/messages.h"

#include <algorithm>
#include <numeric>
#include <string_view>
#include <tuple>
#include <utility>

#include "base/printable.h"
#include "builder/sources/process/held_values.h"

namespace splatvol {
namespace {

/// Sends or receives several members.
template <class... Members>
Status put_all(Channel& channel, const Members&... members) {
  Status status;
  (void)((status = channel.put(members)) && ...);
  return status;
}

template <class... Members>
Status get_all(Channel& channel, Members&... members) {
  Status status;
  (void)((status = channel.get(members)) && ...);
  return status;
}

template <class Options>
auto members_of(Options& options) requires std::is_same_v<std::remove_const_t<Options>, SourceOptions> {
  return std::tie(options.selection, options.columns, options.time, options.cells, options.missing, options.patches,
                  options.may_lack);
}

template <class State>
auto members_of(State& state) requires std::is_same_v<std::remove_const_t<State>, SourceState> {
  return std::tie(state.attributes, state.units, state.components, state.pieces, state.number, state.points, state.time,
                  state.left_out_cells, state.copies, state.averages_by_piece, state.may_have_cells,
                  state.brings_material, state.single_precision);
}

template <class Census>
auto members_of(Census& census) requires std::is_same_v<std::remove_const_t<Census>, CellCensus> {
  return std::tuple_cat(std::tie(census.cells), numbers_of(census));
}

template <class Material>
auto members_of(Material& material) requires std::is_same_v<std::remove_const_t<Material>, PointMaterial> {
  return std::tie(material.moments, material.value_moments, material.gradients, material.planes);
}

template <class Cells>
auto members_of(Cells& cells) requires std::is_same_v<std::remove_const_t<Cells>, PointCells> {
  return std::tie(cells.corners, cells.tetrahedra, cells.points, cells.moments);
}

template <class T>
Status put_members(Channel& channel, const T& value) {
  return std::apply([&](const auto&... members) { return put_all(channel, members...); }, members_of(value));
}

template <class T>
Status get_members(Channel& channel, T& value) {
  return std::apply([&](auto&... members) { return get_all(channel, members...); }, members_of(value));
}

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

Status check_piece(const Piece& piece, std::size_t attributes) {
  const std::size_t points = piece.points.size();
  if (!all_below(piece.tetrahedra, points)) return fail_piece("tetrahedra name points that are not there");
  const auto fits = [&](const auto& of_points) { return of_points.size() == points; };
  if (!piece.lent && (piece.values.size() != attributes || !std::ranges::all_of(piece.values, fits)))
    return fail_piece("values are not those of its points");
  if (!piece.fills.empty() && piece.fills.size() != attributes) return fail_piece("counts are not of its attributes");
  if (piece.material) SPLATVOL_TRY(check_material(*piece.material, points, attributes));
  if (piece.cells) SPLATVOL_TRY(check_cells(*piece.cells, points));
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

Status put(Channel& channel, const Error& error) { return put_all(channel, error.code, cut(error.message)); }

Status get(Channel& channel, Error& error) {
  SPLATVOL_TRY(channel.get(error.code));
  SPLATVOL_TRY(get_line(channel, error.message));
  return error.code <= ErrorCode::cancelled ? Status{} : fail(ErrorCode::invalid_data, "an error of no kind");
}

Status put(Channel& channel, const SourceOptions& options) { return put_members(channel, options); }
Status get(Channel& channel, SourceOptions& options) { return get_members(channel, options); }

Status put(Channel& channel, const SourceState& state) {
  SPLATVOL_TRY(put_members(channel, state));
  SPLATVOL_TRY(channel.put(std::uint64_t{state.conversions.size()}));
  for (const std::string& line : state.conversions) SPLATVOL_TRY(channel.put(cut(line)));
  SPLATVOL_TRY(channel.put(state.step.has_value()));
  return state.step ? put_all(channel, state.step->time, state.step->index, state.step->times) : Status{};
}

Status get(Channel& channel, SourceState& state) {
  SPLATVOL_TRY(get_members(channel, state));
  std::uint64_t conversions = 0;
  SPLATVOL_TRY(channel.get(conversions));
  for (std::uint64_t i = 0; i < conversions; ++i) SPLATVOL_TRY(get_line(channel, state.conversions.emplace_back()));
  bool has_step = false;
  SPLATVOL_TRY(channel.get(has_step));
  if (!has_step) return {};
  state.step.emplace();
  return get_all(channel, state.step->time, state.step->index, state.step->times);
}

Status put(Channel& channel, const std::optional<std::vector<ArrayShape>>& arrays) {
  SPLATVOL_TRY(channel.put(arrays.has_value()));
  if (!arrays) return {};
  SPLATVOL_TRY(channel.put(std::uint64_t{arrays->size()}));
  for (const ArrayShape& array : *arrays)
    SPLATVOL_TRY(put_all(channel, array.name, array.components, array.of_cells, array.unit));
  return {};
}

Status get(Channel& channel, std::optional<std::vector<ArrayShape>>& arrays) {
  bool has_arrays = false;
  std::uint64_t count = 0;
  arrays.reset();
  SPLATVOL_TRY(channel.get(has_arrays));
  if (!has_arrays) return {};
  arrays.emplace();
  SPLATVOL_TRY(channel.get(count));
  for (std::uint64_t i = 0; i < count; ++i) {
    ArrayShape& array = arrays->emplace_back();
    SPLATVOL_TRY(get_all(channel, array.name, array.components, array.of_cells, array.unit));
    if (array.components < 1) return fail(ErrorCode::invalid_data, "the reader process sent an array without numbers");
  }
  return {};
}

Status put(Channel& channel, const TriangleMesh& mesh) {
  return put_all(channel, mesh.points, mesh.triangles, mesh.open_end);
}

Status get(Channel& channel, TriangleMesh& mesh) {
  SPLATVOL_TRY(get_all(channel, mesh.points, mesh.triangles, mesh.open_end));
  const bool fits = std::ranges::all_of(
      mesh.triangles, [&](const auto& corners) { return std::ranges::max(corners) < mesh.points.size(); });
  if (!fits || !std::ranges::all_of(mesh.points, is_usable_position))
    return fail(ErrorCode::invalid_data, "the reader process sent a surface whose points do not fit");
  return {};
}

Status put(Channel& channel, std::unique_ptr<Piece> piece, std::size_t attributes) {
  const std::size_t points = piece->points.size();
  SPLATVOL_TRY(put_members(channel, piece->census));
  SPLATVOL_TRY(
      put_all(channel, piece->fills, piece->lent != nullptr, piece->material.has_value(), piece->cells.has_value()));
  SPLATVOL_TRY(put_away(channel, piece->points));
  SPLATVOL_TRY(put_away(channel, piece->tetrahedra));
  SPLATVOL_TRY(channel.put(std::uint64_t{piece->values.size()}));
  for (std::vector<double>& values : piece->values) SPLATVOL_TRY(put_away(channel, values));
  if (piece->lent) {
    SPLATVOL_TRY(put_lent(channel, *piece->lent, points, attributes));
    piece->lent.reset();
  }
  if (piece->material) SPLATVOL_TRY(put_members(channel, *piece->material));
  if (piece->cells) SPLATVOL_TRY(put_members(channel, *piece->cells));
  SPLATVOL_TRY(channel.put(std::uint64_t{piece->patches.size()}));
  for (const Patch& patch : piece->patches) {
    SPLATVOL_TRY(channel.put(patch.name));
    SPLATVOL_TRY(put(channel, patch.mesh));
  }
  return {};
}

Status get(Channel& channel, Piece& piece, std::size_t attributes) {
  bool is_lent = false, has_material = false, has_cells = false;
  SPLATVOL_TRY(get_members(channel, piece.census));
  SPLATVOL_TRY(get_all(channel, piece.fills, is_lent, has_material, has_cells));
  SPLATVOL_TRY(get_all(channel, piece.points, piece.tetrahedra, piece.values));
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
  if (has_material) SPLATVOL_TRY(get_members(channel, piece.material.emplace()));
  if (has_cells) SPLATVOL_TRY(get_members(channel, piece.cells.emplace()));
  std::uint64_t patches = 0;
  SPLATVOL_TRY(channel.get(patches));
  for (std::uint64_t i = 0; i < patches; ++i) {
    Patch patch;
    SPLATVOL_TRY(channel.get(patch.name));
    SPLATVOL_TRY(get(channel, patch.mesh));
    piece.patches.push_back(std::move(patch));
  }
  return check_piece(piece, attributes);
}

}  // namespace splatvol
