#include "builder/sources/vtk/openfoam_reader.h"

#include <fmt/format.h>
#include <vtkCellData.h>
#include <vtkCollection.h>
#include <vtkCompositeDataIterator.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkObjectFactory.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtk_zlib.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <sstream>
#include <string_view>
#include <utility>

#include "builder/sources/read_text.h"
#include "builder/sources/units.h"
#include "builder/sources/vtk/finer_numbers.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> folders_in(const fs::path& path) {
  std::vector<std::string> names;
  std::error_code error, ignored;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error))
    if (entry->is_directory(ignored)) names.push_back(entry->path().filename());
  return names;
}

/// Whether a folder of time steps has a mesh, or one of its regions has one.
bool has_mesh(const fs::path& path) {
  std::error_code error;
  if (fs::exists(path / "polyMesh", error)) return true;
  return std::ranges::any_of(folders_in(path),
                             [&](const std::string& region) { return fs::exists(path / region / "polyMesh", error); });
}

/// The folder of a case. `path`: system/controlDict, or a file in the folder.
fs::path case_folder(const std::string& path) {
  fs::path folder = fs::path(path).parent_path();
  if (path.ends_with("system/controlDict")) folder = folder.parent_path();
  return folder.empty() ? "." : folder;
}

/// The folders of a case's processors; of none: the case's own.
std::vector<fs::path> parts_of(const std::string& path, const std::vector<std::string>& processors) {
  std::vector<fs::path> parts;
  for (const std::string& processor : processors) parts.push_back(case_folder(path) / processor);
  if (parts.empty()) parts.push_back(case_folder(path));
  return parts;
}

/// The beginning of a file, which may be packed by gzip; empty if there is no such file.
std::string unpacked_start(const fs::path& path) {
  constexpr std::size_t most = std::size_t{16} << 20, portion = std::size_t{1} << 16;
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), gzclose);
  std::string text;
  for (int read = 1; file && read > 0 && text.size() < most;) {
    const std::size_t before = text.size();
    text.resize(before + portion);
    read = gzread(file.get(), text.data() + before, portion);
    text.resize(before + static_cast<std::size_t>(std::max(read, 0)));
  }
  return text;
}

/// Whether the points in a folder of a mesh have more digits than single precision. Binary files tell the bytes of a
/// number, or have 8.
bool has_finer_points(const fs::path& mesh) {
  for (const char* name : {"points", "points.gz"}) {
    const std::string text = unpacked_start(mesh / "polyMesh" / name);
    const std::string_view head = std::string_view(text).substr(0, text.find('}'));
    const bool binary = head.find("binary") != std::string_view::npos;
    const bool finer = binary ? head.find("scalar=32") == std::string_view::npos : has_finer_number(text);
    if (finer && !text.empty()) return true;
  }
  return false;
}

/// Whether a region has a mesh, of all times or of this one. The region of no name is the case's own.
bool has_mesh_of(const fs::path& path, const std::string& step, const std::string& region) {
  std::error_code error;
  return fs::exists(path / "constant" / region / "polyMesh", error) ||
         fs::exists(path / step / region / "polyMesh", error);
}

/// The time of the last step in a folder; none if there is no step.
std::optional<double> last_time(const fs::path& path) {
  std::optional<double> last;
  for (const std::string& name : folders_in(path))
    if (const auto time = number_of<double>(name); time && (!last || *time > *last)) last = time;
  return last;
}

/// Whether the case itself holds all that its processors hold. `processor`: one of their folders.
bool is_reconstructed(const fs::path& path, const std::string& processor) {
  const std::vector<std::string> folders = folders_in(path);
  const bool mesh = has_mesh(path / "constant") || std::ranges::any_of(folders, [&](const std::string& name) {
                      return number_of<double>(name) && has_mesh(path / name);
                    });
  const auto own = last_time(path), of_processor = last_time(path / processor);
  return mesh && (!of_processor || (own && *own >= *of_processor));
}

/// Cuts the units off the names of the arrays.
void take_units(vtkDataSetAttributes& arrays, std::map<std::string, std::string>& units) {
  for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
    vtkAbstractArray* array = arrays.GetAbstractArray(i);
    if (!array->GetName()) continue;
    std::string name = array->GetName();
    const std::string unit = cut_unit(name);
    array->SetName(name.c_str());
    if (!unit.empty()) units.emplace(name, unit_of_openfoam(unit));
  }
}

/// The components of a field of a class such as "volVectorField", and whether it is of cells; none if it is no field.
std::optional<std::pair<int, bool>> field_of(std::string_view name) {
  const bool of_cells = name.starts_with("vol");
  if (!of_cells && !name.starts_with("point")) return std::nullopt;
  const std::string_view kind = name.substr(of_cells ? 3 : 5);
  if (is_one_of(kind, {"ScalarField", "SphericalTensorField"})) return std::pair(1, of_cells);
  const int components = kind == "VectorField" ? 3 : kind == "SymmTensorField" ? 6 : kind == "TensorField" ? 9 : 0;
  return components > 0 ? std::optional(std::pair(components, of_cells)) : std::nullopt;
}

