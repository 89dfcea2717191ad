#include "tools/export/streamline_export.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "base/file.h"
#include "base/names.h"
#include "extractor/output_arrays.h"
#include "format/splat_reader.h"
#include "sampler/csv_table.h"
#include "sampler/streamlines.h"
#include "tools/export/vtu_file.h"

namespace splatvol {
namespace {

std::vector<double> numbers_of(const OutputArray& array, const Streamline& line) {
  std::vector<double> joined;
  const std::span<const double> numbers = numbers_of(array, line.values, joined);
  return {numbers.begin(), numbers.end()};
}

// Arrays one after another, each behind its length, and their elements of XML.
class AppendedArrays {
 public:
  // `numbers_of`: appends the numbers of a line.
  template <class Number, class NumbersOf>
  std::string add(const VtuArray& array, std::span<const Streamline> lines, const NumbersOf& numbers_of) {
    std::vector<Number> numbers;
    for (const Streamline& line : lines) numbers_of(line, numbers);
    const std::uint64_t bytes = numbers.size() * sizeof(Number);
    const std::string element = vtk_array_element(array, data_.size());
    append(std::as_bytes(std::span(&bytes, 1)));
    append(std::as_bytes(std::span(numbers)));
    return element;
  }

  [[nodiscard]] std::span<const std::byte> data() const { return data_; }

 private:
  void append(std::span<const std::byte> bytes) { data_.insert(data_.end(), bytes.begin(), bytes.end()); }

  std::vector<std::byte> data_;
};

template <class Number>
void append(std::vector<Number>& numbers, const auto& more) {
  numbers.insert(numbers.end(), more.begin(), more.end());
}

Status write_vtp(AtomicFile& file, std::span<const Streamline> lines, std::span<const OutputArray> arrays,
                 const StreamlineReport& report) {
  AppendedArrays appended;
  const auto of_lines = [&](const char* name, const auto& number_of) {
    return appended.add<std::int64_t>({.name = name, .type = "Int64"}, lines, [&](const Streamline& line, auto& all) {
      all.push_back(static_cast<std::int64_t>(number_of(line)));
    });
  };
  const std::string points =
      appended.add<dvec3>({.name = "Points", .components = 3}, lines,
                          [](const Streamline& line, auto& all) { append(all, line.positions); });
  const std::string corners = appended.add<std::int64_t>({.name = "connectivity", .type = "Int64"}, lines,
                                                         [](const Streamline& line, auto& all) {
                                                           for (std::size_t row = 0; row < line.positions.size(); ++row)
                                                             all.push_back(std::ssize(all));
                                                         });
  std::size_t rows = 0;
  const std::string ends = of_lines("offsets", [&](const Streamline& line) { return rows += line.positions.size(); });
  const auto renamed = [&](const std::string& name) {
    const auto found = report.renamed.find(name);
    return found == report.renamed.end() ? name : found->second;
  };
  std::string values = appended.add<double>({.name = renamed("time")}, lines,
                                            [](const Streamline& line, auto& all) { append(all, line.times); });
  for (const OutputArray& array : arrays)
    values += appended.add<double>({.name = array.name, .components = array.components(), .unit = array.unit}, lines,
                                   [&](const Streamline& line, auto& all) { append(all, numbers_of(array, line)); });
  const std::string of_cells = of_lines("seed", [](const Streamline& line) { return line.seed; }) +
                               of_lines("begin", [](const Streamline& line) { return static_cast<int>(line.begin); }) +
                               of_lines("end", [](const Streamline& line) { return static_cast<int>(line.end); });
  const std::string header = fmt::format(
      "<?xml version=\"1.0\"?>\n{}\n"
      "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  <PolyData>\n"
      "    <Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"{}\" NumberOfStrips=\"0\" "
      "NumberOfPolys=\"0\">\n"
      "      <Points>\n{}      </Points>\n      <Lines>\n{}{}      </Lines>\n      <PointData>\n{}"
      "      </PointData>\n      <CellData>\n{}      </CellData>\n    </Piece>\n  </PolyData>\n"
      "  <AppendedData encoding=\"raw\">\n   _",
      vtk_export_mark, report.rows, report.lines, points, corners, ends, values, of_cells);
  SPLATVOL_TRY(file.append(std::as_bytes(std::span(header))));
  SPLATVOL_TRY(file.append(appended.data()));
  constexpr std::string_view tail = "\n  </AppendedData>\n</VTKFile>\n";
  return file.append(std::as_bytes(std::span(tail)));
}

Status write_csv(AtomicFile& file, std::span<const Streamline> lines, std::span<const std::string> names,
                 StreamlineReport& report) {
  SPLATVOL_TRY(write_csv_header(file, {"seed", "time", "x", "y", "z"}, names, report.renamed));
  for (const Streamline& line : lines)
    SPLATVOL_TRY(write_csv_rows(file, line.positions.size(), [&](std::size_t row, std::vector<double>& numbers) {
      const dvec3& p = line.positions[row];
      numbers = {static_cast<double>(line.seed), line.times[row], p.x, p.y, p.z};
      for (const std::vector<double>& values : line.values) numbers.push_back(values[row]);
    }));
  return {};
}

}  // namespace

Result<StreamlineReport> export_streamlines(const format::Volume& volume, const std::string& path,
                                            const StreamlineRequest& request, std::uint64_t memory, Replace replace) {
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, {}, request.attributes, format::SplatSelection().box));
  if (const auto duplicate = find_duplicate(selection.names))
    return fail(ErrorCode::invalid_argument, "{}: attribute \"{}\" is selected twice", volume.name(), *duplicate);
  const std::vector<OutputArray> arrays = output_arrays(volume.info(), selection);
  const bool is_table = has_extension(path, ".csv");
  if (!is_table) SPLATVOL_TRY(check_vtu_names(volume.name(), names_of(arrays)));
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path, AtomicFile::Unnamed::if_possible, replace));
  const std::size_t threads = std::max(1u, std::thread::hardware_concurrency());
  SPLATVOL_TRY_ASSIGN(found, find_streamlines(volume, request, memory, threads));
  StreamlineReport report{.seeds = found.lines.size()};
  std::erase_if(found.lines, [](const Streamline& line) { return line.positions.empty(); });
  report.lines = found.lines.size();
  for (const Streamline& line : found.lines) {
    report.rows += line.positions.size();
    for (const StreamlineEnd end : {line.begin, line.end}) ++report.ends[static_cast<std::size_t>(end)];
  }
  if (is_table) {
    SPLATVOL_TRY(write_csv(file, found.lines, found.names, report));
  } else {
    const std::vector<std::string> names = names_of(arrays);
    const std::string time =
        free_name("time", [&](const std::string& taken) { return std::ranges::find(names, taken) != names.end(); });
    if (time != "time") report.renamed.emplace("time", time);
    SPLATVOL_TRY(write_vtp(file, found.lines, arrays, report));
  }
  report.file_bytes = file.position();
  SPLATVOL_TRY(file.commit());
  return report;
}

}  // namespace splatvol
