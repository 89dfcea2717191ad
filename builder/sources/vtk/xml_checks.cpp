#include "builder/sources/vtk/xml_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

#include "base/file.h"
#include "base/memory_limit.h"
#include "base/names.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/file_words.h"
#include "builder/sources/read_text.h"
#include "builder/sources/vtk/compression.h"
#include "builder/sources/vtk/xml_file.h"

namespace splatvol {
namespace {

/// The name of an array for messages; without one, that of the element that it is in.
std::string_view name_of(vtkXMLDataElement& array) {
  if (const char* name = array.GetAttribute("Name")) return name;
  return array.GetParent() ? array.GetParent()->GetName() : "";
}

/// VTK makes no array for a type that it does not know, but fills the array nevertheless.
Status check_types(const std::string& path, vtkXMLDataElement& element) {
  for (int i = 0; i < element.GetNumberOfNestedElements(); ++i)
    SPLATVOL_TRY(check_types(path, *element.GetNestedElement(i)));
  const std::string_view name = element.GetName();
  if (name != "DataArray" && name != "Array") return {};
  const std::string_view type = element.GetAttribute("type") ? element.GetAttribute("type") : "";
  if (is_one_of(type, {"Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Float32", "Float64",
                       "String", "Bit"}))
    return {};
  return fail(ErrorCode::invalid_data, "{}: an array of unknown type \"{}\"", path, type);
}

/// VTK gives arrays of other time steps than the first without their values.
Status check_time_steps(const std::string& path, vtkXMLDataElement& element) {
  for (int i = 0; i < element.GetNumberOfNestedElements(); ++i)
    SPLATVOL_TRY(check_time_steps(path, *element.GetNestedElement(i)));
  const char* step = element.GetAttribute("TimeStep");
  if (!step || trimmed(step) == "0") return {};
  return fail(ErrorCode::unsupported,
              "{}: the array \"{}\" has time steps in one file, which cannot be read: write a file for each step", path,
              name_of(element));
}

/// VTK makes one array for each name, but fills one for each element: if two have the same name, it fills a wrong one.
/// It finds the coordinates of a rectilinear grid by their order.
Status check_names(const std::string& path, vtkXMLDataElement& element) {
  const std::string_view of_element = element.GetName();
  const bool holds_values = of_element == "PointData" || of_element == "CellData";
  std::vector<std::string> names;
  for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement& nested = *element.GetNestedElement(i);
    SPLATVOL_TRY(check_names(path, nested));
    const char* name = nested.GetAttribute("Name");
    if (name) names.emplace_back(name);
    if (holds_values && (!name || *name == '\0'))
      return fail(ErrorCode::invalid_data, "{}: an array of its {} has no name: give it one", path, element.GetName());
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
  if (!(needed > 0)) return {};  // most elements are no pieces
  const auto limit = static_cast<double>(memory_limit());
  if (!(needed > limit)) return {};
  return fail(ErrorCode::out_of_budget,
              "{}: {:.3g} cells and {:.3g} points in one piece take about {:.3g} GB of memory, and there are {:.3g}: "
              "write them as several pieces",
              path, cells, points, needed / 1e9, limit / 1e9);
}

/// The values of `element`'s attribute `name`, if these are `count` integers.
std::optional<std::vector<std::int64_t>> integers_in(vtkXMLDataElement& element, const char* name, std::size_t count) {
  const char* text = element.GetAttribute(name);
  std::vector<std::int64_t> values;
  for (std::string_view rest = text ? text : ""; !rest.empty();) {
    rest.remove_prefix(std::min(rest.find_first_not_of(" \t\r\n"), rest.size()));
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    if (error != std::errc()) break;
    values.push_back(value);
    rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
    rest.remove_prefix(std::min(rest.find_first_not_of(" \t\r\n"), rest.size()));
    if (values.size() == count && rest.empty()) return values;
  }
  return std::nullopt;
}

/// The components of an array; none if their number is wrong.
std::optional<std::uint64_t> components_of(vtkXMLDataElement& array) {
  if (!array.GetAttribute("NumberOfComponents")) return 1;
  const auto stated = integers_in(array, "NumberOfComponents", 1);
  if (!stated || stated->front() < 0 || stated->front() > static_cast<std::int64_t>(AttributeCount::most))
    return std::nullopt;
  return static_cast<std::uint64_t>(stated->front());
}

/// What a piece has so far.
struct ArrayCount {
  AttributeCount attributes;
  std::size_t arrays = 0;
};

/// VTK takes memory for the names of all components of an array, also if the piece has no points, and time by the
/// square of the number of arrays.
Status check_components(const std::string& path, vtkXMLDataElement& element, ArrayCount& count) {
  const std::string_view of_element = element.GetName();
  const bool holds_values = of_element == "PointData" || of_element == "CellData";
  for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement& nested = *element.GetNestedElement(i);
    const std::string_view name = nested.GetName();
    if (name != "DataArray") {
      ArrayCount of_piece;
      SPLATVOL_TRY(check_components(path, nested, name == "Piece" ? of_piece : count));
      continue;
    }
    const auto components = components_of(nested);
    if (!components)
      return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has a number of components that is not 1 to {}", path,
                  name_of(nested), AttributeCount::most);
    if (!holds_values) continue;
    if (!count.attributes.add(*components)) return fail_too_many_attributes(path);
    if (++count.arrays > most_vtk_arrays)
      return fail(ErrorCode::unsupported, "{}: more than {} arrays in a piece", path, most_vtk_arrays);
  }
  return {};
}