/// The class that a file's header states; empty if there is none.
std::string class_of(const fs::path& path) {
  constexpr std::uint64_t header_bytes = 4096;
  const auto text = read_text(path, header_bytes);
  const std::size_t at = text ? text->find("FoamFile") : std::string::npos;
  if (at == std::string::npos) return {};
  std::istringstream words(text->substr(at));
  for (std::string word; words >> word && word != "}";)
    if (word == "class" && words >> word) return word.substr(0, word.find(';'));
  return {};
}

/// Adds the fields whose files are in a folder.
void add_fields(const fs::path& folder, std::vector<ArrayShape>& shapes) {
  std::error_code error, ignored;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (!entry->is_regular_file(ignored)) continue;
    const std::string name = entry->path().filename();
    const auto field = field_of(class_of(entry->path()));
    if (field && std::ranges::find(shapes, name, &ArrayShape::name) == shapes.end())
      shapes.push_back({name, field->first, field->second});
  }
}

}  // namespace

vtkStandardNewMacro(ProcessorReader);

void ProcessorReader::set_processor(const std::string& folder) {
  if (folder == folder_) return;
  folder_ = folder;
  is_new_ = true;
  this->Modified();
}

int ProcessorReader::RequestInformation(vtkInformation* request, vtkInformationVector** inputs,
                                        vtkInformationVector* outputs) {
  if (folder_.empty()) return this->Superclass::RequestInformation(request, inputs, outputs);
  if (!is_new_) return 1;
  this->NumberOfReaders = 0;
  if (!this->MakeInformationVector(outputs, folder_) || !this->MakeMetaDataAtTimeStep(true)) return 0;
  this->Refresh = false;
  is_new_ = false;
  return 1;
}

std::vector<std::string> find_processors(const std::string& path) {
  const fs::path folder = case_folder(path);
  std::vector<int> numbers;
  std::string collated, any;
  for (const std::string& name : folders_in(folder)) {
    constexpr std::string_view start = "processor";
    if (!name.starts_with(start)) continue;
    const auto number = number_of<int>(std::string_view(name).substr(start.size()));
    if (number) numbers.push_back(*number);
    if (!number && name.starts_with("processors")) collated = name;
    if (number || !collated.empty()) any = name;
  }
  if (any.empty() || is_reconstructed(folder, any)) return {};
  if (numbers.empty())
    throw ReaderError(
        "the folder {} is of the collated format, which cannot be read: reconstruct the case "
        "first (reconstructPar)",
        collated);
  std::ranges::sort(numbers);
  std::vector<std::string> names;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] != static_cast<int>(i))
      throw ReaderError("the folder processor{} of the decomposed case is missing", i);
    names.push_back(fmt::format("processor{}", i));
  }
  return names;
}

bool has_finer_openfoam_points(const std::string& path, const std::vector<std::string>& processors) {
  for (const fs::path& part : parts_of(path, processors))
    for (const std::string& name : folders_in(part)) {
      if (name != "constant" && !number_of<double>(name)) continue;
      if (has_finer_points(part / name)) return true;
      for (const std::string& region : folders_in(part / name))
        if (has_finer_points(part / name / region)) return true;
    }
  return false;
}

void check_openfoam_time(ProcessorReader& reader, std::optional<double> time) {
  vtkDoubleArray* times = reader.GetTimeValues();
  if (!time || !times) return;
  for (vtkIdType i = 0; i < times->GetNumberOfTuples(); ++i)
    if (times->GetValue(i) == *time) return;
  throw ReaderError("a processor's folder has no time step {}, which others have", *time);
}

std::vector<ArrayShape> openfoam_arrays(const std::string& path, const std::vector<std::string>& processors,
                                        double time) {
  std::vector<ArrayShape> shapes;
  for (const fs::path& mesh : parts_of(path, processors))
    for (const std::string& step : folders_in(mesh)) {
      if (number_of<double>(step) != time) continue;
      if (has_mesh_of(mesh, step, "")) add_fields(mesh / step, shapes);
      for (const std::string& region : folders_in(mesh / step))
        if (has_mesh_of(mesh, step, region)) add_fields(mesh / step / region, shapes);
    }
  std::ranges::sort(shapes, {}, &ArrayShape::name);  // folders have no order
  return shapes;
}

void take_openfoam_units(ProcessorReader& reader, std::map<std::string, std::string>& units) {
  vtkMultiBlockDataSet* tree = reader.GetOutput();
  if (!tree) return;
  const auto entry = vtkSmartPointer<vtkCompositeDataIterator>::Take(tree->NewIterator());
  for (entry->InitTraversal(); !entry->IsDoneWithTraversal(); entry->GoToNextItem())
    if (auto* data = vtkDataSet::SafeDownCast(entry->GetCurrentDataObject())) {
      take_units(*data->GetPointData(), units);
      take_units(*data->GetCellData(), units);
    }
}

}  // namespace splatvol
