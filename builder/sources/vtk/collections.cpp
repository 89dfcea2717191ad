#include "builder/sources/vtk/collections.h"

#include <fmt/format.h>
#include <vtkDataSet.h>
#include <vtkSmartPointer.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <functional>
#include <tuple>
#include <utility>

#include "builder/sources/vtk/cell_counts.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/reader.h"
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

std::vector<VtkFile> as_blocks(std::vector<VtkFile> files) {
  for (VtkFile& file : files) file.is_block = true;
  return files;
}

/// The blocks of a composite file.
class CompositeDataSets final : public VtkDataSets {
 public:
  CompositeDataSets(const VtkFile& composite, std::vector<std::string> selection, std::optional<double> time,
                    CellValues cells, const MissingValues& missing)
      : path_(composite.path),
        blocks_(read_vtk_files(as_blocks(composite.blocks), std::move(selection), time, cells, missing)) {}

  std::size_t count() const override { return blocks_->count(); }
  const std::string& path() const override { return blocks_->path().empty() ? path_ : blocks_->path(); }
  std::string unit(const std::string& array) const override { return blocks_->unit(array); }
  Status announce(ArrayUnion& arrays) override { return blocks_->announce(arrays); }
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
  bool rounds_points() const override { return blocks_->rounds_points(); }
  Result<bool> has_finer_points() override { return blocks_->has_finer_points(); }

  Result<vtkSmartPointer<vtkDataSet>> next() override {
    for (;;) {
      SPLATVOL_TRY_ASSIGN(data, blocks_->next());
      if (!data) return data;
      bool used = false;
      SPLATVOL_TRY(run_vtk(path(), [&] {
        used = data->GetNumberOfPoints() > 0 && !is_surface(*data);
        if (!used) {
          left_out_ += census_of(*data);
          left_out_.left_out += static_cast<std::uint64_t>(data->GetNumberOfCells());
        }
      }));
      if (used) return data;
    }
  }

 private:
  std::string path_;
  std::unique_ptr<VtkDataSets> blocks_;
  CellCensus left_out_;
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