/// First and last point along each axis.
using Extent = std::array<std::int64_t, 6>;

/// An extent of numbers that VTK can hold; none if it is missing or wrong.
std::optional<Extent> extent_in(vtkXMLDataElement& element, const char* name) {
  constexpr std::int64_t most = std::numeric_limits<std::int32_t>::max();
  const auto numbers = integers_in(element, name, 6);
  if (!numbers) return std::nullopt;
  Extent extent{};
  std::ranges::copy(*numbers, extent.begin());
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (extent[2 * axis] < -most || extent[2 * axis + 1] > most || extent[2 * axis + 1] < extent[2 * axis])
      return std::nullopt;
  return extent;
}

/// Whether a piece is stated to have no points.
bool is_empty_piece(vtkXMLDataElement& piece) {
  if (piece.GetAttribute("NumberOfPoints"))
    return integers_in(piece, "NumberOfPoints", 1) == std::vector{std::int64_t{0}};
  const auto extent = integers_in(piece, "Extent", 6);
  for (std::size_t axis = 0; extent && axis < 3; ++axis)
    if ((*extent)[2 * axis + 1] < (*extent)[2 * axis]) return true;
  return false;
}

std::array<double, 3> sides_of(const Extent& extent) {
  std::array<double, 3> sides{};
  for (std::size_t axis = 0; axis < 3; ++axis)
    sides[axis] = static_cast<double>(extent[2 * axis + 1] - extent[2 * axis] + 1);
  return sides;
}

/// Points along each axis of an extent; none if the extent is missing or wrong.
std::optional<std::array<double, 3>> sides_in(vtkXMLDataElement& element, const char* name) {
  const auto extent = extent_in(element, name);
  return extent ? std::optional(sides_of(*extent)) : std::nullopt;
}

double cells_of(const std::array<double, 3>& sides) {
  double cells = 1;
  for (const double side : sides) cells *= std::max(side - 1, 1.0);
  return cells;
}

/// How many values the arrays of a piece must have.
struct PieceSizes {
  double points = 0;
  double cells = 0;
  std::array<double, 3> sides{};             // of a structured piece
  std::map<std::string_view, double> lists;  // cells in each list of them
};

/// The sizes of a piece of an unstructured grid or of a surface.
std::optional<PieceSizes> sizes_by_counts(vtkXMLDataElement& piece) {
  PieceSizes sizes;
  constexpr std::array<std::pair<const char*, std::string_view>, 6> attributes = {{{"NumberOfPoints", "Points"},
                                                                                   {"NumberOfCells", "Cells"},
                                                                                   {"NumberOfVerts", "Verts"},
                                                                                   {"NumberOfLines", "Lines"},
                                                                                   {"NumberOfStrips", "Strips"},
                                                                                   {"NumberOfPolys", "Polys"}}};
  for (const auto& [attribute, list] : attributes) {
    const auto count = integers_in(piece, attribute, 1);
    if (piece.GetAttribute(attribute) && (!count || count->front() < 0)) return std::nullopt;
    sizes.lists[list] = count ? static_cast<double>(count->front()) : 0;
    if (list != "Points") sizes.cells += sizes.lists[list];
  }
  sizes.points = sizes.lists["Points"];
  return sizes;
}

