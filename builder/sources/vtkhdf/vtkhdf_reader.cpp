#include "builder/sources/vtkhdf/vtkhdf_reader.h"

#include <fmt/format.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDoubleArray.h>
#include <vtkIdTypeArray.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <set>
#include <utility>

#include "base/printable.h"
#include "builder/sources/hdf5/hdf5_checks.h"
#include "builder/sources/hdf5/netcdf_checks.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/data_set.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

[[noreturn]] void fail_array(const std::string& name) {
  throw ReaderError("the array \"{}\" is missing, damaged or too short", name);
}

/// A packed array cannot be smaller than this share of its numbers: deflate packs 1032 times at most.
constexpr std::uint64_t most_packing = 1100;

/// A group of an HDF5 file. All functions throw a ReaderError if something is not there or damaged. Not thread-safe.
class Hdf5Group {
 public:
  Hdf5Group(const std::string& path, const std::string& group)
      : file_(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose),
        group_(file_.is_open() ? H5Gopen2(file_.id(), group.c_str(), H5P_DEFAULT) : -1, H5Gclose) {
    if (!file_.is_open()) throw ReaderError("damaged, cut off, or not an HDF5 file");
    if (!group_.is_open()) throw ReaderError("not a VTKHDF file: it has no group {}", group);
  }

  /// Whether there is an object of this name, such as "PointData/p".
  [[nodiscard]] bool has(const std::string& name) const {
    for (std::size_t at = name.find('/'); at != std::string::npos; at = name.find('/', at + 1))
      if (H5Lexists(group_.id(), name.substr(0, at).c_str(), H5P_DEFAULT) <= 0) return false;
    return H5Lexists(group_.id(), name.c_str(), H5P_DEFAULT) > 0;
  }

  /// The names of all that is in a group; none if there is no such group.
  [[nodiscard]] std::vector<std::string> names_in(const std::string& group) const {
    std::vector<std::string> names;
    if (!has(group)) return names;
    const Hdf5Handle opened(H5Gopen2(group_.id(), group.c_str(), H5P_DEFAULT), H5Gclose);
    H5G_info_t info{};
    if (!opened.is_open() || H5Gget_info(opened.id(), &info) < 0) fail_array(group);
    for (hsize_t i = 0; i < info.nlinks; ++i) {
      std::array<char, 1024> name{};
      if (H5Lget_name_by_idx(opened.id(), ".", H5_INDEX_NAME, H5_ITER_INC, i, name.data(), name.size(), H5P_DEFAULT) <
          0)
        fail_array(group);
      names.emplace_back(name.data());
    }
    return names;
  }

  /// Whether an array holds numbers: not texts. Throws if its link leads nowhere, or if it holds something else.
  [[nodiscard]] bool holds_numbers(const std::string& array) const {
    return splatvol::holds_numbers(Hdf5Handle(H5Oopen(group_.id(), array.c_str(), H5P_DEFAULT), H5Oclose), array);
  }

  /// Attributes of the group itself, or of a group in it.
  [[nodiscard]] bool has_attribute(const std::string& name, const std::string& group = ".") const {
    return H5Aexists_by_name(group_.id(), group.c_str(), name.c_str(), H5P_DEFAULT) > 0;
  }

