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

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <string_view>

#include "builder/sources/units.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

template <class T>
std::optional<T> number_of(std::string_view text) {
  T number{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc{} && end == text.data() + text.size() ? std::optional(number) : std::nullopt;
}

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
  fs::path folder = fs::path(path).parent_path();
  if (path.ends_with("system/controlDict")) folder = folder.parent_path();
  if (folder.empty()) folder = ".";
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
        fmt::format("the folder {} is of the collated format, which cannot be read: reconstruct the case "
                    "first (reconstructPar)",
                    collated));
  std::ranges::sort(numbers);
  std::vector<std::string> names;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] != static_cast<int>(i))
      throw ReaderError(fmt::format("the folder processor{} of the decomposed case is missing", i));
    names.push_back(fmt::format("processor{}", i));
  }
  return names;
}

void check_openfoam_time(ProcessorReader& reader, std::optional<double> time) {
  vtkDoubleArray* times = reader.GetTimeValues();
  if (!time || !times) return;
  for (vtkIdType i = 0; i < times->GetNumberOfTuples(); ++i)
    if (times->GetValue(i) == *time) return;
  throw ReaderError(fmt::format("a processor's folder has no time step {}, which others have", *time));
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