/// The cells of a piece of a structured grid along each axis: the first, and the one behind the last. A grid that is
/// flat along an axis has one layer of cells there.
Extent cells_in(const Extent& piece, const Extent& whole) {
  Extent cells = piece;
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (whole[2 * axis] == whole[2 * axis + 1]) cells[2 * axis + 1] = piece[2 * axis] + 1;
  return cells;
}

double count_of(const Extent& cells) {
  double count = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) count *= static_cast<double>(cells[2 * axis + 1] - cells[2 * axis]);
  return count;
}

bool overlap(const Extent& a, const Extent& b) {
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (a[2 * axis + 1] <= b[2 * axis] || b[2 * axis + 1] <= a[2 * axis]) return false;
  return true;
}

/// Whether some of these pieces have a cell in common. Sorts them.
bool any_overlap(std::vector<Extent>& pieces) {
  std::erase_if(pieces, [](const Extent& piece) { return count_of(piece) == 0; });
  std::ranges::sort(pieces);
  for (std::size_t i = 0; i < pieces.size(); ++i)
    for (std::size_t j = i + 1; j < pieces.size() && pieces[j][0] < pieces[i][1]; ++j)
      if (overlap(pieces[i], pieces[j])) return true;
  return false;
}

Result<std::vector<Extent>> extents_of_pieces(const std::string& path, vtkXMLDataElement& grid, const Extent& whole) {
  std::vector<Extent> extents;
  for (int i = 0; i < grid.GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement& piece = *grid.GetNestedElement(i);
    if (piece.GetName() != std::string_view("Piece")) continue;
    if (is_empty_piece(piece)) continue;
    const bool stated = piece.GetAttribute("Extent") != nullptr;
    const auto extent = stated ? extent_in(piece, "Extent") : whole;
    if (!extent) return fail(ErrorCode::invalid_data, "{}: the Extent of a piece is damaged", path);
    extents.push_back(*extent);
  }
  return extents;
}

/// Checks that the pieces of a structured grid fill its extent: VTK fills the rest with zeros, or not at all.
Status check_pieces(const std::string& path, vtkXMLDataElement& grid, const Extent& whole) {
  constexpr std::size_t most_pieces = 65536;
  constexpr double most_cells = 1e15;  // are counted exactly
  SPLATVOL_TRY_ASSIGN(pieces, extents_of_pieces(path, grid, whole));
  const double expected = count_of(cells_in(whole, whole));
  if (pieces.size() > most_pieces || expected > most_cells)
    return fail(ErrorCode::unsupported, "{}: {} pieces and {} cells are too many", path, pieces.size(), expected);
  double count = 0;
  bool inside = true;
  for (Extent& piece : pieces) {
    for (std::size_t axis = 0; axis < 3; ++axis)
      inside = inside && piece[2 * axis] >= whole[2 * axis] && piece[2 * axis + 1] <= whole[2 * axis + 1];
    piece = cells_in(piece, whole);
    count += count_of(piece);
  }
  if (count != expected)
    return fail(ErrorCode::invalid_data,
                "{}: its pieces have {} cells, and its WholeExtent {}: damaged, or a part of a larger grid; write the "
                "extent of the part as its WholeExtent",
                path, count, expected);
  // As many cells as the grid has, none outside and none twice: they fill it.
  if (!inside || any_overlap(pieces))
    return fail(ErrorCode::invalid_data, "{}: its pieces overlap, or reach out of its WholeExtent", path);
  return {};
}

/// Whether an attribute of an element is missing, or holds `count` finite numbers.
bool has_finite_numbers(vtkXMLDataElement& element, const char* name, std::size_t count) {
  if (!element.GetAttribute(name)) return true;
  std::istringstream words{std::string(element.GetAttribute(name))};
  std::size_t found = 0;
  for (std::string word; words >> word; ++found) {
    char* end = nullptr;
    if (!std::isfinite(std::strtod(word.c_str(), &end)) || *end != '\0') return false;
  }
  return found == count;
}

