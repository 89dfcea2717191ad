#include "builder/sources/vtk/collections.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <utility>

#include "base/file.h"
#include "base/input_formats.h"
#include "base/json.h"
#include "builder/sources/block_numbers.h"
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

/// Finds the blocks of a tree of data sets. A block is known by its place: by the names in its path, and where there
/// are none, by the numbers.
class BlockTree {
 public:
  explicit BlockTree(const std::string& path) : path_(path) {}

  /// All files of data sets. An empty data set has none.
  std::vector<BlockFile> files(vtkXMLDataElement& root) {
    walk(root, 0, 0);
    return std::move(files_);
  }

 private:
  /// `place`: the element's number; `block`: whose pieces all data sets in it are; 0: each is a block of its own.
  void walk(vtkXMLDataElement& element, std::uint64_t place, std::uint64_t block) {
    for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) {
      vtkXMLDataElement& inner = *element.GetNestedElement(i);
      const std::uint64_t inner_place = numbers_.next(key_of(inner, i), place);
      const bool is_block = is_data_set(inner) || has_pieces(inner);
      const std::uint64_t inner_block = is_block && block == 0 ? inner_place : block;
      const std::string file = is_data_set(inner) ? file_of(inner, path_) : std::string();
      if (!file.empty()) files_.push_back({file, inner_block});
      walk(inner, inner_place, inner_block);
    }
  }

  static bool has_pieces(vtkXMLDataElement& element) {
    return is_one_of(element.GetName(), {"Piece", "Partitions", "vtkPartitionedDataSet"});
  }

  /// Returns the name of an element among those beside it. `number`: its own there.
  static std::string key_of(vtkXMLDataElement& element, int number) {
    for (const char* attribute : {"name", "index"})
      if (const char* text = element.GetAttribute(attribute); text && *text) return text;
    return std::to_string(number);
  }

  const std::string& path_;
  BlockNumbers numbers_;
  std::vector<BlockFile> files_;
};

/// A file that a series names.
struct SeriesEntry {
  double time = 0, part = 0;
  std::string file;
};

Result<std::vector<SeriesEntry>> pvd_entries(const std::string& path) {
  std::vector<SeriesEntry> entries;
  SPLATVOL_TRY(read_elements(path, [&](vtkXMLDataElement& element) {
    if (!is_data_set(element)) return;
    const std::string file = file_of(element, path);
    if (file.empty()) throw ReaderError("a DataSet names no file");
    entries.push_back({number_in(element, "timestep"), number_in(element, "part"), file});
  }));
  return entries;
}

/// Those of a series of files: {"files": [{"name": "a.vtu", "time": 0}, ...]}. Other members tell of the writer.
Result<std::vector<SeriesEntry>> json_entries(const std::string& path) {
  constexpr int most_levels = 8;
  SPLATVOL_TRY_ASSIGN(text, read_text_file(path));
  const auto document = parse_shallow_json(text, most_levels);
  if (!document) return fail_in(path, document.error());
  const JsonField root(**document), files = root.member("files");
  const auto entries = files.each([&](const JsonField& file) -> Result<SeriesEntry> {
    SPLATVOL_TRY_ASSIGN(name, file.member("name").text());
    SPLATVOL_TRY_ASSIGN(time, file.member("time").number());
    return SeriesEntry{time, 0, (std::filesystem::path(path).parent_path() / name).string()};
  });
  if (!entries) return fail_in(path, entries.error());
  return *entries;
}

}  // namespace

Result<std::vector<CollectionStep>> collection_steps(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(entries, is_file_series(path) ? json_entries(path) : pvd_entries(path));
  if (entries.empty()) return fail(ErrorCode::invalid_data, "{}: names no files", path);
  std::ranges::stable_sort(entries, {}, [](const SeriesEntry& entry) { return std::pair(entry.time, entry.part); });
  std::vector<CollectionStep> steps;
  for (SeriesEntry& entry : entries) {
    if (steps.empty() || steps.back().time != entry.time)
      steps.push_back({entry.time, {}});
    else if (is_file_series(path))
      return fail(ErrorCode::invalid_data, "{}: names {} and {}, both for the time {}", path, steps.back().files.back(),
                  entry.file, entry.time);
    steps.back().files.push_back(std::move(entry.file));
  }
  return steps;
}

Result<std::vector<BlockFile>> block_files(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(parser, parse_xml(path));
  std::vector<BlockFile> files;
  SPLATVOL_TRY(run_vtk(path, [&] { files = BlockTree(path).files(*parser->GetRootElement()); }));
  if (files.empty()) return fail(ErrorCode::invalid_data, "{}: names no files", path);
  return files;
}

}  // namespace splatvol