  [[nodiscard]] std::vector<double> attribute(const std::string& name, const std::string& group = ".") const {
    const Hdf5Handle attribute(H5Aopen_by_name(group_.id(), group.c_str(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT),
                               H5Aclose);
    if (!attribute.is_open()) throw ReaderError("the attribute {} is missing", name);
    const Hdf5Handle space(H5Aget_space(attribute.id()), H5Sclose);
    const hssize_t count = H5Sget_simple_extent_npoints(space.id());
    if (count < 1 || count > 64) throw ReaderError("the attribute {} is damaged", name);
    std::vector<double> numbers(static_cast<std::size_t>(count));
    if (H5Aread(attribute.id(), H5T_NATIVE_DOUBLE, numbers.data()) < 0)
      throw ReaderError("the attribute {} is damaged", name);
    return numbers;
  }

  [[nodiscard]] std::string text_attribute(const std::string& name) const {
    const Hdf5Handle attribute(H5Aopen(group_.id(), name.c_str(), H5P_DEFAULT), H5Aclose);
    if (!attribute.is_open()) throw ReaderError("the attribute {} is missing", name);
    const Hdf5Handle type(H5Aget_type(attribute.id()), H5Tclose);
    if (H5Tget_class(type.id()) != H5T_STRING) throw ReaderError("the attribute {} is no text", name);
    if (H5Tis_variable_str(type.id()) > 0) {
      char* text = nullptr;
      if (H5Aread(attribute.id(), type.id(), static_cast<void*>(&text)) < 0 || !text)
        throw ReaderError("the attribute {} is damaged", name);
      std::string copy(text);
      H5free_memory(text);
      return copy;
    }
    std::string text(std::min<std::size_t>(H5Tget_size(type.id()), 4096), '\0');
    if (H5Tget_size(type.id()) > text.size() || H5Aread(attribute.id(), type.id(), text.data()) < 0)
      throw ReaderError("the attribute {} is damaged", name);
    return text.substr(0, text.find('\0'));
  }

  /// The extents of an array, the slowest first.
  [[nodiscard]] std::vector<std::uint64_t> shape(const std::string& array) const {
    if (!has(array)) fail_array(array);
    const Hdf5Handle opened(H5Dopen2(group_.id(), array.c_str(), H5P_DEFAULT), H5Dclose);
    const Hdf5Handle space(opened.is_open() ? H5Dget_space(opened.id()) : -1, H5Sclose);
    const int rank = space.is_open() ? H5Sget_simple_extent_ndims(space.id()) : 0;
    if (rank < 1 || rank > 8) fail_array(array);
    std::vector<hsize_t> extents(static_cast<std::size_t>(rank));
    H5Sget_simple_extent_dims(space.id(), extents.data(), nullptr);
    return {extents.begin(), extents.end()};
  }

  /// Reads the rows [first, first + count) of an array, the numbers of a row side by side.
  [[nodiscard]] std::vector<double> doubles(const std::string& array, std::uint64_t first, std::uint64_t count) const {
    return read<double>(array, first, count, H5T_NATIVE_DOUBLE);
  }

  [[nodiscard]] std::vector<std::int64_t> integers(const std::string& array, std::uint64_t first,
                                                   std::uint64_t count) const {
    return read<std::int64_t>(array, first, count, H5T_NATIVE_INT64);
  }

 private:
  template <class T>
  std::vector<T> read(const std::string& array, std::uint64_t first, std::uint64_t count, std::int64_t type) const {
    const std::vector<std::uint64_t> extents = shape(array);
    if (count > extents[0] || first > extents[0] - count) fail_array(array);
    const Hdf5Handle opened(H5Dopen2(group_.id(), array.c_str(), H5P_DEFAULT), H5Dclose);
    const Hdf5Handle space(H5Dget_space(opened.id()), H5Sclose);
    if (checked_.insert(array).second) check_values(opened.id(), array);

    // Numbers that the file cannot hold are not allocated for.
    std::uint64_t left = H5Dget_storage_size(opened.id()) * most_packing, numbers = count;
    for (std::size_t axis = 0; axis < extents.size(); ++axis) {
      const std::uint64_t extent = axis == 0 ? count : extents[axis];
      if (extent != 0 && left / extent == 0) fail_array(array);
      left = extent == 0 ? left : left / extent;
      numbers = axis == 0 ? count : numbers * extent;
    }
    std::vector<T> values(numbers);
    if (numbers == 0) return values;
    std::vector<hsize_t> start(extents.size()), counts(extents.begin(), extents.end());
    start[0] = first;
    counts[0] = count;
    const Hdf5Handle memory(H5Screate_simple(static_cast<int>(counts.size()), counts.data(), nullptr), H5Sclose);
    if (H5Sselect_hyperslab(space.id(), H5S_SELECT_SET, start.data(), nullptr, counts.data(), nullptr) < 0 ||
        H5Dread(opened.id(), type, memory.id(), space.id(), H5P_DEFAULT, values.data()) < 0)
      fail_array(array);
    return values;
  }

  Hdf5Handle file_, group_;
  mutable std::set<std::string> checked_;  // arrays whose values are there
};

/// Where a partition's points, cells and connectivity begin in the arrays of the file, and how many there are.
struct Partition {
  std::uint64_t number = 0;  // in the file
  std::uint64_t points = 0, cells = 0, ids = 0;
  std::uint64_t first_point = 0, first_cell = 0, first_id = 0;
  std::uint64_t points_before = 0, cells_before = 0;  // in its time step
};

std::uint64_t not_negative(std::int64_t number) {
  if (number < 0 || number > std::numeric_limits<std::int64_t>::max() / 16)
    throw ReaderError("a count or an offset is out of range");
  return static_cast<std::uint64_t>(number);
}

constexpr std::uint64_t most_components = 1024;

/// Reads the data sets of one time step.
class HdfFile {
 public:
  HdfFile(const std::string& path, const std::vector<std::string>& selection, std::optional<double> time)
      : selection_(selection), group_(path, "/VTKHDF") {
    if (group_.attribute("Version")[0] > 2) throw ReaderError("a VTKHDF version above 2, which cannot be read");
    type_ = group_.text_attribute("Type");
    if (type_ != "UnstructuredGrid" && type_ != "ImageData")
      throw ReaderError(
          "a VTKHDF file of type \"{}\"; only UnstructuredGrid and ImageData can be read: open it in ParaView, "
          "and save the data as .vtm",
          type_.substr(0, 40));
    if (group_.has("Steps")) choose_step(time);
    if (type_ == "UnstructuredGrid") find_partitions();
  }