/// VTK takes what it likes for numbers that it cannot read.
Status check_geometry(const std::string& path, vtkXMLDataElement& grid) {
  for (const auto& [name, count] : {std::pair("Origin", 3), std::pair("Spacing", 3), std::pair("Direction", 9)})
    if (!has_finite_numbers(grid, name, static_cast<std::size_t>(count)))
      return fail(ErrorCode::invalid_data, "{}: the {} of its {} is not {} finite numbers", path, name, grid.GetName(),
                  count);
  return {};
}

/// The arrays of a piece, but those of lists of cells: where they are, their names, types and components.
std::vector<std::string> arrays_of_piece(vtkXMLDataElement& piece) {
  std::vector<std::string> arrays;
  for (int i = 0; i < piece.GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement& holder = *piece.GetNestedElement(i);
    if (!is_one_of(holder.GetName(), {"PointData", "CellData", "Points", "Coordinates"})) continue;
    for (int k = 0; k < holder.GetNumberOfNestedElements(); ++k) {
      vtkXMLDataElement& array = *holder.GetNestedElement(k);
      const char* type = array.GetAttribute("type");
      arrays.push_back(fmt::format("{} {} {} {}", holder.GetName(), name_of(array), type ? type : "",
                                   components_of(array).value_or(0)));
    }
  }
  return arrays;
}

/// Checks that all pieces of a grid have the same arrays. VTK makes those of the first piece, and fills them by their
/// order. Pieces of unstructured grids are read one by one (builder/sources/vtk/unstructured_reader.cpp).
Status check_alike(const std::string& path, vtkXMLDataElement& root) {
  for (const char* name : {"ImageData", "RectilinearGrid", "StructuredGrid", "PolyData"}) {
    vtkXMLDataElement* grid = root.FindNestedElementWithName(name);
    std::optional<std::vector<std::string>> first;
    for (int i = 0; grid && i < grid->GetNumberOfNestedElements(); ++i) {
      vtkXMLDataElement& piece = *grid->GetNestedElement(i);
      if (piece.GetName() != std::string_view("Piece")) continue;
      std::vector<std::string> arrays = arrays_of_piece(piece);
      if (first && arrays != *first)
        return fail(ErrorCode::unsupported,
                    "{}: a piece has other arrays than the first, or in another order: write each piece to a file of "
                    "its own",
                    path);
      if (!first) first = std::move(arrays);
    }
  }
  return {};
}

Status check_extents(const std::string& path, vtkXMLDataElement& root) {
  for (const char* name : {"ImageData", "RectilinearGrid", "StructuredGrid"}) {
    vtkXMLDataElement* grid = root.FindNestedElementWithName(name);
    if (!grid) continue;
    const auto whole = extent_in(*grid, "WholeExtent");
    if (!whole) return fail(ErrorCode::invalid_data, "{}: the WholeExtent of its {} is damaged", path, name);
    SPLATVOL_TRY(check_geometry(path, *grid));
    SPLATVOL_TRY(check_pieces(path, *grid, *whole));
  }
  return {};
}

/// Checks the header, the end and the size of every array of an XML file.
class Arrays {
 public:
  Arrays(const std::string& path, ByteSource& file, std::unique_ptr<ByteSource> text, vtkXMLDataElement& root,
         std::uint64_t appended_offset)
      : path_(path), file_(file), words_(std::move(text)), appended_offset_(appended_offset) {
    const auto is = [&](vtkXMLDataElement* element, const char* name, std::string_view value) {
      const char* attribute = element ? element->GetAttribute(name) : nullptr;
      return attribute && attribute == value;
    };
    layout_ = {is(&root, "header_type", "UInt64"), is(&root, "byte_order", "BigEndian")};
    compressed_ = root.GetAttribute("compressor") != nullptr;
    appended_base64_ = !is(root.FindNestedElementWithName("AppendedData"), "encoding", "raw");
  }

