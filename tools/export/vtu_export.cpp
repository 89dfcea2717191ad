#include "tools/export/vtu_export.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <set>
#include <span>
#include <string_view>
#include <utility>

#include "base/file.h"
#include "base/names.h"

namespace splatvol {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are written as they are");

// An array of the file.
struct Array {
  std::string name;
  const char* type = "Float64";
  std::size_t components = 1;
  std::size_t number_bytes = sizeof(double);
  std::string unit = {};
  std::uint64_t offset = 0;  // in the appended data: of the array's length; the numbers follow it

  [[nodiscard]] std::uint64_t bytes(std::uint64_t points) const { return points * components * number_bytes; }
};

constexpr std::uint8_t vertex_type = 1;
constexpr std::uint64_t cells_at_once = std::uint64_t{1} << 16;

// A character at the front of a text in UTF-8: its number and bytes. Zero bytes: there is none.
struct Character {
  std::uint32_t number = 0;
  std::size_t bytes = 0;
};

Character first_character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u; };
  const std::size_t bytes = byte(0) < 0x80 ? 1 : byte(0) < 0xc2 ? 0 : byte(0) < 0xe0 ? 2 : byte(0) < 0xf0 ? 3 : 4;
  if (bytes < 2) return {byte(0), bytes};
  std::uint32_t number = byte(0) & (0xffu >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return {};
    number = number << 6 | (byte(i) & 0x3f);
  }
  constexpr std::array<std::uint32_t, 5> least = {0, 0, 0x80, 0x800, 0x10000};  // fewer bytes would do below it
  return number < least[bytes] ? Character{} : Character{number, bytes};
}

// XML 1.0, production 2: no control characters, surrogates, or U+FFFE and U+FFFF.
bool is_xml(std::uint32_t number) {
  return number == '\t' || number == '\n' || (number >= 0x20 && number < 0xd800) ||
         (number >= 0xe000 && number < 0xfffe) || (number >= 0x10000 && number < 0x110000);
}

// XML has no way to write some characters, nor bytes that are no UTF-8; `?` stands for each.
std::string escape(std::string_view text) {
  std::string escaped;
  for (std::size_t bytes = 0; !text.empty(); text.remove_prefix(bytes)) {
    const Character character = first_character(text);
    bytes = std::max<std::size_t>(character.bytes, 1);
    if (character.bytes == 0 || !is_xml(character.number))
      escaped += '?';
    else if (bytes == 1 && std::string_view("&<>\"\t\n").find(text[0]) != std::string_view::npos)
      escaped += fmt::format("&#{};", character.number);
    else
      escaped += text.substr(0, bytes);
  }
  return escaped;
}

bool is_inside(const Box& box, const dvec3& p) {
  return glm::all(glm::greaterThanEqual(p, box.low)) && glm::all(glm::lessThanEqual(p, box.high));
}

// Numbers of some consecutive points for each array, ready to be written.
using Columns = std::vector<std::vector<double>>;

void append(std::vector<double>& column, const dvec3& v) { column.insert(column.end(), {v.x, v.y, v.z}); }

// Returns S^-1 c; S is diagonal along the principal axes. Leaves out axes without extent, where it would not be finite.
dvec3 gradient_of(const SplatValue& value, const SplatShape& shape, const dmat3& axes) {
  dvec3 gradient(0);
  if (!(value.coverage > 0)) return gradient;
  for (int k = 0; k < 3; ++k) {
    const dvec3 along = value.correlation[k] * (value.deviation / shape.deviations[k]) * axes[k];
    const dvec3 sum = gradient + along;
    if (std::isfinite(sum.x + sum.y + sum.z)) gradient = sum;
  }
  return gradient;
}

dvec3 unit(const vec3& direction) { return direction == vec3(0) ? dvec3(0) : glm::normalize(dvec3(direction)); }

class VtuFile {
 public:
  VtuFile(const format::Volume& volume, const format::SplatSelection& selection) : selection_(selection) {
    arrays_.push_back({.name = "Points", .components = 3});
    const format::VolumeInfo& info = volume.info();
    for (std::size_t i = 0; i < selection.attributes.size(); ++i) {
      attributes_.push_back(info.attributes[selection.attributes[i]]);
      attributes_.back().name = selection.names[i];
      arrays_.push_back({.name = attributes_.back().name, .unit = attributes_.back().unit});
      taken_.insert(escape(selection.names[i]));
    }
    add_own({.name = "mass"});
    add_own({.name = "centroid", .components = 3});
    add_own({.name = "covariance", .components = 6});
    for (std::size_t i = 0; i < attributes_.size(); ++i) {
      const format::Attribute& attribute = attributes_[i];
      add_own({.name = attribute.name + " mean", .unit = attribute.unit});
      add_own({.name = attribute.name + " deviation", .unit = attribute.unit});
      add_own({.name = attribute.name + " covariance", .components = 3});
      add_own({.name = attribute.name + " gradient", .components = 3});
      const auto index = static_cast<int>(selection.attributes[i]);
      has_direction_.push_back(info.find_column(format::ColumnKind::gradient, index) >= 0);
      if (has_direction_.back()) add_own({.name = attribute.name + " gradient direction", .components = 3});
    }
    data_arrays_ = arrays_.size();
    arrays_.push_back({.name = "connectivity", .type = "Int64", .number_bytes = sizeof(std::int64_t)});
    arrays_.push_back({.name = "offsets", .type = "Int64", .number_bytes = sizeof(std::int64_t)});
    arrays_.push_back({.name = "types", .type = "UInt8", .number_bytes = sizeof(std::uint8_t)});
  }