  [[nodiscard]] std::optional<TimeStep> step() const { return step_; }
  [[nodiscard]] std::size_t count() const { return type_ == "ImageData" ? 1 : partitions_.size(); }

  /// The arrays of all partitions, without those that read() leaves out.
  [[nodiscard]] std::vector<ArrayShape> arrays() const {
    std::vector<ArrayShape> shapes;
    for (const bool of_cells : {false, true}) {
      const std::string data = of_cells ? "CellData" : "PointData";
      for (const std::string& name : wanted_in(data)) {
        if (is_bookkeeping(name)) continue;
        const std::uint64_t components = components_of(data, name);
        if (components > 0 && components <= most_components)
          shapes.push_back({as_utf8(name), static_cast<int>(components), of_cells});
      }
    }
    return shapes;
  }

  [[nodiscard]] vtkSmartPointer<vtkDataSet> read(std::size_t index) const {
    return type_ == "ImageData" ? read_image() : read_partition(partitions_[index]);
  }

 private:
  void choose_step(std::optional<double> time) {
    const std::vector<std::uint64_t> shape = group_.shape("Steps/Values");
    const std::vector<double> times = group_.doubles("Steps/Values", 0, shape[0]);
    if (times.empty()) throw ReaderError("no time steps in it");
    step_ = splatvol::choose_step(times, time);
  }

  /// An offset of the time step; 0 if the file has no such offsets.
  [[nodiscard]] std::uint64_t offset(const std::string& name) const {
    if (!step_ || !group_.has("Steps/" + name)) return 0;
    return not_negative(group_.integers("Steps/" + name, step_->index, 1).at(0));
  }

  void find_partitions() {
    const std::uint64_t all = group_.shape("NumberOfPoints")[0];
    const std::uint64_t first = offset("PartOffsets");
    const bool counted = step_ && group_.has("Steps/NumberOfParts");
    const std::uint64_t count = counted ? offset("NumberOfParts") : step_ ? 1 : all;
    const auto points = group_.integers("NumberOfPoints", first, count);
    const auto cells = group_.integers("NumberOfCells", first, count);
    const auto ids = group_.integers("NumberOfConnectivityIds", first, count);
    Partition next{.first_point = offset("PointOffsets"),
                   .first_cell = offset("CellOffsets"),
                   .first_id = offset("ConnectivityIdOffsets")};
    for (std::size_t i = 0; i < points.size(); ++i) {
      next.number = first + i;
      next.points = not_negative(points[i]);
      next.cells = not_negative(cells.at(i));
      next.ids = not_negative(ids.at(i));
      partitions_.push_back(next);
      next.first_point += next.points;
      next.first_cell += next.cells;
      next.first_id += next.ids;
      next.points_before += next.points;
      next.cells_before += next.cells;
    }
  }

  [[nodiscard]] vtkSmartPointer<vtkDataSet> read_partition(const Partition& part) const {
    auto grid = vtkSmartPointer<vtkUnstructuredGrid>::New();
    const std::vector<double> coordinates = group_.doubles("Points", part.first_point, part.points);
    if (coordinates.size() != 3 * part.points) throw ReaderError("its points have no three coordinates");
    const vtkNew<vtkPoints> points;
    points->SetDataTypeToDouble();
    points->SetNumberOfPoints(static_cast<vtkIdType>(part.points));
    for (std::size_t i = 0; i < part.points; ++i) points->SetPoint(static_cast<vtkIdType>(i), &coordinates[3 * i]);
    grid->SetPoints(points);
    read_cells(part, *grid);
    read_arrays("PointData", *grid->GetPointData(), part.points_before, part.first_point, part.points);
    read_arrays("CellData", *grid->GetCellData(), part.cells_before, part.first_cell, part.cells);
    return grid;
  }

