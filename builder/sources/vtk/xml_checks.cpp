#include "builder/sources/vtk/xml_checks.h"

#include <vtkSmartPointer.h>
#include <vtkXMLDataElement.h>
#include <vtkXMLDataParser.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "base/file.h"
#include "base/memory_limit.h"
#include "base/names.h"
#include "builder/sources/read_text.h"
#include "builder/sources/vtk/compression.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

/// VTK makes no array for a type that it does not know, but fills the array nevertheless.
Status check_types(const std::string& path, vtkXMLDataElement& element) {
  constexpr std::array<std::string_view, 12> known = {"Int8",  "UInt8",  "Int16",   "UInt16",  "Int32",  "UInt32",
                                                      "Int64", "UInt64", "Float32", "Float64", "String", "Bit"};
  for (int i = 0; i < element.GetNumberOfNestedElements(); ++i)
    SPLATVOL_TRY(check_types(path, *element.GetNestedElement(i)));
  const std::string_view name = element.GetName();
  if (name != "DataArray" && name != "Array") return {};
  const std::string_view type = element.GetAttribute("type") ? element.GetAttribute("type") : "";
  if (std::ranges::find(known, type) != known.end()) return {};
  return fail(ErrorCode::invalid_data, "{}: an array of unknown type \"{}\"", path, type);
}

/// VTK makes one array for each name, but fills one for each element: if two have the same name, it fills a wrong one.
/// It finds the coordinates of a rectilinear grid by their order.
Status check_names(const std::string& path, vtkXMLDataElement& element) {
  std::vector<std::string> names;
  for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement& nested = *element.GetNestedElement(i);
    SPLATVOL_TRY(check_names(path, nested));
    if (const char* name = nested.GetAttribute("Name")) names.emplace_back(name);
  }
  if (element.GetName() == std::string_view("Coordinates")) return {};
  if (const auto duplicate = find_duplicate(std::move(names)))
    return fail(ErrorCode::invalid_data, "{}: two arrays of its {} are called \"{}\"", path, element.GetName(),
                *duplicate);
  return {};
}

/// A piece is read whole. It was measured to take about 400 bytes for each tetrahedron, and some for each point.
Status check_memory(const std::string& path, vtkXMLDataElement& element) {
  constexpr double cell_bytes = 400, point_bytes = 300;
  for (int i = 0; i < element.GetNumberOfNestedElements(); ++i)
    SPLATVOL_TRY(check_memory(path, *element.GetNestedElement(i)));
  double cells = 0, points = 0;
  element.GetScalarAttribute("NumberOfCells", cells);
  element.GetScalarAttribute("NumberOfPoints", points);
  const double needed = cells * cell_bytes + points * point_bytes;
  const auto limit = static_cast<double>(memory_limit());
  if (!(needed > limit)) return {};
  return fail(ErrorCode::out_of_budget,
              "{}: {:.3g} cells and {:.3g} points in one piece take about {:.3g} GB of memory, and there are {:.3g}: "
              "write them as several pieces",
              path, cells, points, needed / 1e9, limit / 1e9);
}

/// Checks the header and the end of every binary array of an XML file.
class BinaryArrays {
 public:
  BinaryArrays(ByteSource& file, vtkXMLDataElement& root, std::uint64_t appended_offset)
      : file_(file), appended_offset_(appended_offset) {
    const auto is = [&](vtkXMLDataElement* element, const char* name, std::string_view value) {
      const char* text = element ? element->GetAttribute(name) : nullptr;
      return text && text == value;
    };
    layout_ = {is(&root, "header_type", "UInt64"), is(&root, "byte_order", "BigEndian")};
    compressed_ = root.GetAttribute("compressor") != nullptr;
    appended_base64_ = !is(root.FindNestedElementWithName("AppendedData"), "encoding", "raw");
  }

  [[nodiscard]] Status check(vtkXMLDataElement& element) {
    for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) SPLATVOL_TRY(check(*element.GetNestedElement(i)));
    const std::string_view format = element.GetAttribute("format") ? element.GetAttribute("format") : "";
    if (format == "appended") return check_appended(element);
    return format == "binary" ? check_inline(element) : Status{};
  }

 private:
  Status check_appended(vtkXMLDataElement& element) {
    vtkTypeInt64 offset = 0;
    if (!element.GetScalarAttribute("offset", offset) || offset < 0) return {};
    const std::uint64_t at = appended_offset_ + static_cast<std::uint64_t>(offset);
    return check_array(at, appended_base64_);
  }

  /// Checks a header that follows the element's start tag and white space.
  Status check_inline(vtkXMLDataElement& element) {
    constexpr std::uint64_t longest_tag = 4096;
    const auto tag = static_cast<std::uint64_t>(element.GetXMLByteIndex());
    SPLATVOL_TRY_ASSIGN(text, read_text(file_, tag, longest_tag));
    const std::size_t end = text.find('>');
    if (end == std::string::npos) return {};
    const std::size_t start = text.find_first_not_of(" \t\r\n", end + 1);
    if (start == std::string::npos) return {};
    return check_array(tag + start, true);
  }

  Status check_array(std::uint64_t offset, bool base64) {
    return compressed_ ? check_compression_header(file_, layout_, offset, base64)
                       : check_uncompressed_array(file_, layout_, offset, base64);
  }

  ByteSource& file_;
  std::uint64_t appended_offset_;
  CompressionLayout layout_;
  bool compressed_;
  bool appended_base64_;
};

}  // namespace

Status check_xml(const std::string& path) {
  const auto parser = vtkSmartPointer<vtkXMLDataParser>::New();
  SPLATVOL_TRY(run_vtk(path, [&] {
    parser->SetFileName(path.c_str());
    parser->Parse();
  }));
  vtkXMLDataElement* root = parser->GetRootElement();
  if (!root) return fail(ErrorCode::invalid_data, "{}: not XML", path);
  SPLATVOL_TRY(check_types(path, *root));
  SPLATVOL_TRY(check_names(path, *root));
  SPLATVOL_TRY(check_memory(path, *root));
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  return BinaryArrays(*file, *root, static_cast<std::uint64_t>(parser->GetAppendedDataPosition())).check(*root);
}

}  // namespace splatvol
