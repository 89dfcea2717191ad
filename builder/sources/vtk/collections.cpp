#include "builder/sources/vtk/collections.h"

#include <vtkDataObject.h>
#include <vtkDataSet.h>
#include <vtkInformation.h>
#include <vtkInformationVector.h>
#include <vtkSmartPointer.h>
#include <vtkXMLReader.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <string_view>
#include <tuple>
#include <utility>

#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/block_readers.h"
#include "builder/sources/vtk/cell_counts.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/reader.h"
#include "builder/sources/vtk/xml_checks.h"
#include "builder/sources/vtk/xml_file.h"

namespace splatvol {
namespace {

using VisitElement = std::function<void(vtkXMLDataElement& element)>;

void visit_elements(vtkXMLDataElement& element, const VisitElement& visit) {
  visit(element);
  for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) visit_elements(*element.GetNestedElement(i), visit);
}

/// Visits all elements of a file in their order.
Status read_elements(const std::string& path, const VisitElement& visit) {
  SPLATVOL_TRY_ASSIGN(parser, parse_xml(path));
  return run_vtk(path, [&] { visit_elements(*parser->GetRootElement(), visit); });
}

bool is_data_set(vtkXMLDataElement& element) { return element.GetName() == std::string("DataSet"); }

std::string file_of(vtkXMLDataElement& element, const std::string& path) {
  const char* file = element.GetAttribute("file");
  return file && *file ? (std::filesystem::path(path).parent_path() / file).string() : std::string();
}

double number_of(vtkXMLDataElement& element, const char* name) {
  const char* text = element.GetAttribute(name);
  if (!text || !*text) return 0;
  const std::string whole(text);
  double number = 0;
  const auto [end, error] = std::from_chars(whole.data(), whole.data() + whole.size(), number);
  if (error != std::errc{} || end != whole.data() + whole.size() || !std::isfinite(number))
    throw ReaderError(fmt::format("{}=\"{}\" of a DataSet is not a number", name, whole.substr(0, 40)));
  return number;
}

/// The arrays that a file declares for its points, or for its cells.
std::vector<ArrayShape> declared_arrays(vtkXMLReader& reader, bool of_cells) {
  std::vector<ArrayShape> shapes;
  vtkInformationVector* arrays = reader.GetOutputInformation(0)->Get(of_cells ? vtkDataObject::CELL_DATA_VECTOR()
                                                                              : vtkDataObject::POINT_DATA_VECTOR());
  for (int i = 0; arrays && i < arrays->GetNumberOfInformationObjects(); ++i) {
    vtkInformation* array = arrays->GetInformationObject(i);
    const char* name = array->Get(vtkDataObject::FIELD_NAME());
    if (!name || is_ghost_array(name) || name == std::string_view("HigherOrderDegrees")) continue;
    if (array->Get(vtkDataObject::FIELD_ARRAY_TYPE()) == VTK_STRING) continue;
    shapes.push_back({name, std::max(1, array->Get(vtkDataObject::FIELD_NUMBER_OF_COMPONENTS())), of_cells});
  }
  return shapes;
}

/// Adds the arrays that a file declares. If a name is known already, the file's array counts as the same one, unless
/// its points and cells both have an array of this name.
void learn_declared(const VtkFile& file, std::vector<ArrayShape>& shapes) {
  auto reader = make_xml_reader(file.kind);
  if (!reader || file.kind == VtkFile::Kind::poly) return;
  reader->SetFileName(file.path.c_str());
  reader->UpdateInformation();
  for (const bool of_cells : {false, true}) {
    const std::vector<ArrayShape> others = declared_arrays(*reader, !of_cells);
    for (const ArrayShape& array : declared_arrays(*reader, of_cells)) {
      const bool both = std::ranges::find(others, array.name, &ArrayShape::name) != others.end();
      const bool known = std::ranges::any_of(shapes, [&](const ArrayShape& shape) {
        return shape.name == array.name && (shape.of_cells == of_cells || !both);
      });
      if (!known) shapes.push_back(array);
    }
  }
}

/// The blocks of a composite file.
class CompositeDataSets final : public VtkDataSets {
 public:
  CompositeDataSets(const VtkFile& composite, std::vector<std::string> selection, std::optional<double> time,
                    CellValues cells, const MissingValues& missing)
      : path_(composite.path),
        files_(composite.blocks),
        selection_(std::move(selection)),
        cells_(cells),
        blocks_(read_vtk_files(composite.blocks, selection_, time, cells, missing)) {}

