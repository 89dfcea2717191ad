#include "tools/export/vtu_export.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/names.h"
#include "extractor/output_arrays.h"
#include "tools/export/vtu_file.h"

namespace splatvol {
namespace {

constexpr std::uint8_t vertex_type = 1;
constexpr std::uint64_t cells_at_once = std::uint64_t{1} << 16;

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

// The arrays of the file.
class PointArrays {
 public:
  PointArrays(const format::Volume& volume, const format::SplatSelection& selection)
      : selection_(selection), arrays_(output_arrays(volume.info(), selection)) {
    vtu_.add({.of = VtuArray::Of::points, .name = "Points", .components = 3});
    const format::VolumeInfo& info = volume.info();
    for (std::size_t i = 0; i < selection.attributes.size(); ++i) {
      attributes_.push_back(info.attributes[selection.attributes[i]]);
      attributes_.back().name = selection.names[i];
    }
    for (const OutputArray& array : arrays_) {
      vtu_.add({.name = array.name, .components = array.components(), .unit = array.unit});
      taken_.insert(escape_xml(array.name));
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
    cell_arrays_ = vtu_.add_cells();
  }

  // Writes all but the numbers of the points.
  Status start(AtomicFile& file, std::uint64_t points) {
    vtu_.set_counts({.points = points, .cells = points, .corners = points});
    SPLATVOL_TRY(vtu_.write_frame(file));
    return write_cells(file, points);
  }

  // Appends the points of a group that are in the box.
  void collect(const format::SplatGroup& group, Columns& columns, VtuReport& report) const {
    columns.resize(cell_arrays_);
    for (std::size_t i = 0; i < group.size(); ++i) {
      if (!is_inside(selection_.box, group.positions[i])) continue;
      report.mass += group.shapes[i].mass;
      auto column = columns.begin();
      append(*column++, group.positions[i]);
      for (const OutputArray& array : arrays_) {
        for (const std::size_t a : array.members)
          column->push_back(attributes_[a].value(static_cast<double>(group.values[a][i])));
        ++column;
      }
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
      SPLATVOL_TRY(vtu_.write(file, i, first, std::as_bytes(std::span(columns[i]))));
    return {};
  }

  [[nodiscard]] std::uint64_t bytes() const { return vtu_.bytes(); }
  [[nodiscard]] const std::map<std::string, std::string>& renamed() const { return renamed_; }

 private:
  // Adds an array of the material. Its name may be that of an attribute, which keeps it.
  void add_own(VtuArray array) {
    const std::string usual = array.name;
    array.name = free_name(usual, [&](const std::string& name) { return taken_.contains(escape_xml(name)); });
    taken_.insert(escape_xml(array.name));
    if (array.name != usual) renamed_.emplace(usual, array.name);
    vtu_.add(std::move(array));
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
      for (std::size_t k = 0; k < parts.size(); ++k) SPLATVOL_TRY(vtu_.write(file, cell_arrays_ + k, first, parts[k]));
    }
    return {};
  }

  const format::SplatSelection& selection_;
  std::vector<OutputArray> arrays_;  // of values
  std::vector<format::Attribute> attributes_;
  std::vector<bool> has_direction_;  // [attribute]
  VtuFile vtu_;
  std::size_t cell_arrays_;      // index of the first
  std::set<std::string> taken_;  // names of the points' arrays, as they are in the file
  std::map<std::string, std::string> renamed_;
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
  SPLATVOL_TRY(for_each_group(format::SplatReader(volume, selection, own_room(format::splat_reader_bytes)),
                              {.positions = true}, count_group, progress));
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
  SPLATVOL_TRY(check_vtu_names(volume.name(), names_of(output_arrays(volume.info(), selection))));
  PointArrays arrays(volume, selection);
  SPLATVOL_TRY_ASSIGN(points, count_points(volume, selection, [&](double done) { progress(done / 4); }));
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path, AtomicFile::Unnamed::if_possible, replace));
  SPLATVOL_TRY(arrays.start(file, points));
  VtuReport report;
  Columns columns;
  const auto write_group = [&](const format::SplatGroup& group) -> Status {
    columns.clear();
    arrays.collect(group, columns, report);
    SPLATVOL_TRY(arrays.write(file, columns, report.points));
    report.points += columns[0].size() / 3;
    return {};
  };
  SPLATVOL_TRY(for_each_group(format::SplatReader(volume, selection, own_room(format::splat_reader_bytes)),
                              {.positions = true, .values = true, .material = true, .directions = true}, write_group,
                              [&](double done) { progress(0.25 + 0.75 * done); }));
  SPLATVOL_TRY(file.commit());
  report.file_bytes = arrays.bytes();
  report.renamed = arrays.renamed();
  return report;
}

}  // namespace splatvol