  // VTK keeps one array of a name.
  Status check_names(const std::string& file) const {
    std::vector<std::string> names;
    for (const std::string& name : selection_.names) names.push_back(escape(name));
    if (const auto duplicate = find_duplicate(std::move(names)))
      return fail(ErrorCode::invalid_argument,
                  "{}: two attributes are called \"{}\" in the output: take one (--attribute)", file, *duplicate);
    return {};
  }

  // Writes all but the numbers of the points: the header, the lengths, the cells and the tail.
  Status start(AtomicFile& file, std::uint64_t points) {
    std::uint64_t end = 0;
    for (Array& array : arrays_) {
      array.offset = end;
      end += sizeof(std::uint64_t) + array.bytes(points);
    }
    const std::string header = header_of(points);
    SPLATVOL_TRY(file.append(std::as_bytes(std::span(header))));
    data_ = header.size();
    for (const Array& array : arrays_) {
      const std::array<std::uint64_t, 1> length = {array.bytes(points)};
      SPLATVOL_TRY(file.write_at(data_ + array.offset, std::as_bytes(std::span(length))));
    }
    SPLATVOL_TRY(write_cells(file, points));
    const std::string tail = "\n  </AppendedData>\n</VTKFile>\n";
    bytes_ = data_ + end + tail.size();
    return file.write_at(data_ + end, std::as_bytes(std::span(tail)));
  }

  // Appends the points of a group that are in the box.
  void collect(const format::SplatGroup& group, Columns& columns, VtuReport& report) const {
    columns.resize(data_arrays_);
    for (std::size_t i = 0; i < group.size(); ++i) {
      if (!is_inside(selection_.box, group.positions[i])) continue;
      report.mass += group.shapes[i].mass;
      auto column = columns.begin();
      append(*column++, group.positions[i]);
      for (std::size_t a = 0; a < attributes_.size(); ++a)
        (column++)->push_back(attributes_[a].value(static_cast<double>(group.values[a][i])));
      const SplatShape& shape = group.shapes[i];
      const dmat3 axes = glm::mat3_cast(shape.orientation);
      dmat3 covariance(0);
      for (int k = 0; k < 3; ++k)
        covariance += shape.deviations[k] * shape.deviations[k] * glm::outerProduct(axes[k], axes[k]);
      (column++)->push_back(shape.mass);
      append(*column++, group.centroids[i]);
      append(*column, {covariance[0][0], covariance[1][1], covariance[2][2]});
      append(*column++, {covariance[1][0], covariance[2][1], covariance[2][0]});
      for (std::size_t a = 0; a < attributes_.size(); ++a) {
        SplatValue value = group.materials[a][i];
        value.mean = attributes_[a].value(value.mean);
        value.deviation *= attributes_[a].scale;
        const double none = value.coverage > 0 ? 0 : std::numeric_limits<double>::quiet_NaN();
        (column++)->push_back(none + value.mean);
        (column++)->push_back(none + value.deviation);
        append(*column++, none + axes * (value.deviation * value.correlation * shape.deviations));
        append(*column++, gradient_of(value, shape, axes));
        if (has_direction_[a]) append(*column++, unit(group.directions[a][i]));
      }
    }
  }

  // Writes the numbers of the points from `first` on.
  Status write(AtomicFile& file, const Columns& columns, std::uint64_t first) const {
    for (std::size_t i = 0; i < columns.size(); ++i)
      SPLATVOL_TRY(file.write_at(data_ + arrays_[i].offset + sizeof(std::uint64_t) + arrays_[i].bytes(first),
                                 std::as_bytes(std::span(columns[i]))));
    return {};
  }

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  [[nodiscard]] const std::map<std::string, std::string>& renamed() const { return renamed_; }

 private:
  // Adds an array of the material. Its name may be that of an attribute, which keeps it.
  void add_own(Array array) {
    const std::string usual = array.name;
    array.name = free_name(usual, [&](const std::string& name) { return taken_.contains(escape(name)); });
    taken_.insert(escape(array.name));
    if (array.name != usual) renamed_.emplace(usual, array.name);
    arrays_.push_back(std::move(array));
  }