  void read_cells(const Partition& part, vtkUnstructuredGrid& grid) const {
    if (part.cells == 0) return;
    // Each partition has one offset more than cells.
    const auto offsets = group_.integers("Offsets", part.first_cell + part.number, part.cells + 1);
    const auto ids = group_.integers("Connectivity", part.first_id, part.ids);
    const auto types = group_.integers("Types", part.first_cell, part.cells);
    const bool ordered = offsets.front() == 0 && std::ranges::is_sorted(offsets) &&
                         static_cast<std::uint64_t>(offsets.back()) == part.ids;
    if (!ordered) throw ReaderError("the offsets of its cells are damaged");
    if (std::ranges::find(types, VTK_POLYHEDRON) != types.end())
      throw ReaderError("polyhedra in VTKHDF files cannot be read: save it as .vtu");
    const vtkNew<vtkIdTypeArray> vtk_offsets, vtk_ids;
    const vtkNew<vtkUnsignedCharArray> vtk_types;
    for (const std::int64_t offset : offsets) vtk_offsets->InsertNextValue(offset);
    for (const std::int64_t id : ids) vtk_ids->InsertNextValue(id);
    for (const std::int64_t type : types) {
      if (type < 0 || type > 255) throw ReaderError("the type of a cell is out of range");
      vtk_types->InsertNextValue(static_cast<unsigned char>(type));
    }
    const vtkNew<vtkCellArray> cells;
    cells->SetData(vtk_offsets, vtk_ids);
    grid.SetCells(vtk_types, cells);
  }

  /// The arrays of numbers in a group that are to be read.
  [[nodiscard]] std::vector<std::string> wanted_in(const std::string& data) const {
    std::vector<std::string> names = group_.names_in(data);
    std::erase_if(names, [&](const std::string& name) {
      const bool wanted = is_ghost_array(name) || wants_array(selection_, as_utf8(name));
      return !wanted || !group_.holds_numbers(fmt::format("{}/{}", data, name));
    });
    return names;
  }

  [[nodiscard]] std::uint64_t components_of(const std::string& data, const std::string& name) const {
    const auto shape = group_.shape(fmt::format("{}/{}", data, name));
    const bool timed = step_ && shape.size() >= 4 &&
                       (group_.has(fmt::format("Steps/{}Offsets/{}", data, name)) || shape[0] == step_->times.size());
    std::uint64_t components = 1;
    for (std::size_t axis = type_ != "ImageData" ? 1 : timed ? 4 : 3; axis < shape.size(); ++axis)
      components = std::min(components * std::min(shape[axis], most_components + 1), most_components + 1);
    return components;
  }

  /// Reads the arrays of a partition. `before`: its rows before it in the time step; `first`: in the file.
  void read_arrays(const std::string& data, vtkDataSetAttributes& to, std::uint64_t before, std::uint64_t first,
                   std::uint64_t count) const {
    for (const std::string& name : wanted_in(data)) {
      const std::string own_offsets = fmt::format("{}Offsets/{}", data, name);
      const bool own = step_ && group_.has("Steps/" + own_offsets);
      const auto values =
          group_.doubles(fmt::format("{}/{}", data, name), own ? offset(own_offsets) + before : first, count);
      add_array(name, values, count, to);
    }
  }

  static void add_array(const std::string& name, const std::vector<double>& values, std::uint64_t count,
                        vtkDataSetAttributes& to) {
    if (count == 0) return;
    if (values.size() / count > most_components)
      throw ReaderError("the array \"{}\" has more than {} components", name, most_components);
    const auto components = static_cast<int>(values.size() / count);
    vtkSmartPointer<vtkDataArray> array = vtkSmartPointer<vtkDoubleArray>::New();
    if (is_ghost_array(name)) array = vtkSmartPointer<vtkUnsignedCharArray>::New();
    array->SetName(as_utf8(name).c_str());
    array->SetNumberOfComponents(components);
    array->SetNumberOfTuples(static_cast<vtkIdType>(count));
    for (std::size_t i = 0; i < values.size(); ++i)
      array->SetComponent(static_cast<vtkIdType>(i) / components, static_cast<int>(i) % components, values[i]);
    to.AddArray(array);
  }

  [[nodiscard]] std::vector<double> attribute(const std::string& name, std::size_t count) const {
    std::vector<double> numbers = group_.attribute(name);
    if (numbers.size() != count) throw ReaderError("the attribute {} is damaged", name);
    return numbers;
  }

