#include "sampler/line_export.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <span>

#include "base/file.h"
#include "base/names.h"
#include "format/mesh_box.h"
#include "sampler/cell_line.h"
#include "sampler/cell_tetrahedra.h"

namespace splatvol {
namespace {

constexpr std::uint64_t held_bytes = std::uint64_t{128} << 20;  // of parts of the file
constexpr std::size_t text_bytes = std::size_t{1} << 16;        // written at once

std::string field_of(const std::string& name) {
  if (name.find_first_of(",\"\r\n") == std::string::npos) return name;
  std::string quoted = "\"";
  for (const char c : name) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + '"';
}

std::string header_of(const std::vector<std::string>& names, std::map<std::string, std::string>& renamed) {
  std::string header;
  for (const std::string usual : {"arc_length", "x", "y", "z"}) {
    const std::string name =
        free_name(usual, [&](const std::string& taken) { return std::ranges::find(names, taken) != names.end(); });
    if (name != usual) renamed.emplace(usual, name);
    header += field_of(name) + ',';
  }
  for (const std::string& name : names) header += field_of(name) + ',';
  header.back() = '\n';
  return header;
}

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

Status write_rows(AtomicFile& file, const LineRows& rows) {
  std::string text;
  const auto flush = [&] {
    Status status = file.append(std::as_bytes(std::span(text)));
    text.clear();
    return status;
  };
  for (std::size_t row = 0; row < rows.arc_lengths.size(); ++row) {
    const dvec3& p = rows.positions[row];
    fmt::format_to(std::back_inserter(text), "{},{},{},{}", rows.arc_lengths[row], p.x, p.y, p.z);
    for (const std::vector<double>& values : rows.values)
      fmt::format_to(std::back_inserter(text), ",{}", std::isnan(values[row]) ? std::abs(values[row]) : values[row]);
    text += '\n';
    if (text.size() > text_bytes) SPLATVOL_TRY(flush());
  }
  return flush();
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
  const std::string header = header_of(selection.names, report.renamed);
  SPLATVOL_TRY(file.append(std::as_bytes(std::span(header))));
  SPLATVOL_TRY(write_rows(file, rows));
  report.file_bytes = file.position();
  SPLATVOL_TRY(file.commit());
  return report;
}

}  // namespace splatvol