  std::size_t count() const override { return blocks_->count(); }
  const std::string& path() const override { return blocks_->path().empty() ? path_ : blocks_->path(); }
  std::string unit(const std::string& array) const override { return blocks_->unit(array); }
  CellCensus left_out() const override {
    CellCensus all = left_out_;
    all += blocks_->left_out();
    return all;
  }
  void share_means(vtkDataSet& data, const std::string& array, int component, std::span<double> means) const override {
    blocks_->share_means(data, array, component, means);
  }

  CellCensus take_changes() override { return blocks_->take_changes(); }
  bool averages_by_data_set() const override { return blocks_->averages_by_data_set(); }

  Result<vtkSmartPointer<vtkDataSet>> next() override {
    if (!learnt_) SPLATVOL_TRY(learn());
    for (;;) {
      SPLATVOL_TRY_ASSIGN(data, blocks_->next());
      if (!data) return data;
      bool used = false;
      SPLATVOL_TRY(run_vtk(path(), [&] {
        used = data->GetNumberOfPoints() > 0 && !is_surface(*data);
        if (!used) left_out_ += census_of(*data);
        if (used) add_missing(*data, shapes_, cells_);
      }));
      if (used) return data;
    }
  }

 private:
  Status learn() {
    learnt_ = true;
    for (const VtkFile& file : files_) {
      if (!make_xml_reader(file.kind)) continue;
      SPLATVOL_TRY(check_xml(file.path));
      SPLATVOL_TRY(run_vtk(file.path, [&] { learn_declared(file, shapes_); }));
    }
    std::erase_if(shapes_, [&](const ArrayShape& shape) { return !wants_array(selection_, shape.name); });
    return {};
  }

  std::string path_;
  std::vector<VtkFile> files_;
  std::vector<std::string> selection_;
  CellValues cells_;
  std::unique_ptr<VtkDataSets> blocks_;
  std::vector<ArrayShape> shapes_;  // of the blocks with a volume, as far as their headers tell
  CellCensus left_out_;
  bool learnt_ = false;
};

}  // namespace

Result<std::vector<CollectionStep>> pvd_steps(const std::string& path) {
  std::vector<std::tuple<double, double, std::string>> entries;  // time, part, file
  SPLATVOL_TRY(read_elements(path, [&](vtkXMLDataElement& element) {
    if (!is_data_set(element)) return;
    const std::string file = file_of(element, path);
    if (file.empty()) throw ReaderError("a DataSet names no file");
    entries.emplace_back(number_of(element, "timestep"), number_of(element, "part"), file);
  }));
  if (entries.empty()) return fail(ErrorCode::invalid_data, "{}: names no files", path);
  std::ranges::stable_sort(entries, {},
                           [](const auto& entry) { return std::pair(std::get<0>(entry), std::get<1>(entry)); });
  std::vector<CollectionStep> steps;
  for (const auto& [time, part, file] : entries) {
    if (steps.empty() || steps.back().time != time) steps.push_back({time, {}});
    steps.back().files.push_back(file);
  }
  return steps;
}

Result<std::vector<std::string>> block_files(const std::string& path) {
  std::vector<std::string> files;
  SPLATVOL_TRY(read_elements(path, [&](vtkXMLDataElement& element) {
    const std::string file = is_data_set(element) ? file_of(element, path) : std::string();
    if (!file.empty()) files.push_back(file);  // an empty block has no file
  }));
  if (files.empty()) return fail(ErrorCode::invalid_data, "{}: names no files", path);
  return files;
}

std::unique_ptr<VtkDataSets> read_composite(const VtkFile& composite, std::vector<std::string> selection,
                                            std::optional<double> time, CellValues cells,
                                            const MissingValues& missing) {
  return std::make_unique<CompositeDataSets>(composite, std::move(selection), time, cells, missing);
}

}  // namespace splatvol
