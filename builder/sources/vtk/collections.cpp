#include "builder/sources/vtk/collections.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <tuple>
#include <utility>

#include "builder/sources/read_text.h"
#include "builder/sources/vtk/messages.h"
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

double number_in(vtkXMLDataElement& element, const char* name) {
  const char* text = element.GetAttribute(name);
  if (!text || !*text) return 0;
  const auto number = number_of<double>(text);
  if (!number || !std::isfinite(*number))
    throw ReaderError("{}=\"{}\" of a DataSet is not a number", name, std::string_view(text).substr(0, 40));
  return *number;
}

}  // namespace

Result<std::vector<CollectionStep>> pvd_steps(const std::string& path) {
  std::vector<std::tuple<double, double, std::string>> entries;  // time, part, file
  SPLATVOL_TRY(read_elements(path, [&](vtkXMLDataElement& element) {
    if (!is_data_set(element)) return;
    const std::string file = file_of(element, path);
    if (file.empty()) throw ReaderError("a DataSet names no file");
    entries.emplace_back(number_in(element, "timestep"), number_in(element, "part"), file);
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

}  // namespace splatvol