  /// Checks all arrays in `element`. `whole`: the sides of the structured grid that it is in.
  [[nodiscard]] Status check(vtkXMLDataElement& element, const std::array<double, 3>& whole = {}) {
    const std::string_view name = element.GetName();
    if (name == "Piece") SPLATVOL_TRY(begin_piece(element, whole));
    const auto inner = sides_in(element, "WholeExtent").value_or(whole);
    std::size_t axis = 0;
    for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) {
      vtkXMLDataElement& nested = *element.GetNestedElement(i);
      if (nested.GetName() != std::string_view("DataArray")) {
        SPLATVOL_TRY(check(nested, inner));
        continue;
      }
      SPLATVOL_TRY_ASSIGN(values, check_array(nested));
      const auto tuples =
          name == "Coordinates" && axis < 3 ? std::optional(sizes_.sides[axis++]) : tuples_in(name, nested);
      if (values && tuples) SPLATVOL_TRY(check_count(nested, *values, *tuples));
    }
    if (name == "Piece") in_piece_ = false;
    return {};
  }

 private:
  Status begin_piece(vtkXMLDataElement& piece, const std::array<double, 3>& whole) {
    in_piece_ = true;
    const auto counts = sizes_by_counts(piece);
    if (!counts)
      return fail(ErrorCode::invalid_data, "{}: a piece has a number of points or cells that is wrong", path_);
    sizes_ = *counts;
    if (whole[0] == 0) return {};
    sizes_.sides = sides_in(piece, "Extent").value_or(whole);
    sizes_.points = sizes_.sides[0] * sizes_.sides[1] * sizes_.sides[2];
    sizes_.cells = cells_of(sizes_.sides);
    return {};
  }

  /// Tuples that an array in an element must have, if that is known.
  [[nodiscard]] std::optional<double> tuples_in(std::string_view parent, vtkXMLDataElement& array) const {
    if (!in_piece_) return std::nullopt;
    if (parent == "PointData" || parent == "Points") return sizes_.points;
    if (parent == "CellData") return sizes_.cells;
    const auto list = sizes_.lists.find(parent);
    const std::string_view name = array.GetAttribute("Name") ? array.GetAttribute("Name") : "";
    if (list == sizes_.lists.end() || (name != "offsets" && name != "types")) return std::nullopt;
    return list->second;
  }

  [[nodiscard]] Status check_count(vtkXMLDataElement& array, double values, double tuples) const {
    const auto components = integers_in(array, "NumberOfComponents", 1);
    const double expected = tuples * static_cast<double>(components ? components->front() : 1);
    if (values == expected) return {};
    return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} numbers instead of {}: damaged", path_,
                name_of(array), values, expected);
  }

  /// Returns how many numbers an array has, if that is known.
  Result<std::optional<double>> check_array(vtkXMLDataElement& element) {
    const std::string_view format = element.GetAttribute("format") ? element.GetAttribute("format") : "";
    const double bytes = value_bytes(element.GetAttribute("type"));
    if (format != "appended" && format != "binary") return bytes > 0 ? count_words(element) : std::nullopt;
    SPLATVOL_TRY_ASSIGN(offset, format == "appended" ? appended_offset_of(element) : inline_offset(element));
    const bool base64 = format == "binary" || appended_base64_;
    SPLATVOL_TRY_ASSIGN(stated, compressed_ ? check_compression_header(file_, layout_, offset, base64)
                                            : check_uncompressed_array(file_, layout_, offset, base64));
    return bytes > 0 ? std::optional(stated / bytes) : std::nullopt;
  }

  /// Whether VTK reads a number of a text. It knows two words, unless a tag follows at once, and no number beyond the
  /// array's type.
  static bool vtk_reads(std::string_view number, bool tag_follows, vtkXMLDataElement& array) {
    if (number.find_first_of("en") == std::string_view::npos) return true;
    const std::string text(number);
    const std::string_view word = number.substr(number.find_first_not_of("+-"));
    if (word == "nan" || word == "inf") return !tag_follows;
    const bool single = array.GetAttribute("type") == std::string_view("Float32");
    return std::isfinite(single ? std::strtof(text.c_str(), nullptr) : std::strtod(text.c_str(), nullptr));
  }

  /// Bytes of a number of a type; 0 for texts and bits.
  static double value_bytes(std::string_view type) {
    if (type.ends_with("64")) return 8;
    if (type.ends_with("32")) return 4;
    if (type.ends_with("16")) return 2;
    return type.ends_with("8") ? 1 : 0;
  }

  Result<std::uint64_t> appended_offset_of(vtkXMLDataElement& element) const {
    vtkTypeInt64 offset = 0;
    if (!element.GetScalarAttribute("offset", offset) || offset < 0)
      return fail(ErrorCode::invalid_data, "{}: an appended array has no offset: damaged", path_);
    return appended_offset_ + static_cast<std::uint64_t>(offset);
  }

  /// Where the text after an element's start tag and white space begins. VTK too takes the first '>' for the tag's end.
  Result<std::uint64_t> inline_offset(vtkXMLDataElement& element) {
    constexpr std::uint64_t read_bytes = 4096;
    bool in_tag = true;
    for (auto at = static_cast<std::uint64_t>(element.GetXMLByteIndex()); at < file_.size();) {
      SPLATVOL_TRY_ASSIGN(text, read_text(file_, at, read_bytes));
      for (const char c : text) {
        if (!in_tag && !is_white_space(c)) return at;
        in_tag = in_tag && c != '>';
        ++at;
      }
    }
    return fail(ErrorCode::invalid_data, "{}: the file is cut off: it ends within an array", path_);
  }

  /// Counts the numbers of an array of text. Nothing is known if it holds elements of its own.
  Result<std::optional<double>> count_words(vtkXMLDataElement& element) {
    SPLATVOL_TRY_ASSIGN(offset, inline_offset(element));
    words_.move_to(offset);
    for (double count = 0;; ++count) {
      const std::string word = words_.next();
      const std::size_t tag = word.find('<');
      const std::string_view number = std::string_view(word).substr(0, tag);
      const bool valid = is_number(number);
      if (valid && !vtk_reads(number, tag != std::string::npos, element))
        return fail(
            ErrorCode::unsupported,
            "{}: VTK's reader does not take \"{}\" in the array \"{}\": write it binary, or with a space behind", path_,
            number.substr(0, 10), name_of(element));
      if (!number.empty() && !valid)
        return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has a word instead of a number: damaged", path_,
                    name_of(element));
      if (word.empty() || tag == 0) return std::optional(count);
      if (tag != std::string::npos) return std::optional(count + 1);
    }
  }

  const std::string& path_;
  ByteSource& file_;
  FileWords words_;
  std::uint64_t appended_offset_;
  CompressionLayout layout_;
  bool compressed_;
  bool appended_base64_;
  bool in_piece_ = false;
  PieceSizes sizes_;  // of the current piece
};

}  // namespace