  [[nodiscard]] vtkSmartPointer<vtkDataSet> read_image() const {
    auto image = vtkSmartPointer<vtkImageData>::New();
    std::array<int, 6> extent{};
    const std::vector<double> numbers = attribute("WholeExtent", 6);
    std::array<std::uint64_t, 3> points{};
    for (std::size_t i = 0; i < 6; ++i) extent[i] = static_cast<int>(std::clamp(numbers[i], -1e9, 1e9));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (extent[2 * axis + 1] < extent[2 * axis]) throw ReaderError("the attribute WholeExtent is damaged");
      points[axis] =
          static_cast<std::uint64_t>(extent[2 * axis + 1]) - static_cast<std::uint64_t>(extent[2 * axis]) + 1;
    }
    image->SetOrigin(attribute("Origin", 3).data());
    image->SetSpacing(attribute("Spacing", 3).data());
    if (group_.has_attribute("Direction")) image->SetDirectionMatrix(attribute("Direction", 9).data());
    read_image_arrays("PointData", points, *image->GetPointData());
    for (std::uint64_t& count : points) count = std::max<std::uint64_t>(count, 2) - 1;
    read_image_arrays("CellData", points, *image->GetCellData());
    image->SetExtent(extent.data());
    return image;
  }

  void read_image_arrays(const std::string& data, const std::array<std::uint64_t, 3>& counts,
                         vtkDataSetAttributes& to) const {
    for (const std::string& name : wanted_in(data)) {
      std::vector<std::uint64_t> shape = group_.shape(fmt::format("{}/{}", data, name));
      const std::string own_offsets = fmt::format("{}Offsets/{}", data, name);
      const bool own = step_ && group_.has("Steps/" + own_offsets);
      std::uint64_t first = 0, rows = shape[0];
      if (step_ && shape.size() >= 4 && (own || shape[0] == step_->times.size())) {  // the first axis is time
        first = own ? offset(own_offsets) : step_->index;
        rows = 1;
        shape.erase(shape.begin());
      }
      const bool fits = shape.size() >= 3 && shape[0] == counts[2] && shape[1] == counts[1] && shape[2] == counts[0];
      if (!fits) throw ReaderError("the array \"{}\" is not of the extent of the image", name);
      add_array(name, group_.doubles(fmt::format("{}/{}", data, name), first, rows), counts[0] * counts[1] * counts[2],
                to);
    }
  }

  const std::vector<std::string>& selection_;
  Hdf5Group group_;
  std::string type_;
  std::optional<TimeStep> step_;
  std::vector<Partition> partitions_;
};

class HdfDataSets final : public DataSets {
 public:
  HdfDataSets(std::string path, std::vector<std::string> selection)
      : path_(std::move(path)), selection_(std::move(selection)) {}

  Status open(std::optional<double> time) {
    SPLATVOL_TRY(check_file_end(path_));
    return run_vtk(path_, [&] {
      H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // keeps the library from printing its errors
      file_ = std::make_unique<HdfFile>(path_, selection_, time);
      if (file_->count() == 0) throw ReaderError("no partitions in it");
    });
  }

  std::size_t count() const override { return file_->count(); }
  const std::string& path() const override { return path_; }
  std::optional<TimeStep> time_step() const override { return file_->step(); }

  Status announce(ArrayUnion& arrays) override {
    std::vector<ArrayShape> shapes;
    SPLATVOL_TRY(run_vtk(path_, [&] { shapes = file_->arrays(); }));
    return arrays.add(path_, shapes);
  }

  Result<std::unique_ptr<DataSet>> next() override {
    std::unique_ptr<DataSet> data;
    if (next_ == file_->count()) return data;
    SPLATVOL_TRY(run_vtk(path_, [&] {
      data = data_set_of(*file_->read(next_++));
      declared_.part = file_->count() > 1 ? fmt::format("partition {}", next_) : std::string();
      declared_.arrays = file_->arrays();
      if (data->cell_count() == 0)
        std::erase_if(declared_.arrays, [](const ArrayShape& shape) { return *shape.of_cells; });
    }));
    return data;
  }
  DeclaredArrays declared() const override { return declared_; }

 private:
  std::string path_;
  std::vector<std::string> selection_;
  std::unique_ptr<HdfFile> file_;
  std::size_t next_ = 0;
  DeclaredArrays declared_;  // for the last data set
};

}  // namespace

Result<std::unique_ptr<DataSets>> open_vtkhdf(const InputFile& file, const SourceOptions& options) {
  forbid_hdf5_plugins();
  auto data_sets = std::make_unique<HdfDataSets>(file.path, options.selection);
  SPLATVOL_TRY(data_sets->open(options.time));
  return data_sets;
}

}  // namespace splatvol
