#include "sampler/line_export.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/file.h"
#include "base/names.h"
#include "format/mesh_box.h"
#include "sampler/cell_line.h"
#include "sampler/cell_tetrahedra.h"
#include "sampler/csv_table.h"

namespace splatvol {
namespace {

constexpr std::uint64_t held_bytes = std::uint64_t{128} << 20;  // of parts of the file

// The length of the parts between rows that have all values.
double length_inside(const LineRows& rows) {
  double length = 0;
  for (std::size_t row = 1; row < rows.arc_lengths.size(); ++row)
    if (std::ranges::none_of(rows.values, [row](const auto& v) { return std::isnan(v[row - 1] + v[row]); }))
      length += rows.arc_lengths[row] - rows.arc_lengths[row - 1];
  return length;
}

bool has_values(const LineRows& rows) {
  return std::ranges::any_of(rows.values, [](const std::vector<double>& values) {
    return std::ranges::any_of(values, [](double value) { return !std::isnan(value); });
  });
}

}  // namespace

Result<LineReport> export_line(const format::Volume& volume, const std::string& path,
                               const format::SplatSelection& selection, const dvec3& start, const dvec3& end,
                               std::optional<std::size_t> samples, Replace replace) {
  if (const auto duplicate = find_duplicate(selection.names))
    return fail(ErrorCode::invalid_argument, "{}: attribute \"{}\" is selected twice", volume.name(), *duplicate);
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, selection.attributes, own_room(held_bytes)));
  if (!cells) return fail_without_cells(volume);
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path, AtomicFile::Unnamed::if_possible, replace));
  SPLATVOL_TRY_ASSIGN(rows, follow_line(*cells, start, end));
  if (!has_values(rows)) {
    SPLATVOL_TRY_ASSIGN(box, format::mesh_box(volume));
    return fail(ErrorCode::invalid_argument,
                "{}: the line has no values: no cell is on it, or these lack them; the mesh reaches from "
                "({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, {:.6g})",
                volume.name(), box.low.x, box.low.y, box.low.z, box.high.x, box.high.y, box.high.z);
  }
  LineReport report{.length = rows.arc_lengths.back(), .inside = length_inside(rows)};
  if (samples) rows = in_equal_steps(rows, start, end, *samples);
  report.rows = rows.arc_lengths.size();
  SPLATVOL_TRY(write_csv_header(file, {"arc_length", "x", "y", "z"}, selection.names, report.renamed));
  SPLATVOL_TRY(write_csv_rows(file, rows.arc_lengths.size(), [&](std::size_t row, std::vector<double>& numbers) {
    const dvec3& p = rows.positions[row];
    numbers = {rows.arc_lengths[row], p.x, p.y, p.z};
    for (const std::vector<double>& values : rows.values) numbers.push_back(values[row]);
  }));
  report.file_bytes = file.position();
  SPLATVOL_TRY(file.commit());
  return report;
}

}  // namespace splatvol