  [[nodiscard]] std::string header_of(std::uint64_t points) const {
    const auto element = [](const Array& array) {
      // VTK's own key for the unit of an array.
      const std::string unit = fmt::format(
          ">\n          <InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\">{}</InformationKey>"
          "\n        </DataArray>\n",
          escape(array.unit));
      return fmt::format(
          "        <DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"appended\" offset=\"{}\"{}",
          array.type, escape(array.name), array.components, array.offset, array.unit.empty() ? "/>\n" : unit);
    };
    std::string header = fmt::format(
        "<?xml version=\"1.0\"?>\n{1}\n"
        "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n"
        "  <UnstructuredGrid>\n"
        "    <Piece NumberOfPoints=\"{0}\" NumberOfCells=\"{0}\">\n      <Points>\n",
        points, vtu_export_mark);
    header += element(arrays_[0]) + "      </Points>\n      <Cells>\n";
    for (std::size_t i = data_arrays_; i < arrays_.size(); ++i) header += element(arrays_[i]);
    header += "      </Cells>\n      <PointData>\n";
    for (std::size_t i = 1; i < data_arrays_; ++i) header += element(arrays_[i]);
    return header + "      </PointData>\n    </Piece>\n  </UnstructuredGrid>\n  <AppendedData encoding=\"raw\">\n   _";
  }

  Status write_cells(AtomicFile& file, std::uint64_t points) const {
    for (std::uint64_t first = 0; first < points; first += cells_at_once) {
      const std::uint64_t count = std::min(cells_at_once, points - first);
      std::vector<std::int64_t> numbers(count + 1);
      for (std::uint64_t i = 0; i <= count; ++i) numbers[i] = static_cast<std::int64_t>(first + i);
      const std::vector<std::uint8_t> types(count, vertex_type);
      const std::array<std::span<const std::byte>, 3> parts = {std::as_bytes(std::span(numbers).first(count)),
                                                               std::as_bytes(std::span(numbers).subspan(1)),
                                                               std::as_bytes(std::span(types))};
      for (std::size_t k = 0; k < parts.size(); ++k) {
        const Array& array = arrays_[data_arrays_ + k];
        SPLATVOL_TRY(file.write_at(data_ + array.offset + sizeof(std::uint64_t) + array.bytes(first), parts[k]));
      }
    }
    return {};
  }

  const format::SplatSelection& selection_;
  std::vector<format::Attribute> attributes_;
  std::vector<bool> has_direction_;  // [attribute]
  std::vector<Array> arrays_;        // points and their data, then those of the cells
  std::set<std::string> taken_;      // names of the points' arrays, as they are in the file
  std::map<std::string, std::string> renamed_;
  std::size_t data_arrays_;
  std::uint64_t data_ = 0;  // where the appended data begins
  std::uint64_t bytes_ = 0;
};

// Without a box, the metadata tells the number of points.
Result<std::uint64_t> count_points(const format::Volume& volume, const format::SplatSelection& selection,
                                   const std::function<void(double)>& progress) {
  if (selection.box == format::SplatSelection().box) return volume.info().resolution_counts[selection.resolution];
  std::uint64_t points = 0;
  const auto count_group = [&](const format::SplatGroup& group) -> Status {
    points += static_cast<std::uint64_t>(
        std::ranges::count_if(group.positions, [&](const dvec3& p) { return is_inside(selection.box, p); }));
    return {};
  };
  SPLATVOL_TRY(for_each_group(format::SplatReader(volume, selection), {.positions = true}, count_group, progress));
  if (points == 0) return fail(ErrorCode::invalid_argument, "{}: no points in the box", volume.name());
  return points;
}

}  // namespace

Result<VtuReport> export_vtu(const format::Volume& volume, const std::string& path,
                             const format::SplatSelection& selection, const std::function<void(double)>& progress,
                             Replace replace) {
  for (const std::size_t a : selection.attributes)
    if (volume.info().find_column(format::ColumnKind::value, static_cast<int>(a)) < 0)
      return fail(ErrorCode::unsupported, "{}: no values of attribute \"{}\"", volume.name(),
                  volume.info().attributes[a].name);
  VtuFile vtu(volume, selection);
  SPLATVOL_TRY(vtu.check_names(volume.name()));
  SPLATVOL_TRY_ASSIGN(points, count_points(volume, selection, [&](double done) { progress(done / 4); }));
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path, AtomicFile::Unnamed::if_possible, replace));
  SPLATVOL_TRY(vtu.start(file, points));
  VtuReport report;
  Columns columns;
  const auto write_group = [&](const format::SplatGroup& group) -> Status {
    columns.clear();
    vtu.collect(group, columns, report);
    SPLATVOL_TRY(vtu.write(file, columns, report.points));
    report.points += columns[0].size() / 3;
    return {};
  };
  SPLATVOL_TRY(for_each_group(format::SplatReader(volume, selection),
                              {.positions = true, .values = true, .material = true, .directions = true}, write_group,
                              [&](double done) { progress(0.25 + 0.75 * done); }));
  SPLATVOL_TRY(file.commit());
  report.file_bytes = vtu.bytes();
  report.renamed = vtu.renamed();
  return report;
}

}  // namespace splatvol