Status check_parallel_pieces(const std::string& path, vtkXMLDataElement& grid) {
  const char* ghosts = grid.GetAttribute("GhostLevel");
  if (grid.GetName() == std::string_view("PUnstructuredGrid") || (ghosts && std::string_view(ghosts) != "0")) return {};
  const auto whole = extent_in(grid, "WholeExtent");
  if (!whole) return fail(ErrorCode::invalid_data, "{}: the WholeExtent of its {} is damaged", path, grid.GetName());
  return check_pieces(path, grid, *whole);
}

Result<bool> is_empty_xml(const std::string& path) {
  constexpr std::uint64_t largest = 1 << 20;  // all else has points
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  if (file->size() > largest) return false;
  SPLATVOL_TRY_ASSIGN(parser, parse_xml(path));
  vtkXMLDataElement& root = *parser->GetRootElement();
  std::size_t pieces = 0, empty = 0;
  for (int g = 0; g < root.GetNumberOfNestedElements(); ++g)
    for (int p = 0; p < root.GetNestedElement(g)->GetNumberOfNestedElements(); ++p) {
      vtkXMLDataElement& piece = *root.GetNestedElement(g)->GetNestedElement(p);
      if (piece.GetName() != std::string_view("Piece")) continue;
      ++pieces;
      empty += is_empty_piece(piece) ? 1 : 0;
    }
  return pieces > 0 && pieces == empty;
}

Result<std::vector<XmlPiece>> check_xml(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(parser, parse_xml(path));
  vtkXMLDataElement* root = parser->GetRootElement();
  SPLATVOL_TRY(check_types(path, *root));
  SPLATVOL_TRY(check_time_steps(path, *root));
  SPLATVOL_TRY(check_names(path, *root));
  ArrayCount count;
  SPLATVOL_TRY(check_components(path, *root, count));
  SPLATVOL_TRY(check_memory(path, *root));
  SPLATVOL_TRY(check_extents(path, *root));
  SPLATVOL_TRY(check_alike(path, *root));
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  SPLATVOL_TRY_ASSIGN(text, open_file(path));
  SPLATVOL_TRY(
      Arrays(path, *file, std::move(text), *root, static_cast<std::uint64_t>(parser->GetAppendedDataPosition()))
          .check(*root));
  return pieces_of(*root);
}

}  // namespace splatvol
